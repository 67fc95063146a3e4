"""What happened on the day besides the driving: silence of the node, signals, targets, events worth a mark."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final, NamedTuple

from foxglove_schemas_protobuf.Log_pb2 import Log

from das.advice.advice import Cause
from das.advice.reason import Reason
from das.advice.wording import words
from das.bus import das_pb2, topics
from das.bus.recording import Recording
from das.domain.units import NS
from sim.drive.events.event import DriveEvent, EventKind, read_notes
from sim.recording.course import DriveClock, DrivenCourse

HEARD_NS: Final = 3_000_000_000
"""A message that withdraws the advice does not say how long it is valid; it counts for this long (ns)."""

NOT_HEARD: Final = "the node is not heard"


class Span(NamedTuple):
    """From when to when something lasted (ns since 1970), and what it was."""

    start_ns: int
    end_ns: int
    text: str


class Signal(NamedTuple):
    """A signal at danger: its position (m), and from when to when the driver saw it at danger."""

    s_m: float
    start_ns: int
    end_ns: int


class Point(NamedTuple):
    """A target of traffic management: its position (m), when the node received it, and what it demands."""

    s_m: float
    told_ns: int
    text: str


def silences(recording: Recording, trip: DrivenCourse) -> tuple[Span, ...]:
    """The times without advice, each with its first reason: advice withdrawn, or no message from the node.

    A recording without a node has no such times.
    """
    first_ns, last_ns = int(trip.time_ns[0]), int(trip.time_ns[-1])
    found: list[Span] = []
    before: int | str = ""
    for said, cause in _silent(recording, first_ns, last_ns):
        span = said._replace(start_ns=max(said.start_ns, first_ns), end_ns=min(said.end_ns, last_ns))
        if span.end_ns <= span.start_ns:
            continue
        if found and found[-1].end_ns == span.start_ns and before == cause:
            found[-1] = found[-1]._replace(end_ns=span.end_ns)
        else:
            found.append(span)
        before = cause
    return tuple(found)


def _silent(recording: Recording, first_ns: int, last_ns: int) -> Iterator[tuple[Span, int | str]]:
    """The times without advice, each with what caused it."""
    advices = sorted((entry.message for entry in recording.of(topics.ADVICE)), key=lambda message: message.time_ns)
    heard_ns = first_ns
    for advice, following in pairwise([*advices, None]):
        assert advice is not None
        if advice.time_ns > heard_ns:
            yield Span(heard_ns, advice.time_ns, NOT_HEARD), NOT_HEARD
        next_ns = last_ns if following is None else following.time_ns
        valid_ns = max(advice.valid_until_ns, advice.time_ns + HEARD_NS)
        heard_ns = min(next_ns, valid_ns)
        if advice.source == das_pb2.Advice.SOURCE_NONE:
            yield Span(advice.time_ns, heard_ns, withdrawal_words(advice)), int(advice.cause)
    if advices:
        yield Span(heard_ns, last_ns, NOT_HEARD), NOT_HEARD


def silence_text(span: Span) -> str:
    """How long there was no advice, and why."""
    return f"no advice for {(span.end_ns - span.start_ns) * NS:.0f} s: {span.text}"


def withdrawal_words(advice: Any) -> str:
    """Why advice was withdrawn, in words; in a recording older than the codes of reasons, the name of the cause."""
    text = words(Reason.read(advice.reason))
    return text or Cause(advice.cause).label.replace("-", " ")


def signals(recording: Recording) -> tuple[Signal, ...]:
    """The signals at danger that the driver saw."""
    found: list[Signal] = []
    before_m = -1.0
    for entry in recording.of(topics.CAB):
        cab = entry.message
        if cab.signal_m == before_m:
            found[-1] = found[-1]._replace(end_ns=cab.time_ns)
        elif cab.signal_m > 0.0:
            found.append(Signal(cab.signal_m, cab.time_ns, cab.time_ns))
        before_m = cab.signal_m if cab.signal_m > 0.0 else -1.0
    return tuple(found)


def points(recording: Recording, trip: DrivenCourse) -> tuple[Point, ...]:
    """The targets that the node received, each once."""
    stops = {stop.name: stop.s_m for entry in recording.of(topics.JOURNEY) for stop in entry.message.stops}
    found: dict[tuple[float, str], Point] = {}
    clock = DriveClock.of(recording, int(trip.time_ns[0]))
    for entry in recording.of(topics.TARGET):
        for target in entry.message.targets:
            s_m = stops.get(target.stop, target.s_m)
            text = _asked(target, clock)
            found.setdefault((s_m, text), Point(s_m, entry.message.time_ns, text))
    return tuple(found.values())


def _asked(target: Any, clock: DriveClock) -> str:
    words = (("arrival", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    return ", ".join(f"{word} {clock.shown(at_ns)}" for word, at_ns in words if at_ns)


def happenings(recording: Recording, trip: DrivenCourse, silent: tuple[Span, ...]) -> tuple[DriveEvent, ...]:
    """All marks in order of time: the simulator's log, silences, other warnings of the node, and notes.

    What happened before the first position is moved to the moment of that position, and its text says so.
    """
    start_ns, end_ns = int(trip.time_ns[0]), int(trip.time_ns[-1])
    found = [(EventKind.LOG, *_said(entry.message)) for entry in recording.of(topics.LOG)]
    found += [(EventKind.LAPSE, span.start_ns, silence_text(span)) for span in silent]
    for event in (entry.message for entry in recording.of(topics.EVENT)):
        time_ns, text = _said(event)
        # A node that still runs after the last position warns that the position is old.
        if event.level >= Log.WARNING and time_ns <= end_ns and not any(x.text in text for x in silent):
            found.append((EventKind.WARNING, time_ns, text))
    for note in read_notes(recording.path):
        if start_ns <= note.time_ns <= end_ns:  # not about another part of the drive
            found.append((EventKind.NOTE, note.time_ns, f"note: {note.text}"))
    marks = []
    for kind, time_ns, text in found:
        early = f"({(start_ns - time_ns) * NS:.0f} s before) " if time_ns < start_ns else ""
        marks.append(DriveEvent.on(trip, kind, max(time_ns, start_ns), f"{early}{text}"))
    return tuple(sorted(marks, key=lambda one: one.time_ns))


def _said(event: Any) -> tuple[int, str]:
    return event.timestamp.ToNanoseconds(), event.message
