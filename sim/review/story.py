"""Everything that a picture of a recording shows, found once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from das.bus.recording import Recording
from das.domain.units import KMH
from sim.drive.happenings import NOT_HEARD, Happening, Point, Signal, Span, happenings, points, signals, silences
from sim.drive.limits import TemporaryLimit, limit_in_force, temporary_limits
from sim.recording.clock import DriveClock
from sim.recording.course import DrivenCourse
from sim.review.filling import filled_in
from sim.review.lanes import Lane, lanes
from sim.review.series import Found, MapTrack, on_trip, series

FROM_ADVICE: Final = (
    "speed/advised", "force/advised", "deviation/predicted", "buffer/percent", "estimate/sd", "estimate/error",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Story:
    """The course of the train, the series to plot, and what happened on the way."""

    recording: Recording
    trip: DrivenCourse
    clock: DriveClock
    series: Found
    lanes: tuple[Lane, ...]
    limits: tuple[TemporaryLimit, ...]
    silences: tuple[Span, ...]
    signals: tuple[Signal, ...]
    points: tuple[Point, ...]
    happenings: tuple[Happening, ...]
    way: MapTrack | None = None
    """The way on the map; None where neither places nor the line's geometry are known."""
    filled_from: str = ""
    """What is estimated because it was not recorded, in a sentence; empty where nothing is."""

    @classmethod
    def of(cls, recording: Recording) -> Story:
        """The story of a recording; DasError if it has no position at all."""
        trip = DrivenCourse.of(recording)
        silent, filled = silences(recording, trip), filled_in(recording, trip)
        at, limit_mps = limit_in_force(recording, trip)
        return cls(
            recording=recording,
            trip=trip,
            clock=DriveClock.of(recording, int(trip.time_ns[0])),
            series={
                "speed/limit": on_trip(trip, at, limit_mps / KMH, held=True),
                **_broken(series(recording, trip), silent),
                **filled.series,
            },
            lanes=lanes(recording, trip),
            limits=temporary_limits(recording, trip),
            silences=silent,
            signals=signals(recording),
            points=points(recording, trip),
            happenings=happenings(recording, trip, silent),
            way=MapTrack.of(recording) or filled.way,
            filled_from=filled.source,
        )


def _broken(found: Found, silent: tuple[Span, ...]) -> Found:
    """The series, with a gap in those that come with the advice where the node was not heard."""
    gaps = np.array([span.start_ns for span in silent if span.text == NOT_HEARD], dtype=np.int64)
    broken = dict(found)
    for name in FROM_ADVICE:
        at, values = found[name]
        if len(at):
            places = np.searchsorted(at, gaps)
            broken[name] = np.insert(at, places, gaps), np.insert(values, places, np.nan)
    return broken
