"""Stands of a train: where it stood, and when it came to rest and left, by its positions and speeds.

Every command takes these times from here, so that a running time is the same everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.units import NS
from sim.recording.course import DrivenCourse, stretches_of

STANDING_MPS: Final = 0.3
"""Speed (m/s) below which a train stands: receivers report a few cm/s at rest."""
POSITION_ERROR_M: Final = 3.0
"""Error of a receiver's positions (m): over a shorter distance they do not show when the train stopped."""


class StandingTime(NamedTuple):
    """A stand of the train: the indices of its first and last sample, and its position (m)."""

    first: int
    last: int
    s_m: float


def stands(trip: DrivenCourse) -> tuple[StandingTime, ...]:
    """Every stand of the train, in order of time; creeping below `STANDING_MPS` does not end a stand."""
    return tuple(
        StandingTime(first, end - 1, float(np.median(trip.s_m[first:end])))
        for first, end in stretches_of(trip.speed_mps < STANDING_MPS)
    )


def stood_ns(
    s_m: float, near_m: float, trip: DrivenCourse, measured: DrivenCourse | None = None
) -> tuple[StandingTime | None, int, int]:
    """The stand that is nearest to a position (None: none within `near_m`), and when the train came to it and left.

    Times are in ns since 1970, 0 if they are not in the record. `trip` shows where the train stood. If the course of a
    receiver (`measured`) has the same stand, it gives the times.
    """
    stand = _nearest(stands(trip), s_m, near_m)
    if stand is None:
        return None, 0, 0
    told = None if measured is None else _nearest(stands(measured), s_m, near_m)
    if measured is not None and told is not None:
        return stand, *_rest_ns(measured, told)
    rest = at_rest(trip, stand)
    return stand, arrival_ns(trip, rest), departure_ns(trip, rest)


def _rest_ns(measured: DrivenCourse, stand: StandingTime) -> tuple[int, int]:
    """When the train came to rest and left, by the course of a receiver (ns since 1970; 0: not in the record).

    If the distance to the stand is within the error of the positions, the time is halfway between the samples at rest
    and in motion: taking the sample at rest would make trips too long.
    """
    rest, at = at_rest(measured, stand), measured.time_ns
    came_ns, left_ns = arrival_ns(measured, rest), departure_ns(measured, rest)
    if came_ns and _is_lost(measured, rest.first - 1, rest.first - 1):
        came_ns = int(at[rest.first - 1] + at[rest.first]) // 2
    if left_ns and _is_lost(measured, rest.last + 1, rest.last):
        left_ns = int(at[rest.last] + at[rest.last + 1]) // 2
    return came_ns, left_ns


def _is_lost(measured: DrivenCourse, moving: int, first: int) -> bool:
    """Whether the distance to or from a stand, at constant deceleration, is within the error of the positions."""
    over_s = float(measured.time_ns[first + 1] - measured.time_ns[first]) * NS
    return 0.5 * float(measured.speed_mps[moving]) * over_s < POSITION_ERROR_M


def _nearest(stood: Sequence[StandingTime], s_m: float, near_m: float) -> StandingTime | None:
    """The stand that is nearest to a position; None if none is within `near_m`."""
    near = [one for one in stood if abs(one.s_m - s_m) <= near_m]
    return min(near, key=lambda one: abs(one.s_m - s_m), default=None)


def at_rest(trip: DrivenCourse, stand: StandingTime) -> StandingTime:
    """A stand cut to the samples from the first to the last with a speed of exactly 0; uncut if there is none.

    A train that has begun to move has left, even if it is slower than the noise.
    """
    zeros = stand.first + np.flatnonzero(trip.speed_mps[stand.first : stand.last + 1] == 0)
    return stand._replace(first=int(zeros[0]), last=int(zeros[-1])) if len(zeros) else stand


def arrival_ns(trip: DrivenCourse, stand: StandingTime) -> int:
    """When the train came to a stand (ns since 1970); 0 if it stood from the first sample on.

    At constant deceleration the train needs 2·Δs/v from the last moving sample to the stand.
    """
    if stand.first == 0:
        return 0
    moving = stand.first - 1
    return int(trip.time_ns[moving]) + _between_ns(trip.time_ns, trip.s_m, trip.speed_mps[moving], moving)


def departure_ns(trip: DrivenCourse, stand: StandingTime) -> int:
    """When the train left a stand (ns since 1970); 0 if it stood to the last sample. Mirrors `arrival_ns`."""
    moving = stand.last + 1
    if moving >= len(trip.time_ns):
        return 0
    return int(trip.time_ns[moving]) - _between_ns(trip.time_ns, trip.s_m, trip.speed_mps[moving], stand.last)


def _between_ns(time_ns: NDArray[np.int64], s_m: NDArray[np.float64], speed_mps: float, first: int) -> int:
    """Time (ns) from standstill to a speed over the distance between two samples, at most the time between them."""
    way_m, whole_ns = abs(float(s_m[first + 1] - s_m[first])), int(time_ns[first + 1] - time_ns[first])
    return min(round(2.0 * way_m / max(float(speed_mps), 1e-3) / NS), whole_ns)
