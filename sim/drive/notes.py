"""Notes that people make on a recording, kept in an MCAP file next to it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final, NamedTuple

from foxglove_schemas_protobuf.Event_pb2 import Event as FoxgloveEvent
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from sim.recording.opening import notes_path

TOPIC: Final = "notes"
LONGEST_NOTE: Final = 2000
"""The greatest number of characters in a note."""


class Note(NamedTuple):
    """A note: the time to which it refers (ns since 1970), and its text."""

    time_ns: int
    text: str


def read_notes(recording: Path) -> tuple[Note, ...]:
    """The notes of a recording in order of time; empty if there are none. DasError for a file that is damaged."""
    path = notes_path(recording)
    if not path.exists():
        return ()
    try:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            found = [_note(FoxgloveEvent.FromString(message.data)) for _, _, message in reader.iter_messages([TOPIC])]
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    except Exception as error:  # Damaged bytes surface as errors of the decompressor, of struct, of protobuf, …
        raise DasError(f"{path}: damaged notes: {' '.join(str(error).split()) or type(error).__name__}") from error
    return tuple(sorted(found))


def add_note(recording: Path, note: Note) -> Path:
    """Add a note to a recording's notes; rewrite the file of the notes as a whole and return its path.

    Raises DasError if the text is empty or too long, or the file cannot be read or written.
    """
    if not note.text.strip() or len(note.text) > LONGEST_NOTE:
        raise DasError(f"note of {len(note.text)} characters: expected 1 to {LONGEST_NOTE}")
    path = notes_path(recording)
    write_whole(path, _as_mcap(recording, sorted([*read_notes(recording), note])))
    return path


def _as_mcap(recording: Path, notes: list[Note]) -> bytes:
    content = io.BytesIO()
    writer = Writer(content)
    writer.start(library="das-sim")
    writer.add_metadata("notes", {"recording": recording.name})
    channel = writer.register_channel(TOPIC, "protobuf", register_schema(writer, FoxgloveEvent))
    for note in notes:
        event: Any = FoxgloveEvent()
        event.start_time.FromNanoseconds(note.time_ns)
        event.end_time.FromNanoseconds(note.time_ns)
        event.metadata.add(key="text", value=note.text)
        writer.add_message(channel, note.time_ns, event.SerializeToString(), note.time_ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return content.getvalue()


def _note(event: Any) -> Note:
    said = {pair.key: pair.value for pair in event.metadata}
    # Other programs may use another key for the text; then all their keys and values are shown.
    text = said.get("text") or "; ".join(f"{key}: {value}" for key, value in said.items()) or "(no text)"
    return Note(event.start_time.ToNanoseconds(), text)
