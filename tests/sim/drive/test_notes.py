"""Notes in a sidecar: what is written is read again, by us and as foxglove events; damage is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from foxglove_schemas_protobuf.Event_pb2 import Event as FoxgloveEvent
from mcap.reader import make_reader

from das.domain.errors import DasError
from sim.drive.notes import Note, add_note, read_notes
from sim.recording.opening import notes_path
from tests.support.recordings import at_ns


def a_note(t_s: float, text: str = "braked late") -> Note:
    return Note(at_ns(t_s), text)


def test_notes_are_read_as_they_were_written_in_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    later, sooner = a_note(60.0), a_note(5.0, "left late")
    add_note(path, later)
    assert add_note(path, sooner) == tmp_path / "drive.notes"
    assert list(tmp_path.glob("*.mcap")) == []
    assert read_notes(path) == (sooner, later)


def test_other_programs_find_foxglove_events(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    add_note(path, a_note(60.0))
    with notes_path(path).open("rb") as file:
        ((schema, channel, message),) = make_reader(file, validate_crcs=True).iter_messages()
    assert schema is not None
    assert (schema.name, channel.topic, message.log_time) == ("foxglove.Event", "notes", at_ns(60.0))
    event = FoxgloveEvent.FromString(message.data)
    assert event.start_time.ToNanoseconds() == at_ns(60.0)
    assert {pair.key: pair.value for pair in event.metadata} == {"text": "braked late"}


def test_bad_notes_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    for text in (" ", "x" * 2001):
        with pytest.raises(DasError, match="expected 1 to 2000"):
            add_note(path, a_note(0.0, text))
    add_note(path, a_note(1.0))
    file = notes_path(path)
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(DasError, match="damaged notes"):
        read_notes(path)
