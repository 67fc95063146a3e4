"""An event of a recorded drive, the kinds of events, how a list is filtered, and which events are bookmarks."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from foxglove_schemas_protobuf.Event_pb2 import Event as FoxgloveEvent
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.units import NS
from sim.recording.course import DrivenCourse, own_timetable


class EventKind(StrEnum):
    """What an event is about; `das-sim events --kind` takes these words."""

    DEPARTURE = "departure"
    ARRIVAL = "arrival"
    MISSED_STOP = "missed-stop"
    STAND = "stand"
    """The train came to a stand where it has no stop."""
    SIGNAL = "signal"
    RESTRICTION = "restriction"
    TARGET = "target"
    JOURNEY = "journey"
    DELAY = "delay"
    ADVICE = "advice"
    """The advised mode changed."""
    REPLAN = "replan"
    """The node made a new plan that differs from the one before."""
    WITHDRAWAL = "withdrawal"
    OVERSPEED = "overspeed"
    """The train was above the limit of the line, or above a temporary restriction."""
    BEYOND_TRAIN = "beyond-train"
    """The train was faster than its vehicle file says that it can go: it may be another train."""
    DRIVER = "driver"
    """How the driver answered a change of the advice."""
    LAPSE = "lapse"
    """A message stream paused: no positions, or no advice, came for a while."""
    DEVIATION = "deviation"
    """For the first time the train was, or was expected to arrive, far off its timetable."""
    LOG = "log"
    WARNING = "warning"
    NOTE = "note"
    """A bookmark that somebody made."""


@dataclass(frozen=True, kw_only=True)
class DriveEvent:
    """Something that happened: when (ns since 1970), where (m, NaN where unknown), what, and figures that go with it.

    `end_ns` is when it was over, 0 if it has no duration. The names in `facts` carry their units.
    `mark` says why the program made the event a bookmark; it is empty for all others.
    """

    time_ns: int
    kind: EventKind
    text: str
    s_m: float
    end_ns: int = 0
    facts: Mapping[str, Any] = field(default_factory=dict)
    mark: str = ""

    @classmethod
    def on(cls, trip: DrivenCourse, kind: EventKind, time_ns: int, text: str, *, end_ns: int = 0, **facts: Any) -> Self:
        """An event where the train was on its course at that moment; the figures that go with it are given by name."""
        return cls(time_ns=time_ns, end_ns=end_ns, kind=kind, text=text, s_m=place_m(trip, time_ns), facts=facts)

    @property
    def last_ns(self) -> int:
        """When the event was over (ns since 1970)."""
        return max(self.time_ns, self.end_ns)


def place_m(trip: DrivenCourse, time_ns: int) -> float:
    """Where the train's head was at a moment (m)."""
    return float(trip.at(np.array([time_ns]), trip.s_m)[0])


def lateness_text(late_s: float) -> str:
    """How late a train is in words: "12 s late", "3 s early" or "on time"."""
    return "on time" if abs(late_s) <= 0.5 else f"{abs(late_s):.0f} s {'late' if late_s > 0 else 'early'}"


def times_text(count: int) -> str:
    """How often something happened, in words: "once", "twice", "3 times"."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Which events are wanted; a field that is empty or None lets every event pass."""

    kinds: Collection[EventKind] = ()
    text: str = ""
    """Words that the event's text must contain, in upper or lower case."""
    from_ns: int | None = None
    to_ns: int | None = None
    bookmarks: bool = False
    """Only bookmarks: those that the program made, and notes."""

    def choose(self, events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
        """The events that pass, in their order."""
        return tuple(one for one in events if self._passes(one))

    def _passes(self, one: DriveEvent) -> bool:
        return (
            (not self.kinds or one.kind in self.kinds)
            and (not self.bookmarks or bool(one.mark) or one.kind is EventKind.NOTE)
            and self.text.casefold() in one.text.casefold()
            and (self.from_ns is None or one.last_ns >= self.from_ns)
            and (self.to_ns is None or one.time_ns <= self.to_ns)
        )


MUCH_OVER_KMH: Final = 3.0
"""A train this much (km/h) above the limit was too fast by more than the error of a speedometer and of the sampling."""
LONG_OVER_S: Final = 5.0
"""A train that is above the limit for this long (s) did not only touch it."""
LONG_SILENT_S: Final = 3.0
"""The driver does not notice a shorter silence (s), because the display keeps its advice for this long."""
LONG_AWAY_S: Final = 10.0
"""Attention that is away for this long (s) is more than a look at something else."""
LARGE_DEVIATION_S: Final = 60.0
"""It is an event if the train is, or is expected to arrive, this much (s) off the timetable."""


def with_marks(events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
    """The events in order of time; those that are bookmarks say so in `mark`."""
    found = sorted(events, key=lambda one: one.time_ns)
    # Only the first refusal of each leg is marked, and only under way: a driver who refuses once usually does so again.
    may_refuse = not any(one.kind is EventKind.DEPARTURE for one in found)
    marked = []
    for one in found:
        if one.kind in (EventKind.DEPARTURE, EventKind.ARRIVAL):
            may_refuse = one.kind is EventKind.DEPARTURE
        mark = _mark(one)
        if mark == REFUSED:
            mark, may_refuse = (mark if may_refuse else ""), False
        marked.append(replace(one, mark=mark) if mark else one)
    return tuple(marked)


REFUSED: Final = "advice not followed"


def _mark(one: DriveEvent) -> str:
    """Why an event is a bookmark; empty for an event that is none."""
    from sim.drivers.cab import AT_STOP_M  # imports the compiler, for which no command's help should wait

    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.MISSED_STOP:
            return "stop missed"
        case EventKind.ARRIVAL if one.facts["missed_m"] > AT_STOP_M:
            return "beyond the stop"
        case EventKind.STAND:
            return "unplanned stop"
        case EventKind.SIGNAL:
            return "signal at danger"
        case EventKind.OVERSPEED if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "too fast"
        case EventKind.BEYOND_TRAIN if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "another train?"
        case EventKind.WITHDRAWAL if lasted_s >= LONG_SILENT_S:
            return "advice withdrawn"
        case EventKind.LAPSE if lasted_s >= LONG_SILENT_S:
            return "nothing heard"
        case EventKind.DRIVER if one.facts.get("followed") is False:
            return REFUSED
        case EventKind.DRIVER if one.facts.get("away_s", 0.0) >= LONG_AWAY_S:
            return "attention away"
        case EventKind.DEVIATION:
            return "a minute off the timetable"
        case _:
            return ""


def deviation_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """The first moment at which the train was, or was expected to arrive, a minute off its timetable; else nothing.

    The operator reports how late the train is, the node predicts how late it will arrive. Without a timetable there is
    no such moment.
    """
    if own_timetable(recording):
        return
    told = recording.columns(topics.DELAY, "time_ns", "delay_s")
    said = recording.columns(topics.ADVICE, "time_ns", "mode", "predicted_deviation_s")
    expected = np.where(said["mode"] > 0, said["predicted_deviation_s"], 0.0)
    firsts = [
        (int(time_ns[at]), float(late_s[at]), words)
        for time_ns, late_s, words in (
            (told["time_ns"], told["delay_s"], "the operator reports"),
            (said["time_ns"], expected, "the next arrival is expected"),
        )
        for at in np.flatnonzero(np.abs(late_s) >= LARGE_DEVIATION_S)[:1]
    ]
    for time_ns, late_s, words in sorted(firsts)[:1]:
        text = f"{words} {lateness_text(late_s)}"
        yield DriveEvent.on(trip, EventKind.DEVIATION, time_ns, text, deviation_s=late_s)


def bookmarks(events: Sequence[DriveEvent]) -> tuple[DriveEvent, ...]:
    """All bookmarks in order of time: those that the program made, and the notes of people."""
    return tuple(one for one in events if one.mark or one.kind is EventKind.NOTE)


SUFFIX: Final = ".notes"
"""The end of the name of a file of notes. It is an MCAP file, but must not be taken for a drive, as by `run*.mcap`."""
FORMER_SUFFIX: Final = ".notes.mcap"
"""The end of the name until version 0.2. Such notes are read, and moved when they change."""
TOPIC: Final = "notes"
LONGEST_NOTE: Final = 2000
"""The greatest number of characters in a note."""


@dataclass(frozen=True, kw_only=True)
class Note:
    """A note: the span of time that it is about (ns since 1970), its text, its tags, and its author if one is given."""

    time_ns: int
    end_ns: int
    text: str
    tags: tuple[str, ...] = ()
    author: str = ""


def notes_path(recording: Path) -> Path:
    """The file of the notes of a recording."""
    return recording.with_name(f"{recording.stem}{SUFFIX}")


def _write_notes(recording: Path, notes: list[Note]) -> Path:
    path = notes_path(recording)
    write_whole(path, _as_mcap(recording, notes))
    recording.with_name(f"{recording.stem}{FORMER_SUFFIX}").unlink(missing_ok=True)
    return path


def read_notes(recording: Path) -> tuple[Note, ...]:
    """The notes of a recording in order of time; empty if there are none. DasError for a file that is damaged."""
    path, former = notes_path(recording), recording.with_name(f"{recording.stem}{FORMER_SUFFIX}")
    path = path if path.exists() else former
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
    return tuple(sorted(found, key=lambda note: note.time_ns))


def add_note(recording: Path, note: Note) -> Path:
    """Add a note to those of a recording; rewrite the file of the notes as a whole and return its path.

    Raises DasError if the text is empty or too long, a tag is wrong, or the file cannot be read or written.
    """
    if not note.text.strip() or len(note.text) > LONGEST_NOTE:
        raise DasError(f"note of {len(note.text)} characters: expected 1 to {LONGEST_NOTE}")
    for tag in note.tags:
        if not tag.strip() or "," in tag:
            raise DasError(f"--tag {tag!r}: expected a word without commas")
    return _write_notes(recording, [*read_notes(recording), note])


def remove_note(recording: Path, number: int) -> Note:
    """Remove a note by its number, counted from 1 in order of time, and return it; DasError if there is none."""
    kept = list(read_notes(recording))
    if not 1 <= number <= len(kept):
        raise DasError(f"--remove {number}: {recording} has {len(kept)} notes")
    removed = kept.pop(number - 1)
    _write_notes(recording, kept)
    return removed


def _as_mcap(recording: Path, notes: list[Note]) -> bytes:
    """The notes as an MCAP file, in order of time."""
    content = io.BytesIO()
    writer = Writer(content)
    writer.start(library="das-sim")
    writer.add_metadata("notes", {"recording": recording.name})
    channel = writer.register_channel(TOPIC, "protobuf", register_schema(writer, FoxgloveEvent))
    for note in sorted(notes, key=lambda one: one.time_ns):
        writer.add_message(channel, note.time_ns, _event(note).SerializeToString(), note.time_ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return content.getvalue()


def _event(note: Note) -> Any:
    event = FoxgloveEvent()
    event.start_time.FromNanoseconds(note.time_ns)
    event.end_time.FromNanoseconds(max(note.end_ns, note.time_ns))
    for key, value in (("text", note.text), ("tags", ",".join(note.tags)), ("author", note.author)):
        if value:
            event.metadata.add(key=key, value=value)
    return event


def _note(event: Any) -> Note:
    said = {pair.key: pair.value for pair in event.metadata}
    # Other programs may use another key for the text; then all their keys and values are shown.
    text = said.get("text") or "; ".join(f"{key}: {value}" for key, value in said.items()) or "(no text)"
    return Note(
        time_ns=event.start_time.ToNanoseconds(),
        end_ns=event.end_time.ToNanoseconds(),
        text=text,
        tags=tuple(filter(None, said.get("tags", "").split(","))),
        author=said.get("author", ""),
    )
