"""The last word's own model of a line and a train: the highest speeds from which full braking is still in time.

It is made from the route, the train and the restrictions alone. It shares no code with the solver, so that an error in
the solver is not repeated here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import last_word_kernels as kernels
from das.advice.regimes import Regime
from das.domain.conditions import Conditions
from das.domain.restriction import Restriction
from das.domain.route import Route
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import BrakePolicy, Vehicle
from das.estimate.estimate import Estimate

Floats = NDArray[np.float64]

LIMIT_TOLERANCE_MPS = 0.5
"""Half of the 1 m/s by which no train may ever exceed a limit or braking curve; the other half is for the driver."""
STOP_TOLERANCE_M = 5.0
"""Half of the 10 m by which no train may ever pass a stop; the driver finds the mark by eye, from about 2 m/s on."""
STEP_M = 20.0
"""Longest step (m) of the braking curve, which also has a step wherever a limit or the supply changes: gradients and
curves act slowly on a whole train."""
BEYOND_TOP_MPS = 20.0
"""Speed above the train's top speed (m/s) up to which forces are tabulated."""
BEHIND_M = 100.0
"""Distance before the section (m) at which the model begins: a train about to depart may still stand there."""


class BrakingBasis(NamedTuple):
    """What the highest speeds depend on: line, train, brakes, restrictions, conditions, and the ends of the section."""

    route: Route
    vehicle: Vehicle
    brakes: BrakePolicy
    restrictions: tuple[Restriction, ...]
    conditions: Conditions
    start_m: float
    end_m: float
    point_mass: bool = False


class Needed(NamedTuple):
    """The deceleration (m/s²) that a train needs, the speed (m/s) that it must slow down to, and where (m)."""

    rate_mps2: float
    speed_mps: float
    at_m: float


class BrakingModel:
    """Limits, full braking and forces of one train on one section.

    The train uses the brakes that its policy names, without the electric brake where the line does not take its power.
    Where mass or resistance were measured, the model is cautious: the train is never lighter, and never has more
    resistance, than its file says. Gradients and curves are averaged over the length of the train.
    """

    def __init__(self, basis: BrakingBasis) -> None:
        measured = basis.conditions
        careful = replace(
            measured,
            mass_ratio=max(measured.mass_ratio, 1.0),
            resistance_ratio=min(measured.resistance_ratio, 1.0),
        )
        train, self.end_m = careful.train(basis.vehicle), basis.end_m
        self.vehicle = train
        self.end_stop = basis.route.stop_name_at(basis.end_m)
        length_m = 0.0 if basis.point_mass else train.train_length_m
        nodes_m = _nodes(basis, length_m)
        limit_mps = np.minimum(_limits(basis, nodes_m, length_m), train.max_speed_mps)
        places = np.empty((kernels.PLACES, len(nodes_m) - 1))
        places[kernels.LIMIT] = np.where(nodes_m[:-1] < basis.end_m, limit_mps, 0.0)
        places[kernels.LINE] = _line_mps2(basis, nodes_m, length_m) * (train.mass_kg / train.inertial_mass_kg)
        supply = basis.route.supply().minimum(nodes_m[:-1], nodes_m[1:])
        places[kernels.MOTORS] = (supply >= 0) | (basis.brakes is BrakePolicy.FRICTION)
        places[kernels.ALLOWED + 2] = places[kernels.LIMIT] ** 2
        # The model ends where the tolerance beyond the stop ends; there the train stands at the latest.
        places[kernels.BOUND + 2] = (limit_mps + LIMIT_TOLERANCE_MPS) ** 2
        self.line = nodes_m, places, _forces_n(train)
        self.train = *self.line, train.inertial_mass_kg, min(train.max_deceleration_mps2, 1e6)
        """The model as the kernels take it: the arrays of `line`, then the train's mass and largest deceleration."""
        for row in (kernels.ALLOWED, kernels.BOUND):
            kernels.fill_curve(*self.train, row)

    @property
    def mass_kg(self) -> float:
        """The inertial mass (kg) of the train, with its rotating parts."""
        return self.train[3]

    def limit_mps(self, s_m: float) -> float:
        """The limit over the train (m/s) with its head at a position; 0 beyond the end of the section."""
        nodes_m, places, _ = self.line
        return float(places[kernels.LIMIT, kernels.interval(nodes_m, s_m)])

    def highest_limit_mps(self, from_m: float, to_m: float) -> float:
        """The highest limit over the train (m/s) with its head anywhere between two positions."""
        nodes_m, places, _ = self.line
        return float(kernels.highest_limit(nodes_m, places, from_m, to_m))

    def allowed_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a position from which full braking keeps every limit and the stop."""
        return float(kernels.speed_at(*self.line[:2], kernels.ALLOWED, s_m))

    def bound_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a position from which full braking keeps limits and stop within the tolerances."""
        return float(kernels.speed_at(*self.line[:2], kernels.BOUND, s_m))

    def traction_n(self, v_mps: float) -> float:
        """The largest traction (N) at a speed."""
        return float(kernels.force_at(self.line[2], kernels.TRACTION, v_mps))

    def electric_n(self, v_mps: float) -> float:
        """The largest force (N, > 0) of the electric brake at a speed."""
        return float(kernels.force_at(self.line[2], kernels.ELECTRIC, v_mps))

    def has_motors(self, s_m: float) -> bool:
        """Whether the electric brake is available at a position."""
        nodes_m, places, _ = self.line
        return bool(places[kernels.MOTORS, kernels.interval(nodes_m, s_m)] > 0)

    def most_brake_n(self, v_mps: float) -> float:
        """The largest force (N, > 0) of all brakes of the train at a speed, friction included."""
        return float(kernels.force_at(self.line[2], kernels.MOST, v_mps))

    def resisting_n(self, s_m: float, v_mps: float) -> float:
        """The resistance (N) at a position and speed: running resistance, gradient and curves."""
        return float(kernels.resisting(*self.line, self.mass_kg, s_m, v_mps))

    def needed(self, s_m: float, v_mps: float, within_s: float) -> Needed:
        """The least constant deceleration from here that keeps every limit ahead and the stop.

        A train above the limit where it is comes down to that limit within `within_s` as well.
        """
        nodes_m, places, _ = self.line
        i = int(kernels.interval(nodes_m, s_m))
        here_mps = float(places[kernels.LIMIT, i])
        found = Needed(max((v_mps - here_mps) / within_s, 0.0), here_mps, s_m)
        limits_mps, begins_m = places[kernels.LIMIT, i + 1 :], nodes_m[i + 1 : -1]
        if len(begins_m):
            rates = (v_mps**2 - limits_mps**2) / (2.0 * np.maximum(begins_m - s_m, 0.1))
            k = int(np.argmax(rates))
            if rates[k] > found.rate_mps2:
                found = Needed(float(rates[k]), float(limits_mps[k]), float(begins_m[k]))
        return found


def _forces_n(train: Vehicle) -> Floats:
    """The forces (N) of a train at speeds 0.1 m/s apart, in the rows that the kernels name."""
    speeds = np.arange(0.0, train.max_speed_mps + BEYOND_TOP_MPS, 1.0 / kernels.STEPS_PER_MPS)
    electric_n, both_n = train.electric_brake_effort_n(speeds), train.brake_effort_n(speeds)
    friction_n = np.minimum(train.friction_brake_force_n, both_n)
    blends = train.brake_policy is not BrakePolicy.ELECTRIC
    rows = {
        kernels.TRACTION: train.traction_effort_n(speeds),
        kernels.ELECTRIC: electric_n,
        kernels.MOST: both_n,
        kernels.BRAKE: both_n if blends else electric_n,
        kernels.BRAKE_WITHOUT_MOTORS: friction_n if blends else np.zeros(len(speeds)),
        kernels.RUNNING: train.resistance.force_n(speeds),
    }
    return np.array([rows[row] for row in range(len(rows))])


def _nodes(basis: BrakingBasis, length_m: float) -> Floats:
    """The nodes (m): every place where a limit or the supply changes, and more in between."""
    route, last_m = basis.route, basis.end_m + STOP_TOLERANCE_M
    begins_m = basis.start_m - BEHIND_M
    rising_m = [route.limits_mps.start_m, *(np.array([x.end_m]) for x in basis.restrictions)]
    zones = (*route.neutral_sections, *route.no_regeneration)
    found = np.concatenate(
        (
            *rising_m,
            *(places_m + length_m for places_m in rising_m),
            [x.start_m for x in basis.restrictions],
            [edge_m for zone in zones for edge_m in (zone.start_m, zone.start_m + zone.length_m)],
            np.arange(begins_m, last_m, STEP_M),
            [basis.end_m, last_m],
        )
    )
    found = np.unique(found[(found >= begins_m) & (found <= last_m)])
    apart = np.concatenate((np.diff(found) > 1e-3, [True]))
    return np.asarray(found[apart])


def _limits(basis: BrakingBasis, nodes_m: Floats, length_m: float) -> Floats:
    """For each interval, the lowest limit (m/s) over the whole train, with the restrictions in force."""
    from_m, to_m = nodes_m[:-1], nodes_m[1:]
    limit = basis.route.limits_mps.minimum(from_m - length_m, to_m)
    middle_m = 0.5 * (from_m + to_m)
    for one in basis.restrictions:
        inside = (middle_m > one.start_m) & (middle_m < one.end_m + length_m)
        limit = np.where(inside, np.minimum(limit, one.limit_mps), limit)
    return limit


def _line_mps2(basis: BrakingBasis, nodes_m: Floats, length_m: float) -> Floats:
    """The deceleration (m/s², uphill > 0) of a train by gradient and curves, averaged over its length."""
    found = np.zeros(len(nodes_m) - 1)
    resistance = basis.vehicle.line_resistance_mps2(basis.route)
    for stretches, factor in ((basis.route.gradients_ratio, STANDARD_GRAVITY_MPS2), (resistance, 1.0)):
        middle_m = 0.5 * (nodes_m[:-1] + nodes_m[1:])
        over = stretches.mean(middle_m - length_m, middle_m) if length_m > 0 else stretches.at(middle_m)
        found += factor * over
    return found


SDS_AHEAD = 2.0
"""Standard deviations by which the train is assumed to be ahead of its estimated position."""
BY_EYE_M = 10.0
"""Distance (m) from which the driver sees the mark; the train is assumed nearer to it only if its estimated position
is."""
HELD_ABOVE_MPS = 1.0
"""Largest excess over the allowed speed (m/s) at which a driver may be told to hold a lower speed; beyond it he must
brake."""
BACK_IN_S = 5.0
"""Time (s) in which strong enough braking brings a train back under a limit."""
FULL_RATIO = 0.97
"""Share of the full braking force from which braking counts as full: nothing stronger can be asked for."""
FORCE_RATIO = 1.02
"""Multiple of the largest force at a speed up to which a force counts as available: the difference is rounding."""
LONGEST_S = 30.0
"""Longest time (s) ahead for which announced braking is judged; braking later than that is announced and judged
again."""
STOPPED_MPS = 0.1
"""Speed (m/s) below which a train counts as standing."""


class Doing(NamedTuple):
    """What the driver does until a time (s): he applies a wheel force (N) to reach a speed (m/s).

    `holds`: he then holds the speed, with whatever force that takes. `of_n` > 0: the braking force is a share of
    the electric brake, and grows with it as the train slows down; `of_n` is the force of the electric brake (N) at the
    start. `of_n` = 0: the braking force is constant.
    """

    until_s: float
    force_n: float
    speed_mps: float
    holds: bool = False
    of_n: float = 0.0


class Excess(NamedTuple):
    """A speed (m/s) that is too high, and the highest safe speed (m/s) there (NaN: it could not be judged)."""

    value_mps: float
    bound_mps: float


class Consequences:
    """Predicts how a train moves until its advice expires, for whatever its driver does.

    The train starts from `ahead_m`: it may be ahead of its estimated position by `SDS_AHEAD` standard deviations.
    """

    def __init__(self, model: BrakingModel, here: Estimate, valid_s: float) -> None:
        self.model, self.v_mps = model, max(here.speed_mps, 0.0)
        self.valid_s = min(max(valid_s, kernels.STEP_S), LONGEST_S)
        """Time (s) for which the advice is still valid."""
        deviation_m = SDS_AHEAD * here.position_sd_m
        self.behind_m, self.s_m = here.s_m - deviation_m, here.s_m
        self.ahead_m = min(here.s_m + deviation_m, max(here.s_m, model.end_m - BY_EYE_M))
        """The furthest position (m) at which the train may be."""

    def excess(self, doings: Sequence[Doing], lasts_s: float, since_s: float = 0.0) -> Excess | None:
        """The first speed between `since_s` and `lasts_s` that is too high if the driver does `doings`, or None."""
        done = np.array(doings, dtype=float)
        tuned = FULL_RATIO, HELD_ABOVE_MPS, STOPPED_MPS, BACK_IN_S
        found = kernels.first_excess(*self.model.train, done, self.ahead_m, self.v_mps, since_s, lasts_s, tuned)
        return Excess(*found) if found[0] >= 0 else None

    def braking(self) -> tuple[float, Needed]:
        """The braking force (N, <= 0) needed from here, and the speed and place that need it.

        If the constant force computed from the needed deceleration does not suffice, all brakes are applied fully.
        """
        model, v_mps = self.model, self.v_mps
        needed = model.needed(self.ahead_m, v_mps, self.valid_s)
        wanted_n = needed.rate_mps2 * model.mass_kg - model.resisting_n(self.ahead_m, v_mps)
        most_n = model.most_brake_n(v_mps)
        force_n = -min(max(wanted_n, 0.0), most_n)
        doing = Doing(math.inf, force_n, needed.speed_mps)
        return (force_n if self.excess([doing], self.valid_s) is None else -most_n), needed

    @property
    def sees_only_mark(self) -> bool:
        """Whether no limit below the train's speed begins before the stop."""
        nodes_m, places, _ = self.model.line
        ahead = (nodes_m[:-1] > self.ahead_m) & (nodes_m[:-1] < self.model.end_m)
        return not (places[kernels.LIMIT][ahead] < self.v_mps).any()

    def by_eye_n(self) -> float:
        """The wheel force (N, <= 0) of a driver who sees nothing but his mark and brakes evenly to it."""
        model, v_mps = self.model, self.v_mps
        way_m = max(model.end_m - self.ahead_m, 0.5)
        wanted_n = model.mass_kg * v_mps**2 / (2.0 * way_m) - model.resisting_n(self.ahead_m, v_mps)
        return -min(max(wanted_n, 0.0), model.most_brake_n(v_mps))

    def mode_of(self, force_n: float) -> Regime:
        """The mode of a braking force (N, <= 0) here; the friction brake if the electric brake is not enough."""
        electric_n = self.model.electric_n(self.v_mps) if self.model.has_motors(self.ahead_m) else 0.0
        if force_n >= 0:
            return Regime.COAST
        if -force_n > electric_n * FORCE_RATIO:
            return Regime.FRICTION_BRAKE
        return Regime.FULL_BRAKE if -force_n >= FULL_RATIO * electric_n else Regime.REDUCED_BRAKE

    def unavailable(self, force_n: float, v_mps: float) -> Excess | None:
        """An excess if the train does not have this force (N) at the speed `v_mps`, so that no driver can apply it.

        The forces are those of this very speed: at a step of an effort curve, the table's may be a tenth off.
        """
        vehicle = self.model.vehicle
        most_n = float(vehicle.traction_effort_n(v_mps) if force_n > 0 else vehicle.brake_effort_n(v_mps))
        return Excess(self.v_mps, math.nan) if abs(force_n) > FORCE_RATIO * most_n + 1.0 else None

    def braked_horizon(self, force_n: float, to_mps: float, seconds: int) -> dict[str, tuple[float, ...]]:
        """The horizon fields of advice, by name, for braking with a force (N) to a speed (m/s).

        No speed is above what is allowed.
        """
        model, s_m, v_mps = self.model, self.ahead_m, self.v_mps
        doing = np.array(Doing(math.inf, force_n, to_mps), dtype=float)
        speeds: list[float] = []
        forces: list[float] = []
        for _ in range(seconds):
            for _ in range(round(1.0 / kernels.STEP_S)):
                after_mps = float(kernels.after_step(*model.line, model.mass_kg, doing, s_m, v_mps))
                s_m, v_mps = s_m + 0.5 * (v_mps + after_mps) * kernels.STEP_S, after_mps
            forces.append(force_n if v_mps > to_mps else 0.0)
            speeds.append(min(v_mps, model.allowed_mps(s_m), *speeds[-1:]))
        return {"horizon_speed_mps": tuple(speeds), "horizon_force_n": tuple(forces)}

    def brake_n(self, effort_ratio: float) -> float:
        """The braking force (N) of an effort: a share of the motors' brake now, or of all brakes if there is none."""
        return effort_ratio * (self.model.electric_n(self.v_mps) or self.model.most_brake_n(self.v_mps))
