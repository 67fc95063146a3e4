"""Where the legs of a drive begin and end: at stops, or at equal speeds if it does not stand at both its stops."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Route
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from sim.drive.above_optimum import NO_PART, NOT_COMPARABLE, NOT_WHOLE, passing_name
from sim.drive.attribution.driven_legs import LEAST_WAY_M, DrivenLeg, DrivenMotion, fast_enough, legs_of
from sim.drive.calls import KeptCall, calls_on_the_way, reported_course
from sim.recording.stands import STANDING_MPS

if TYPE_CHECKING:
    from sim.drive.drive import DrivenEnergy

EQUAL_MPS: Final = 0.5
"""Two speeds count as equal if each is within this (m/s) of the same speed."""
LEAST_PART_M: Final = 1000.0
"""A part between equal speeds that is shorter than this (m) says nothing about the drive."""


def open_calls(
    path: Path, motion: DrivenMotion, route: Route, vehicle: Vehicle, stood: Iterable[KeptCall] = ()
) -> tuple[KeptCall, ...]:
    """The ends of the longest part of a drive between equal speeds, and the stops in it.

    It is for a drive that does not stand at both its stops; `stood` are the stops on the way. As much kinetic energy
    enters the part as leaves it. Both ends are within the limits of line and vehicle. `legs_of` cuts the motion there,
    also one that is smoothed otherwise: the ends keep their times and speeds. DasError if the part is shorter than
    1 km, or if the drive is faster than the vehicle.
    """
    vehicle = fast_enough(vehicle, motion)
    v, s_m = motion.speed_mps, motion.s_m
    limit_mps = np.minimum(route.limits_over_train(vehicle.train_length_m).at(s_m), vehicle.max_speed_mps)
    allowed = (v <= limit_mps) & (s_m >= 0.0) & (s_m <= route.length_m)
    longest = (0, 0)
    for level in np.arange(0.0, v.max() + EQUAL_MPS, EQUAL_MPS):
        there = np.flatnonzero(allowed & (np.abs(v - level) <= EQUAL_MPS))
        if len(there) and s_m[there[-1]] - s_m[there[0]] > s_m[longest[1]] - s_m[longest[0]]:
            longest = (int(there[0]), int(there[-1]))
    first, last = longest
    if s_m[last] - s_m[first] < LEAST_PART_M:
        top_kmh, own_kmh = v.max() / KMH, vehicle.max_speed_mps / KMH
        faster = f"the trip runs {top_kmh:.0f} km/h, which is faster than this train, {own_kmh:.0f} km/h"
        raise DasError(f"{path}: {NOT_COMPARABLE}: {faster if top_kmh > own_kmh else NO_PART}")
    if v[first] < STANDING_MPS:  # the part begins when the train leaves
        first = int(np.flatnonzero(s_m <= s_m[first])[-1])
    if v[last] < STANDING_MPS:
        last = int(np.flatnonzero(s_m >= s_m[last])[0])
    start, end = (_passing(motion, sample) for sample in (first, last))
    inside = [one for one in stood if start.s_m + LEAST_WAY_M < one.stood_m < end.s_m - LEAST_WAY_M]
    return (start, *inside, end)


def _passing(motion: DrivenMotion, sample: int) -> KeptCall:
    """A sample of a motion as an end of a leg."""
    s_m, time_ns = float(motion.s_m[sample]), int(motion.time_ns[sample])
    speed_mps = float(motion.speed_mps[sample]) * bool(motion.speed_mps[sample] >= STANDING_MPS)
    return KeptCall(
        name=passing_name(s_m, speed_mps), s_m=s_m, due_arrival_ns=0, due_departure_ns=0,
        arrived_ns=time_ns, departed_ns=time_ns, stood_m=s_m, passed_mps=speed_mps,
    )  # fmt: skip


def legs_of_drive(drive: DrivenEnergy, motion: DrivenMotion) -> tuple[DrivenLeg, ...]:
    """The legs of a motion of a recorded drive, between its stops or in the part that a replay compared.

    DasError if there are none, in the words of the recording if it says why.
    """
    recording, said, calls = drive.recording, drive.said, drive.calls
    if said is None:
        return legs_of(recording.path, motion, calls)
    on_the_way = {one.start for one in said.sections[1:]} - {one.name for one in calls}
    if on_the_way:
        stops = [one for one in drive.inputs.route.stops if one.name in on_the_way]
        more = calls_on_the_way(stops, drive.course, reported_course(recording))
        calls = tuple(sorted((*calls, *more), key=lambda one: one.s_m))
    if said.part:
        calls = open_calls(recording.path, drive.motion, drive.inputs.route, drive.inputs.vehicle, calls)
    return legs_of(recording.path, motion, calls, said.why_not or NOT_WHOLE)
