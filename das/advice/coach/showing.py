"""From the reference to what is shown: which instruction holds for the train as it is, and what comes after it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.coach.coaching import Instruction
from das.advice.coach.keeping import Kept
from das.advice.coach.planning import elapsed_s
from das.advice.coach.settings import ShowingSettings
from das.advice.coach.shown_brakes import (
    BRAKES,
    SAME_EFFORT,
    SAME_MPS,
    TRACTION,
    ShownBrakes,
    SpeedsAllowed,
    announced_brake,
    brake_of,
)
from das.advice.modes import EFFORT_ORDER, FULL_RATIO, Mode
from das.advice.planner import TrainState
from das.domain.units import KMH, NS
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import Phase
from das.solver.calm.schedule import Schedule
from das.solver.section import Section

Floats = NDArray[np.float64]
FOLLOWING = 3
"""Of so many phases after the present one it is known when they begin: one of them may be no change."""
ROUNDED_MPS = 0.5 * KMH
"""A display in whole km/h shows a speed that is above what is allowed by less than this as one that is not."""
LONG_S = 3600.0
"""A creeping train has no forecast: it takes so long at most."""
BEGUN_M = 1.0
"""A limit that begins within this way of an instruction holds for it."""
ROLLS, CREEPS = -1, -2
"""A train that has braked early rolls on, or holds a low speed because it would stand short of its mark."""


class ShownNow(NamedTuple):
    """What is shown: the instruction, those after it, and way (m) and time (s) to where it ends.

    `number` is that of the phase, `force_n` the wheel force of the instruction (N), and `reference_force_n` that which
    keeps to the reference: of a brake exactly what it needs, before its effort is rounded up.
    """

    now: Instruction
    following: tuple[Instruction, ...]
    target_m: float
    target_s: float
    number: int
    force_n: float
    reference_force_n: float


class Showing:
    """Chooses what is shown, and remembers it, so that a display does not waver about a speed."""

    def __init__(self, settings: ShowingSettings) -> None:
        self._settings = settings
        self._schedule: Schedule | None = None
        self._number, self._back, self._share, self._left_s = 0, 0, 1.0, math.inf
        self._reached_mps = 0.0
        self._brakes: ShownBrakes | None = None
        self._coming: dict[int, Instruction] = {}
        self._shown, self._since_ns = Instruction(), 0

    def forget(self) -> None:
        """Nothing is shown any more."""
        self._schedule, self._shown = None, Instruction()

    @property
    def shown_effort(self) -> float:
        """The effort of the brake that is shown (> 0); 0 where none is."""
        return -self._shown.effort_ratio if self._shown.mode in BRAKES else 0.0

    def braking(self, effort: float) -> Instruction:
        """The instruction to brake to a standstill with an effort (> 0), whatever the reference is."""
        self._shown = brake_of(effort, 0.0)
        return self._shown

    def show(self, kept: Kept, state: TrainState, place: SpeedsAllowed) -> ShownNow:
        """What is shown of the reference to a train in a state."""
        schedule = kept.reference.schedule
        if schedule is not self._schedule:
            self._schedule, self._number, self._back, self._coming = schedule, 0, 0, {}
            self._reached_mps = 0.0
        if self._brakes is None or self._brakes.ahead.section is not schedule.section:
            self._brakes = ShownBrakes(schedule.section, self._settings)
        number = self._number_for(schedule, state, place)
        if number != self._number:
            self._back, self._reached_mps = 0, 0.0
        self._number = number
        times_s, at_m = elapsed_s(schedule, kept.forecast, state.s_m)
        begins_m = [schedule.begin_m(k) for k in range(number + 1, number + 2 + FOLLOWING)]
        begins_s = np.interp(begins_m, at_m, times_s).tolist()
        self._left_s = begins_s[0]
        planned = self._planned(schedule, number, state, place)
        wanted = self._brakes.under_limit(planned, state, place)
        wanted = self._brakes.safe(wanted, state, schedule.speed_at(state.s_m))
        brakes_again = number + 1 < len(schedule.phases) and schedule.phases[number + 1].kind is NotchKind.BRAKE
        between = brakes_again and begins_s[0] < self._settings.least_shown_s
        # A speed that cannot be reached before the phase ends is not shown any longer than a limit that is passed.
        reachable = place._replace(limit_mps=min(place.limit_mps, _highest_mps(schedule, number, state.s_m)))
        urgent = wanted is not planned
        ends_mps = float(
            np.interp(schedule.begin_m(number + 1), schedule.section.node_m, schedule.section.envelope_mps)
        )
        brakes_on = wanted.mode in BRAKES and self._shown.mode in BRAKES  # Nobody releases the brake in between.
        now = self._held(wanted, state, reachable, ends_mps, between_brakes=between, urgent=urgent)
        due_m = 0.0 if number == 0 or brakes_on else schedule.begin_m(number) - state.s_m
        due_s = float(np.interp(schedule.begin_m(number), at_m, times_s))
        kept_on = due_m > 0 and not _alike(now, wanted)  # The instruction before it still stands.
        following = self._following(schedule, number - kept_on, state, [due_s] * kept_on + begins_s)
        following = self._in_time(now, following, state, (times_s, at_m))
        end_m = min(schedule.begin_m(number + 1), self._brakes.ends_m(now, state, schedule.phases[number].kind))
        in_time = state.v_mps <= place.allowed_mps + self._settings.limit.overspeed_mps
        if due_m > 0 and in_time and not (urgent or kept_on):
            now = replace(now, way_m=due_m, in_s=due_s)
        end_s = float(np.interp(end_m, at_m, times_s))
        return ShownNow(
            now, _allowed(following, state.s_m, schedule.section), max(end_m - state.s_m, 0.0), end_s, number, self._brakes.force_n(now, state),
            self._brakes.force_n(self._brakes.unrounded(now), state),
        )  # fmt: skip

    def creeping(
        self, section: Section, state: TrainState, place: SpeedsAllowed
    ) -> tuple[Instruction, tuple[Instruction, ...], float]:
        """The instruction to creep to the stop, or to brake there, the brake that follows, and the wheel force (N)."""
        self.forget()
        self._brakes = ShownBrakes(section, self._settings)
        creeps = Instruction(mode=Mode.CRUISE, speed_mps=min(self._settings.brake.creep_mps, place.allowed_mps))
        now = self._brakes.safe(creeps, state, state.v_mps)
        following = self._in_time(now, (), state, (np.full(2, LONG_S), np.array([state.s_m, section.end_m])))
        return now, following, self._brakes.force_n(now, state)

    def _number_for(self, schedule: Schedule, state: TrainState, place: SpeedsAllowed) -> int:
        """The instruction that holds, or the next one where it is due within the lead; none is taken up again.

        A brake is shown up to its end, however short it is, unless another brake follows it: anything else is due at
        its speed. An acceleration is shown before it is due only where the limit allows its speed already.
        """
        here = max(schedule.number_at(state.s_m), self._number)
        if here + 1 == len(schedule.phases):
            return here
        after = schedule.phases[here + 1]
        lead = self._settings.lead
        leads = {
            NotchKind.COAST: lead.coasting_s,
            NotchKind.BRAKE: lead.braking_s,
            NotchKind.TRACTION: lead.accelerating_s if after.target_mps <= place.limit_mps else 0.0,
        }
        if schedule.phases[here].kind is NotchKind.BRAKE and after.kind is not NotchKind.BRAKE:
            return here
        soon_m = state.s_m + state.v_mps * leads.get(after.kind, 0.0)
        return here + 1 if schedule.number_at(soon_m) > here else here

    def _planned(self, schedule: Schedule, number: int, state: TrainState, place: SpeedsAllowed) -> Instruction:
        """The instruction of the schedule for the train as it is."""
        one, v_mps = schedule.phases[number], state.v_mps
        target = min(_aim_mps(schedule, number, state.s_m), place.limit_mps)
        if one.kind is NotchKind.BRAKE:
            return self._braking(schedule, number, state, target)
        if one.kind is NotchKind.COAST:
            return Instruction(mode=Mode.COAST, speed_mps=target, effort_ratio=0.0)
        if self._accelerates(one, v_mps, target):
            self._share = one.share
            return _traction(one.share, target)
        return self._holding(schedule, state, target)

    def _accelerates(self, one: Phase, v_mps: float, target: float) -> bool:
        """Whether the train is still to accelerate to the speed of a phase: once it is reached it is held."""
        if one.kind is not NotchKind.TRACTION or target <= self._reached_mps + SAME_MPS:
            return False
        if v_mps < target - self._settings.reached_mps:
            return True
        self._reached_mps = target
        return False

    def _holding(self, schedule: Schedule, state: TrainState, target: float) -> Instruction:
        """Hold a speed; a train that is far from it goes back to it first."""
        settings, away = self._settings, state.v_mps - target
        if self._back == 0 and away < -settings.reached_mps and self._shown.mode in TRACTION:
            self._back = 1  # It has not yet reached the speed that it accelerates to.
        elif self._back == 0 and away < 0 and self._left_s < settings.worth_accelerating_s:
            pass  # What comes next is near: to accelerate now would soon be braked away.
        elif self._back == 0 and abs(away) > (settings.above_mps if away > 0 else settings.below_mps):
            self._back = -1 if away > 0 else 1
            self._share = schedule.back_share
        elif (self._back > 0 and away >= -settings.reached_mps) or (self._back < 0 and away <= SAME_MPS):
            self._back = 0
        if self._back > 0:
            return _traction(self._share, target)
        if self._back < 0:
            return Instruction(mode=Mode.COAST, speed_mps=target, effort_ratio=0.0)
        return Instruction(mode=Mode.CRUISE, speed_mps=target)

    def _braking(self, schedule: Schedule, number: int, state: TrainState, target: float) -> Instruction:
        """Brake with one effort to the speed; a driver who has braked early lets the train roll until it is due."""
        settings, v_mps = self._settings, state.v_mps
        if v_mps <= target + SAME_MPS and target > SAME_MPS:
            return self._holding(schedule, state, target)
        way_m = max(schedule.begin_m(number + 1) - state.s_m, 1.0)
        needed = (v_mps**2 - target**2) / (2.0 * way_m)
        eased = 1.0 if schedule.brakes_by_effort(number) else needed / schedule.braking_mps2(number)
        stands_short = eased < settings.brake.short_ratio and way_m > settings.brake.short_m
        slows = target > SAME_MPS  # A train that is nearly at its speed brakes on to it.
        may_roll = v_mps > target + settings.above_mps if slows else v_mps >= settings.brake.last_mps or stands_short
        if self._back == 0 and eased < settings.brake.early_ratio and may_roll:
            self._back = ROLLS
        elif self._back < 0 and eased > settings.brake.again_ratio:
            self._back = 0
        if self._back == ROLLS and target <= SAME_MPS and v_mps < settings.brake.creep_mps:
            self._back = CREEPS
        if self._back == CREEPS:
            creep_mps = min(settings.brake.creep_mps, _highest_mps(schedule, number, state.s_m))
            return Instruction(mode=Mode.CRUISE, speed_mps=creep_mps)
        if self._back < 0:
            return Instruction(mode=Mode.COAST, speed_mps=target, effort_ratio=0.0)
        assert self._brakes is not None
        brakes = self._shown.mode in BRAKES
        return self._brakes.shown(self._brakes.needed(schedule, number, state, target, brakes=brakes), state)

    def _held(
        self, wanted: Instruction, state: TrainState, place: SpeedsAllowed, ends_mps: float, *,
        between_brakes: bool, urgent: bool,
    ) -> Instruction:  # fmt: skip
        """The instruction to show: it stands for a while, unless limits ask for another one (`urgent`).

        `ends_mps` is the highest speed that is allowed where the phase ends.
        Between two brakes that follow each other at once the first one stands: at its speed the driver releases it.
        """
        shown = self._shown
        highest_mps = min(place.limit_mps, ends_mps) if shown.mode is Mode.COAST else place.limit_mps
        too_high = shown.speed_mps > highest_mps + ROUNDED_MPS
        same = _alike(wanted, shown) and not too_high
        if same and (wanted.effort_ratio == shown.effort_ratio or wanted.mode is Mode.CRUISE):
            return shown
        held_s = (state.now_ns - self._since_ns) * NS
        settled = shown.mode in (Mode.NONE, Mode.STOP) or not 0 <= held_s < self._settings.least_shown_s
        too_fast = state.v_mps > place.allowed_mps + self._settings.limit.overspeed_mps
        less = EFFORT_ORDER.index(wanted.mode) > EFFORT_ORDER.index(shown.mode)
        harder = shown.mode in BRAKES and (
            wanted.speed_mps < shown.speed_mps - SAME_MPS or wanted.effort_ratio < shown.effort_ratio
        )
        braked = (less and (wanted.mode in BRAKES or too_fast)) or (wanted.mode in BRAKES and harder)
        reached = shown.mode in BRAKES and state.v_mps <= shown.speed_mps + SAME_MPS
        lower = wanted.speed_mps < shown.speed_mps - self._settings.reached_mps
        above = too_high or (lower and wanted.mode is shown.mode is Mode.COAST)
        if reached and between_brakes and wanted.mode not in BRAKES and not too_fast and not above:
            return shown
        released = reached and shown.speed_mps > SAME_MPS
        passed_mps = max(shown.speed_mps, min(place.limit_mps, place.allowed_mps))
        rolls_on = shown.mode in TRACTION and state.v_mps > passed_mps + SAME_MPS
        eased = shown.mode in BRAKES and self._eased(shown, wanted, state)
        if settled or braked or released or above or urgent or eased or rolls_on:
            self._shown, self._since_ns = wanted, state.now_ns
        return self._shown

    def _eased(self, shown: Instruction, wanted: Instruction, state: TrainState) -> bool:
        """Whether a brake is far too strong, or beyond the train by now: all brakes, where the motors are enough."""
        assert self._brakes is not None
        half = wanted.mode in BRAKES and wanted.effort_ratio > self._settings.brake.eased_ratio * shown.effort_ratio
        enough = wanted.mode in (Mode.REDUCED_BRAKE, Mode.FULL_BRAKE)
        if shown.mode is not Mode.FRICTION_BRAKE:
            return half
        return enough or -shown.effort_ratio > self._brakes.ahead.largest(state.v_mps) + SAME_EFFORT

    def _following(
        self, schedule: Schedule, number: int, state: TrainState, begins_s: list[float]
    ) -> tuple[Instruction, ...]:
        """The next changes; to hold the speed that the train accelerates to is none."""
        found: list[Instruction] = []
        phases = schedule.phases
        for k, in_s in zip(range(number + 1, len(phases)), begins_s, strict=False):
            one, before = phases[k], phases[k - 1]
            same = abs(one.target_mps - before.target_mps) < SAME_MPS
            if one.kind is NotchKind.HOLD and before.kind is NotchKind.TRACTION and same:
                continue
            shown = self._announced(schedule, k)
            way_m = schedule.begin_m(k) - state.s_m
            found.append(
                Instruction(
                    mode=shown.mode, speed_mps=shown.speed_mps, effort_ratio=shown.effort_ratio, way_m=way_m, in_s=in_s
                )
            )
            if len(found) == self._settings.ahead:
                break
        return tuple(found)

    def _in_time(
        self, now: Instruction, following: tuple[Instruction, ...], state: TrainState, elapsed: tuple[Floats, Floats]
    ) -> tuple[Instruction, ...]:
        """The next changes, where a brake is announced in time for a driver who reaches the speed that is shown now.

        The forecast may stay below this speed, on a hill, and its brake begins later. What follows a brake does so when
        its speed is reached. `elapsed` are times (s) and places (m) of the forecast.
        """
        assert self._brakes is not None
        if following and now.mode in BRAKES and following[0].mode not in BRAKES:
            lasts_s, lasts_m = self._brakes.lasts(now, state)
            first = following[0]
            late = any(one.way_m <= lasts_m or one.in_s <= lasts_s for one in following[1:])
            if first.in_s >= lasts_s or late:
                return following
            return (replace(first, way_m=lasts_m, in_s=lasts_s), *following[1:])
        if now.mode in BRAKES:
            return following
        times_s, at_m = elapsed
        ahead, v_mps = self._brakes.ahead, state.v_mps
        speeds_mps = ahead.rolling_mps(state.s_m, v_mps)
        if now.mode is not Mode.COAST:
            speeds_mps = np.full(len(speeds_mps), max(now.speed_mps, v_mps))
        begins_m = max(ahead.curve_begins_m(state.s_m, speeds_mps) - state.ahead_m, state.s_m)
        before_m = state.s_m + following[0].way_m if following else math.inf
        if following and following[0].mode in BRAKES:
            begins_m, brake, after = min(begins_m, before_m), following[0], following[1:]
        else:  # The brake that the schedule has not, or has begun already: the driver brakes later.
            brake = self._brakes.brake_at(begins_m, speeds_mps) if begins_m < before_m - BEGUN_M else None
            after = following[: self._settings.ahead - 1]
            if brake is None:
                return following
        in_s = float(np.interp(begins_m, at_m, times_s))
        if now.mode not in TRACTION:  # A train that rolls or holds its speed may be there sooner than the forecast.
            in_s = min(in_s, ahead.ahead_s(state.s_m, v_mps, speeds_mps, begins_m))
        return (replace(brake, way_m=begins_m - state.s_m, in_s=in_s), *after)

    def _announced(self, schedule: Schedule, number: int) -> Instruction:
        """An instruction as it is shown before it is due; it depends on the schedule alone, and is made once."""
        found = self._coming.get(number)
        if found is None:
            found = self._coming[number] = _announced(schedule, number)
        return found


def _alike(one: Instruction, other: Instruction) -> bool:
    """Whether two instructions are of one mode and lead to one speed."""
    return one.mode is other.mode and abs(one.speed_mps - other.speed_mps) < SAME_MPS


def _allowed(following: tuple[Instruction, ...], s_m: float, section: Section) -> tuple[Instruction, ...]:
    """The next changes, none to a speed above the limit where it leads: of a brake or of coasting, where that ends."""
    kept = []
    for k, one in enumerate(following):
        ends = k + 1 < len(following) and one.mode in (*BRAKES, Mode.COAST)
        ways_m = one.way_m, following[k + 1].way_m if ends else one.way_m
        nodes = np.searchsorted(section.node_m, s_m + BEGUN_M + np.array(ways_m), side="right")
        first, last = np.clip(nodes - 1, 0, len(section.limit_mps) - 1)
        limit_mps = float(section.limit_mps[first : last + 1].max())
        kept.append(replace(one, speed_mps=limit_mps) if one.speed_mps > limit_mps else one)
    return tuple(kept)


def _announced(schedule: Schedule, number: int) -> Instruction:
    """An instruction as it is shown before it is due."""
    one = schedule.phases[number]
    # It leads to no higher speed than the limit where it begins, even if a higher one is allowed before it ends.
    target = min(_aim_mps(schedule, number, schedule.begin_m(number)), float(schedule.section.limit_mps[one.begin]))
    if one.kind is NotchKind.TRACTION:
        return _traction(one.share, target)
    if one.kind is NotchKind.BRAKE:
        return announced_brake(schedule, number, target)
    if one.kind is NotchKind.COAST:
        return Instruction(mode=Mode.COAST, speed_mps=target, effort_ratio=0.0)
    return Instruction(mode=Mode.CRUISE, speed_mps=target)


def _highest_mps(schedule: Schedule, number: int, s_m: float) -> float:
    """The highest speed that is allowed anywhere from a position to the end of a phase."""
    section = schedule.section
    first = max(int(np.searchsorted(section.node_m, s_m, side="right")) - 1, 0)
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    return float(section.envelope_mps[min(first, end) : end + 1].max())


def _aim_mps(schedule: Schedule, number: int, s_m: float) -> float:
    """The speed that a phase leads to, no higher than what is allowed on its way; where it slows the train, at its end.

    The schedule may know higher ones: of a limit told too late, or where limits brake the train and no phase does.
    """
    section, one = schedule.section, schedule.phases[number]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    first = min(int(np.searchsorted(section.node_m, max(s_m, schedule.begin_m(number)))), end)
    slows = one.kind in (NotchKind.BRAKE, NotchKind.COAST)
    highest = section.envelope_mps[end] if slows else section.envelope_mps[first : end + 1].max()
    return float(min(one.target_mps, highest))


def _traction(share: float, target_mps: float) -> Instruction:
    mode = Mode.FULL_TRACTION if share >= FULL_RATIO else Mode.REDUCED_TRACTION
    return Instruction(mode=mode, speed_mps=target_mps, effort_ratio=share)
