"""From the reference to what is shown: the instruction for the train in its present state, and those after it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Instruction, ReplanCause
from das.advice.coach.announcing import Announcing, Foreseen, Notices, allowed, in_time
from das.advice.coach.keeping import Changes, Kept
from das.advice.coach.phase_now import BRAKES_BACK, CREEPS, ROLLS, PhaseNow, PhaseScene, highest_mps
from das.advice.coach.planning import elapsed_s
from das.advice.coach.settings import ShowingSettings
from das.advice.coach.shown_brakes import (
    SAME_EFFORT,
    SAME_MPS,
    SOONER_S,
    ShownBrakes,
    SpeedsAllowed,
    brake_of,
    nearer_limit_mps,
)
from das.advice.goal import OVERSPEED_MPS, TrainState
from das.advice.regimes import BRAKES, EFFORT_ORDER, KIND_OF, TRACTION, InstructionKind, Regime
from das.advice.shown import SAME_READING_MPS
from das.domain.units import NS
from das.solver.guide.phases import PhaseKind
from das.solver.guide.schedule import Schedule
from das.solver.section import Section

Floats = NDArray[np.float64]
FORGOTTEN_S = 15.0
"""A driver to whom nothing was shown for this long is told anew, as if nothing had been shown before."""
IMPOSED = (ReplanCause.LINE, ReplanCause.GOAL, ReplanCause.POINT)
"""Causes of a new reference that came from outside: what is shown was chosen without knowing them."""
LONG_S = 3600.0
"""A creeping train has no forecast: this long time (s) is used instead."""


class ShownNow(NamedTuple):
    """What is shown: the present instruction, distance (m) and time (s) to its goal, and the instructions after it.

    The goal is the place where the instruction ends or, for a brake, where the train reaches its speed.
    `number` is the number of the phase in the schedule. `force_n` is the wheel force of the instruction (N).
    `reference_force_n` is the force that keeps the reference; for a brake it is exactly the force needed, before the
    effort is rounded up.
    """

    now: Instruction
    following: tuple[Instruction, ...]
    target_m: float
    target_s: float
    number: int
    force_n: float
    reference_force_n: float


class _Chosen(NamedTuple):
    """The instruction to show and the one wanted; they differ if the last one is shown for some time longer.

    `urgent`: limits or the stop ahead demand it. `for_limits`: it is a brake for them that no phase has yet.
    """

    now: Instruction
    wanted: Instruction
    urgent: bool
    for_limits: bool


class Showing:
    """Chooses the instruction to show, and remembers it, so that a display does not flicker between two of them."""

    def __init__(self, settings: ShowingSettings) -> None:
        self._settings = settings
        self._schedule: Schedule | None = None
        self._number, self._phase = 0, PhaseNow(settings)
        self._brakes: ShownBrakes | None = None
        self._announcing, self._notices = Announcing(settings.ahead), Notices(settings.announced_s)
        self._unannounced: Instruction | None = None
        self._brake_begun, self._brakes_back_ns = False, 0
        self._shown, self.changes = Instruction(), Changes()
        """When the instruction shown last changed, and when its next change is due."""

    def forget(self) -> None:
        """Forget what was shown: from now on nothing is shown."""
        self._schedule, self._shown = None, Instruction()

    def has_shown(self, now: Instruction, now_ns: int) -> None:
        """Take note of a brake that was shown at a moment (ns) though none was chosen; other acts do not last."""
        if now.mode not in BRAKES or self._shown.mode in BRAKES:
            return
        self._shown, self.changes, self._brake_begun = now, self.changes._replace(last_ns=now_ns), True

    @property
    def shown_effort(self) -> float:
        """The braking effort shown (> 0); 0 if no brake is shown."""
        return -self._shown.effort_ratio if self._shown.mode in BRAKES else 0.0

    def stands_at_mark(self, state: TrainState) -> bool:
        """Whether a train in the last metres before its stop will stop near the mark if it brakes on as shown."""
        return self._brakes is not None and self._brakes.stands_at_mark(self._shown, state)

    def braking(self, effort: float) -> Instruction:
        """The instruction to brake to a standstill with an effort (> 0), whatever the reference is."""
        self._shown = brake_of(effort, 0.0)
        return self._shown

    def show(self, kept: Kept, state: TrainState, place: SpeedsAllowed) -> ShownNow:
        """What to show of the reference to a driver whose train is in this state."""
        schedule, replan = kept.reference.schedule, kept.reference.replan
        imposed = replan.cause in IMPOSED and replan.time_ns > self.changes.last_ns
        self.changes = self.changes._replace(imposed=imposed)
        if self._notices.silent_s(state.now_ns) > FORGOTTEN_S:
            self._shown = Instruction()
        brakes, number = self._begin(schedule, state, place)
        foreseen = _foreseen(schedule, kept, state)
        phase_ends_m, begins_m = schedule.begin_m(number + 1), schedule.begin_m(number) if number else 0.0
        scene = PhaseScene(brakes, place.limit_mps, self._shown, self._brake_begun, foreseen, self._notices)
        planned = self._phase.instruction(schedule, number, state, scene)
        begins_s = foreseen.time_s(begins_m) if begins_m > state.s_m else 0.0
        chosen = self._chosen(planned, schedule, state, place, (begins_s, foreseen.time_s(phase_ends_m)))
        kept_on = begins_s > 0.0 and not _alike(chosen.now, chosen.wanted)  # The previous instruction is still shown.
        due_s = self._due_s(chosen, state, place, begins_s)
        waits = due_s > 0.0 and not kept_on
        now = replace(chosen.now, way_m=due_s * state.v_mps, in_s=due_s) if waits else chosen.now
        end_m = min(phase_ends_m, self._phase.coast_ends[0], brakes.ends_m(now, state, schedule.phases[number]))
        reached_m = min(end_m, _goal_m(now, schedule, number, state.s_m))
        foreseen = foreseen._replace(as_shown=_alike(now, planned))
        put_off = self._put_off(now, state)
        following = self._following(now, number - kept_on, end_m, state, foreseen, put_off)
        self._notices.note(following if put_off is None else (put_off, *following), state.now_ns)
        next_s = now.in_s if now.in_s > 0.0 or not following else following[0].in_s
        self.changes = self.changes._replace(next_ns=state.now_ns + round(next_s / NS))
        return ShownNow(
            now, following, max(reached_m - state.s_m, 0.0), foreseen.time_s(reached_m), number,
            brakes.force_n(now, state), brakes.force_n(brakes.unrounded(now), state),
        )  # fmt: skip

    def _begin(self, schedule: Schedule, state: TrainState, place: SpeedsAllowed) -> tuple[ShownBrakes, int]:
        """The brakes of the schedule's section, and the number of the phase to show."""
        if schedule is not self._schedule:
            self._schedule, self._number = schedule, 0
            self._phase.begin()
        if self._brakes is None or self._brakes.ahead.section is not schedule.section:
            self._brakes = ShownBrakes(schedule.section, self._settings)
        number = self._number_for(schedule, state, place)
        if number != self._number:
            self._phase.begin()
        self._number = number
        return self._brakes, number

    def _chosen(
        self, planned: Instruction, schedule: Schedule, state: TrainState, place: SpeedsAllowed,
        spans_s: tuple[float, float],
    ) -> _Chosen:  # fmt: skip
        """The instruction to show now: the planned one, the last one for some time longer, or what limits need.

        `spans_s` are the times until the phase of the planned instruction begins and ends.
        """
        assert self._brakes is not None
        brakes, number, known_mps = self._brakes, self._number, schedule.speed_at(state.s_m)
        begins_s, ends_s = spans_s
        if self._shown.mode not in BRAKES:
            self._brake_begun = False
        under = brakes.under_limit(planned, state, place)
        wanted = brakes.safe(under, state, known_mps, begun=self._brake_begun, begins_s=begins_s)
        if brakes.stands_at_mark(self._shown, state):
            return _Chosen(self._shown, self._shown, urgent=wanted is not planned, for_limits=False)
        brakes_again = schedule.kind_after(number) is PhaseKind.BRAKE
        ends_m, ends_mps = schedule.begin_m(number + 1), self._phase.coast_ends[1]
        if math.isinf(ends_mps):
            ends_mps = float(np.interp(ends_m, schedule.section.node_m, schedule.section.envelope_mps))
        # A shown speed that is allowed nowhere in the rest of the phase, or that a nearer board forbids, is replaced at
        # once, as if above the limit.
        most_mps = min(place.limit_mps, highest_mps(schedule, number, state.s_m))
        if self._shown.mode in TRACTION:
            nearer_mps = nearer_limit_mps(brakes.ahead, self._shown.speed_mps, state.braked_m)
            most_mps = min(most_mps, nearer_mps) if state.v_mps < nearer_mps + SAME_MPS else most_mps
        reachable = place._replace(limit_mps=most_mps)
        urgent = wanted is not planned
        between = brakes_again and ends_s < self._settings.least_shown_s
        now = self._held(wanted, state, reachable, ends_mps, between_brakes=between, urgent=urgent, begins_s=begins_s)
        safe = now if now is wanted else brakes.safe(now, state, known_mps, begun=self._brake_begun, begins_s=begins_s)
        if safe is not now:  # An instruction that is still shown must be as safe as a new one.
            self._shown, self.changes = safe, self.changes._replace(last_ns=state.now_ns)
            return _Chosen(safe, wanted, urgent=True, for_limits=True)
        return _Chosen(now, wanted, urgent=urgent, for_limits=wanted is not under and now is wanted)

    def _due_s(self, chosen: _Chosen, state: TrainState, place: SpeedsAllowed, begins_s: float) -> float:
        """In what time (s) the chosen instruction is due; its phase begins in `begins_s`, 0 if it has begun.

        A brake that limits or the stop demand is due where the train must begin to brake. A train that is too fast does
        not wait, nor does a brake that has begun, or that follows another brake.
        """
        assert self._brakes is not None
        too_fast = state.v_mps > place.allowed_mps + OVERSPEED_MPS
        if chosen.now.mode not in BRAKES:
            return 0.0 if chosen.urgent or too_fast else begins_s
        if self._phase.back == BRAKES_BACK and not chosen.urgent:
            due_s = (self._brakes_back_ns - state.now_ns) * NS
            self._brake_begun = due_s <= 0.0
            return due_s
        if self._brake_begun:
            return 0.0
        scheduled_s = begins_s if begins_s > 0.0 and not chosen.urgent else math.inf
        due_s = min(scheduled_s, self._brakes.begins_s(state))
        self._brake_begun = too_fast or not (chosen.for_limits or begins_s > 0.0) or due_s <= 0.0
        return 0.0 if self._brake_begun else due_s

    def _following(
        self, now: Instruction, number: int, end_m: float, state: TrainState, foreseen: Foreseen,
        put_off: Instruction | None,
    ) -> tuple[Instruction, ...]:  # fmt: skip
        """The announced instructions, with the one that is put off.

        If the brake shown ends before its phase, the first is the rest of the phase.
        """
        assert self._schedule is not None
        assert self._brakes is not None
        schedule = self._schedule
        following = self._announcing.following(schedule, number, state.s_m, foreseen)
        freely = foreseen.as_shown and (self._phase.back == BRAKES_BACK or schedule.brakes_by_effort(number))
        following = in_time(following, now, self._brakes, state, foreseen, freely=freely)
        brakes = now.mode in BRAKES and schedule.phases[number].kind is PhaseKind.BRAKE
        if brakes and end_m < schedule.begin_m(number + 1):
            in_s = max(foreseen.time_s(end_m), self._brakes.lasts(now, state)[0])
            rest = replace(self._announcing.announced(schedule, number), way_m=end_m - state.s_m, in_s=in_s)
            following = (rest, *following[: self._settings.ahead - 1])
        if put_off is None or put_off.in_s < 1.0 or (following and following[0].in_s <= put_off.in_s):
            return allowed(following, now, state.s_m, self._brakes, foreseen)
        put_first = (put_off, *following[: self._settings.ahead - 1])
        return allowed(put_first, now, state.s_m, self._brakes, foreseen)

    def _put_off(self, now: Instruction, state: TrainState) -> Instruction | None:
        """A change that waits until it has been announced long enough; None if there is none, or too fast for there."""
        assert self._brakes is not None
        one = self._unannounced or (self._phase.creeping_soon if now.mode in BRAKES else None)
        too_fast = one is not None and one.speed_mps > self._brakes.ahead.allowed_mps(state.braked_m + one.way_m)
        return None if too_fast else one

    def creeping(
        self, section: Section, state: TrainState, place: SpeedsAllowed
    ) -> tuple[Instruction, tuple[Instruction, ...], float]:
        """The instruction to creep to the stop, or to brake if that is due; the brake after it; and the force (N)."""
        self.forget()
        self._brakes = ShownBrakes(section, self._settings)
        creeps = Instruction(mode=Regime.CRUISE, speed_mps=self._settings.brake.creep_mps)
        now = self._brakes.safe(creeps, state, state.v_mps)
        if place.allowed_mps < creeps.speed_mps:  # In the last metres he finds the mark by eye.
            now = brake_of(self._settings.effort.step_ratio, 0.0)
        ends_m, speeds_mps = np.array([state.s_m, section.end_m]), np.full(2, creeps.speed_mps)
        foreseen = Foreseen(np.full(2, LONG_S), ends_m, speeds_mps, as_shown=False)
        following = in_time((), now, self._brakes, state, foreseen)
        return now, following, self._brakes.force_n(now, state)

    def _number_for(self, schedule: Schedule, state: TrainState, place: SpeedsAllowed) -> int:
        """The number of the phase to show: the phase at the train's position, or the next one if it is due soon.

        The number never goes back. A brake is shown up to its end, unless another brake follows it. An acceleration is
        shown before it is due only if the limit already allows its speed.
        """
        here = max(schedule.number_at(state.s_m), self._number)
        if here + 1 == len(schedule.phases):
            return here
        after = schedule.phases[here + 1]
        lead = self._settings.lead
        leads = {
            PhaseKind.COAST: lead.coasting_s,
            PhaseKind.BRAKE: lead.astray_s if schedule.phases[here].kind is PhaseKind.TRACTION else lead.braking_s,
            PhaseKind.TRACTION: lead.accelerating_s if after.target_mps <= place.limit_mps else 0.0,
        }
        if schedule.phases[here].kind is PhaseKind.BRAKE and after.kind is not PhaseKind.BRAKE:
            return here
        soon_m = state.s_m + state.v_mps * leads.get(after.kind, 0.0)
        if after.kind is PhaseKind.BRAKE:
            soon_m += state.ahead_m + SOONER_S * state.v_mps
        return here + 1 if schedule.number_at(soon_m) > here else here

    def _held(
        self, wanted: Instruction, state: TrainState, place: SpeedsAllowed, ends_mps: float, *,
        between_brakes: bool, urgent: bool, begins_s: float,
    ) -> Instruction:  # fmt: skip
        """The instruction to show: the last one for some time longer, or the wanted one.

        The wanted one is shown at once if limits need it (`urgent`), if it brakes more, or if the last one is completed
        or shows too high a speed. `ends_mps` is the highest speed allowed where the phase ends. `between_brakes`: the
        next phase brakes soon. Then a brake that has reached its speed is still shown; the driver releases it himself.
        """
        shown, self._unannounced = self._shown, None
        # An acceleration ends without notice where news from outside want a slower train; a brake back waits for it.
        slower = self.changes.imposed and shown.mode in TRACTION and wanted.speed_mps < state.v_mps - SAME_MPS
        if slower and self._phase.back == BRAKES_BACK and not urgent:
            wanted = Instruction(mode=Regime.CRUISE, speed_mps=wanted.speed_mps)
        held_s = (state.now_ns - self.changes.last_ns) * NS
        settled = shown.mode in (Regime.NONE, Regime.STOP) or not 0 <= held_s < self._settings.least_shown_s
        by_its_end = shown.mode is Regime.COAST and (settled or wanted.mode is not Regime.COAST)
        highest_mps = min(place.limit_mps, ends_mps) if by_its_end else place.limit_mps
        too_high = shown.speed_mps > highest_mps + SAME_READING_MPS
        same = _alike(wanted, shown) and not too_high
        if same and (wanted.effort_ratio == shown.effort_ratio or wanted.mode is Regime.CRUISE):
            return shown
        too_fast = state.v_mps > place.allowed_mps + OVERSPEED_MPS
        less = EFFORT_ORDER.index(wanted.mode) > EFFORT_ORDER.index(shown.mode)
        harder = shown.mode in BRAKES and (
            wanted.speed_mps < shown.speed_mps - SAME_MPS or wanted.effort_ratio < shown.effort_ratio
        )
        braked = (less and (wanted.mode in BRAKES or too_fast)) or (wanted.mode in BRAKES and harder)
        if self._phase.back == BRAKES_BACK and not (urgent or too_fast) and shown.mode not in BRAKES:
            braked = False  # It can wait until it has been announced.
        reached = shown.mode in BRAKES and state.v_mps <= shown.speed_mps + SAME_MPS
        lower = wanted.speed_mps < shown.speed_mps - self._settings.reached_mps
        coasts_on = settled and lower and wanted.mode is shown.mode is Regime.COAST
        above = too_high or (coasts_on and state.v_mps < shown.speed_mps + self._settings.above_mps)
        if reached and between_brakes and wanted.mode not in BRAKES and not too_fast and not above:
            return shown
        released = reached and shown.speed_mps > SAME_MPS
        passed_mps = max(shown.speed_mps, min(place.limit_mps, place.allowed_mps))
        rolls_on = shown.mode in TRACTION and state.v_mps > passed_mps + SAME_MPS
        eased = shown.mode in BRAKES and (self._phase.back in (ROLLS, CREEPS) or self._eased(shown, wanted, state))
        at_once = braked or released or above or eased or rolls_on or (slower and settled)
        at_once |= urgent and (settled or shown.mode in BRAKES or not self._stands(state, place))
        if at_once or (settled and not self._goes_on(wanted, state) and self._is_announced(wanted, state, begins_s)):
            self._shown, self.changes = wanted, self.changes._replace(last_ns=state.now_ns)
        elif not settled:
            self._announce_still(wanted, state, self._settings.least_shown_s - held_s)
        return self._shown

    def _goes_on(self, wanted: Instruction, state: TrainState) -> bool:
        """Whether an acceleration to the speed shown goes on to a higher one, so soon that this one is not held."""
        if self._shown.mode not in TRACTION or not _reaches(wanted, self._shown):
            return False
        return 0.0 <= self._notices.due_in_s(InstructionKind.TRACTION, state.now_ns) < self._settings.least_shown_s

    def _announce_still(self, wanted: Instruction, state: TrainState, in_s: float) -> None:
        """Announce a change further on that was announced early enough, but must wait until what is shown has stood."""
        kind = KIND_OF.get(wanted.mode)
        if kind is None or kind is KIND_OF.get(self._shown.mode) or _reaches(wanted, self._shown):
            return
        if self._notices.lacks_s(wanted, state.now_ns, in_s) <= 0.0:
            self._unannounced = replace(wanted, way_m=in_s * state.v_mps, in_s=in_s)

    def _stands(self, state: TrainState, place: SpeedsAllowed) -> bool:
        """Whether what is shown, no brake, is still safe: neither the limit here nor a brake ahead asks for less."""
        assert self._schedule is not None
        assert self._brakes is not None
        known_mps = self._schedule.speed_at(state.s_m)
        under = self._brakes.under_limit(self._shown, state, place)
        return self._brakes.safe(under, state, known_mps, begun=False) is self._shown

    def _is_announced(self, wanted: Instruction, state: TrainState, begins_s: float) -> bool:
        """Whether a change to an instruction has been announced early enough; if not, it is announced from now on.

        An instruction to accelerate or to coast says itself that its speed is held after it.
        """
        shown, kind = self._shown, KIND_OF.get(wanted.mode)
        same = kind is KIND_OF.get(shown.mode) or _reaches(wanted, shown)
        if same or kind is None or shown.mode not in KIND_OF:
            return True
        lacks_s = self._notices.lacks_s(wanted, state.now_ns, begins_s)
        if kind is InstructionKind.BRAKE and lacks_s <= self._settings.lead.braking_s:
            self._brakes_back_ns = state.now_ns + round(max(lacks_s, self._settings.lead.least_s) / NS)
            return True
        if lacks_s > 0.0:
            in_s = begins_s + lacks_s
            self._unannounced = replace(wanted, way_m=in_s * state.v_mps, in_s=in_s)
        return lacks_s <= 0.0

    def _eased(self, shown: Instruction, wanted: Instruction, state: TrainState) -> bool:
        """Whether the brake shown is far too strong by now, more than the train has, or needs no friction any more.

        Before it has begun, its effort does not fall.
        """
        assert self._brakes is not None
        largest = self._brakes.ahead.largest(state.s_m, state.v_mps)
        if largest == 0.0 or -shown.effort_ratio > max(largest, 1.0) + SAME_EFFORT:
            return True
        if wanted.mode not in BRAKES:
            return shown.speed_mps <= SAME_MPS and self._brakes.stands_short(shown, state)
        if not self._brake_begun:
            return False
        if shown.mode is Regime.FRICTION_BRAKE:
            return wanted.mode is not Regime.FRICTION_BRAKE
        if shown.speed_mps > SAME_MPS and self._brakes.lasts(shown, state)[0] < self._settings.effort.settled_s:
            return False
        return wanted.effort_ratio > self._settings.effort.eased_ratio * shown.effort_ratio


def _goal_m(now: Instruction, schedule: Schedule, number: int, s_m: float) -> float:
    """Where a brake reaches its speed, or where the speed of coasting is no longer allowed (m); else infinity."""
    if now.mode in BRAKES:
        return schedule.reached_m(number, s_m)
    if now.mode is not Regime.COAST:
        return math.inf
    section = schedule.section
    lower = (section.node_m > s_m) & (section.envelope_mps < now.speed_mps - SAME_READING_MPS)
    return float(section.node_m[np.argmax(lower)]) if lower.any() else math.inf


def _foreseen(schedule: Schedule, kept: Kept, state: TrainState) -> Foreseen:
    """The forecast of a reference from the train's position on."""
    times_s, at_m = elapsed_s(schedule, kept.forecast, state.s_m)
    speeds_mps = kept.forecast.speeds_mps[-len(at_m) :].copy()
    speeds_mps[0] = state.v_mps
    return Foreseen(times_s, at_m, speeds_mps, as_shown=True)


def _reaches(wanted: Instruction, shown: Instruction) -> bool:
    """Whether an instruction holds the speed that the one shown leads to."""
    return wanted.mode is Regime.CRUISE and abs(wanted.speed_mps - shown.speed_mps) < SAME_MPS


def _alike(one: Instruction, other: Instruction) -> bool:
    """Whether two instructions have the same mode and lead to the same speed."""
    return one.mode is other.mode and abs(one.speed_mps - other.speed_mps) < SAME_MPS
