"""When a train was at the stops of its journey, for all axes and lanes of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from das.bus.recording import Recording
from sim.drive.events.calls import RecordedCall, calls
from sim.recording.course import DrivenCourse


class AtStop(NamedTuple):
    """A stop's name, and from when to when the train was there (ns since 1970): the same moment if it ran through."""

    name: str
    start_ns: int
    end_ns: int


def at_stops(recording: Recording, trip: DrivenCourse) -> tuple[AtStop, ...]:
    """The stops at which the train stood or which it passed, in order of time; none without a journey."""
    first_m, last_m = float(trip.s_m.min()), float(trip.s_m.max())
    met = (one for one in calls(recording, trip) if one.stand is not None or first_m <= one.s_m <= last_m)
    return tuple(sorted((_at(call, trip) for call in met), key=_start))


def _start(at: AtStop) -> int:
    return at.start_ns


def _at(call: RecordedCall, trip: DrivenCourse) -> AtStop:
    if call.stand is None:
        came = min(int(np.searchsorted(np.maximum.accumulate(trip.s_m), call.s_m)), len(trip.time_ns) - 1)
        return AtStop(call.name, int(trip.time_ns[came]), int(trip.time_ns[came]))
    first_ns, last_ns = (int(trip.time_ns[i]) for i in call.stand[:2])
    return AtStop(call.name, call.arrived_ns or first_ns, call.departed_ns or last_ns)
