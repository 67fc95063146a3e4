"""A leg: a section of the journey under way, with its timetable, its planner and its display."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from das.advice.advice import Advice, Timetable, Withdrawal
from das.advice.braking import AT_MARK_M
from das.advice.display import Display, Scene
from das.advice.goal import AT_END_M, AT_STOP_M, Goal, PassingTarget, SpeedsAllowed, TrainState, is_too_fast
from das.advice.guide.guard import STEP_RATIO
from das.advice.guide.guide import Guide
from das.advice.planner import Planner
from das.advice.reason import Reason, ReasonCode
from das.cab.heard import Target
from das.domain.errors import DasError
from das.domain.route import Stop
from das.domain.units import NS
from das.estimate.estimate import Estimate
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.guide.policies import GuideFront
from das.solver.section import Section

SHORT_M: Final = 15.0
"""Distance (m) before its stop beyond which a train that has stood gets no advice until it has drawn forward."""
AHEAD_DEVIATIONS: Final = 2.0
"""Largest number of standard deviations by which the train is assumed to be ahead of its estimated position."""
LEAST_WAY_M = 2.0
"""Least distance (m) of a timing point from both ends of its section."""


class NoPlanError(DasError):
    """No plan finishes the section from the state of the train."""


class Leg:
    """One section of the journey under way: it takes timetable, targets and delay, and advises for a known state."""

    def __init__(self, start: Stop, end: Stop, section: Section, guide: Guide | None = None) -> None:
        self.start, self.end = start, end
        self.section = section
        """The section with which the leg is planned now."""
        self.planner, self.display = Planner(section), Display()
        self.guide = guide
        """The guide of the section; None: the train is advised without one."""
        self.arrival_ns: int | None = None
        """The arrival that traffic management wants (ns since 1970); None: by the timetable."""
        self.points: list[PassingTarget] = []
        """The points to pass within windows of time, in the order of the line."""
        self.goal = Goal()
        """The times that the train has to keep now; `refresh_goal` brings it up to date."""
        self.here: Estimate | None = None
        """The last state of the train on the leg; None if it cannot be used."""
        self._arrived_ns: int | None = None
        self.reached_m = -math.inf
        """Position (m) that the train has reached."""
        self.refusal = ""
        """Why the section cannot be driven; empty if it can."""
        self.stood_short = False
        """Whether the train has stood clearly short of the leg's first stop, and has not reached it yet."""
        self._too_fast = False

    def use(self, planner: Planner) -> None:
        """Plan with another planner from now on."""
        self.planner, self.section = planner, planner.section
        self.use_guide(None)

    def use_guide(self, front: GuideFront | None) -> None:
        """Lead the driver by these policies, continuing where the last guide ended; None: there is no reference yet."""
        if self.guide is not None:
            self.guide = self.guide.successor(self.section, front)

    def use_meanwhile(self, section: Section) -> None:
        """Plan for a changed section without a front yet: the last plan applies, capped by the speeds safe now."""
        self.use(Planner(section, before=self.planner.plan or self.planner.before))

    def set_timetable(self, timetable: Timetable, *, counts: bool = True) -> None:
        """Take over a timetable, and whether being on time counts at its end; raises DasError if it leaves no time."""
        timetable.check()
        if (timetable.departure_ns, timetable.arrival_ns) != (self.goal.departure_ns, self.goal.due_ns):
            self.planner.forget()
        self.goal = replace(self.goal, departure_ns=timetable.departure_ns, due_ns=timetable.arrival_ns, counts=counts)

    def set_delay(self, delay_s: float) -> None:
        """Take over the delay that the operator states (s), for the reason only: plans follow the timetable."""
        self.goal = replace(self.goal, operator_delay_s=delay_s if math.isfinite(delay_s) else None)

    def see(self, here: Estimate) -> None:
        """Take over the state of the train."""
        self.here = here if here.usable else None
        if self.here is None:
            return
        short_m = self.section.start_m - here.s_m
        if here.speed_mps < STANDSTILL_MPS:
            self.stood_short = short_m > SHORT_M
        elif short_m < AT_END_M:
            self.stood_short = False

    def refresh_goal(self) -> None:
        """Bring the goal up to date: the arrival, and the next point ahead of the last known position."""
        if self.here is not None:
            self.reached_m = self.here.s_m
        points = self.points
        passing = next((one for one in points if one.s_m > self.reached_m), None) if points else None
        before = self.goal
        if self.arrival_ns == before.target_ns and passing == before.passing:
            return
        point, here = before.passing, self.here
        # If the train has passed the goal's point and no other follows, the plan continues.
        is_behind = passing is None and point is not None and here is not None and here.s_m >= point.s_m
        if self.arrival_ns != before.target_ns or (passing != point and not is_behind):
            self.planner.forget()
        self.goal = replace(before, target_ns=self.arrival_ns, passing=passing)

    def advise(self, here: Estimate) -> Advice:
        """The advice for a usable state, at its time; raises NoPlanError if no plan finishes the section from it."""
        planner = self.planner
        state = self._state(here)
        allowed_mps = planner.allowed_for(state)
        self._too_fast = is_too_fast(state.v_mps - allowed_mps, told=self._too_fast)
        limit_mps = min(planner.limit_mps(state.s_m), planner.limit_mps(state.braked_m))
        place = SpeedsAllowed(allowed_mps, limit_mps, self._too_fast)
        scene = Scene(state, here, planner, self.goal, place)
        beyond_m, stands = state.s_m - self.section.end_m, state.v_mps < STANDSTILL_MPS
        if not stands or beyond_m < -AT_STOP_M:
            self._arrived_ns = None
        if stands and (reason := self._stays(state, beyond_m)) is not None:
            if self.guide is not None:
                left_s = max((self.goal.departure_ns - state.now_ns) * NS, 0.0)
                scene = scene._replace(guide=self.guide.stands(left_s))
            return self.display.standing(scene, reason)
        if beyond_m >= -AT_END_M:
            needed = planner.ahead.effort_to(state.s_m, state.v_mps, self.section.end_m, 0.0)
            reason = Reason(code=ReasonCode.STOP, stop=self.section.end_stop_name)
            return self._braking(scene, reason, needed)
        try:
            kept = None if self.guide is None else self.guide.plan(state, self.goal)
            plan = planner.plan_for(state, self.goal, None if kept is None else kept.scheduled)
            if self.guide is not None:
                show = self.guide.departs if stands else self.guide.show
                scene = scene._replace(guide=show(kept, state, self.goal, place))
                if kept is not None:
                    scene = scene._replace(late_s=self.guide.keeper.arrival_late_s(kept, state, self.goal))
            return self.display.departing(scene, plan) if stands else self.display.following(scene, plan)
        except DasError as error:
            if state.v_mps > planner.allowed_mps(state.s_m):
                return self._braking(scene, Reason(code=ReasonCode.NO_PLAN, text=str(error)))
            raise NoPlanError(str(error)) from error

    def _state(self, here: Estimate) -> TrainState:
        """The state to advise for, including how much further ahead the train may be than plans allow for."""
        section = self.section
        s_m = max(here.s_m, section.start_m)
        planned_m = 0.0 if section.braking is None else section.braking.deviation_m
        ahead_m = min(AHEAD_DEVIATIONS * here.position_sd_m - planned_m, section.end_m - AT_MARK_M - s_m)
        return TrainState(here.time_ns, s_m, here.speed_mps, max(ahead_m, 0.0))

    def withdraw(self, here: Estimate, why: Withdrawal) -> Advice:
        """The message that withdraws advice, with the cause. The plan is dropped unless the display is only quiet."""
        self._too_fast = False
        if not why.cause.is_quiet:
            self._forget()
        elif self.guide is not None:
            self.guide.showing.forget()
        return self.display.withdrawn(here, why)

    def _braking(self, scene: Scene, reason: Reason, needed: float = math.inf) -> Advice:
        """Advise full brakes without a plan; the guide shows the `needed` effort, but no less than it shows already."""
        shown = 0.0 if self.guide is None else self.guide.showing.shown_effort
        if self.guide is not None and math.isfinite(needed) and self.guide.showing.stands_at_mark(scene.state):
            needed = shown
        self._forget()
        advice = self.display.braking(scene, reason)
        if self.guide is None:
            return advice
        ahead, state = self.planner.ahead, scene.state
        largest = advice.advised_force_n / min(ahead.force_n(1.0, state.s_m, state.v_mps), -1.0)
        effort = max(min(max(needed, STEP_RATIO), largest), min(shown, ahead.largest(state.s_m, state.v_mps)))
        force_n = ahead.force_n(effort, state.s_m, state.v_mps)
        return replace(advice, guide=self.guide.brakes(effort, force_n, reason, state))

    def _forget(self) -> None:
        """Drop the plan and the reference of the guide."""
        self.planner.forget()
        if self.guide is not None:
            self.guide.forget()

    def _stays(self, state: TrainState, beyond_m: float) -> Reason | None:
        """The reason why a train that stands has to stay; the lateness of an arrival does not grow meanwhile."""
        goal, now_ns = self.goal, state.now_ns
        if beyond_m >= -AT_STOP_M:
            self._arrived_ns = min(self._arrived_ns or now_ns, now_ns)
            return Reason(code=ReasonCode.ARRIVED, late_s=(self._arrived_ns - goal.arrival_ns) * NS)
        if state.s_m <= self.section.start_m + AT_STOP_M and now_ns < goal.departure_ns:
            return Reason(code=ReasonCode.DEPARTURE, time_ns=goal.departure_ns)
        return None


def assign_targets(targets: Sequence[Target], legs: Sequence[Leg]) -> tuple[tuple[Target, ...], list[str]]:
    """Assign each target to its leg and drop all earlier ones; returns the accepted targets and the refusals' texts."""
    for leg in legs:
        leg.arrival_ns, leg.points = None, []
    accepted, refused = [], []
    for target in targets if legs else ():
        try:
            _assign(target, legs)
            accepted.append(target)
        except DasError as error:
            refused.append(str(error))
    for leg in legs:
        leg.points.sort(key=lambda point: point.s_m)
    return tuple(accepted), refused


def _assign(target: Target, legs: Sequence[Leg]) -> None:
    for leg in legs:
        end_m = leg.end.position_m
        at_end = leg.end.name.casefold() == target.stop.casefold() if target.stop else target.s_m == end_m
        if at_end:
            if target.arrival_ns <= 0:
                raise DasError(f"{leg.end.name}: no arrival is given")
            leg.arrival_ns = target.arrival_ns
            return
        if not target.stop and leg.start.position_m + LEAST_WAY_M <= target.s_m <= end_m - LEAST_WAY_M:
            leg.points.append(
                PassingTarget(
                    s_m=target.s_m,
                    earliest_ns=target.earliest_ns or None,
                    latest_ns=target.latest_ns or None,
                    reason=target.reason,
                )
            )
            return
    raise DasError(f"{target.stop or f'{target.s_m:.0f} m'} is not on the way to a stop of this journey")
