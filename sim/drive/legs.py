"""The legs of a drive: the motion from stand to stand, its energy, and its optimum."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.losses import LossMap
from das.domain.restriction import Restriction
from das.domain.route import Route
from das.domain.trajectory import Trajectory
from das.domain.units import KMH, NS
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section, rebuilt
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import NO_PART, NOT_COMPARABLE, NOT_WHOLE, SectionEnergy, passing_name
from sim.drive.calls import KeptCall, calls_on_the_way
from sim.drive.table import DriveTable
from sim.recording.course import STANDING_MPS, DrivenCourse, Floats, Times
from sim.recording.opening import DriveInputs
from sim.trips.estimate import (
    BRAKING,
    CHOICE_OVERSPEED_RATIO,
    DrivenCase,
    Unknown,
    doubt,
    estimate_run,
    one_by_one,
)

if TYPE_CHECKING:
    from sim.trips.profile import DrivenRun

EQUAL_MPS: Final = 0.5
"""Largest difference (m/s) from a common speed at which two speeds count as equal."""
LEAST_PART_M: Final = 1000.0
"""Least length (m) of a part between equal speeds for an assessment of the drive."""
LEAST_WAY_M = 100.0
"""Distance (m) below which two stands do not bound a leg: the train only moved up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenMotion(DrivenCourse):
    """Samples of a drive with its energy, each array of shape (samples,).

    `input_j` and `friction_j` are the energies at the current collector and of the friction brake since the start; they
    are None if they were not measured.
    """

    input_j: Floats | None = None
    friction_j: Floats | None = None

    @property
    def drawn_j(self) -> float:
        """Energy drawn at the current collector over the samples (J); NaN if it was not measured."""
        return math.nan if self.input_j is None else float(self.input_j[-1] - self.input_j[0])

    @classmethod
    def of_run(cls, run: DrivenRun) -> DrivenMotion:
        """The motion of a smoothed record, for which no energy was measured."""
        course = run.course
        return cls(time_ns=course.time_ns, s_m=course.s_m, speed_mps=course.speed_mps)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenLeg:
    """The motion from a stand at one stop to the stand at the next stop that was served.

    In the first and the last sample the train stands; their times are the refined departure and arrival. A leg of a
    part between equal speeds begins or ends at that speed instead.
    """

    start: KeptCall
    end: KeptCall
    motion: DrivenMotion

    @property
    def time_s(self) -> Floats:
        """Time since the departure (s)."""
        since_s: Floats = (self.motion.time_ns - self.motion.time_ns[0]) * NS
        return since_s

    @property
    def trip_s(self) -> float:
        """Time from departure to arrival (s)."""
        return float(self.time_s[-1])

    @property
    def timetable_s(self) -> float | None:
        """Trip time of the timetable (s); None if the timetable gives none."""
        due_ns, leaves_ns = self.end.due_arrival_ns, self.start.due_departure_ns
        return (due_ns - leaves_ns) * NS if due_ns > leaves_ns > 0 else None

    @property
    def left_s(self) -> float | None:
        """Time from the departure as driven to the arrival of the timetable (s); None without a timetable."""
        due_ns = self.end.due_arrival_ns
        return (due_ns - int(self.motion.time_ns[0])) * NS if due_ns else None


def motion_of(table: DriveTable) -> DrivenMotion:
    """The motion of a recorded drive: the truth of a simulation, else smoothed positions and measured brake forces.

    Energies count as measured only in the recording of a simulated run; a replay records estimates. DasError if the
    recording has no usable positions.
    """
    time_ns, s_m, speed_mps, input_j, friction_j = table.of_topic(
        "truth", "s_m", "speed_mps", "energy_input_j", "friction_brake_j"
    )
    if len(time_ns) > 1:
        measured = table.knows_truth
        return DrivenMotion(
            time_ns=time_ns, s_m=s_m, speed_mps=speed_mps, input_j=input_j if measured else None,
            friction_j=friction_j if measured else None,
        )  # fmt: skip
    return smoothed_motions(table)(1.0)


def smoothed_motions(table: DriveTable) -> Callable[[float], DrivenMotion]:
    """A function that smooths the positions of a drive with a multiple of the usual density of jerk.

    The motion has the energy of the friction brake if the recording has brake forces. DasError for positions that
    cannot be used.
    """
    from sim.trips.profile import to_profile  # with cleaning and matching, which a simulated drive does not need
    from sim.trips.trip import recorded_trip

    trip = recorded_trip(table.recording, table.inputs.route)

    def smoothed(jerk_ratio: float) -> DrivenMotion:
        run = trip.run if jerk_ratio == 1.0 else to_profile(trip.matched, jerk_ratio)
        motion = DrivenMotion.of_run(run)
        return replace(motion, friction_j=_friction_j(table, motion.time_ns, motion.speed_mps))

    return smoothed


def _friction_j(table: DriveTable, time_ns: Times, speed_mps: Floats) -> Floats | None:
    """Energy of the friction brake since the start (J), from the forces that the train measured; None without them."""
    measured_ns, force_n = table.of_topic("effort", "force_friction_n")
    if len(measured_ns) < 2:
        return None
    power_w = -np.interp(time_ns, measured_ns, np.minimum(force_n, 0.0), left=0.0, right=0.0) * speed_mps
    step_j = 0.5 * (power_w[:-1] + power_w[1:]) * np.diff(time_ns) * NS
    return np.concatenate(([0.0], np.cumsum(step_j)))


def legs_of(
    path: Path, motion: DrivenMotion, made: Sequence[KeptCall], why_none: str = NOT_WHOLE
) -> tuple[DrivenLeg, ...]:
    """The legs of a drive between the stops that were served; if fewer than two, DasError with `why_none`."""
    found = tuple(_legs(motion, [call for call in made if call.served]))
    if not found:
        raise DasError(f"{path}: {NOT_COMPARABLE}: {why_none}")
    return found


def _legs(motion: DrivenMotion, served: list[KeptCall]) -> Iterator[DrivenLeg]:
    for start, end in pairwise(served):
        if not start.departed_ns or not end.arrived_ns or end.stood_m - start.stood_m < LEAST_WAY_M:
            continue
        leaving = int(np.searchsorted(motion.time_ns, start.departed_ns, side="right")) - 1
        arrived = int(np.searchsorted(motion.time_ns, end.arrived_ns))
        part = slice(max(leaving, 0), arrived + 1)
        cut = replace(motion, **{name: one[part] for name, one in vars(motion).items() if one is not None})
        time_ns, speed_mps = cut.time_ns.copy(), cut.speed_mps.copy()
        # From rest to rest: a leg lasts from the recorded departure to the arrival, and its optimum has all that time.
        time_ns[0], time_ns[-1] = start.departed_ns, end.arrived_ns
        speed_mps[0], speed_mps[-1] = start.passed_mps, end.passed_mps
        s_m = np.clip(np.maximum.accumulate(cut.s_m), cut.s_m[0], cut.s_m[-1])
        yield DrivenLeg(start=start, end=end, motion=replace(cut, time_ns=time_ns, speed_mps=speed_mps, s_m=s_m))


def open_calls(
    path: Path, motion: DrivenMotion, route: Route, vehicle: Vehicle, stood: Iterable[KeptCall] = ()
) -> tuple[KeptCall, ...]:
    """The ends of the longest part of a drive between equal speeds, and the stops in it.

    This part is used for a drive without a stand at each end; `stood` are the stops on the way. As much kinetic energy
    enters the part as leaves it. Both ends are within the limits of line and vehicle. `legs_of` cuts any smoothing of
    the motion at the same times and speeds. DasError if the part is shorter than 1 km; its text differs if the drive is
    faster than the vehicle.
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
        faster = f"the trip reaches {top_kmh:.0f} km/h, but the top speed of this train is {own_kmh:.0f} km/h"
        raise DasError(f"{path}: {NOT_COMPARABLE}: {faster if top_kmh > own_kmh else NO_PART}")
    if v[first] < STANDING_MPS:  # the part begins when the train leaves
        first = int(np.flatnonzero(s_m <= s_m[first])[-1])
    if v[last] < STANDING_MPS:
        last = int(np.flatnonzero(s_m >= s_m[last])[0])
    start, end = (_passing(motion, sample) for sample in (first, last))
    inside = [one for one in stood if start.s_m + LEAST_WAY_M < one.stood_m < end.s_m - LEAST_WAY_M]
    return (start, *inside, end)


def _passing(motion: DrivenMotion, sample: int) -> KeptCall:
    s_m, time_ns = float(motion.s_m[sample]), int(motion.time_ns[sample])
    speed_mps = float(motion.speed_mps[sample]) * bool(motion.speed_mps[sample] >= STANDING_MPS)
    return KeptCall(
        name=passing_name(s_m, speed_mps), s_m=s_m, due_arrival_ns=0, due_departure_ns=0,
        arrived_ns=time_ns, departed_ns=time_ns, stood_m=s_m, passed_mps=speed_mps,
    )  # fmt: skip


def legs_of_drive(table: DriveTable, made: Sequence[KeptCall], motion: DrivenMotion) -> tuple[DrivenLeg, ...]:
    """The legs of a recorded drive for one of its motions: between the stops, or in the part that a replay compared.

    `made` are the stops of its journey as served. DasError if there are no legs, with the reason that the recording
    states, if any.
    """
    said, path = table.said.saving, table.recording.path
    if said is None:
        return legs_of(path, motion, made)
    on_the_way = {one.start for one in said.sections[1:]} - {one.name for one in made}
    if on_the_way:
        stops = [one for one in table.inputs.route.stops if one.name in on_the_way]
        more = calls_on_the_way(stops, table.course, table.received)
        made = sorted((*made, *more), key=lambda one: one.s_m)
    if said.part:
        made = open_calls(path, motion_of(table), table.inputs.route, table.inputs.vehicle, made)
    return legs_of(path, motion, made, said.why_not or NOT_WHOLE)


def section_of_leg(inputs: DriveInputs, leg: DrivenLeg, told: Iterable[Restriction] = ()) -> Section:
    """The section of a leg, with these restrictions, and with its speeds at both ends (0 at a stop).

    Raises DasError if the train cannot run there.
    """
    first_m, last_m = float(leg.motion.s_m[0]), float(leg.motion.s_m[-1])
    restrictions = sorted(told)
    route = inputs.route.with_restrictions(restrictions) if restrictions else inputs.route
    start_m, end_m = max(first_m, 0.0), min(last_m, route.length_m)
    ends = SectionOptions(start_speed_mps=leg.start.passed_mps, end_speed_mps=leg.end.passed_mps)
    vehicle = fast_enough(inputs.vehicle, leg.motion)
    return build_section(route, vehicle, level=inputs.level, start_m=start_m, end_m=end_m, options=ends)


def fast_enough(vehicle: Vehicle, motion: DrivenMotion) -> Vehicle:
    """The vehicle with the highest speed of the drive as its top speed, if that is at most 5 % above its own.

    With its own top speed, no optimum could arrive as early as the drive. Losses must be known up to the higher speed.
    """
    top_mps, own_mps = float(motion.speed_mps.max()), vehicle.max_speed_mps
    losses = (one for one in vehicle.losses.values() if isinstance(one, LossMap))
    known_mps = min([CHOICE_OVERSPEED_RATIO * own_mps, *(float(one.speed_mps[-1]) for one in losses)])
    return replace(vehicle, max_speed_mps=top_mps) if own_mps < top_mps <= known_mps else vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class LegEnergies:
    """Energies at the current collector up to every sample of a leg (J), arrays of shape (samples,), 0 at the start.

    `balance_j`: as measured, else `blended_j`. `blended_j`: the same motion with the planned train, whose motors and
    friction brake share the braking as recorded. `motors_j`: the same motion with the planned train, whose motors brake
    first; `trajectory` is that motion, and `index[i]` the sample at its node i. `beyond_s` is the time (s) in which the
    motion needs more force than the planned train has, and `lacking_ratio` the largest share of a force that it lacks.
    """

    balance_j: Floats
    blended_j: Floats
    motors_j: Floats
    trajectory: Trajectory
    index: NDArray[np.intp]
    beyond_s: float
    lacking_ratio: float

    @property
    def driven_j(self) -> float:
        """Energy at the current collector as driven (J)."""
        return float(self.balance_j[-1])


def leg_energies(section: Section, leg: DrivenLeg) -> LegEnergies:
    """The energies of a driven leg by inverse dynamics, and as measured."""
    motion = leg.motion
    driven = estimate_run(section, leg.time_s, motion.s_m, motion.speed_mps)
    nodes, index = np.arange(len(motion.s_m)), driven.index
    motors_j = np.interp(nodes, index, driven.energy_input_j)
    blended_j = motors_j
    if motion.friction_j is not None:
        extra_j = _blended_input_j(section, driven.trajectory, np.diff(motion.friction_j[index]))
        blended_j = np.interp(nodes, index, np.concatenate(([0.0], np.cumsum(extra_j))))
    balance_j = blended_j if motion.input_j is None else motion.input_j - motion.input_j[0]
    return LegEnergies(
        balance_j=balance_j,
        blended_j=blended_j,
        motors_j=motors_j,
        trajectory=driven.trajectory,
        index=index,
        beyond_s=float(driven.trajectory.interval_s()[driven.beyond].sum()),
        lacking_ratio=driven.lacking_ratio,
    )


def since_departure_j(
    legs: Sequence[DrivenLeg], energies: Sequence[LegEnergies], time_ns: Times, name: str = "balance_j"
) -> Floats:
    """Energy since the first departure (J) at moments (ns), summed over the legs: at stops in between nothing counts.

    `name` names an array of `LegEnergies`.
    """
    total_j = np.zeros(len(time_ns))
    for leg, one in zip(legs, energies, strict=True):
        total_j += np.interp(time_ns, leg.motion.time_ns, getattr(one, name))
    return total_j


def _blended_input_j(section: Section, run: Trajectory, friction_j: Floats) -> Floats:
    """Energy drawn in each interval (J) if the friction brake took `friction_j` and the motors all the rest.

    While the planned train must brake for the motion, the friction brake takes no more than that; otherwise the motors
    pulled against it.
    """
    total_n, taken_n = run.force_el_n + run.force_friction_n, -friction_j / np.diff(run.s_m)
    friction_n = np.where(total_n < 0.0, np.maximum(taken_n, total_n), taken_n)
    electric_n, mean_mps = total_n - friction_n, run.mean_speed_mps()
    if isinstance(section.loss, LossMap):
        mean_mps = np.minimum(mean_mps, section.loss.speed_mps[-1])
        low_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_low_n)
        high_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_high_n)
        loss_j = section.loss.loss_w(np.clip(electric_n, low_n, high_n), mean_mps) * run.interval_s()
    else:
        loss_j = section.loss.loss_w(electric_n, mean_mps) * run.interval_s()
    gross_j = electric_n * np.diff(run.s_m) + loss_j
    return np.where(gross_j > 0, gross_j, np.clip(run.supply, 0.0, 1.0) * gross_j)


Smoothed = Callable[[float], Sequence[DrivenLeg]]
"""A function that returns the legs of a drive if its record is smoothed with a multiple of the usual jerk density."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedLeg:
    """A driven leg with its energies, and the planned train's front and optimum for the same trip time.

    Front and optimum ignore temporary restrictions.
    """

    leg: DrivenLeg
    front: Front
    optimum: Solution
    energies: LegEnergies

    @classmethod
    def of(cls, leg: DrivenLeg, front: Front) -> ComparedLeg:
        """A driven leg with the front of its section."""
        optimum = front.trajectory(leg.trip_s)
        return cls(leg=leg, front=front, optimum=optimum, energies=leg_energies(front.section, leg))

    @property
    def driven_j(self) -> float:
        """Energy at the current collector as driven (J)."""
        return self.energies.driven_j

    @property
    def section_energy(self) -> SectionEnergy:
        """The energies of the leg as driven and of its optimum."""
        return self._beside_optimum(self.driven_j)

    @property
    def motors_first(self) -> SectionEnergy:
        """The energies of the leg and of its optimum if the planned train drives this motion and its motors brake
        first, whatever was measured."""
        return self._beside_optimum(float(self.energies.motors_j[-1]))

    def _beside_optimum(self, driven_j: float) -> SectionEnergy:
        found = SectionEnergy.of(self.leg.start.name, self.leg.end.name, driven_j, self.optimum)
        # The measured train did run like this. If the planned train cannot, the measured one may have been lighter.
        return replace(found, beyond_s=self.energies.beyond_s if self.leg.motion.input_j is None else 0.0)


def beside_optima(inputs: DriveInputs, legs: Iterable[DrivenLeg]) -> tuple[ComparedLeg, ...]:
    """The legs with the optima of the planned train; DasError if that train cannot run there."""
    return tuple(ComparedLeg.of(leg, solve_front(section_of_leg(inputs, leg))) for leg in legs)


@dataclass(frozen=True, kw_only=True)
class LikelyRange:
    """The likely range (J) of the energy above the optimum, and its range for each unknown on its own.

    Mass, resistance, wind and the smoothing of the positions are independent of each other, so their deviations add as
    squares. The kind of braking is no deviation: `by_friction_j` is the energy above the optimum if the friction brake
    did all braking, in the drive and in its optimum; NaN if such a train could not have driven so, or if forces were
    measured.
    """

    low_j: float
    high_j: float
    by_friction_j: float
    unknowns: tuple[Unknown, ...]


def likely_range(legs: Sequence[ComparedLeg], smoothed: Smoothed | None) -> LikelyRange:
    """The likely range of an estimated energy above the optimum.

    Train, wind and brakes are the same for the drive and its optimum in every case, and in all legs. A case in which
    the train could not have driven a leg in its trip time is left out; the assumed case must be possible. Without
    `smoothed`, the motion is taken to be known.
    """
    above_j = _above_in_cases(legs, smoothed)
    beyond_ratio = sum(one.energies.beyond_s for one in legs) / sum(one.leg.trip_s for one in legs)
    doubt_ratio = doubt(beyond_ratio, max(one.energies.lacking_ratio for one in legs))
    unknowns = one_by_one(above_j, doubt_ratio)
    middle_j = sum(one.driven_j for one in legs) - sum(one.optimum.balance.input for one in legs)
    spread = [one for one in unknowns if one.name != BRAKING]
    known = any(leg.leg.motion.friction_j is not None for leg in legs)
    friction_j = None if known else above_j(DrivenCase(all_friction=True))
    return LikelyRange(
        low_j=middle_j - math.hypot(*(min(one.low_j - middle_j, 0.0) for one in spread)),
        high_j=middle_j + math.hypot(*(max(one.high_j - middle_j, 0.0) for one in spread)),
        by_friction_j=math.nan if friction_j is None else friction_j,
        unknowns=unknowns,
    )


def _above_in_cases(legs: Sequence[ComparedLeg], smoothed: Smoothed | None) -> Callable[[DrivenCase], float | None]:
    """A function that gives the energy above the optimum (J) in a case; None if the train cannot have moved so.

    Without `smoothed`, the motion stays as it is, even in a case with other smoothing.
    """
    best_runs = [cache(partial(_best_run, one)) for one in legs]
    again = None if smoothed is None else cache(smoothed)

    def above_j(case: DrivenCase) -> float | None:
        jerk_ratio, case = case.jerk_ratio, replace(case, jerk_ratio=1.0)
        driven = [one.leg for one in legs] if again is None or jerk_ratio == 1.0 else again(jerk_ratio)
        total_j = 0.0
        for one, leg, best_run in zip(legs, driven, best_runs, strict=True):
            # If the braking was measured, the kind of braking is known.
            best = best_run(case if leg.motion.friction_j is None else replace(case, all_friction=False))
            if best is None:
                return None
            same = best is one.optimum and leg is one.leg
            driven_j = one.driven_j if same else leg_energies(best.section, leg).driven_j
            total_j += driven_j - best.balance.input
        return total_j

    return above_j


def _best_run(one: ComparedLeg, case: DrivenCase) -> Solution | None:
    if case == DrivenCase():
        return one.optimum
    try:
        section = one.front.section
        train = rebuilt(section, case.train(section.vehicle), case.brakes(section))
        best = solve_front(train).trajectory(one.leg.trip_s)
    except DasError:  # this train cannot run here
        return None
    return None if best.fit is Fit.LATE else best
