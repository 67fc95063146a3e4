"""Braking ahead: where a train must begin to brake, and the effort that keeps the limits and the stop ahead.

A braking effort is a share of the motors' braking force at the present speed, so one effort serves for a whole brake
application. An effort above 1 uses the friction brake as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import kernels
from das.advice.regimes import FULL_RATIO, Regime
from das.solver.kernels.forces import traction_limit
from das.solver.section import Section, without_motors

Floats = NDArray[np.float64]

STOP_SLACK_M = 1.0
"""Largest distance beyond a stop (m) at which braking may end: the driver finds the mark by eye."""
SPEED_SLACK_MPS = 0.2
"""Largest excess (m/s) over the planned speed at which a train need not brake, and over a lower limit at which braking
may end: a driver cannot read a smaller difference."""
LEVEL_MPS = 1e-6
"""Decrease (m/s) of the speed over an interval below which a braking curve counts as level."""
BEGINS_MPS = 0.05
"""Decrease (m/s) of the speed ahead above which a braking curve counts as falling."""
BACK_IN_S = 4.0
"""Time (s) in which the force of an instruction leads to its speed, or a train above a limit comes back to it."""
LEAST_MPS2 = 0.02
"""Deceleration (m/s²) below which it is too early to brake for a lower speed ahead."""
BRAKED_MORE = 1.1
"""Factor by which a train above its plan brakes harder than needed, so that it need not brake harder later."""
AT_MARK_M = 10.0
"""Distance (m) from a stop within which the driver sees the mark; a train that stands further off is short of it."""
ALIKE = 0.9
"""Share of the largest needed effort; places that need at least that share count as equally urgent."""
RIVALS = 0.8
"""Share of the largest deceleration needed; an effort is computed only for places that need at least that share."""


def braking_mode(effort: float) -> Regime:
    """The mode of a braking effort: part of the motors' braking, all of it, or the friction brake as well."""
    if effort < FULL_RATIO:
        return Regime.REDUCED_BRAKE
    return Regime.FULL_BRAKE if effort <= 1.0 + 1e-3 else Regime.FRICTION_BRAKE


class NeededBrake(NamedTuple):
    """The braking effort needed (0: none), the speed to brake to (m/s), and where it must be reached (m)."""

    effort: float
    target_mps: float = math.inf
    at_m: float = math.inf


class _Foot(NamedTuple):
    """The foot of a braking curve: its place, its speed, and the way with brakes up to there."""

    at_m: float
    speed_mps: float
    braked_m: float


class BrakingAhead:
    """The braking that the limits and the stop ahead need; `Section.guarded_mps` contains the braking curves."""

    def __init__(self, section: Section) -> None:
        self.section = section
        # The brake policy may exclude the friction brake from plans; a train that is too fast uses it all the same.
        self._train = section.train._replace(friction_force_n=section.vehicle.friction_brake_force_n)
        envelope = section.guarded_mps
        self._planned_w = envelope**2
        self._falls = np.append(envelope[1:] < envelope[:-1] - LEVEL_MPS, False)
        feet = np.flatnonzero(np.append(False, self._falls[:-1]) & ~self._falls)
        supplies, which = np.unique(section.supply, return_inverse=True)
        brakes = np.array([kernels.most_braked(1.0, one, self._train) > 0.0 for one in supplies.tolist()])
        self._braked_m = np.append(0.0, np.cumsum(section.step_m * brakes[which]))
        columns = np.column_stack((section.node_m, envelope, self._braked_m))
        self._feet = [_Foot(*one) for one in columns[feet].tolist()]
        self._demanded = list(_demanded(section))
        self._half_build_up_s = 0.5 * section.vehicle.service_brake.build_up_s
        # While a brake is announced, the same effort is computed every second.
        self.effort_to = lru_cache(maxsize=64)(self._effort_to)
        """The least effort that slows the train from a place (m) and speed (m/s) to a place and speed there; the
        largest if none is enough."""

    @staticmethod
    @lru_cache(maxsize=4)
    def of(section: Section) -> BrakingAhead:
        """The braking ahead on a section, one for all parts of the advice, which ask for the same efforts."""
        return BrakingAhead(section)

    def is_due(self, s_m: float, v_mps: float, within_s: float = 0.0) -> bool:
        """Whether a train that keeps its speed will exceed a braking curve ahead within a time (s)."""
        least_mps = self.lowest_mps(s_m, v_mps * within_s)
        if v_mps <= least_mps + SPEED_SLACK_MPS:
            return False
        falls = self._falls[kernels.interval(self.section.node_m, s_m)]
        return bool(falls or least_mps < self.lowest_mps(s_m) - BEGINS_MPS)

    def lowest_mps(self, s_m: float, way_m: float = 0.0) -> float:
        """The lowest speed (m/s) of the planned braking curves over a distance (m) from a position."""
        return math.sqrt(kernels.lowest_w(s_m, s_m + way_m, self.section.node_m, self._planned_w))

    def allowed_mps(self, s_m: float) -> float:
        """The highest speed (m/s) from which full braking at `feared_m` still keeps every limit and the stop."""
        return float(np.interp(self.feared_m(s_m), self.section.node_m, self.section.allowed_mps))

    def feared_m(self, s_m: float) -> float:
        """The furthest position (m) of a train estimated at `s_m`: ahead by the position error that plans allow
        for, but not beyond the place from which the driver sees the mark."""
        planned, mark_m = self.section.braking, self.section.end_m - AT_MARK_M
        return s_m if planned is None else max(s_m, min(s_m + planned.deviation_m, mark_m))

    def nodes_ahead(self, s_m: float) -> int:
        """The number of nodes ahead of a position; the last node counts as ahead of every position."""
        return len(self.section.step_m) - int(kernels.interval(self.section.node_m, s_m))

    def curve_begins_m(self, s_m: float, speeds_mps: Floats) -> float:
        """The place (m) where a train with these speeds at the nodes ahead meets a braking curve (else the last node
        but one); if the train is above the curve here, the speeds are first reduced by that excess."""
        nodes, envelope, first = self.section.node_m, self.section.guarded_mps, len(self._planned_w) - len(speeds_mps)
        here_mps = self.lowest_mps(s_m)
        above_mps = max(float(speeds_mps[0]) - here_mps, 0.0)
        reached = int(kernels.meets_curve(above_mps, SPEED_SLACK_MPS, speeds_mps, envelope, self._planned_w))
        if reached < 0:
            return max(float(nodes[-2]), s_m)
        # Squares of speeds are linear in the distance.
        told_mps = [max(one - above_mps, 0.0) for one in speeds_mps[max(reached - 1, 0) : reached + 1].tolist()]
        left_w = float(self._planned_w[first + reached]) - told_mps[-1] * told_mps[-1]
        from_m, before_w = s_m, max(here_mps**2 - told_mps[0] ** 2, 0.0)
        if reached:
            from_m = float(nodes[first + reached - 1])
            before_w = float(self._planned_w[first + reached - 1]) - told_mps[0] * told_mps[0]
        share = before_w / max(before_w - left_w, 1e-9)
        return float(from_m + share * (float(nodes[first + reached]) - from_m))

    def sooner_s(self, s_m: float, v_mps: float) -> float:
        """The time (s) before the braking curve ahead at which a train with a speed (m/s) begins to brake.

        The curve to a lower limit contains the delay of the brakes only for the speed difference (`ServiceBraking`).
        """
        foot_mps = next((one.speed_mps for one in self._feet if one.at_m > s_m and one.speed_mps < v_mps), 0.0)
        return self._half_build_up_s * foot_mps / max(v_mps, 1.0)

    def rolling_mps(self, s_m: float, v_mps: float, braked_n: float = 0.0) -> Floats:
        """The speeds (m/s) at all nodes ahead of a train that coasts from here, or brakes with a force (N, > 0)."""
        section = self.section
        speeds = np.full(self.nodes_ahead(s_m), v_mps, dtype=float)
        kernels.rolling(s_m, v_mps**2, braked_n, section.node_m, section.for_kernels, section.train, speeds)
        return speeds

    def gaining_mps(self, s_m: float, v_mps: float) -> Floats:
        """The highest speeds (m/s) at all nodes ahead of a train that accelerates from here with all its traction."""
        return self.rolling_mps(s_m, v_mps, -float(traction_limit(max(v_mps, 0.1), self.section.train)))

    def rolls_to_brakes_mps(self, s_m: float, v_mps: float) -> float:
        """The speed (m/s) with which a coasting train reaches the next place where it has a brake."""
        here = kernels.interval(self.section.node_m, s_m) + 1
        behind = np.flatnonzero(np.diff(self._braked_m[here:]) > 0.0)
        return float(self.rolling_mps(s_m, v_mps)[behind[0] if behind.size else -1])

    def ahead_s(self, s_m: float, v_mps: float, speeds_mps: Floats, to_m: float) -> float:
        """The time (s) until a train with these speeds at the nodes ahead reaches a place (m)."""
        return float(kernels.passed_after(s_m, v_mps, speeds_mps, self.section.node_m, to_m))

    def needed(self, s_m: float, v_mps: float) -> NeededBrake:
        """The least braking from here that keeps every limit and the stop ahead; the largest if none is enough."""
        here_m = float(np.interp(s_m, self.section.node_m, self._braked_m))
        rates_mps2 = {
            foot: (v_mps**2 - foot.speed_mps * foot.speed_mps) / (2.0 * max(foot.braked_m - here_m, 1.0))
            for foot in self._feet
            if foot.at_m > s_m and foot.speed_mps < v_mps - SPEED_SLACK_MPS
        }
        largest_mps2 = max(rates_mps2.values(), default=0.0)
        if largest_mps2 < LEAST_MPS2:
            return NeededBrake(0.0)
        rivals = [
            NeededBrake(self.effort_to(s_m, v_mps, foot.at_m, foot.speed_mps), foot.speed_mps, foot.at_m)
            for foot, rate_mps2 in rates_mps2.items()
            if rate_mps2 >= RIVALS * largest_mps2
        ]
        most = max(one.effort for one in rivals)
        # Of places that need nearly the same effort, the nearest is named: the driver reaches it first.
        nearest = next(one for one in rivals if one.effort >= ALIKE * most)
        return nearest._replace(effort=most)

    def _effort_to(self, s_m: float, v_mps: float, to_m: float, target_mps: float) -> float:
        effort = self._least_effort(s_m, v_mps, to_m, target_mps)
        return self.by_policy(effort, s_m, v_mps) if to_m > s_m else effort

    def by_policy(self, effort: float, s_m: float, v_mps: float) -> float:
        """An effort of at most 1 if plans exclude the friction brake, unless limits or the stop ahead demand more."""
        if effort <= 1.0 or self.section.train.friction_force_n > 0.0:
            return effort
        ahead = (self._least_effort(s_m, v_mps, *one) for one in self._demanded if one[0] > s_m and one[1] < v_mps)
        return min(effort, max(BRAKED_MORE * max(ahead, default=effort), 1.0))

    def _least_effort(self, s_m: float, v_mps: float, to_m: float, target_mps: float) -> float:
        section = self.section
        stops = target_mps <= SPEED_SLACK_MPS
        to_m, target_mps = (to_m + STOP_SLACK_M, 0.0) if stops else (to_m, target_mps + SPEED_SLACK_MPS)
        if to_m <= s_m:
            return self.largest(s_m, v_mps)
        first = int(kernels.interval(section.node_m, s_m))
        final = min(max(int(np.searchsorted(section.node_m, to_m)) - 1, first), len(section.step_m) - 1)
        return float(
            kernels.needed_effort(
                s_m, v_mps, first, final, to_m, target_mps, section.node_m, section.for_kernels, self._train
            )
        )

    def largest(self, s_m: float, v_mps: float) -> float:
        """The effort of all brakes available here together, at a speed; 0 if there are none."""
        return float(kernels.largest_effort(max(v_mps, 0.1), self._supply(s_m), self._train))

    def stop_is_next(self, s_m: float, v_mps: float) -> bool:
        """Whether the train only has to brake for the stop: no limit below its speed lies before the stop."""
        return not any(s_m < foot.at_m < self.section.end_m and foot.speed_mps < v_mps for foot in self._feet)

    def full(self, s_m: float, v_mps: float) -> float:
        """The effort of full braking here, as used for the curve of the highest allowed speeds."""
        section, v, supply = self.section, max(v_mps, 0.1), self._supply(s_m)
        train = section.train if supply >= 0.0 else without_motors(section.vehicle, section.train)
        slowed_n = train.max_deceleration_mps2 * train.inertial_mass_kg - section.resistance_n(s_m, v)
        full_n = min(float(kernels.most_braked(v, supply, train)), max(slowed_n, 0.0))
        return float(min(full_n / float(kernels.full_effort(v, self._train)), self.largest(s_m, v)))

    def force_n(self, effort: float, s_m: float, v_mps: float) -> float:
        """The wheel force (N, <= 0) of a braking effort here, at most the force available."""
        return -float(kernels.braked(effort, max(v_mps, 0.1), self._supply(s_m), self._train))

    def effort_of(self, rate_mps2: float, s_m: float, v_mps: float) -> float:
        """The braking effort that decelerates the train at a rate (m/s²) here, at most what its brakes give."""
        section, v = self.section, max(v_mps, 0.1)
        force_n = section.train.inertial_mass_kg * rate_mps2 - section.resistance_n(s_m, v)
        full_n = float(kernels.full_effort(v, self._train))
        return min(max(force_n / full_n, 0.0), self.largest(s_m, v)) if full_n > 0.0 else 0.0

    def back_under(self, s_m: float, v_mps: float, limit_mps: float) -> NeededBrake:
        """The braking that brings a train above a limit back to it within `BACK_IN_S`; effort 0 if it is not above."""
        excess_mps = v_mps - limit_mps
        effort = self.effort_of(excess_mps / BACK_IN_S, s_m, v_mps) if excess_mps > 0 else 0.0
        return NeededBrake(effort, limit_mps, s_m)

    def rolls_mps2(self, s_m: float, v_mps: float) -> float:
        """The acceleration (m/s²; < 0: it slows down) of a train that coasts here."""
        return -self.section.resistance_n(s_m, v_mps) / self.section.train.inertial_mass_kg

    def accelerates_mps2(self, share: float, s_m: float, v_mps: float) -> float:
        """The acceleration (m/s²) of the train here with a share of its largest traction."""
        train = self.section.train
        gained = share * float(traction_limit(max(v_mps, 0.1), train)) / train.inertial_mass_kg
        return gained + self.rolls_mps2(s_m, v_mps)

    def _supply(self, s_m: float) -> float:
        return float(self.section.supply[kernels.interval(self.section.node_m, s_m)])


def _demanded(section: Section) -> Iterator[tuple[float, float]]:
    """The places (m) for which limits or the stop demand a brake, with the speeds (m/s) that plans keep there."""
    planned = section.braking
    early_m, below_mps = (planned.deviation_m, planned.below_limit_mps) if planned else (0.0, 0.0)
    for i in (np.flatnonzero(np.diff(section.limit_mps) < -LEVEL_MPS) + 1).tolist():
        yield float(section.node_m[i]) - early_m, float(section.limit_mps[i]) - below_mps
    yield section.end_m, 0.0
