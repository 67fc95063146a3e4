"""How a recorded drive kept its stops: found from where the train stood, to a fraction of a second."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import NS
from sim.recording.course import DrivenCourse

STANDING_MPS: Final = 0.3
"""A train that is slower than this (m/s) stands: receivers report a few cm/s at rest."""
NEAR_M: Final = 100.0
"""A stand this near (m) to a stop may be the one at that stop; the nearest stand is."""


class StandingTime(NamedTuple):
    """A stand of the train: index of its first and last sample, and its position (m)."""

    first: int
    last: int
    s_m: float


@dataclass(frozen=True, kw_only=True)
class RecordedCall:
    """How a drive kept one stop of its journey.

    Times are in ns since 1970 and 0 where there is none: due times of the timetable, and when the train came and left.
    `stand` is where it stood, None where it did not stop. `missed_m` is how far beyond the stop (before it: negative)
    it stood. `reached` says that the train got as far as the stop.
    """

    name: str
    s_m: float
    due_arrival_ns: int
    due_departure_ns: int
    arrived_ns: int
    departed_ns: int
    stand: StandingTime | None
    reached: bool

    @property
    def missed_m(self) -> float:
        """How far beyond the stop the train stood (m); NaN where it did not stand."""
        return math.nan if self.stand is None else self.stand.s_m - self.s_m

    @property
    def arrived_late_s(self) -> float:
        """Arrival after the timetable's (s; early < 0); NaN where one of the two is not known."""
        known = self.arrived_ns and self.due_arrival_ns
        return (self.arrived_ns - self.due_arrival_ns) * NS if known else math.nan

    @property
    def departed_late_s(self) -> float:
        """Departure after the timetable's (s; early < 0); NaN where one of the two is not known."""
        known = self.departed_ns and self.due_departure_ns
        return (self.departed_ns - self.due_departure_ns) * NS if known else math.nan


def stands(trip: DrivenCourse) -> tuple[StandingTime, ...]:
    """Every stand of the train, in order of time; one during which it crept less than the noise is one stand."""
    still = np.concatenate(([False], trip.speed_mps < STANDING_MPS, [False]))
    edges = np.flatnonzero(np.diff(still.astype(np.int8)))
    return tuple(
        StandingTime(int(first), int(end) - 1, float(np.median(trip.s_m[first:end])))
        for first, end in zip(edges[::2], edges[1::2], strict=True)
    )


def calls(recording: Recording, trip: DrivenCourse) -> tuple[RecordedCall, ...]:
    """How each stop of the last journey was kept; empty without a journey."""
    found: list[RecordedCall] = []
    known = stands(trip)
    for entry in recording.of(topics.JOURNEY)[-1:]:
        for stop in entry.message.stops:
            near = [one for one in known if abs(one.s_m - stop.s_m) <= NEAR_M]
            stand = min(near, key=lambda one: abs(one.s_m - stop.s_m), default=None)
            found.append(
                RecordedCall(
                    name=stop.name,
                    s_m=stop.s_m,
                    due_arrival_ns=stop.arrival_ns,
                    due_departure_ns=stop.departure_ns,
                    arrived_ns=0 if stand is None else arrival_ns(trip, at_rest(trip, stand)),
                    departed_ns=0 if stand is None else departure_ns(trip, at_rest(trip, stand)),
                    stand=stand,
                    reached=bool(trip.s_m.max() >= stop.s_m - NEAR_M),
                )
            )
    return tuple(found)


def at_rest(trip: DrivenCourse, stand: StandingTime) -> StandingTime:
    """A stand from its first to its last sample with a speed of exactly 0; the same where there is none.

    A train that begins to move at less than the noise has left.
    """
    zeros = stand.first + np.flatnonzero(trip.speed_mps[stand.first : stand.last + 1] == 0)
    return stand._replace(first=int(zeros[0]), last=int(zeros[-1])) if len(zeros) else stand


def arrival_ns(trip: DrivenCourse, stand: StandingTime) -> int:
    """When the train came to a stand (ns since 1970), 0 where it stood from the first sample on.

    From the last moving sample the train needs 2·Δs/v at constant deceleration.
    """
    if stand.first == 0:
        return 0
    moving = stand.first - 1
    return int(trip.time_ns[moving]) + _between_ns(trip.time_ns, trip.s_m, trip.speed_mps[moving], moving)


def departure_ns(trip: DrivenCourse, stand: StandingTime) -> int:
    """When the train left a stand (ns since 1970), 0 where it stood to the last sample; as `arrival_ns`, mirrored."""
    moving = stand.last + 1
    if moving >= len(trip.time_ns):
        return 0
    return int(trip.time_ns[moving]) - _between_ns(trip.time_ns, trip.s_m, trip.speed_mps[moving], stand.last)


def _between_ns(time_ns: NDArray[np.int64], s_m: NDArray[np.float64], speed_mps: float, first: int) -> int:
    """Time (ns) from a standstill to a speed over the way between two samples, at most the time between them."""
    way_m, whole_ns = abs(float(s_m[first + 1] - s_m[first])), int(time_ns[first + 1] - time_ns[first])
    return min(round(2.0 * way_m / max(float(speed_mps), 1e-3) / NS), whole_ns)
