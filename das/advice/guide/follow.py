"""The wanted instruction: the present step, or how to return to it for a driver who has deviated from it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from das.advice.advice import Instruction
from das.advice.braking import AT_MARK_M, LEAST_MPS2, Floats, NeededBrake
from das.advice.guide.guard import (
    LESS_RATIO,
    STEP_RATIO,
    Proposal,
    Sight,
    begins_s,
    braked,
    rate_mps2,
    stepped,
)
from das.advice.guide.memory import Lead, Memory, brake, coast, hold, traction
from das.advice.guide.timeline import OFF_MPS, REACHED_MPS, SAME_MPS, GuideStep, told_mps
from das.advice.regimes import BRAKES, TRACTION, InstructionKind, Regime
from das.advice.shown import OVERSPEED_MPS, REACTS_S, SAME_READING_MPS, STOP_BY_EYE_M, target_below
from das.domain.units import KMH
from das.solver.guide.policies import LEAST_MPS
from das.solver.kernels.guide_policy import STANDS_S
from das.solver.kernels.schedule import BACK_SHARE

WORTH_S = 40.0
"""The least time (s) to the next step with which an acceleration back to a speed is worthwhile and shown."""
ROLLS_BACK_S, BRAKES_BACK_S = 60.0, 10.0
"""The longest time (s) for rolling back to a speed to hold, up or down, and the time (s) for braking back to it
otherwise, with the motors alone if they slow the train."""
COAST_MISSES_MPS = 4.0 * KMH
"""The largest error (m/s) of the speed shown for the end of coasting; beyond it the forecast speed is shown."""
ROLLS_SOON_S = 10.0
"""The least time (s) of rolling up to a speed; if it takes less, the instruction is to hold that speed."""
BRIEF_S, GAINS_S = 30.0, 2.5
"""An acceleration that ends within `BRIEF_S` (s) at a brake must gain at least `GAINS_S` (s), because drivers gain less
than forecast. A brake for the stop is released for at least `BRIEF_S`, except when even the smallest effort brakes too
much."""


def advanced(scene: Sight, memory: Memory) -> Memory:
    """The memory at the step in force here, sought from the remembered step on; if that one begins more than `STANDS_S`
    from now, from the first step on."""
    state = scene.state
    number = memory.step if scene.due_s(memory.step) <= STANDS_S else 0
    while number + 1 < len(scene.steps):
        following = scene.steps[number + 1]
        if following.from_m > (state.braked_m if following.kind is InstructionKind.BRAKE else state.s_m):
            break
        number += 1
    return memory if number == memory.step else at_step(memory, number)


def at_step(memory: Memory, number: int) -> Memory:
    """The memory at the beginning of a step."""
    return replace(memory, step=number, mode=Lead.FOLLOW, back=None, reached=False)


def wanted(scene: Sight, memory: Memory) -> tuple[Proposal, Memory]:
    """The proposal of the present step, due when the step begins, and the memory after it."""
    step = scene.steps[memory.step]
    if memory.back is not None and _is_back(scene, memory, step):
        memory = replace(memory, mode=Lead.FOLLOW, back=None, reached=memory.mode is not Lead.CREEP)
    if memory.back is not None:
        coasts = memory.back.mode is Regime.COAST
        return Proposal(_coasting_back(scene, memory.shown, step) if coasts else memory.back, mode=memory.mode), memory
    found, memory = _of_step(scene, memory, step)
    in_s = scene.due_s(memory.step)
    return found._replace(in_s=in_s) if memory.back is None and not found.brakes else found, memory


def _of_step(scene: Sight, memory: Memory, step: GuideStep) -> tuple[Proposal, Memory]:
    if step.kind is InstructionKind.BRAKE and not memory.reached:
        return _braking(scene, memory, step)
    has_rolled_up = _rolls_up(scene, step) and scene.state.v_mps > step.speed_mps - SAME_READING_MPS
    if step.kind is InstructionKind.COAST and scene.state.s_m < step.by_m and not has_rolled_up:
        return coasting(scene, memory.shown, memory.step), memory
    if step.kind is InstructionKind.TRACTION and not memory.reached:
        to_mps = reachable_mps(scene, memory.step)
        if scene.state.v_mps < to_mps - REACHED_MPS:
            return Proposal(_accelerating(scene, memory, step, to_mps)), memory
        memory = replace(memory, reached=True)
    return _holding(scene, memory, step)


def _rolls_up(scene: Sight, step: GuideStep) -> bool:
    """Whether the train coasts to a higher speed in a step of the plan."""
    return step.kind is InstructionKind.COAST and scene.schedule.speed_at(step.from_m) < step.speed_mps - SAME_MPS


def _is_back(scene: Sight, memory: Memory, step: GuideStep) -> bool:
    v_mps, to_mps = scene.state.v_mps, step.speed_mps
    if memory.mode is Lead.CREEP:
        return _need(scene, step) > planned_effort(scene, step)
    if memory.mode is Lead.BACK_UP:
        return v_mps >= to_mps - REACHED_MPS
    return v_mps <= to_mps + SAME_MPS


def _holding(scene: Sight, memory: Memory, step: GuideStep) -> tuple[Proposal, Memory]:
    """The hold of a step's speed; the return to it for a train that is too far from it and does not roll up to it."""
    to_mps, away_mps = step.speed_mps, scene.state.v_mps - step.speed_mps
    if away_mps < -max(OFF_MPS, scene.rolls_mps2 * ROLLS_BACK_S) and scene.due_s(memory.step + 1) > WORTH_S:
        back = traction(step.effort if step.kind is InstructionKind.TRACTION else BACK_SHARE, to_mps)
        return Proposal(back, mode=Lead.BACK_UP), replace(memory, mode=Lead.BACK_UP, back=back)
    if away_mps > OFF_MPS:
        back, ahead, state = _coasting_back(scene, memory.shown, step), scene.ahead, scene.state
        rolls_long = -scene.rolls_mps2 * ROLLS_BACK_S < away_mps
        if rolls_long or ahead.is_due(state.braked_m, state.v_mps, BRAKES_BACK_S):
            effort = ahead.effort_of(away_mps / BRAKES_BACK_S, state.s_m, state.v_mps)
            motors_slow = rate_mps2(ahead, 1.0, state) > LEAST_MPS2  # On a steep descent, the motors alone may not.
            back = brake(stepped(min(effort, 1.0) if motors_slow else effort), to_mps)
        return Proposal(back, mode=Lead.BACK_DOWN), replace(memory, mode=Lead.BACK_DOWN, back=back)
    goes_on = memory.shown.mode is Regime.COAST and away_mps > SAME_MPS and scene.rolls_mps2 < 0.0
    return Proposal(coast(to_mps) if goes_on else hold(to_mps)), memory


# --- accelerating ----------------------------------------------------------------------------------------------------


def reachable_mps(scene: Sight, number: int) -> float:
    """The speed to accelerate to: for a train slower than the reference, no higher than the next step needs."""
    to_mps = scene.steps[number].speed_mps
    after = scene.after(number)
    if after is not None and after.kind in (InstructionKind.BRAKE, InstructionKind.HOLD) and after.speed_mps < to_mps:
        reached_mps = scene.foreseen.passes_mps(after.from_m)
        return after.speed_mps if reached_mps < after.speed_mps + SAME_MPS else to_mps
    return to_mps


def _accelerating(scene: Sight, memory: Memory, step: GuideStep, to_mps: float) -> Instruction:
    """The acceleration of a step; a hold if accelerating would gain too little time before a brake that is due soon."""
    state, shown = scene.state, memory.shown
    if shown.mode in TRACTION or not is_vain(scene, memory.step):
        return traction(step.effort, to_mps)
    if shown.mode is Regime.CRUISE and shown.speed_mps <= to_mps:
        return shown
    after = scene.after(memory.step)
    return hold(min(max(target_below(state.v_mps), 0.0 if after is None else after.speed_mps), to_mps))


def is_vain(scene: Sight, number: int) -> bool:
    """Whether the acceleration of a step gains this train too little time before a brake that follows soon."""
    begin_m = max(scene.steps[number].from_m, scene.state.s_m)
    end_m, v_mps = _brakes_m(scene, number), max(scene.foreseen.passes_mps(begin_m), 1.0)
    left_s = scene.foreseen.passes_s(end_m) - scene.foreseen.passes_s(begin_m)
    return left_s < BRIEF_S and (end_m - begin_m) / v_mps - left_s < GAINS_S


def _brakes_m(scene: Sight, number: int) -> float:
    """The place (m) where a train that accelerates as forecast must brake, for the next step or a limit before."""
    after = scene.after(number)
    next_m = after.from_m if after is not None else math.inf
    speeds_mps, at_m = scene.foreseen.ahead_mps[1:-1], scene.foreseen.at_m[1:-1]
    curve_mps = scene.schedule.section.envelope_mps[-len(at_m) - 1 :]
    slowed = (curve_mps[:-1] < speeds_mps + SAME_MPS) & (np.diff(curve_mps) < 0.0) & (at_m < next_m)
    slowed &= at_m > scene.steps[number].from_m
    if slowed.any():
        return float(at_m[np.argmax(slowed)])
    return next_m if after is not None and after.kind is InstructionKind.BRAKE else math.inf


# --- coasting --------------------------------------------------------------------------------------------------------


class _Leads(NamedTuple):
    """The result of coasting: the speeds on the way, and the highest end speed of coasting that may be shown."""

    end_m: float
    speeds_mps: Floats
    highest_mps: float

    @property
    def only_slows(self) -> bool:
        """Whether the train ends no faster than it begins, and is hardly faster or slower on the way."""
        first, last = self.speeds_mps[0], self.speeds_mps[-1]
        strays_mps = max(last - self.speeds_mps.min(), self.speeds_mps.max() - first)
        return bool(last <= first + SAME_MPS and strays_mps <= COAST_MISSES_MPS)


def coasting(scene: Sight, shown: Instruction, number: int) -> Proposal:
    """The proposal to coast to the end speed of coasting, or to hold that speed if this is
    as good or the speed is nearly reached."""
    step, after = scene.steps[number], scene.after(number)
    from_m = max(scene.state.s_m, step.from_m)
    v_mps = scene.foreseen.passes_mps(from_m) if from_m > scene.state.s_m else scene.state.v_mps
    leads, to_mps = _leads(scene, step, from_m, v_mps), step.speed_mps
    goes_on = after is not None and after.kind in (InstructionKind.HOLD, InstructionKind.TRACTION)
    is_next = step.to_m > step.by_m or (after is not None and goes_on and after.speed_mps > to_mps - SAME_MPS)
    least_mps = REACHED_MPS if shown.mode is Regime.COAST else -SAME_MPS
    if is_next and least_mps < to_mps - v_mps < OFF_MPS + SAME_MPS and leads.only_slows:
        return Proposal(hold(to_mps))
    told = _told_mps(scene, shown, step, leads)
    if shown.mode is Regime.CRUISE or shown.mode in BRAKES:
        rolled_mps, section = scene.ahead.rolling_mps(from_m, v_mps), scene.schedule.section
        soon = section.node_m[-len(rolled_mps) :] < from_m + ROLLS_SOON_S * v_mps
        tops_mps = section.limit_mps[-len(rolled_mps) :]
        tops_mps = np.minimum(tops_mps, told) if v_mps <= told + SAME_MPS else tops_mps
        reached = tops_mps[soon & (rolled_mps > np.maximum(tops_mps - SAME_READING_MPS, v_mps))]
        if reached.size:
            return Proposal(hold(float(reached[0])))
    return Proposal(coast(told), at_m=leads.end_m)


def _leads(scene: Sight, step: GuideStep, from_m: float, v_mps: float) -> _Leads:
    """The result of a step's coasting from a place and a speed.

    Coasting ends with the step, or earlier where the train must brake to a speed over `OVERSPEED_MPS` below its own.
    """
    ahead, state, section, end_m = scene.ahead, scene.state, scene.schedule.section, _by_m(scene, step)
    rolled_mps = ahead.rolling_mps(from_m, v_mps)
    rolled_mps = np.minimum(rolled_mps, section.limit_mps[-len(rolled_mps) :])
    if _rolls_up(scene, step):  # Coasting ends at the speed of the step, even if that is reached sooner than planned.
        rolled_mps = np.minimum(rolled_mps, max(step.speed_mps, v_mps))
    at_m = np.append(from_m, section.node_m[-len(rolled_mps) :])
    passes_mps = np.append(v_mps, rolled_mps)
    brakes_m = max(ahead.curve_begins_m(from_m, rolled_mps) - state.ahead_m, state.s_m)
    if brakes_m < end_m:
        at_mps = float(np.interp(brakes_m, at_m, passes_mps))
        needed = ahead.needed(brakes_m, at_mps)
        if needed.effort > 0.0 and needed.target_mps < at_mps - OVERSPEED_MPS:
            end_m = brakes_m
    ends_mps = float(np.interp(end_m, at_m, passes_mps))
    on_way = (section.node_m[:-1] >= from_m) & (section.node_m[:-1] < end_m)
    highest_mps = float(section.limit_mps[on_way].min(initial=scene.place.limit_mps))
    return _Leads(end_m, np.append(passes_mps[at_m < end_m], ends_mps), highest_mps)


def _coasting_back(scene: Sight, shown: Instruction, step: GuideStep) -> Instruction:
    """Coasting back to the speed of a step, or to that at which a brake for a limit ends it earlier."""
    v_mps, to_mps = scene.state.v_mps, step.speed_mps
    leads = _leads(scene, step, scene.state.s_m, v_mps)
    highest_mps = min(leads.highest_mps, max(target_below(v_mps), to_mps))
    leads = leads._replace(speeds_mps=np.maximum(leads.speeds_mps, to_mps), highest_mps=highest_mps)
    return coast(_told_mps(scene, shown, step, leads))


def _told_mps(scene: Sight, shown: Instruction, step: GuideStep, leads: _Leads) -> float:
    """The speed to show to a driver who coasts: the shown or planned one if near the end speed, else the end speed."""
    ends_mps = float(leads.speeds_mps[-1])
    goes_on = shown.mode is Regime.COAST and shown.speed_mps <= leads.highest_mps + SAME_READING_MPS
    for told in (shown.speed_mps if goes_on else math.nan, step.speed_mps):
        if abs(ends_mps - told) <= COAST_MISSES_MPS:
            return told
    return told_mps(min(max(ends_mps, LEAST_MPS), leads.highest_mps), scene.schedule.section, leads.highest_mps)


# --- braking ---------------------------------------------------------------------------------------------------------


def _braking(scene: Sight, memory: Memory, step: GuideStep) -> tuple[Proposal, Memory]:
    """The brake of a step with one effort; after too much braking, coasting to a lower speed, or creeping to a stop."""
    state, to_mps, slows = scene.state, step.speed_mps, step.speed_mps > SAME_MPS
    if slows and state.v_mps <= to_mps + SAME_MPS:
        return _holding(scene, replace(memory, reached=True), step)
    need, in_s = _need(scene, step), scene.due_s(memory.step)
    if in_s > 0.0 and step.effort == 0.0:
        in_s = min(in_s, max(begins_s(scene, state.v_mps), REACTS_S))
    if in_s <= 0.0 and need < LESS_RATIO * planned_effort(scene, step):
        back = _eased(scene, memory, step, need)
        if back is not None:
            mode = Lead.BACK_DOWN if slows else Lead.CREEP
            return Proposal(back, mode=mode), replace(memory, mode=mode, back=back)
    if step.effort > 0.0:  # No limit requires this brake: the motors suffice.
        need = min(max(need, step.effort), 1.0)
    found = braked(scene, memory, NeededBrake(need, to_mps, _by_m(scene, step)), in_s)
    return found._replace(waits=step.effort > 0.0), memory


def _eased(scene: Sight, memory: Memory, step: GuideStep, need: float) -> Instruction | None:
    """The instruction for a driver who has braked early or hard; None if the train is so near that it must brake."""
    state, v_mps, to_mps = scene.state, scene.state.v_mps, step.speed_mps
    left_m = _by_m(scene, step) - state.s_m
    if to_mps > SAME_MPS:
        rolled_w = v_mps**2 + 2.0 * scene.rolls_mps2 * left_m
        return coast(to_mps) if v_mps > to_mps + OFF_MPS and rolled_w <= to_mps**2 else None
    shown = memory.shown if memory.shown.mode in BRAKES else brake(planned_effort(scene, step), 0.0)
    soon_mps = v_mps - STANDS_S * rate_mps2(scene.ahead, -shown.effort_ratio, state)
    low_mps = max(target_below(soon_mps), LEAST_MPS)
    # If even the least effort shown is too much, the train would stop short of the mark: a brief release is better.
    least_s = BRIEF_S if need >= STEP_RATIO else BRAKES_BACK_S
    if scene.ahead.is_due(state.braked_m, low_mps, least_s):
        return None
    rolls_m = v_mps**2 / (2.0 * max(-scene.rolls_mps2, LEAST_MPS2))
    by_eye = left_m - STANDS_S * v_mps < STOP_BY_EYE_M
    return None if by_eye and rolls_m > left_m - AT_MARK_M else hold(low_mps)


def _by_m(scene: Sight, step: GuideStep) -> float:
    """The place (m) where a step has reached its speed; for a train beyond it, the end of the step."""
    return step.by_m if scene.state.s_m < step.by_m else step.to_m


def _need(scene: Sight, step: GuideStep) -> float:
    from_m = max(scene.state.braked_m, step.from_m)
    return scene.ahead.effort_to(from_m, scene.state.v_mps, _by_m(scene, step), step.speed_mps)


def planned_effort(scene: Sight, step: GuideStep) -> float:
    """The effort that the reference needs for the brake of a step."""
    if step.effort > 0.0:
        return step.effort
    v_mps = max(scene.schedule.speed_at(step.from_m), 1.0)
    return scene.ahead.effort_to(step.from_m, v_mps, step.by_m, step.speed_mps)
