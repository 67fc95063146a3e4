"""The schedule a trip kept: where and when the train stood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from das.domain.route import Route
from das.domain.units import NS
from sim.trips.matching import MatchedTrip
from sim.trips.settings import STANDS
from sim.trips.standing import stands


@dataclass(frozen=True, kw_only=True)
class StandFound:
    """A standstill: its place, the stop of the route there if any, and when it began and ended.

    `off_m` is how far beyond the stop the train stood. A time is None if the record begins or ends with the stand.
    """

    s_m: float
    stop: str | None
    off_m: float | None
    arrival_ns: int | None
    departure_ns: int | None

    @property
    def dwell_s(self) -> float | None:
        if self.arrival_ns is None or self.departure_ns is None:
            return None
        return (self.departure_ns - self.arrival_ns) * NS


def stands_found(matched: MatchedTrip, route: Route, speed_lag_s: float) -> tuple[StandFound, ...]:
    """The stands of a trip in order; their times come from the speeds, which are late by `speed_lag_s`."""
    found = []
    last = len(matched.time_ns) - 1
    time_ns = np.clip(matched.time_ns - round(speed_lag_s / NS), matched.time_ns[0], matched.time_ns[-1])
    for stand in stands(matched.standing):
        inside = stand.first > 0 and stand.last < last
        if inside and (time_ns[stand.last] - time_ns[stand.first]) * NS < STANDS.shortest_stand_s:
            continue
        s_m = float(matched.s_m[stand.last])
        stop = min(route.stops, key=lambda stop: abs(stop.position_m - s_m))
        there = abs(stop.position_m - s_m) <= STANDS.at_stop_m
        found.append(
            StandFound(
                s_m=s_m,
                stop=stop.name if there else None,
                off_m=s_m - stop.position_m if there else None,
                arrival_ns=int(time_ns[stand.first]) if stand.first > 0 else None,
                departure_ns=int(time_ns[stand.last]) if stand.last < last else None,
            )
        )
    return tuple(found)
