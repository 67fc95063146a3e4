"""What is announced: the next two changes, or the brake of the guard where it comes first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from das.advice.advice import Instruction
from das.advice.guide.follow import BRIEF_S, coasting, is_vain, planned_effort, reachable_mps
from das.advice.guide.guard import SOONER_S, STEP_RATIO, Sight, foreseen_brake, lasts_s
from das.advice.guide.memory import NOTHING, Memory, brake, coast, hold, is_own_end, repeats, traction
from das.advice.guide.timeline import REACHED_MPS, SAME_MPS, STANDS_S, GuideStep
from das.advice.regimes import BRAKES, KIND_OF, TRACTION, InstructionKind, Regime
from das.domain.units import NS

AHEAD = 2
"""The number of changes shown after the present instruction."""
BEGUN_M = 1.0
"""The distance (m) ahead of a place within which a limit that begins there already applies to it."""


def following(scene: Sight, memory: Memory, now: Instruction, put_off: Instruction | None) -> tuple[Instruction, ...]:
    """The next changes after the instruction shown; `put_off` waits until it has been announced."""
    found: list[Instruction] = []
    for number in range(memory.step + 1, len(scene.steps)):
        if len(found) >= AHEAD:
            break
        last = found[-1] if found else now
        one = said(scene, number, now if number == memory.step + 1 else NOTHING)
        if one is None or repeats(one, last) or is_own_end(one, last) or _needs_not(one, last):
            continue
        if one.mode in BRAKES or one.mode in TRACTION or scene.due_s(number + 1) - scene.due_s(number) >= STANDS_S:
            found.append(one)
    found = _guarded(scene, memory, now, found)
    found = [_waiting(scene, memory, now, one) if k == 0 else one for k, one in enumerate(found)]
    if put_off is not None and put_off.speed_mps <= scene.ahead.allowed_mps(scene.state.braked_m + put_off.way_m):
        found = sorted([put_off, *found], key=lambda one: one.in_s)
    return _allowed(scene, now, found)


def said(scene: Sight, number: int, now: Instruction = NOTHING) -> Instruction | None:
    """The instruction of a step as announced; None if this train needs it not, because it is slower or as fast.

    A train that holds a speed `now`, and is no faster than a brake asks for, holds that.
    """
    step, passes_mps = scene.steps[number], scene.foreseen.passes_mps(scene.steps[number].from_m)
    if step.kind is InstructionKind.BRAKE and passes_mps < step.speed_mps + SAME_MPS:
        return None
    if step.kind is InstructionKind.TRACTION:
        step = step._replace(speed_mps=reachable_mps(scene, number))
    is_there = passes_mps > step.speed_mps - REACHED_MPS
    if step.kind is InstructionKind.TRACTION and (is_there or is_vain(scene, number)):
        return None
    in_s, way_m = scene.due_s(number), max(step.from_m - scene.state.s_m, 0.0)
    if now.mode is Regime.CRUISE and scene.state.v_mps < step.speed_mps + SAME_MPS:
        step = step._replace(kind=InstructionKind.HOLD) if step.kind is InstructionKind.BRAKE else step
    if step.kind is InstructionKind.BRAKE:
        sooner_s = SOONER_S + scene.state.ahead_m / max(passes_mps, 1.0)
        way_m, in_s = max(way_m - sooner_s * passes_mps, 0.0), in_s - sooner_s
    one = instruction(scene, step)
    if step.kind is InstructionKind.COAST and in_s < BRIEF_S and now.mode in KIND_OF:
        one = coasting(scene, now, number).one  # As it will be shown.
    return replace(one, way_m=way_m, in_s=max(in_s, 0.0))


def _needs_not(one: Instruction, last: Instruction) -> bool:
    """Whether a driver who does the last instruction is no faster than a brake asks for."""
    return one.mode in BRAKES and last.mode in (*TRACTION, Regime.CRUISE) and one.speed_mps > last.speed_mps - SAME_MPS


def instruction(scene: Sight, step: GuideStep) -> Instruction:
    """The instruction of a step, for a train on the reference."""
    if step.kind is InstructionKind.TRACTION:
        return traction(step.effort, step.speed_mps)
    if step.kind is InstructionKind.HOLD:
        return hold(step.speed_mps)
    if step.kind is InstructionKind.COAST:
        return coast(step.speed_mps)
    return brake(max(planned_effort(scene, step), STEP_RATIO), step.speed_mps)


def _waiting(scene: Sight, memory: Memory, now: Instruction, one: Instruction) -> Instruction:
    """The next change, due no sooner than the instruction shown has stood; a brake does not wait."""
    if one.mode in BRAKES or now.mode not in KIND_OF:
        return one
    stands_s = STANDS_S - (scene.state.now_ns - memory.since_ns) * NS
    return one if one.in_s >= stands_s else replace(one, in_s=stands_s, way_m=stands_s * scene.state.v_mps)


def _guarded(scene: Sight, memory: Memory, now: Instruction, found: list[Instruction]) -> list[Instruction]:
    """The changes, with the next brake early enough for a driver who does what is shown now."""
    found = _after_brake(scene, now, found) if now.mode in BRAKES else found
    guard = foreseen_brake(scene, now, max((memory.due_ns - scene.state.now_ns) * NS, 0.0))
    if found and found[0].mode is Regime.COAST and (guard is None or guard.in_s > found[0].in_s):
        after = foreseen_brake(scene, found[0], found[0].in_s)
        guard = after if after is not None and after.in_s < found[0].in_s + STANDS_S else guard
        found = found[1:] if guard is after is not None else found  # It would be over at once.
    before_m = scene.state.s_m + found[0].way_m if found else math.inf
    planned = found[0] if found and found[0].mode in BRAKES else None
    is_braked = guard is None or (now.mode in BRAKES and guard.one.speed_mps > now.speed_mps - SAME_MPS)
    if guard is None or is_braked or scene.state.s_m + guard.one.way_m >= before_m:
        return found
    if planned is not None and guard.one.speed_mps < planned.speed_mps + SAME_MPS:
        return [replace(planned, way_m=guard.one.way_m, in_s=guard.in_s), *found[1:]]
    return found if scene.state.s_m + guard.one.way_m >= before_m - BEGUN_M else [guard.one, *found[:1]]


def _after_brake(scene: Sight, now: Instruction, found: list[Instruction]) -> list[Instruction]:
    """The changes after a brake: the first is due when the brake has reached its speed; none leads to no lower one."""
    while found and found[0].mode in BRAKES and found[0].speed_mps > now.speed_mps - SAME_MPS:
        found = found[1:]
    if not found or found[0].mode in BRAKES:
        return found
    ends_s = lasts_s(scene, now)
    if found[0].in_s >= ends_s or any(one.in_s <= ends_s for one in found[1:]):
        return found
    way_m = 0.5 * (scene.state.v_mps + now.speed_mps) * ends_s
    return [replace(found[0], in_s=ends_s, way_m=way_m), *found[1:]]


def _allowed(scene: Sight, now: Instruction, found: list[Instruction]) -> tuple[Instruction, ...]:
    """The changes with no speed above the limit where it applies, and none that repeats the one before it.

    The speed of a brake or of coasting applies at its end; any other speed, where the change is due.
    """
    kept, section = [now], scene.schedule.section
    for k, one in enumerate(found[:AHEAD]):
        ends = k + 1 < len(found) and one.mode in (*BRAKES, Regime.COAST)
        ways_m = np.array([one.way_m, max(found[k + 1].way_m if ends else 0.0, one.way_m)])
        nodes = np.searchsorted(section.node_m, scene.state.s_m + BEGUN_M + ways_m, side="right")
        first, last = np.clip(nodes - 1, 0, len(section.limit_mps) - 1)
        limit_mps = float(section.limit_mps[first : last + 1].max())
        capped = replace(one, speed_mps=limit_mps) if one.speed_mps > limit_mps else one
        if not repeats(capped, kept[-1]) and not is_own_end(capped, kept[-1]):
            kept.append(capped)
    return tuple(kept[1:])
