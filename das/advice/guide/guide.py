"""The guide of a section: it keeps the reference and chooses the instruction to show, with the reason."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import replace
from itertools import takewhile

import numpy as np

from das.advice.advice import Guidance, Instruction, Replan, ReplanCause
from das.advice.braking import BrakingAhead, Floats
from das.advice.goal import Goal, SpeedsAllowed, TrainState
from das.advice.guide.drift import Drift
from das.advice.guide.keeping import LEAST_AGE_S, Keeper, Kept
from das.advice.guide.showing import Showing
from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import BRAKES, KIND_OF, TRACTION, Regime
from das.advice.shown import SPEED_STEP_MPS, STOP_BY_EYE_M, TARGET_STEP_MPS, as_read
from das.advice.worker import AT_ONCE
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.domain.route import Route
from das.domain.units import KMH, NS
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.guide.policies import LEAST_MPS, GuideFront
from das.solver.guide.schedule import PhaseKind, Schedule
from das.solver.section import Section

NEAR_M = 4000.0
"""The distance (m) within which the reason names the limit or stop that an instruction leads to."""
BESIDE_M = 100.0
"""The largest distance (m) of a limit beyond the end of the phase that slows down for it."""
BINDS_MPS = 10.0 * KMH
"""The largest difference (m/s) between a limit and the forecast speed there at which the limit can be the reason."""
SAID_LATE_S = 30.0
"""The least lateness or earliness (s), at the stop or a timing point, that is stated: a driver cannot correct less."""
SAID_ANEW_S = 10.0
"""The change (s) from which a stated lateness is updated: a figure that changes often is not read."""
CREEPS_M = 100.0
"""The last distance (m) before the stop, over which a train too slow for any reference creeps to it."""
SLOWING = (PhaseKind.COAST, PhaseKind.BRAKE)
NOT_FASTER = (*SLOWING, PhaseKind.HOLD)


class Guide:
    """Leads a driver along one section, by instructions that follow a reference (standing plan) made by a `worker`."""

    def __init__(
        self, section: Section, front: GuideFront | None, worker: Executor = AT_ONCE, drift: Drift | None = None
    ) -> None:
        self._section, self._worker = section, worker
        self._ahead_of_train = BrakingAhead.of(section)
        self.drift = drift or Drift()
        """The driver's drift, as measured so far."""
        self.keeper = Keeper(section, front, worker, self.drift)
        """Keeper of the reference."""
        self.showing = Showing()
        """Instruction shown, second by second."""
        self._news: tuple[Restriction, ...] = ()
        self._lost = False
        self._said_late_s = 0.0
        self._reasoned: tuple[Instruction, Reason] = Instruction(), NO_REASON

    def successor(self, section: Section, front: GuideFront | None) -> Guide:
        """The guide that takes over from this one, with another front or under other limits."""
        found = Guide(section, front, self._worker, self.drift)
        found.keeper.take_over(self.keeper)
        found.showing = self.showing
        found._said_late_s, found._reasoned = self._said_late_s, self._reasoned
        known = self._section.route.restrictions
        found._news = tuple(one for one in section.route.restrictions if one not in known) or self._news
        return found

    def forget(self) -> None:
        """Drop the reference and the memory of what was shown."""
        self.keeper.forget()
        self.showing.forget()
        self._said_late_s = 0.0

    def plan(self, state: TrainState, goal: Goal) -> Kept | None:
        """The reference for a state, kept or new; None if there is none yet, or none that leads to the stop."""
        self._lost = False
        try:
            return self.keeper.keep(state, goal, changes=self.showing.changes)
        except DasError:
            self._lost = True
            return None

    def show(self, kept: Kept | None, state: TrainState, goal: Goal, place: SpeedsAllowed) -> Guidance | None:
        """The present and the next instructions for the driver; None if there is no reference."""
        if kept is None:
            return self._creeping(state, place) if self._lost else None
        shown = self.showing.show(kept, state, place)
        return self._as_read(replace(shown, reason=self._reason(kept, shown.now, state, goal, place)), state)

    def _as_read(self, found: Guidance, state: TrainState) -> Guidance:
        near = self._section.end_m - state.s_m < STOP_BY_EYE_M
        sees_mark = near and self._ahead_of_train.stop_is_next(state.s_m, state.v_mps)
        return as_read(found, self._section.largest_n(state.v_mps), sees_mark=sees_mark)

    def _creeping(self, state: TrainState, place: SpeedsAllowed) -> Guidance | None:
        """The advice to creep to the stop, for a train so slow that no reference leads there; None for a faster one."""
        if state.v_mps > LEAST_MPS or self._section.end_m - state.s_m > CREEPS_M:
            return None
        reason = Reason(code=ReasonCode.STOP, stop=self._section.end_stop_name)
        return self._as_read(replace(self.showing.creeping(self._section, state, place), reason=reason), state)

    def stands(self, departs_in_s: float = 0.0) -> Guidance:
        """The advice for a train that stands at a stop and departs in `departs_in_s`."""
        self.showing.forget()
        return Guidance(now=Instruction(mode=Regime.STOP, speed_mps=0.0, effort_ratio=0.0), target_s=departs_in_s)

    def brakes(self, effort: float, force_n: float, reason: Reason, state: TrainState) -> Guidance:
        """The advice to brake to a standstill with an effort (> 0): at the stop, or if the train is far too fast."""
        self.forget()
        found = Guidance(now=self.showing.braking(effort), force_n=force_n, reference_force_n=force_n, reason=reason)
        return self._as_read(found, state)

    def departs(self, kept: Kept | None, state: TrainState, goal: Goal, place: SpeedsAllowed) -> Guidance | None:
        """The advice for a train that is due to depart; None without a reference, or if the reference brakes here."""
        self.showing.forget()
        found = self.show(kept, state, goal, place)
        self.showing.forget()
        if found is None or found.now.mode in BRAKES:
            return None
        ratio = found.now.effort_ratio if found.now.mode in TRACTION else math.nan
        now = Instruction(mode=Regime.DEPART, speed_mps=found.now.speed_mps, effort_ratio=ratio)
        return replace(found, now=now, force_n=0.0, reference_force_n=0.0, lever_ratio=0.0)

    def _reason(self, kept: Kept, now: Instruction, state: TrainState, goal: Goal, place: SpeedsAllowed) -> Reason:
        if place.too_fast:
            return Reason(code=ReasonCode.TOO_FAST, speed_mps=state.v_mps - place.allowed_mps)
        ahead = self._standing_reason(now, self._ahead(kept, now, state), state)
        point = goal.passing
        time_ns = 0 if point is None else point.earliest_ns or 0
        if not ahead and point is not None and point.s_m > state.s_m and time_ns > state.now_ns:
            earliest_s = point.window(state.now_ns).earliest_s
            if kept.forecast.passes_s(point.s_m) - earliest_s < SAID_LATE_S:  # The reference slows the train for it.
                return Reason(code=ReasonCode.POINT_EARLIEST, at_m=point.s_m, time_ns=time_ns, text=point.reason)
        ahead = ahead or self._new_restriction(kept.reference.replan, state)
        late_s = self._said_arrival_s(kept, state, goal)
        if now.mode in BRAKES or abs(late_s) < SAID_LATE_S:
            return ahead
        return replace(ahead, code=ahead.code or ReasonCode.ARRIVAL, late_s=late_s)

    def _new_restriction(self, replan: Replan, state: TrainState) -> Reason:
        """The next restriction that was recently received and caused the new reference."""
        ahead = [one for one in self._news if one.start_m > state.s_m]
        if replan.cause is not ReplanCause.LINE or (state.now_ns - replan.time_ns) * NS > LEAST_AGE_S or not ahead:
            return NO_REASON
        first = min(ahead, key=lambda one: one.start_m)
        return Reason(code=ReasonCode.RESTRICTION, speed_mps=first.limit_mps, at_m=first.start_m)

    def _standing_reason(self, now: Instruction, ahead: Reason, state: TrainState) -> Reason:
        """The reason of the instruction; it stays while the same instruction is shown and its place is still ahead."""
        shown, kept = self._reasoned
        same = KIND_OF.get(now.mode) is KIND_OF.get(shown.mode) and now.speed_mps == shown.speed_mps
        if not (same and kept and kept.at_m > state.s_m):
            self._reasoned = now, ahead
        return self._reasoned[1]

    def _said_arrival_s(self, kept: Kept, state: TrainState, goal: Goal) -> float:
        """The lateness at arrival as shown (s): the last value until it is off by `SAID_ANEW_S`.

        The value is 0, and so not stated, for a train that stands or is almost at its stop.
        """
        if state.v_mps <= STANDSTILL_MPS or self._section.end_m - state.s_m < STOP_BY_EYE_M:
            return 0.0
        late_s = self.keeper.arrival_late_s(kept, state, goal)
        if abs(late_s - self._said_late_s) >= SAID_ANEW_S:
            self._said_late_s = late_s
        return self._said_late_s

    def _ahead(self, kept: Kept, now: Instruction, state: TrainState) -> Reason:
        """The lower limit or the stop to which the instruction to coast or to brake leads, if it is near."""
        if now.mode is not Regime.COAST and now.mode not in BRAKES:
            return NO_REASON
        schedule = kept.reference.schedule
        section, number = schedule.section, self.showing.phase
        from_mps = max(float(schedule.known.speed_mps[schedule.phases[number].begin]), state.v_mps)
        slows_m, holds_m = _ends_m(schedule, number, SLOWING), _ends_m(schedule, number, NOT_FASTER)
        for at_m, limit_mps in zip(*falling_limits(section.route), strict=True):
            leads_m = holds_m if now.speed_mps <= limit_mps + SPEED_STEP_MPS else slows_m
            near = state.s_m < at_m <= min(leads_m + BESIDE_M, state.s_m + NEAR_M)
            # A brake to the stop is not caused by a higher limit on the way.
            is_passed = now.mode in BRAKES and limit_mps > now.speed_mps + TARGET_STEP_MPS
            binds = limit_mps < from_mps and kept.forecast.passes_mps(at_m) > limit_mps - BINDS_MPS
            if near and binds and not is_passed:
                return _of_limit(section.route, at_m, limit_mps)
        if slows_m >= section.end_m and section.end_m - state.s_m <= NEAR_M:
            return Reason(code=ReasonCode.STOP, stop=section.end_stop_name)
        return NO_REASON


def _ends_m(schedule: Schedule, number: int, kinds: tuple[PhaseKind, ...]) -> float:
    """The end (m) of the unbroken sequence of phases of these kinds that begins with a phase."""
    count = len(list(takewhile(lambda one: one.kind in kinds, schedule.phases[number:])))
    return schedule.begin_m(number + count)


def falling_limits(route: Route) -> tuple[Floats, Floats]:
    """The places (m) where the limits of a line fall, and the lower limits (m/s)."""
    limits = route.limits_mps
    falls = np.flatnonzero(np.diff(limits.value) < 0) + 1
    return limits.start_m[falls], limits.value[falls]


def _of_limit(route: Route, at_m: float, limit_mps: float) -> Reason:
    restricted = any(one.start_m == at_m and one.limit_mps == limit_mps for one in route.restrictions)
    code = ReasonCode.RESTRICTION if restricted else ReasonCode.LIMIT
    return Reason(code=code, speed_mps=float(limit_mps), at_m=float(at_m))
