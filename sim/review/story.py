"""Everything that a picture of a recording shows, found once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from das.bus.recording import Recording
from das.domain.units import KMH
from sim.drive.drive import Drive
from sim.drive.happenings import NOT_HEARD, Happening, Point, Signal, Span, happenings, points
from sim.drive.limits import TemporaryLimit
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
    """A drive, the series to plot, and what happened on the way."""

    drive: Drive
    series: Found
    lanes: tuple[Lane, ...]
    points: tuple[Point, ...]
    happenings: tuple[Happening, ...]
    way: MapTrack | None = None
    """The way on the map; None where neither places nor the line's geometry are known."""
    filled_from: str = ""
    """What is estimated because it was not recorded, in a sentence; empty where nothing is."""

    @classmethod
    def of(cls, drive: Drive) -> Story:
        """The story of a recorded drive; DasError if it has no position at all."""
        recording, trip = drive.recording, drive.course
        filled = filled_in(drive)
        return cls(
            drive=drive,
            series={
                "speed/limit": on_trip(trip, trip.time_ns, drive.limit_mps / KMH, held=True),
                **_broken(series(recording, trip), drive.silences),
                **filled.series,
            },
            lanes=lanes(drive),
            points=points(recording, trip),
            happenings=happenings(recording, trip, drive.silences),
            way=MapTrack.of(recording) or filled.way,
            filled_from=filled.source,
        )

    @property
    def recording(self) -> Recording:
        """The recording of the drive."""
        return self.drive.recording

    @property
    def trip(self) -> DrivenCourse:
        """Where the train was, and how fast."""
        return self.drive.course

    @property
    def clock(self) -> DriveClock:
        """The clock of the drive."""
        return self.drive.clock

    @property
    def limits(self) -> tuple[TemporaryLimit, ...]:
        """The restrictions that the node was told about."""
        return self.drive.temporary_limits

    @property
    def silences(self) -> tuple[Span, ...]:
        """The times without advice."""
        return self.drive.silences

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The signals at danger that the driver saw."""
        return self.drive.signals


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
