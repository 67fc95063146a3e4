"""The planner of a section: its plan is the optimal trajectory from the train's state, or keeps the guide's reference.

A plan is kept while the train stays near it. The same inputs give the same plans, bit for bit.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from das.advice import kernels
from das.advice.advice import Source
from das.advice.braking import BrakingAhead
from das.advice.goal import AT_END_M, LONGEST_RATIO, Goal, PassingTarget, TrainState
from das.advice.guide.planning import Wanted, planned
from das.advice.plan import Plan
from das.domain.errors import DasError
from das.domain.journey import Window
from das.domain.units import NS
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.front import Front
from das.solver.guide.policies import GuideFront
from das.solver.guide.schedule import Schedule, Scheduled
from das.solver.section import Section, capped
from das.solver.solution import Solution
from das.solver.state import fastest, least_time_s

FASTER_BAND_MPS: Final = 0.8
"""Largest excess over the planned speed (m/s) with which a plan is kept."""
SLOWER_BAND_MPS: Final = 1.4
"""Largest shortfall below the planned speed (m/s) with which a plan is kept."""
TIME_BAND_S: Final = 2.0
"""Largest earliness or lateness (s) with which a plan is kept."""
LONGEST_AGE_S: Final = 60.0
"""Age (s) above which a plan is replaced by a new one."""
TOLERANCE_S: Final = 0.2
"""Largest difference (s) between a plan's arrival and the wanted one."""
BRAKED_EARLY_S: Final = 5.0
"""Least saving of time (s) for which a driver who braked early for a limit or stop is advised to speed up again."""
BRAKING_AHEAD_MPS2: Final = 0.25
"""Needed deceleration (m/s²) that shows that the train already brakes for a limit or stop ahead."""
SLOWER_THAN_PLANNED_MPS: Final = 1.0
"""Shortfall (m/s) below the planned speed that shows that a driver has braked early for a limit or stop."""
OVERSPEED_EASED_MPS: Final = 1.0
"""Largest excess over the planned braking curve (m/s) with which a plan starts on the curve, without hard braking."""
PASSED_M: Final = 5.0
"""Distance (m) to a point that counts as passed: it is too near for a plan to change the time of passing."""


class Planner:
    """Makes the plans of a section, and keeps each while the train follows it.

    `front` holds the optimal trajectories. While it is not known yet (None), the plan is the fastest safe trajectory,
    nowhere faster than `before`, the last plan. `passing` holds the guide's policies for a point's window of time.
    """

    def __init__(
        self,
        section: Section,
        front: Front | None = None,
        *,
        passing: GuideFront | None = None,
        before: Plan | None = None,
    ) -> None:
        self.section, self.front, self.passing, self.before = section, front, passing, before
        self.allowed_w = self.section.allowed_mps**2
        self._planned_w = self.section.envelope_mps**2
        self.plan: Plan | None = None
        """The plan behind the present advice; None if the next state needs a new one."""
        self.ahead = BrakingAhead.of(self.section)
        """The braking that limits and the stop ahead need."""
        self._braked_early = False
        self._schedule: Schedule | None = None
        self._own_source = Source.FALLBACK if front is None else Source.SOLVED
        self.source = self._own_source
        """The basis of the present plan."""

    def forget(self) -> None:
        """Drop the plan, because it no longer applies."""
        self.plan = None

    def plan_for(self, state: TrainState, goal: Goal, reference: Scheduled | None = None) -> Plan:
        """The plan for a state: the present one if the train follows it, else a new one.

        If the guide has a `reference`, the plan keeps to it, so that all parts of the advice agree. Raises DasError for
        a state outside the section, InfeasibleError if the train cannot reach the end of the section.
        """
        schedule = None if reference is None else reference.schedule
        self.source = Source.TABLE if reference is not None and reference.finished else self._own_source
        if self.plan is None or schedule is not self._schedule or not self._follows(self.plan, state):
            self._schedule = schedule
            section, v_mps = self.section, state.v_mps
            planned = float(kernels.allowed(section.node_m, self._planned_w, section.limit_mps, state.s_m))
            eased = planned < v_mps <= planned + OVERSPEED_EASED_MPS
            at_least_s = BRAKED_EARLY_S if self._brakes_early(state) else 0.0
            start = state._replace(v_mps=planned) if eased else state
            if reference is None:
                solution = self._solution(start, goal, at_least_s)
            else:
                solution = reference.solution(start.s_m, start.v_mps, goal.aimed_s(state.now_ns))
            self.plan = Plan.of(solution, self.section, state.now_ns)
        return self.plan

    def allowed_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a position from which the limits and the stop can still be kept."""
        section = self.section
        return float(kernels.allowed(section.node_m, self.allowed_w, section.limit_mps, s_m))

    def allowed_for(self, state: TrainState) -> float:
        """The highest speed (m/s) allowed for a train whose true position may be ahead of the estimated one."""
        return self.lowest_allowed_mps(state.s_m, self.ahead.feared_m(state.braked_m))

    def lowest_allowed_mps(self, from_m: float, to_m: float) -> float:
        """The lowest allowed speed (m/s) between two positions (m); 0 from the end of the section on."""
        return math.sqrt(kernels.lowest_w(from_m, to_m, self.section.node_m, self.allowed_w))

    def limit_mps(self, s_m: float) -> float:
        """The speed limit (m/s) over the train."""
        return float(self.section.limit_mps[kernels.interval(self.section.node_m, s_m)])

    def _follows(self, plan: Plan, state: TrainState) -> bool:
        here = plan.at(state.s_m)
        age_s = (state.now_ns - plan.made_ns) * NS
        if state.v_mps < STANDSTILL_MPS and plan.force_n[here.interval] < 0:
            return False  # The train stands where the plan brakes: the plan has no departure.
        return (
            0 <= age_s <= LONGEST_AGE_S
            and -SLOWER_BAND_MPS <= state.v_mps - here.speed_mps <= FASTER_BAND_MPS
            and abs(age_s - here.time_s) <= TIME_BAND_S
        )

    def _brakes_early(self, state: TrainState) -> bool:
        """Whether the driver braked early (below the planned speed) for a limit or stop that is still ahead."""
        s_m, v_mps = state.s_m, state.v_mps
        slower = self.plan is not None and self.plan.at(s_m).speed_mps - v_mps > SLOWER_THAN_PLANNED_MPS
        ahead = self.section.node_m > s_m + AT_END_M
        way_m = self.section.node_m[ahead] - s_m
        falls = v_mps**2 - self._planned_w[ahead] > 2.0 * BRAKING_AHEAD_MPS2 * way_m
        self._braked_early = bool(np.any(falls)) and (slower or self._braked_early)
        return self._braked_early

    def _solution(self, state: TrainState, goal: Goal, at_least_s: float) -> Solution:
        """The optimal trajectory for the time left; with very much time left, the slowest trajectory that is planned.

        The trajectory takes at least `at_least_s` longer than the fastest one.
        """
        if self.front is None:
            return self._cautious(state)
        least_s = least_time_s(self.section, state.s_m, state.v_mps)
        left_s = max(goal.aimed_s(state.now_ns), least_s + at_least_s if at_least_s else 1e-3)
        longest_s = LONGEST_RATIO * least_s
        free = self.front.trajectory(min(left_s, longest_s), state.s_m, state.v_mps, tolerance_s=TOLERANCE_S)
        point = goal.passing
        if point is None or self.passing is None or state.s_m >= point.s_m - PASSED_M:
            return free
        window, free_s = point.window(state.now_ns), passed_s(free, point)
        # A driver ahead of the plan by this time still counts as following it.
        earliest_s = window.earliest_s + TIME_BAND_S
        if earliest_s <= free_s <= window.latest_s:
            return free
        window = Window(earliest_s=earliest_s) if free_s < earliest_s else Window(latest_s=window.latest_s)
        wanted = Wanted(s_m=state.s_m, v_mps=state.v_mps, left_s=left_s, point_m=point.s_m, window=window)
        return planned(self.passing, wanted).solution(state.s_m, state.v_mps, left_s)

    def _cautious(self, state: TrainState) -> Solution:
        """The trajectory of the previous plan, slowed to what is safe now; the fastest one if there is no such plan."""
        if self.before is not None:
            try:
                speeds_w = np.interp(self.section.node_m, self.before.solution.trajectory.s_m, self.before.speed_w)
                return fastest(capped(self.section, np.sqrt(speeds_w)), state.s_m, state.v_mps)
            except DasError:
                pass  # At the speeds of the previous plan the train would stall on a hill.
        return fastest(self.section, state.s_m, state.v_mps)


def passed_s(solution: Solution, point: PassingTarget) -> float:
    """The time at which a trajectory passes a point (s from its start)."""
    run = solution.trajectory
    return float(np.interp(point.s_m, run.s_m, run.t_s))
