"""The coach of a section: it keeps the reference, chooses the instruction to show, and says why and what it saves."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

from das.advice import wording
from das.advice.advice import Coaching, Instruction
from das.advice.coach.keeping import Keeper, Kept
from das.advice.coach.settings import DEFAULT, CoachSettings
from das.advice.coach.showing import Showing, ShownNow
from das.advice.coach.shown_brakes import SpeedsAllowed
from das.advice.goal import OVERSPEED_MPS, Goal, TrainState
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.worker import AT_ONCE, Worker
from das.domain.errors import DasError
from das.domain.units import NS
from das.solver.few_switch.few_switch import FewSwitchFront, NotchRegime
from das.solver.few_switch.schedule import Schedule
from das.solver.section import Section

NEAR_M = 4000.0
"""The limit or stop that an instruction leads to is named if it is nearer than this."""


class Coach:
    """Leads a driver along one section, by instructions that follow a reference (a standing plan).

    The same inputs give the same advice, bit for bit, unless the `worker` makes references in the background.
    """

    def __init__(
        self,
        section: Section,
        front: FewSwitchFront | None,
        settings: CoachSettings = DEFAULT,
        worker: Worker = AT_ONCE,
    ) -> None:
        self._section, self._settings, self._worker = section, settings, worker
        self._keeper, self._showing = Keeper(section, front, settings, worker), Showing(settings.showing)
        self._lost = False

    def successor(self, section: Section, front: FewSwitchFront | None) -> Coach:
        """The coach that takes over from this one, with another front or under other limits."""
        found = Coach(section, front, self._settings, self._worker)
        found._keeper.take_over(self._keeper)
        found._showing = self._showing
        return found

    def forget(self) -> None:
        """Drop the reference and all that was shown."""
        self._keeper.forget()
        self._showing.forget()

    def plan(self, state: TrainState, goal: Goal) -> Kept | None:
        """The reference for a state, kept or new; None if none can be made (yet), or none leads to the stop."""
        self._lost = False
        try:
            return self._keeper.keep(state, goal)
        except DasError:
            self._lost = True
            return None

    def show(
        self, kept: Kept | None, state: TrainState, goal: Goal, place: SpeedsAllowed, late_s: float
    ) -> Coaching | None:
        """What the driver should do now and next; None if there is no reference. The train arrives `late_s` late."""
        if kept is None:
            return self._creeping(state, place) if self._lost else None
        shown = self._showing.show(kept, state, place)
        return Coaching(
            now=shown.now,
            following=shown.following,
            target_m=shown.target_m,
            target_s=shown.target_s,
            force_n=shown.force_n,
            reference_force_n=shown.reference_force_n,
            reason=self._reason(kept, shown, state, goal, place, late_s),
            worth_j=self._worth_j(kept, state, waits=goal.waits(state)),
            replan=kept.reference.replan,
        )

    def _creeping(self, state: TrainState, place: SpeedsAllowed) -> Coaching | None:
        """The advice to creep to the stop, for a train so slow that no reference leads there; None for a faster one."""
        way_m = self._section.end_m - state.s_m
        if state.v_mps > self._settings.showing.brake.creep_mps or way_m > self._settings.showing.brake.creeps_m:
            return None
        now, following, force_n = self._showing.creeping(self._section, state, place)
        return Coaching(
            now=now, following=following, target_m=way_m, target_s=way_m / max(now.speed_mps, 1.0), force_n=force_n,
            reference_force_n=force_n, reason=wording.instructed(now.mode, now.speed_mps, None, 0.0),
        )  # fmt: skip

    def stands(self, departs_in_s: float = 0.0) -> Coaching:
        """The advice for a train that stands at a stop and departs in `departs_in_s`."""
        self._showing.forget()
        now = Instruction(mode=Regime.STOP, speed_mps=0.0, effort_ratio=0.0)
        return Coaching(now=now, target_s=departs_in_s)

    def hush(self) -> None:
        """Take note that the instruction of this moment is not shown; the reference goes on."""
        self._showing.forget()

    @property
    def shown_effort(self) -> float:
        """The braking effort shown (> 0); 0 if no brake is shown."""
        return self._showing.shown_effort

    def stands_at_mark(self, state: TrainState) -> bool:
        """Whether a train in the last metres before its stop will stop near the mark if it brakes on as shown."""
        return self._showing.stands_at_mark(state)

    def brakes(self, effort: float, force_n: float, reason: str) -> Coaching:
        """The advice to brake to a standstill with an effort (> 0): at the stop, or if the train is far too fast."""
        self.forget()
        now = self._showing.braking(effort)
        return Coaching(now=now, force_n=force_n, reference_force_n=force_n, reason=reason)

    def departs(
        self, kept: Kept | None, state: TrainState, goal: Goal, place: SpeedsAllowed, late_s: float
    ) -> Coaching | None:
        """The advice for a standing train that is due to depart: stand until cleared, then follow the reference.

        None if there is no reference, or if the reference brakes here.
        """
        self._showing.forget()
        found = self.show(kept, state, goal, place, late_s)
        if found is None or found.now.mode in BRAKES:
            return None
        ratio = found.now.effort_ratio if found.now.mode in TRACTION else math.nan
        now = Instruction(mode=Regime.DEPART, speed_mps=found.now.speed_mps, effort_ratio=ratio)
        reason = wording.departs_when_cleared(found.reason)
        return replace(found, now=now, force_n=0.0, reference_force_n=0.0, worth_j=0.0, reason=reason)

    def _reason(
        self, kept: Kept, shown: ShownNow, state: TrainState, goal: Goal, place: SpeedsAllowed, late_s: float
    ) -> str:
        excess_mps = state.v_mps - place.allowed_mps
        if excess_mps > OVERSPEED_MPS:
            return wording.too_fast(excess_mps)
        point = goal.passing
        if point is not None and goal.waits(state) and shown.now.mode not in BRAKES:
            clock = datetime.fromtimestamp((point.earliest_ns or 0) * NS, UTC).strftime("%H:%M:%S")
            return wording.slow_for_point(point, state.now_ns, clock)
        ahead = self._ahead(kept.reference.schedule, shown.number, state)
        return wording.instructed(shown.now.mode, shown.now.speed_mps, ahead, late_s)

    def _ahead(self, schedule: Schedule, number: int, state: TrainState) -> wording.Aim | None:
        """The limit or stop that the next braking phase leads to; None if there is none near."""
        phases = schedule.phases
        for k in range(number, min(number + 3, len(phases))):
            if phases[k].kind is not NotchRegime.BRAKE:
                continue
            at_m = schedule.begin_m(k + 1)
            if at_m - state.s_m > NEAR_M:
                return None
            last = at_m >= self._section.end_m - 1.0
            return wording.Aim(phases[k].target_mps, at_m, self._section.end_stop_name if last else "")
        return None

    def _worth_j(self, kept: Kept, state: TrainState, *, waits: bool) -> float:
        """What keeping the reference saves (J) compared with going on at the present speed for a while first.

        It is 0 near the end of the section, and for a train that stands or `waits` until it may pass a point.
        """
        reference = kept.reference
        going_on_m = state.v_mps * self._settings.showing.worth_over_s
        if kept.forecast.time_s < self._settings.showing.arrived_s or waits or going_on_m <= 0.0:
            return 0.0
        try:
            other = reference.schedule.forecast(state.s_m, state.v_mps, held_until_m=state.s_m + going_on_m)
        except DasError:
            return 0.0
        later_s = other.time_s - kept.forecast.time_s
        return other.energy_j - kept.forecast.energy_j + reference.lambda_w * later_s
