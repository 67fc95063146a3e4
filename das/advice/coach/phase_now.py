"""The instruction of one phase of the schedule, for a train that may be slower, faster or elsewhere than planned."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Instruction
from das.advice.braking import BrakingAhead
from das.advice.coach.announcing import Foreseen, Notices, aim_mps, told_mps, traction
from das.advice.coach.settings import ShowingSettings
from das.advice.coach.shown_brakes import SAME_EFFORT, SAME_MPS, ShownBrakes, nearer_limit_mps
from das.advice.goal import OVERSPEED_MPS, TrainState
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.shown import SAME_READING_MPS, STOP_BY_EYE_M, TARGET_STEP_MPS, target_below
from das.domain.units import KMH
from das.solver.guide.phases import Phase, PhaseKind
from das.solver.guide.schedule import Schedule

Floats = NDArray[np.float64]
CREEPS_FOR_S = 6.0
"""A driver who brakes too much is told to hold his speed only if the brake for the stop is not due for this long."""
COAST_MISSES_MPS, MISSES_MOST_MPS, COASTS_ON_S = 4.0 * KMH, 5.0 * KMH, 10.0
"""Coasting that is forecast to end further than `COAST_MISSES_MPS` from the speed shown leads to another one, and says
that; in its last `COASTS_ON_S` only if it ends further than `MISSES_MOST_MPS`, which the grammar excludes."""
BRIEF_S, LEAST_GAIN_S = 30.0, 2.5
"""An acceleration that a brake follows within `BRIEF_S` must gain `LEAST_GAIN_S`: a driver gains less than forecast."""
ROLLS_MPS2 = 0.02
"""A coasting train speeds up by itself if it gains more than this."""
ON_CURVE_MPS = 0.05
"""A train that is forecast to be no further than this below a falling braking curve is braked by it."""
NO_COAST = (math.inf, math.inf)
ROLLS, CREEPS, BRAKES_BACK = -1, -2, -3
"""Deviations from the schedule. A driver who braked early is told to coast (`ROLLS`), or to creep because he would stop
short of the mark (`CREEPS`). A driver above the speed to hold is told to coast back to it (`ROLLS`), or to brake if
coasting takes too long (`BRAKES_BACK`)."""


class PhaseScene(NamedTuple):
    """What the instruction of a phase depends on besides the train.

    That is the brakes of the section, the speed limit here (m/s), the instruction shown now, whether it is a brake that
    is due already, the forecast of the reference, and what has been announced.
    """

    brakes: ShownBrakes
    limit_mps: float
    shown: Instruction
    brake_begun: bool
    foreseen: Foreseen
    notices: Notices


class Leads(NamedTuple):
    """Where coasting leads: places (m) and speeds (m/s) from its begin to its end.

    `allowed_mps` is the highest speed that may be named for its end. A brake that ends it begins at a speed that is
    known within half a step only: a named speed that followed it would flicker.
    """

    at_m: Floats
    speeds_mps: Floats
    allowed_mps: float

    @property
    def end_m(self) -> float:
        """Where the coasting ends (m)."""
        return float(self.at_m[-1])

    @property
    def ends_mps(self) -> float:
        """The speed at the end of the coasting (m/s)."""
        return float(self.speeds_mps[-1])

    @property
    def only_slows(self) -> bool:
        """Whether the train ends no faster than it begins, and is hardly faster or slower on the way."""
        begins_mps, ends_mps = self.speeds_mps[0], self.speeds_mps[-1]
        slower, faster = ends_mps - self.speeds_mps.min(), self.speeds_mps.max() - begins_mps
        return bool(ends_mps <= begins_mps + SAME_MPS and max(slower, faster) <= COAST_MISSES_MPS)


class PhaseNow:
    """Makes the instruction of a phase, second by second, and remembers how the driver deviates from the phase."""

    def __init__(self, settings: ShowingSettings) -> None:
        self._settings = settings
        self._scene: PhaseScene
        self._share, self._reached_mps, self._creeps_mps, self._held_mps = 1.0, 0.0, 0.0, 0.0
        self.back = 0
        """How the train returns to the schedule: > 0 by accelerating, < 0 as a deviation says, 0: it need not."""
        self.creeping_soon: Instruction | None = None
        """The low speed that a driver who brakes too much will be told to hold; None if he need not be."""
        self.coast_ends = NO_COAST
        """Where the coasting that is told now ends (m), and the highest speed to name (m/s); infinity if none is."""

    def begin(self) -> None:
        """Forget how the driver deviates: another phase begins."""
        self.back, self._reached_mps, self._held_mps = 0, 0.0, 0.0

    def instruction(self, schedule: Schedule, number: int, state: TrainState, scene: PhaseScene) -> Instruction:
        """The instruction of a phase of the schedule, for the train in its present state."""
        self._scene, self.creeping_soon, self.coast_ends = scene, None, NO_COAST
        one, v_mps = schedule.phases[number], state.v_mps
        target = min(aim_mps(schedule, number), scene.limit_mps)
        if state.s_m < schedule.begin_m(number) and one.kind in (PhaseKind.TRACTION, PhaseKind.HOLD):
            target = min(target, float(schedule.section.limit_mps[one.begin]))
        highest = highest_mps(schedule, number, state.s_m)
        if one.kind in (PhaseKind.TRACTION, PhaseKind.HOLD):
            target = target_below(highest) if target > highest + SAME_READING_MPS else target
            target = told_mps(target, schedule.section, target)
            nearer_mps = nearer_limit_mps(scene.brakes.ahead, target, state.braked_m)
            # A faster train is not slowed down here: the brake is an instruction of its own.
            target = nearer_mps if v_mps < nearer_mps + SAME_MPS else target
        if one.kind is PhaseKind.BRAKE:
            return self._braking(schedule, number, state, target)
        if one.kind is PhaseKind.COAST:
            return self._coasting(schedule, number, state, target)
        if self._accelerates(one, v_mps, target):
            if self._held_mps == 0.0 and self._is_vain(schedule, number, state):
                self._held_mps = max(target_below(v_mps), schedule.phases[number + 1].target_mps)
            if self._held_mps > 0.0:
                return self._holding(schedule, number, state, min(self._held_mps, target))
            self._share = one.share
            return traction(one.share, self._reachable_mps(schedule, number, target))
        return self._holding(schedule, number, state, target)

    def _coasting(self, schedule: Schedule, number: int, state: TrainState, target: float) -> Instruction:
        """The instruction of a phase to coast: to coast to where that leads, or to hold a speed.

        A speed is held instead by a train that coasting would only make slower though it is no faster than its next
        speed, and by one that holds or brakes and would have rolled up to its speed or to the limit in a moment.
        """
        leads, shown, v_mps = self._leads(schedule, number, state), self._scene.shown, state.v_mps
        self.coast_ends = leads.end_m, leads.allowed_mps
        goes_on = schedule.kind_after(number) in (PhaseKind.HOLD, PhaseKind.TRACTION)
        is_next = goes_on and schedule.phases[number + 1].target_mps > target - SAME_MPS
        least_mps = self._settings.reached_mps if shown.mode is Regime.COAST else -SAME_MPS
        if is_next and target - v_mps > least_mps and leads.only_slows:
            return Instruction(mode=Regime.CRUISE, speed_mps=target)
        told = self._told(schedule, number, state, target, leads)
        if shown.mode is Regime.CRUISE or shown.mode in BRAKES:
            rolled_mps = self._scene.brakes.ahead.rolling_mps(state.s_m, v_mps)
            soon = schedule.section.node_m[-len(rolled_mps) :] < state.s_m + COASTS_ON_S * v_mps
            tops_mps = schedule.section.limit_mps[-len(rolled_mps) :]
            tops_mps = np.minimum(tops_mps, told) if v_mps <= told + SAME_MPS else tops_mps
            reached = tops_mps[soon & (rolled_mps > np.maximum(tops_mps - SAME_READING_MPS, v_mps))]
            if reached.size:
                return Instruction(mode=Regime.CRUISE, speed_mps=float(reached[0]))
        return coasting(told)

    def _is_vain(self, schedule: Schedule, number: int, state: TrainState) -> bool:
        """Whether an acceleration that has not begun yet gains too little time before a brake that follows soon."""
        if self._scene.shown.mode in TRACTION:
            return False
        foreseen, brakes_m = self._scene.foreseen, self._brakes_m(schedule, number, state)
        begin_m = brakes_m - self._settings.lead.astray_s * state.v_mps  # There the brake is shown.
        left_s, way_m = foreseen.time_s(begin_m), begin_m - state.s_m
        return left_s < BRIEF_S and way_m / max(state.v_mps, 1.0) - left_s < LEAST_GAIN_S

    def _brakes_m(self, schedule: Schedule, number: int, state: TrainState) -> float:
        """Where a train that accelerates as forecast must brake (m): for the next phase, or for a limit before that."""
        last = number
        while schedule.kind_after(last) is PhaseKind.HOLD:
            last += 1
        next_m, is_braked = schedule.begin_m(last + 1), schedule.kind_after(last) is PhaseKind.BRAKE
        speeds_mps, at_m = self._scene.foreseen.speeds_mps[1:-1], self._scene.foreseen.at_m[1:-1]
        curve_mps = schedule.section.envelope_mps[-len(at_m) - 1 :]
        slowed = (curve_mps[:-1] < speeds_mps + ON_CURVE_MPS) & (np.diff(curve_mps) < 0.0) & (at_m < next_m)
        if slowed.any():
            return float(at_m[np.argmax(slowed)])
        return next_m if is_braked else math.inf

    def _reachable_mps(self, schedule: Schedule, number: int, target: float) -> float:
        """The speed to accelerate to: that of the next phase, for a train that will be no faster where it begins."""
        if schedule.kind_after(number) in (None, PhaseKind.COAST):
            return target
        slower_mps = aim_mps(schedule, number + 1)
        reached_mps = self._scene.foreseen.speed_mps(schedule.begin_m(number + 1))
        return min(target, slower_mps) if reached_mps < slower_mps + SAME_MPS else target

    def _accelerates(self, one: Phase, v_mps: float, target: float) -> bool:
        """Whether the train still has to accelerate to the speed of a phase; once reached, the speed is held."""
        if one.kind is not PhaseKind.TRACTION or target <= self._reached_mps + SAME_MPS:
            return False
        if v_mps < target - self._settings.reached_mps:
            return True
        self._reached_mps = target
        return False

    def _holding(self, schedule: Schedule, number: int, state: TrainState, target: float) -> Instruction:
        """The instruction to hold a speed, or to return to it if the train is too far from it."""
        settings, away = self._settings, state.v_mps - target
        left_s = self._scene.foreseen.time_s(schedule.begin_m(number + 1))
        if self.back == 0 and away < -settings.reached_mps and self._rolls_up_to(target, state):
            return coasting(target)
        if self.back == 0 and away < -settings.reached_mps and self._scene.shown.mode in TRACTION:
            self.back = 1  # The train is still accelerating to this speed.
        elif self.back == 0 and away < 0 and left_s < settings.worth_accelerating_s:
            pass  # The next instruction is near: accelerating now would be wasted.
        elif self.back == 0 and abs(away) > (settings.above_mps if away > 0 else settings.below_mps):
            self.back, self._share = (1, schedule.back_share) if away < 0 else self._slows_back(state, away)
        elif (self.back > 0 and away >= -settings.reached_mps) or (self.back < 0 and away <= SAME_MPS):
            self.back = 0
        elif self.back == ROLLS and self._scene.shown.mode is not Regime.COAST:
            self.back, self._share = self._slows_back(state, away)  # He may have become faster since.
        if self.back > 0:
            return traction(self._share, target)
        if self.back == BRAKES_BACK:
            return self._scene.brakes.back_to(target, self._share)
        if self.back < 0:
            return coasting(self._rolls_back_to(schedule, number, state, target))
        return Instruction(mode=Regime.CRUISE, speed_mps=target)

    def _rolls_back_to(self, schedule: Schedule, number: int, state: TrainState, target: float) -> float:
        """The speed to which a train coasts back: that to hold, or a higher one if it must brake before."""
        leads = self._leads(schedule, number, state)
        self.coast_ends = leads.end_m, leads.allowed_mps
        return max(target, self._told(schedule, number, state, target, leads)) if leads.ends_mps > target else target

    def _rolls_up_to(self, target: float, state: TrainState) -> bool:
        """Whether the driver has been told to coast to a speed, and his train still speeds up to it down a hill."""
        shown, rolls_mps2 = self._scene.shown, self._scene.brakes.ahead.rolls_mps2(state.s_m, state.v_mps)
        return shown.mode is Regime.COAST and abs(shown.speed_mps - target) < SAME_MPS and rolls_mps2 > ROLLS_MPS2

    def _told(self, schedule: Schedule, number: int, state: TrainState, target: float, leads: Leads) -> float:
        """The speed to name to a driver who coasts: that shown or planned if his train ends near it, else its own."""
        shown, ends_mps, section = self._scene.shown, leads.ends_mps, schedule.section
        passes = (section.node_m[:-1] >= leads.at_m[0]) & (section.node_m[:-1] < leads.end_m)
        highest = min(float(section.limit_mps[passes].min(initial=self._scene.limit_mps)), leads.allowed_mps)
        ends_soon = leads.end_m - leads.at_m[0] < state.v_mps * COASTS_ON_S
        most_mps = MISSES_MOST_MPS if ends_soon else COAST_MISSES_MPS
        goes_on = shown.mode is Regime.COAST and shown.speed_mps <= highest + SAME_READING_MPS
        if goes_on and abs(ends_mps - shown.speed_mps) <= most_mps:
            return shown.speed_mps
        if ends_soon and schedule.kind_after(number) is PhaseKind.HOLD:
            goes_to_mps = aim_mps(schedule, number + 1)
            near = ends_mps - COAST_MISSES_MPS <= goes_to_mps
            if goes_to_mps <= min(ends_mps, highest) and (near or self._rolls_back(state, ends_mps - goes_to_mps)):
                return goes_to_mps  # The train coasts on to the speed that it then holds.
        if abs(ends_mps - target) <= COAST_MISSES_MPS:
            return target
        return told_mps(min(max(ends_mps, self._settings.brake.creep_mps), highest), section, highest)

    def _leads(self, schedule: Schedule, number: int, state: TrainState) -> Leads:
        """Where the coasting of a phase leads, from here or, if it has not begun, from its begin as forecast.

        It ends with the phase, or where the train must brake before: by more than a driver would hold a limit with. A
        driver who rolls up to a limit holds it.
        """
        brakes, from_m = self._scene.brakes, max(state.s_m, schedule.begin_m(number))
        v_mps = self._scene.foreseen.speed_mps(from_m) if from_m > state.s_m else state.v_mps
        speeds_mps, end_m = brakes.ahead.rolling_mps(from_m, v_mps), schedule.begin_m(number + 1)
        speeds_mps = np.minimum(speeds_mps, schedule.section.limit_mps[-len(speeds_mps) :])
        at_m = np.append(from_m, schedule.section.node_m[-len(speeds_mps) :])
        passes_mps = np.append(v_mps, speeds_mps)
        brakes_m = max(brakes.ahead.curve_begins_m(from_m, speeds_mps) - state.ahead_m, state.s_m)
        brake = brakes.brake_at(brakes_m, speeds_mps) if brakes_m < end_m else None
        is_braked = brake is not None and brake.speed_mps < np.interp(brakes_m, at_m, passes_mps) - OVERSPEED_MPS
        end_m = brakes_m if is_braked else end_m
        ends_mps = float(np.interp(end_m, at_m, passes_mps))
        allowed_mps = float(np.interp(end_m, schedule.section.node_m, schedule.section.envelope_mps))
        if is_braked or schedule.kind_after(number) is PhaseKind.BRAKE:
            allowed_mps = max(allowed_mps, ends_mps) + 0.5 * TARGET_STEP_MPS
        on_way = at_m < end_m
        return Leads(np.append(at_m[on_way], end_m), np.append(passes_mps[on_way], ends_mps), allowed_mps)

    def _slows_back(self, state: TrainState, away_mps: float) -> tuple[int, float]:
        """How a train above the speed to hold returns to it: `ROLLS` or `BRAKES_BACK`, and the braking effort."""
        ahead, limit = self._scene.brakes.ahead, self._settings.limit
        soon = _is_braked_soon(self._scene.brakes.ahead, state, self._settings)
        if self._rolls_back(state, away_mps):
            return ROLLS, 0.0
        effort = ahead.effort_of(away_mps / limit.brakes_back_in_s, state.s_m, state.v_mps)
        needed = ahead.needed(state.braked_m, state.v_mps)
        if soon and needed.target_mps > state.v_mps - away_mps - SAME_MPS:
            effort = max(effort, needed.effort)  # One brake, with one effort, for the limit as well.
        return BRAKES_BACK, min(effort, 1.0)

    def _rolls_back(self, state: TrainState, away_mps: float) -> bool:
        """Whether coasting is enough for a train to return to a speed; not if a limit leaves no time for it."""
        ahead, settings = self._scene.brakes.ahead, self._settings
        slows_mps = -ahead.rolls_mps2(state.s_m, state.v_mps) * settings.limit.rolls_back_in_s
        return slows_mps >= away_mps and not _is_braked_soon(ahead, state, settings)

    def _braking(self, schedule: Schedule, number: int, state: TrainState, target: float) -> Instruction:
        """The instruction to brake with one effort to a speed; one who has braked too much coasts or creeps first."""
        settings, v_mps = self._settings, state.v_mps
        held = self._scene.shown.mode is Regime.CRUISE and abs(self._scene.shown.speed_mps - target) < SAME_MPS
        if v_mps <= target + (settings.limit.braked_mps if held else SAME_MPS) and target > SAME_MPS:
            return self._holding(schedule, number, state, target)
        way_m = max(schedule.reached_m(number, state.s_m) - state.s_m, 1.0)
        needed = (v_mps**2 - target**2) / (2.0 * way_m)
        slows = target > SAME_MPS  # It brakes to a lower speed, not to a stop.
        if not schedule.brakes_by_effort(number):
            eased = needed / schedule.braking_mps2(number)
        else:
            eased = 1.0 if slows else self._eased_ratio(schedule, number, state, target)
        if slows:
            rolled_w = v_mps**2 + 2.0 * self._scene.brakes.ahead.rolls_mps2(state.s_m, v_mps) * way_m
            may_roll = v_mps > target + settings.brake.rolls_above_mps and rolled_w <= target**2
        else:
            stands_short = eased < settings.brake.short_ratio and way_m > settings.brake.short_m
            may_roll = way_m >= STOP_BY_EYE_M or stands_short  # Nearer, he brakes by eye.
        has_begun = state.s_m >= schedule.begin_m(number)
        if not slows and self.back == 0 and self._scene.brakes.ahead.is_due(state.braked_m, v_mps, CREEPS_FOR_S):
            may_roll = False
        elif not slows and self.back == 0 and may_roll and has_begun and eased < settings.brake.easing_ratio:
            may_roll = self._has_said_creeping(state, way_m) or eased < settings.brake.short_ratio
        if self.back == 0 and eased < settings.brake.early_ratio and may_roll and has_begun:
            self.back, self._creeps_mps = (ROLLS, 0.0) if slows else (CREEPS, self._low_mps(v_mps))
        elif self.back < 0 and (
            eased > settings.brake.again_ratio
            or (self.back == CREEPS and self._scene.brakes.ahead.is_due(state.braked_m, v_mps, settings.lead.astray_s))
        ):
            self.back = 0
        if self.back == CREEPS and self._creeps_mps > highest_mps(schedule, number, state.s_m):
            self.back = 0
        if self.back == CREEPS:
            if v_mps < self._creeps_mps - TARGET_STEP_MPS:
                self._creeps_mps = self._low_mps(v_mps)
            return Instruction(mode=Regime.CRUISE, speed_mps=self._creeps_mps)
        if self.back < 0:
            return coasting(target)
        brake = self._scene.brakes.needed(schedule, number, state, target, begun=self._scene.brake_begun)
        return self._scene.brakes.shown(brake, state, schedule.begin_m(number))

    def _has_said_creeping(self, state: TrainState, left_m: float) -> bool:
        """Whether holding a low speed has been announced in time to a driver who brakes too much for his stop.

        If not, it is announced from now on, unless he will brake by eye by then.
        """
        creeps = Instruction(mode=Regime.CRUISE, speed_mps=self._low_mps(state.v_mps))
        lacks_s = self._scene.notices.lacks_s(creeps, state.now_ns, 0.0)
        way_m = lacks_s * state.v_mps
        if left_m - way_m >= STOP_BY_EYE_M:
            self.creeping_soon = replace(creeps, way_m=way_m, in_s=lacks_s)
        return lacks_s <= 0.0

    def _low_mps(self, v_mps: float) -> float:
        """The low speed to hold before a stop, for a train with this speed."""
        return max(target_below(v_mps), self._settings.brake.creep_mps)

    def _eased_ratio(self, schedule: Schedule, number: int, state: TrainState, target: float) -> float:
        """The braking effort needed from here, as a share of the planned one."""
        needed = self._scene.brakes.ahead.effort_to(
            state.s_m, state.v_mps, schedule.reached_m(number, state.s_m), target
        )
        return needed / max(float(schedule.phases[number].share), SAME_EFFORT)


def _is_braked_soon(ahead: BrakingAhead, state: TrainState, settings: ShowingSettings) -> bool:
    """Whether a limit leaves a train no time to coast back to its speed."""
    return ahead.is_due(state.braked_m, state.v_mps, settings.limit.brakes_back_in_s + settings.lead.braking_s)


def coasting(to_mps: float) -> Instruction:
    """The instruction to coast to a speed."""
    return Instruction(mode=Regime.COAST, speed_mps=to_mps, effort_ratio=0.0)


def highest_mps(schedule: Schedule, number: int, s_m: float) -> float:
    """The highest speed (m/s) allowed anywhere from a position to the end of a phase."""
    section = schedule.section
    first = max(int(np.searchsorted(section.node_m, s_m, side="right")) - 1, 0)
    end = schedule.phases[number + 1].begin if number + 1 < len(schedule.phases) else len(section.step_m)
    return float(section.envelope_mps[min(first, end) : end + 1].max())
