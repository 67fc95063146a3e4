"""From the reference to what is shown: which instruction holds for the train as it is, and what comes after it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from das.advice.coach.coaching import Instruction
from das.advice.coach.keeping import Kept
from das.advice.coach.planning import elapsed_s
from das.advice.coach.settings import ShowingSettings
from das.advice.modes import EFFORT_ORDER, Mode
from das.advice.planner import TrainState
from das.domain.units import NS
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import Phase
from das.solver.calm.schedule import Schedule
from das.solver.kernels.forces import electric_limit, traction_limit
from das.solver.section import Section

FULL_RATIO = 0.97
"""An effort from this share of the largest on counts as full."""
SAME_MPS = 0.3
"""Speeds this near to each other are the same on a display."""
FOLLOWING = 3
"""Of so many phases after the present one it is known when they begin: one of them may be no change."""
ROLLS, CREEPS = -1, -2
"""A train that has braked early rolls on, or holds a low speed because it would stand short of its mark."""
TRACTION = (Mode.FULL_TRACTION, Mode.REDUCED_TRACTION)
BRAKES = (Mode.REDUCED_BRAKE, Mode.FULL_BRAKE, Mode.FRICTION_BRAKE)


class SpeedsAllowed(NamedTuple):
    """What bounds an instruction where the train is: the highest speed that is safe, and the limit (m/s)."""

    allowed_mps: float
    limit_mps: float


class ShownNow(NamedTuple):
    """What is shown: the instruction, those after it, and way (m) and time (s) to where it ends."""

    now: Instruction
    following: tuple[Instruction, ...]
    target_m: float
    target_s: float
    number: int


class _Brake(NamedTuple):
    """The deceleration (m/s²) that a brake was shown for, and its effort as a share of the motors' largest."""

    rate_mps2: float
    ratio: float


class Showing:
    """Chooses what is shown, and remembers it, so that a display does not waver about a speed."""

    def __init__(self, settings: ShowingSettings) -> None:
        self._settings = settings
        self._schedule: Schedule | None = None
        self._number, self._back, self._share, self._left_s = 0, 0, 1.0, math.inf
        self._reached_mps = 0.0
        self._brakes: dict[int, _Brake] = {}
        self._coming: dict[int, Instruction] = {}
        self._shown, self._since_ns = Instruction(), 0

    def forget(self) -> None:
        """Nothing is shown any more."""
        self._schedule, self._shown = None, Instruction()

    def show(self, kept: Kept, state: TrainState, place: SpeedsAllowed) -> ShownNow:
        """What is shown of the reference to a train in a state."""
        schedule = kept.reference.schedule
        if schedule is not self._schedule:
            self._schedule, self._number, self._back, self._brakes, self._coming = schedule, 0, 0, {}, {}
            self._reached_mps = 0.0
        number = self._number_for(schedule, state, place)
        if number != self._number:
            self._back, self._reached_mps = 0, 0.0
        self._number = number
        times_s, at_m = elapsed_s(schedule, kept.forecast, state.s_m)
        begins_m = [schedule.begin_m(k) for k in range(number + 1, number + 2 + FOLLOWING)]
        begins_s = np.interp(begins_m, at_m, times_s).tolist()
        self._left_s = begins_s[0]
        wanted = self._wanted(schedule, number, state, place)
        brakes_again = number + 1 < len(schedule.phases) and schedule.phases[number + 1].kind is NotchKind.BRAKE
        between = brakes_again and begins_s[0] < self._settings.least_shown_s
        # A speed that cannot be reached before the phase ends is not shown any longer than a limit that is passed.
        reachable = place._replace(limit_mps=min(place.limit_mps, _highest_mps(schedule, number, state.s_m)))
        now = self._held(wanted, state, reachable, between_brakes=between)
        following = self._following(schedule, number, state, begins_s)
        end_m = schedule.begin_m(number + 1)
        due_m = schedule.begin_m(number) - state.s_m if number else 0.0
        if due_m > 0 and state.v_mps <= place.allowed_mps + self._settings.overspeed_mps:
            now = replace(now, way_m=due_m, in_s=float(np.interp(schedule.begin_m(number), at_m, times_s)))
        return ShownNow(now, following, max(end_m - state.s_m, 0.0), begins_s[0], number)

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

    def _wanted(self, schedule: Schedule, number: int, state: TrainState, place: SpeedsAllowed) -> Instruction:
        """The instruction for the train as it is."""
        one, v_mps = schedule.phases[number], state.v_mps
        target = min(_aim_mps(schedule, number, state.s_m), place.limit_mps)
        excess = v_mps - place.allowed_mps
        if one.kind is NotchKind.BRAKE:
            wanted = self._braking(schedule, number, state, target)
        elif one.kind is NotchKind.COAST:
            wanted = Instruction(mode=Mode.COAST, speed_mps=target, effort_ratio=0.0)
        elif self._accelerates(one, v_mps, target):
            self._share = one.share
            wanted = _traction(one.share, target)
        else:
            wanted = self._holding(schedule, state, target)
        if excess > self._settings.overspeed_mps:
            after = schedule.phases[number + 1] if number + 1 < len(schedule.phases) else one
            goal = min(target, after.target_mps if after.kind is NotchKind.BRAKE else place.allowed_mps)
            if wanted.mode in BRAKES and (excess <= self._settings.braked_mps or wanted.effort_ratio <= -1.0):
                return replace(wanted, speed_mps=min(target, place.allowed_mps))
            if excess > self._settings.braked_mps:
                return Instruction(mode=Mode.FULL_BRAKE, speed_mps=goal, effort_ratio=-1.0)
            return Instruction(mode=Mode.COAST, speed_mps=goal, effort_ratio=0.0)
        return wanted

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
        may_roll = target > SAME_MPS or v_mps >= settings.brake.last_mps or stands_short
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
        curve_mps2 = schedule.needed_mps2(number, max(state.s_m, schedule.begin_m(number)), v_mps)
        rate_mps2 = max(curve_mps2, settings.brake.least_mps2)
        ratio = self._brake_ratio(schedule, number, state, rate_mps2)
        return _brake(schedule.section, ratio, v_mps, target)

    def _brake_ratio(self, schedule: Schedule, number: int, state: TrainState, needed_mps2: float) -> float:
        """The effort of a brake: that of one deceleration, which stands until clearly more or less is needed."""
        kept = self._brakes.get(number)
        section, step = schedule.section, self._settings.brake.step_ratio
        if kept is not None and abs(needed_mps2 / kept.rate_mps2 - 1.0) < self._settings.brake.band_ratio:
            return kept.ratio
        left_m, slows = schedule.begin_m(number + 1) - state.s_m, schedule.phases[number].target_mps > SAME_MPS
        if kept is not None and slows and left_m < state.v_mps * self._settings.brake.settled_s:
            return kept.ratio
        force = braking_force_n(section, needed_mps2, state.s_m, state.v_mps)
        most = 1.0 + section.train.friction_force_n / largest_brake_n(section)
        ratio = min(max(round(force / largest_brake_n(section) / step), 1) * step, most)
        self._brakes[number] = _Brake(needed_mps2, ratio)
        return ratio

    def _held(
        self, wanted: Instruction, state: TrainState, place: SpeedsAllowed, *, between_brakes: bool
    ) -> Instruction:
        """The instruction to show: it stands for a while, unless limits ahead ask for another one.

        Between two brakes that follow each other at once the first one stands: at its speed the driver releases it.
        """
        shown = self._shown
        same = wanted.mode is shown.mode and abs(wanted.speed_mps - shown.speed_mps) < SAME_MPS
        if same and (wanted.effort_ratio == shown.effort_ratio or wanted.mode is Mode.CRUISE):
            return shown
        held_s = (state.now_ns - self._since_ns) * NS
        settled = shown.mode in (Mode.NONE, Mode.STOP) or not 0 <= held_s < self._settings.least_shown_s
        too_fast = state.v_mps > place.allowed_mps + self._settings.overspeed_mps
        less = EFFORT_ORDER.index(wanted.mode) > EFFORT_ORDER.index(shown.mode)
        slower = shown.mode in BRAKES and wanted.speed_mps < shown.speed_mps - SAME_MPS
        braked = (less and (wanted.mode in BRAKES or too_fast)) or (wanted.mode in BRAKES and slower)
        reached = shown.mode in BRAKES and state.v_mps <= shown.speed_mps + SAME_MPS
        above = shown.speed_mps > place.limit_mps + SAME_MPS
        if reached and between_brakes and wanted.mode not in BRAKES and not too_fast and not above:
            return shown
        released = reached and shown.speed_mps > SAME_MPS
        if settled or braked or released or above:
            self._shown, self._since_ns = wanted, state.now_ns
        return self._shown

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

    def _announced(self, schedule: Schedule, number: int) -> Instruction:
        """An instruction as it is shown before it is due; it depends on the schedule alone, and is made once."""
        found = self._coming.get(number)
        if found is None:
            found = self._coming[number] = _announced(schedule, number)
        return found


def _announced(schedule: Schedule, number: int) -> Instruction:
    """An instruction as it is shown before it is due."""
    one = schedule.phases[number]
    target = _aim_mps(schedule, number, schedule.begin_m(number))
    if one.kind is NotchKind.TRACTION:
        return _traction(one.share, target)
    if one.kind is NotchKind.BRAKE:
        return _announced_brake(schedule, number, target)
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
    """The speed that a phase leads to, no higher than what is allowed anywhere from a position to its end.

    The schedule may know higher ones: of a limit told too late, or where limits brake the train and no phase does.
    """
    section, one = schedule.section, schedule.phases[number]
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    first = min(int(np.searchsorted(section.node_m, max(s_m, schedule.begin_m(number)))), end)
    highest = section.envelope_mps[end] if one.kind is NotchKind.BRAKE else section.envelope_mps[first : end + 1].max()
    return float(min(one.target_mps, highest))


def reference_force_n(schedule: Schedule, shown: ShownNow, s_m: float, v_mps: float) -> float:
    """The wheel force (N) that keeps to the reference at a position and speed; of a brake not due yet, as it begins."""
    section, now, number = schedule.section, shown.now, shown.number
    if now.mode in BRAKES and schedule.phases[number].kind is NotchKind.BRAKE:
        s_m = max(s_m, schedule.begin_m(number))
        return -max(braking_force_n(section, schedule.needed_mps2(number, s_m, v_mps), s_m, v_mps), 0.0)
    return force_n(section, now, s_m, v_mps)


def force_n(section: Section, now: Instruction, s_m: float, v_mps: float) -> float:
    """The wheel force (N) of an instruction at a position and speed: of a speed to hold, what it needs."""
    train, v = section.train, max(v_mps, 0.1)
    if now.mode in TRACTION:
        return now.effort_ratio * float(traction_limit(v, train))
    if now.mode in BRAKES:
        return now.effort_ratio * largest_brake_n(section)
    if now.mode is not Mode.CRUISE:
        return 0.0
    return float(min(max(-braking_force_n(section, 0.0, s_m, v), -largest_brake_n(section)), traction_limit(v, train)))


def braking_force_n(section: Section, rate_mps2: float, s_m: float, v_mps: float) -> float:
    """The braking force (N, > 0) that decelerates a train at a rate (m/s²) at a position and speed."""
    return section.train.inertial_mass_kg * rate_mps2 - section.resistance_n(s_m, v_mps)


def largest_brake_n(section: Section) -> float:
    """The largest effort (N) of the electric brake at any speed; of all brakes where there is no electric one."""
    train = section.train
    if train.electric_force_n > 0 and not train.brakes_dissipate:
        return train.electric_force_n
    return max(train.friction_force_n + train.electric_force_n, 1.0)


def _announced_brake(schedule: Schedule, number: int, target: float) -> Instruction:
    """A brake as it is shown before it is due: with the effort with which the schedule begins it."""
    section, one = schedule.section, schedule.phases[number]
    v_mps = max(float(schedule.known.speed_mps[one.begin]), 1.0)
    at_m = float(section.node_m[one.begin])
    by_effort = schedule.brakes_by_effort(number)
    rate_mps2 = schedule.needed_mps2(number, at_m, v_mps) if by_effort else schedule.braking_mps2(number)
    force = braking_force_n(section, rate_mps2, at_m, v_mps)
    return _brake(section, max(force, 0.0) / largest_brake_n(section), v_mps, target)


def _traction(share: float, target_mps: float) -> Instruction:
    mode = Mode.FULL_TRACTION if share >= FULL_RATIO else Mode.REDUCED_TRACTION
    return Instruction(mode=mode, speed_mps=target_mps, effort_ratio=share)


def _brake(section: Section, ratio: float, v_mps: float, target_mps: float) -> Instruction:
    """A brake of an effort; where the motors cannot give it at this speed, with friction."""
    motors = float(electric_limit(max(v_mps, 0.1), section.train)) / largest_brake_n(section)
    mode = Mode.REDUCED_BRAKE if ratio < FULL_RATIO * motors else Mode.FULL_BRAKE
    if ratio > motors + 1e-6:
        mode = Mode.FRICTION_BRAKE
    return Instruction(mode=mode, speed_mps=target_mps, effort_ratio=-ratio)
