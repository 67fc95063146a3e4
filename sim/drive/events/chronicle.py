"""All events of a recording in order of time: what happened, when, where and why."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from das.bus import topics
from das.bus.recording import Recording
from sim.drive.calls import KeptCall, calls
from sim.drive.events.advice_events import advice_events, replan_events, withdrawal_events
from sim.drive.events.bookmarks import deviation_events, with_marks
from sim.drive.events.decision_events import decision_events
from sim.drive.events.driving_events import (
    call_events,
    driver_events,
    overspeed_events,
    pause_events,
    stand_events,
    top_speed_events,
)
from sim.drive.events.event import DriveEvent, EventKind
from sim.drive.events.notes import read_notes
from sim.drive.events.told_events import told_events
from sim.drive.happenings import silences
from sim.recording.clock import DriveClock
from sim.recording.course import DrivenCourse
from sim.recording.opening import open_recording


@dataclass(frozen=True, kw_only=True)
class Chronicle:
    """A recording with its course, its clock, how its stops were kept, and its events in order of time."""

    recording: Recording
    trip: DrivenCourse
    clock: DriveClock
    calls: tuple[KeptCall, ...]
    events: tuple[DriveEvent, ...]

    @classmethod
    def of(cls, recording: Recording) -> Chronicle:
        """Everything that happened on a recorded drive; DasError for a recording without positions."""
        trip = DrivenCourse.of(recording)
        made, silent = calls(recording, trip), silences(recording, trip)
        found = (
            *call_events(trip, made),
            *stand_events(trip, made),
            *told_events(recording, trip),
            *advice_events(recording, trip),
            *replan_events(recording, trip),
            *withdrawal_events(recording, trip, silent),
            *overspeed_events(recording, trip),
            *top_speed_events(recording, trip),
            *(decision_events(recording, trip) if recording.of(topics.DECISION) else driver_events(recording, trip)),
            *pause_events(recording, trip),
            *deviation_events(recording, trip),
            *_notes(recording, trip),
        )
        return cls(
            recording=recording,
            trip=trip,
            clock=DriveClock.of(recording, int(trip.time_ns[0])),
            calls=made,
            events=with_marks(found),
        )

    @classmethod
    def read(cls, path: Path) -> Chronicle:
        """The chronicle of a file; DasError where it cannot be used."""
        return cls.of(open_recording(path))

    def as_rows(self, events: Iterable[DriveEvent]) -> list[dict[str, Any]]:
        """Events for programs: times in s on the clock and as UTC text, positions in m."""
        return [
            {
                "time_s": round(self.clock.since_s(one.time_ns), 3),
                "time_utc": self.clock.of_day(one.time_ns),
                "time_ns": one.time_ns,
                "end_s": round(self.clock.since_s(one.last_ns), 3),
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
