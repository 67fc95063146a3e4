"""All events of a recording in order of time: what happened, when, where and why."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import KM, NS, kmh
from sim.drive.calls import KeptCall
from sim.drive.events.advice_events import advice_events, replan_events, withdrawal_events
from sim.drive.events.bookmarks import deviation_events, with_marks
from sim.drive.events.driving_events import (
    call_events,
    decision_events,
    driver_events,
    overspeed_events,
    pause_events,
    stand_events,
    top_speed_events,
)
from sim.drive.events.event import DriveEvent, EventKind
from sim.drive.events.notes import read_notes
from sim.drive.happenings import Span, points, signals
from sim.drive.limits import temporary_limits
from sim.recording.clock import DriveClock
from sim.recording.course import DrivenCourse, Floats

DELAY_STEP_S: Final = 15.0
"""A delay that differs by this much (s) from the one told before is an event; smaller changes come all the time."""


def events_of(
    recording: Recording,
    trip: DrivenCourse,
    made: tuple[KeptCall, ...],
    silent: tuple[Span, ...],
    limit_mps: Floats,
    top_mps: float,
) -> tuple[DriveEvent, ...]:
    """Everything that happened on a recorded drive, in order of time.

    `made` are its stops as kept, `silent` the times without advice, `limit_mps` the limit at every position of its
    course, and `top_mps` the speed that its train can go (infinite: not known).
    """
    found = (
        *call_events(trip, made),
        *stand_events(trip, made),
        *_told_events(recording, trip),
        *advice_events(recording, trip),
        *replan_events(recording, trip),
        *withdrawal_events(recording, trip, silent),
        *overspeed_events(trip, limit_mps),
        *top_speed_events(trip, top_mps),
        *(decision_events(recording, trip) if recording.of(topics.DECISION) else driver_events(recording, trip)),
        *pause_events(recording, trip),
        *deviation_events(recording, trip),
        *_notes(recording, trip),
    )
    return with_marks(found)


def as_rows(events: Iterable[DriveEvent], clock: DriveClock) -> list[dict[str, Any]]:
    """Events for programs: times in s on the clock and as UTC text, positions in m."""
    return [
        {
            "time_s": round(clock.since_s(one.time_ns), 3),
            "time_utc": clock.of_day(one.time_ns),
            "time_ns": one.time_ns,
            "end_s": round(clock.since_s(one.last_ns), 3),
            "s_m": round(one.s_m, 1),
            "kind": str(one.kind),
            "text": one.text,
            **({"bookmark": one.mark} if one.mark else {}),
            **{name: value for name, value in one.facts.items() if not _is_nan(value)},
        }
        for one in events
    ]


def _is_nan(value: object) -> bool:
    """Whether a value is NaN, which JSON does not know."""
    return isinstance(value, float) and math.isnan(value)


def _notes(recording: Recording, trip: DrivenCourse) -> Iterable[DriveEvent]:
    """The notes of people, as events; of a part of a drive, those of that part."""
    for number, note in enumerate(read_notes(recording.path), start=1):
        if not trip.time_ns[0] <= note.time_ns <= trip.time_ns[-1]:
            continue
        tags = f" [{', '.join(note.tags)}]" if note.tags else ""
        by = f" ({note.author})" if note.author else ""
        yield DriveEvent(
            time_ns=note.time_ns,
            end_ns=note.end_ns,
            kind=EventKind.NOTE,
            text=f"{note.text}{tags}{by}",
            s_m=float(trip.at(np.array([note.time_ns]), trip.s_m)[0]),
            facts={"number": number, "note": note.text, "tags": list(note.tags), "author": note.author},
        )


def _told_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """Everything that was told, in no order."""
    yield from _restrictions(recording, trip)
    for point in points(recording, trip):
        text = f"traffic management: {point.text} at km {point.s_m / KM:.1f}"
        yield DriveEvent(time_ns=point.told_ns, kind=EventKind.TARGET, text=text, s_m=_where(trip, point.told_ns))
    for index, entry in enumerate(recording.of(topics.JOURNEY)):
        if index:
            stops = " – ".join(stop.name for stop in entry.message.stops)
            at = int(entry.message.time_ns)
            yield DriveEvent(
                time_ns=at, kind=EventKind.JOURNEY, text=f"another journey was told: {stops}", s_m=_where(trip, at)
            )
    yield from _delays(recording, trip)
    for signal in signals(recording):
        lasted_s = (signal.end_ns - signal.start_ns) * NS
        yield DriveEvent(
            time_ns=signal.start_ns, end_ns=signal.end_ns, kind=EventKind.SIGNAL, s_m=_where(trip, signal.start_ns),
            text=f"signal at danger at km {signal.s_m / KM:.2f} in sight for {lasted_s:.0f} s",
            facts={"signal_m": signal.s_m, "lasted_s": lasted_s},
        )  # fmt: skip
    for entry in recording.of(topics.LOG):
        yield _said(entry.message, EventKind.LOG, trip)
    for entry in recording.of(topics.EVENT):
        if entry.message.level >= Log.WARNING:
            yield _said(entry.message, EventKind.WARNING, trip)


def _where(trip: DrivenCourse, time_ns: int) -> float:
    return float(trip.at(np.array([time_ns]), trip.s_m)[0])


def _restrictions(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    for span in temporary_limits(recording, trip):
        one = span.restriction
        place = f"{kmh(one.limit_mps):.0f} km/h, km {one.start_m / KM:.2f} to {one.end_m / KM:.2f}{one.window_words()}"
        facts = {"start_m": one.start_m, "end_m": one.end_m, "limit_mps": one.limit_mps}
        for at, word in span.changes():
            if word == "told" or at <= trip.time_ns[-1]:
                yield DriveEvent(
                    time_ns=at, kind=EventKind.RESTRICTION, s_m=_where(trip, at), facts=facts,
                    text=f"restriction {word}: {place}",
                )  # fmt: skip


def _delays(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """The delays told that differ from the one told before."""
    delay = recording.columns(topics.DELAY, "time_ns", "delay_s")
    before_s = 0.0
    for time_ns, delay_s in zip(delay["time_ns"].tolist(), delay["delay_s"].tolist(), strict=True):
        if abs(delay_s - before_s) >= DELAY_STEP_S:
            word = f"{abs(delay_s):.0f} s {'late' if delay_s > 0 else 'early'}"
            text = f"the operator says {word if abs(delay_s) >= 0.5 else 'on time'}"
            yield DriveEvent(
                time_ns=time_ns, kind=EventKind.DELAY, text=text,
                s_m=_where(trip, time_ns), facts={"delay_s": delay_s},
            )  # fmt: skip
            before_s = delay_s


def _said(log: Any, kind: EventKind, trip: DrivenCourse) -> DriveEvent:
    at = log.timestamp.ToNanoseconds()
    said = f"{log.name}: {log.message}" if log.name else str(log.message)
    return DriveEvent(time_ns=at, kind=kind, text=said, s_m=_where(trip, at))
