"""Braking ahead: where a train must begin to brake, and the effort that keeps the limits and the stop ahead.

A braking effort is a share of the motors' braking force at the present speed, so one effort serves for a whole brake
application. An effort above 1 uses the friction brake as well.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import kernels
from das.advice.regimes import FULL_RATIO, Regime
from das.solver.kernels.forces import brake_limit, on_supply, traction_limit
from das.solver.kernels.tuples import TrainParams
from das.solver.section import Section

Floats = NDArray[np.float64]

STOP_SLACK_M = 1.0
"""Largest distance beyond a stop (m) at which braking may end: the driver finds the mark by eye."""
SPEED_SLACK_MPS = 0.2
"""Largest excess over a lower limit (m/s) at which braking may end: a driver cannot read a smaller difference."""
ABOVE_MPS = 0.2
"""Largest excess (m/s) over the planned speed at which a train need not brake."""
LEVEL_MPS = 1e-6
"""Decrease (m/s) of the speed over an interval below which a braking curve counts as level."""
BEGINS_MPS = 0.05
"""Decrease (m/s) of the speed ahead above which a braking curve counts as falling."""
BACK_IN_S = 4.0
"""Time (s) in which a train above a limit is braked back to it."""
LEAST_MPS2 = 0.02
"""Deceleration (m/s²) below which it is too early to brake for a lower speed ahead."""
BRAKED_MORE = 1.1
"""Factor by which a train above its plan brakes harder than needed, so that it need not brake harder later."""
AT_MARK_M = 10.0
"""Distance (m) from a stop at which the driver sees the mark, however uncertain the position is."""
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


NOTHING = NeededBrake(0.0)


class BrakingAhead:
    """The braking that the limits and the stop ahead need; the section's envelope contains the braking curves."""

    def __init__(self, section: Section) -> None:
        self.section = section
        # The brake policy may exclude the friction brake from plans; a train that is too fast uses it all the same.
        self._train = section.train._replace(friction_force_n=section.vehicle.friction_brake_force_n)
        envelope = section.envelope_mps
        self._planned_w = envelope**2
        self._falls = np.append(envelope[1:] < envelope[:-1] - LEVEL_MPS, False)
        feet = np.flatnonzero(np.append(False, self._falls[:-1]) & ~self._falls)
        self._foot_m, self._foot_mps = section.node_m[feet], envelope[feet]
        _, firsts, which = np.unique(section.supply, return_index=True, return_inverse=True)
        brakes = np.array([_most_n(section, self._train, i, 1.0) > 0.0 for i in firsts.tolist()])
        self._braked_m = np.append(0.0, np.cumsum(section.step_m * brakes[which]))
        # While a brake is announced, the same effort is computed every second.
        self.effort_to = lru_cache(maxsize=64)(self._effort_to)
        """The least effort that slows the train from a place (m) and speed (m/s) to a place and speed there; the
        largest if none is enough."""

    def is_due(self, s_m: float, v_mps: float, within_s: float = 0.0) -> bool:
        """Whether a train that keeps its speed will exceed a braking curve ahead within a time (s)."""
        least_mps = self.lowest_mps(s_m, v_mps * within_s)
        if v_mps <= least_mps + ABOVE_MPS:
            return False
        return bool(self._falls[_interval(self.section, s_m)] or least_mps < self.lowest_mps(s_m) - BEGINS_MPS)

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
        return len(self.section.node_m) - 1 - _interval(self.section, s_m)

    def curve_begins_m(self, s_m: float, speeds_mps: Floats) -> float:
        """The place (m) where a train with these speeds at the nodes ahead meets a braking curve (else the last node
        but one); if the train is above the curve here, the speeds are first reduced by that excess."""
        nodes, first = self.section.node_m, len(self.section.node_m) - len(speeds_mps)
        here_mps = self.lowest_mps(s_m)
        above_mps = max(float(speeds_mps[0]) - here_mps, 0.0)
        told_mps = np.maximum(speeds_mps - above_mps, 0.0)
        crosses = self.section.envelope_mps[first:] < told_mps - ABOVE_MPS
        if not crosses.any():
            return max(float(nodes[-2]), s_m)
        left_w = self._planned_w[first:] - told_mps**2  # Squares of speeds are linear in the distance.
        below = np.flatnonzero(left_w[: int(np.argmax(crosses))] >= 0.0)
        reached = int(below[-1]) + 1 if below.size else 0
        before_w = float(left_w[reached - 1]) if reached else max(here_mps**2 - float(told_mps[0]) ** 2, 0.0)
        from_m = float(nodes[first + reached - 1]) if reached else s_m
        share = before_w / max(before_w - float(left_w[reached]), 1e-9)
        return from_m + min(share, 1.0) * (float(nodes[first + reached]) - from_m)

    def rolling_mps(self, s_m: float, v_mps: float, braked_n: float = 0.0) -> Floats:
        """The speeds (m/s) at all nodes ahead of a train that coasts from here, or brakes with a force (N, > 0)."""
        section, train, here = self.section, self.section.train, _interval(self.section, s_m)
        speeds = np.full(len(section.node_m) - here - 1, v_mps)
        step_m = section.step_m[here:].copy()
        step_m[0] = section.node_m[here + 1] - s_m
        for _ in range(2):  # First with the running resistance at the present speed, then at the speeds just found.
            per_w_n = train.c2_n_per_mps2 + section.tunnel_n_per_mps2[here:]
            running_n = train.c0_n + train.c1_n_per_mps * speeds + per_w_n * speeds**2
            lost_j = np.cumsum((running_n + section.constant_n[here:] + braked_n) * step_m)
            speeds = np.sqrt(np.maximum(v_mps**2 - 2.0 * lost_j / train.inertial_mass_kg, 0.0))
        return speeds

    def gaining_mps(self, s_m: float, v_mps: float) -> Floats:
        """The highest speeds (m/s) at all nodes ahead of a train that accelerates from here with all its traction."""
        return self.rolling_mps(s_m, v_mps, -float(traction_limit(max(v_mps, 0.1), self.section.train)))

    def rolls_to_brakes_mps(self, s_m: float, v_mps: float) -> float:
        """The speed (m/s) with which a coasting train reaches the next place where it has a brake."""
        here = _interval(self.section, s_m) + 1
        behind = np.flatnonzero(np.diff(self._braked_m[here:]) > 0.0)
        return float(self.rolling_mps(s_m, v_mps)[behind[0] if behind.size else -1])

    def ahead_s(self, s_m: float, v_mps: float, speeds_mps: Floats, to_m: float) -> float:
        """The time (s) until a train with these speeds at the nodes ahead reaches a place (m)."""
        at_m = np.append(s_m, self.section.node_m[-len(speeds_mps) :])
        speeds = np.append(v_mps, speeds_mps)
        steps_s = 2.0 * np.diff(at_m) / np.maximum(speeds[1:] + speeds[:-1], 0.1)
        return float(np.interp(to_m, at_m, np.append(0.0, np.cumsum(steps_s))))

    def needed(self, s_m: float, v_mps: float) -> NeededBrake:
        """The least braking from here that keeps every limit and the stop ahead; the largest if none is enough."""
        ahead = (self._foot_m > s_m) & (self._foot_mps < v_mps - SPEED_SLACK_MPS)
        place_m, speed_mps = self._foot_m[ahead], self._foot_mps[ahead]
        here_m, *ways_m = np.interp([s_m, *place_m], self.section.node_m, self._braked_m).tolist()
        rate_mps2 = (v_mps**2 - speed_mps**2) / (2.0 * np.maximum(np.array(ways_m) - here_m, 1.0))
        largest = float(rate_mps2.max(initial=0.0))
        if largest < LEAST_MPS2:
            return NOTHING
        rivals = [
            NeededBrake(self.effort_to(s_m, v_mps, at_m, to_mps), to_mps, at_m)
            for rate, at_m, to_mps in zip(rate_mps2.tolist(), place_m.tolist(), speed_mps.tolist(), strict=True)
            if rate >= RIVALS * largest
        ]
        most = max(rivals).effort
        # Of places that need nearly the same effort, the nearest is named: the driver reaches it first.
        return next(one for one in rivals if one.effort >= ALIKE * most)._replace(effort=most)

    def _effort_to(self, s_m: float, v_mps: float, to_m: float, target_mps: float) -> float:
        section = self.section
        stops = target_mps <= SPEED_SLACK_MPS
        to_m, target_mps = (to_m + STOP_SLACK_M, 0.0) if stops else (to_m, target_mps + SPEED_SLACK_MPS)
        if to_m <= s_m:
            return self.largest(s_m, v_mps)
        first = _interval(section, s_m)
        final = min(max(int(np.searchsorted(section.node_m, to_m)) - 1, first), len(section.step_m) - 1)
        return float(
            kernels.needed_effort(
                s_m, v_mps, first, final, to_m, target_mps, section.node_m, section.for_kernels, self._train
            )
        )

    def largest(self, s_m: float, v_mps: float) -> float:
        """The effort of all brakes available here together, at a speed; 0 if there are none."""
        v = max(v_mps, 0.1)
        full_n = float(kernels.full_effort(v, self._train))
        return _most_n(self.section, self._train, _interval(self.section, s_m), v) / full_n if full_n > 0.0 else 0.0

    def stop_is_next(self, s_m: float, v_mps: float) -> bool:
        """Whether the train only has to brake for the stop: no limit below its speed lies before the stop."""
        return not ((self._foot_m > s_m) & (self._foot_m < self.section.end_m) & (self._foot_mps < v_mps)).any()

    def full(self, s_m: float, v_mps: float) -> float:
        """The effort of full braking here, as used for the curve of the highest allowed speeds."""
        section, v = self.section, max(v_mps, 0.1)
        here = on_supply(section.train, section.supply[_interval(self.section, s_m)])
        slowed_n = here.max_deceleration_mps2 * here.inertial_mass_kg - section.resistance_n(s_m, v)
        full_n = min(float(brake_limit(v, here, here.friction_force_n)), max(slowed_n, 0.0))
        return float(min(full_n / float(kernels.full_effort(v, self._train)), self.largest(s_m, v)))

    def force_n(self, effort: float, s_m: float, v_mps: float) -> float:
        """The wheel force (N, <= 0) of a braking effort here, at most the force available."""
        v = max(v_mps, 0.1)
        most_n = _most_n(self.section, self._train, _interval(self.section, s_m), v)
        return -min(effort * float(kernels.full_effort(v, self._train)), most_n)

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


def _interval(section: Section, s_m: float) -> int:
    return min(max(int(np.searchsorted(section.node_m, s_m, side="right")) - 1, 0), len(section.step_m) - 1)


def _most_n(section: Section, train: TrainParams, interval: int, v_mps: float) -> float:
    """The force (N) of all brakes that a train has in an interval of a section, at a speed."""
    here = on_supply(train, section.supply[interval])
    return float(brake_limit(v_mps, here, here.friction_force_n))
