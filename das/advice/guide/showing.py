"""The instruction shown to the driver each second: the plan, overridden by limits (guard), changed late (gate)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from das.advice.advice import Guidance, Instruction, ReplanCause
from das.advice.braking import AT_MARK_M, BACK_IN_S, BrakingAhead
from das.advice.goal import SpeedsAllowed, TrainState
from das.advice.guide.follow import (
    BRIEF_S,
    advanced,
    at_step,
    coasting,
    is_vain,
    planned_effort,
    reachable_mps,
    wanted,
)
from das.advice.guide.guard import (
    BRAKE_LEAD_S,
    STEP_RATIO,
    Proposal,
    Sight,
    begins_s,
    brake_lead_s,
    foreseen_brake,
    guarded,
    lasts_s,
    stands_at_mark,
    stepped,
    way_m,
)
from das.advice.guide.keeping import Changes, Kept
from das.advice.guide.memory import NOTHING, Lead, Memory, alike, brake, coast, hold, is_own_end, repeats, traction
from das.advice.guide.timeline import COAST_LEAD_S, OFF_MPS, REACHED_MPS, SAME_MPS, GuideStep, timeline
from das.advice.regimes import BRAKES, KIND_OF, TRACTION, InstructionKind, Regime
from das.advice.shown import REACTS_S, SAME_READING_MPS
from das.domain.units import NS
from das.solver.guide.policies import LEAST_MPS
from das.solver.guide.schedule import Schedule
from das.solver.kernels.forces import traction_limit
from das.solver.kernels.guide_policy import STANDS_S
from das.solver.section import Section

LEADS_S = {
    InstructionKind.COAST: COAST_LEAD_S,
    InstructionKind.BRAKE: BRAKE_LEAD_S,
    InstructionKind.TRACTION: REACTS_S,
    InstructionKind.HOLD: 0.0,
}
"""Time (s) for which an instruction is shown before it is due; 0 if it is to accelerate above the present limit."""
FORGOTTEN_S = 15.0
"""The time (s) without any instruction after which the next one is shown as if there had been none before."""
IMPOSED = (ReplanCause.LINE, ReplanCause.GOAL, ReplanCause.POINT)
"""Causes of a new reference that came from outside, after the instruction shown was chosen."""
AHEAD = 2
"""The number of changes shown after the present instruction."""
BEGUN_M = 1.0
"""Largest distance (m) from a place to the beginning of a limit ahead that already applies at the place."""


class Showing:
    """Chooses the present and next instructions second by second, and remembers them."""

    def __init__(self) -> None:
        self._memory = Memory()
        self._schedule: Schedule | None = None
        self._steps: tuple[GuideStep, ...] = ()
        self._ahead: BrakingAhead | None = None
        self._next_ns = 0
        self.phase = 0
        """The phase of the schedule in which the train is."""

    def forget(self) -> None:
        """Forget what was shown, as if the display were blank."""
        self._memory = replace(self._memory, shown=Instruction(), mode=Lead.SILENT, back=None)

    def has_shown(self, now: Instruction, now_ns: int) -> None:
        """Note a brake that was shown at a time (ns) but not chosen here; other instructions are ignored."""
        if now.mode in BRAKES and self._memory.shown.mode not in BRAKES:
            self._memory = replace(self._memory, shown=now, since_ns=now_ns, due_ns=now_ns)

    @property
    def changes(self) -> Changes:
        """The moments of the last change of the instruction shown, and of the next one."""
        return Changes(self._memory.since_ns, self._next_ns)

    @property
    def shown_effort(self) -> float:
        """The braking effort shown (> 0); 0 if no brake is shown."""
        return -self._memory.shown.effort_ratio if self._memory.shown.mode in BRAKES else 0.0

    def stands_at_mark(self, state: TrainState) -> bool:
        """Whether a train close to its stop will stop near the mark if it continues to brake as shown."""
        return self._ahead is not None and stands_at_mark(self._ahead, self._memory.shown, state)

    def braking(self, effort: float) -> Instruction:
        """The instruction to brake to a standstill with an effort (> 0), whatever the reference is."""
        self._memory = replace(self._memory, shown=brake(effort, 0.0), mode=Lead.GUARD)
        return self._memory.shown

    def creeping(self, section: Section, state: TrainState, place: SpeedsAllowed) -> Guidance:
        """The instruction to creep to the stop, or to brake if that is due, and the brake after it."""
        self.forget()
        self._ahead = ahead = BrakingAhead.of(section)
        v_mps = max(state.v_mps, 1.0)
        begins_m = ahead.curve_begins_m(state.s_m, np.full(ahead.nodes_ahead(state.s_m), LEAST_MPS))
        needed = ahead.needed(begins_m, LEAST_MPS)
        lead_s = max(BRAKE_LEAD_S + ahead.sooner_s(state.s_m, v_mps), AT_MARK_M / v_mps)
        if place.allowed_mps < LEAST_MPS:  # In the last metres the driver finds the mark by eye.
            now = brake(STEP_RATIO, 0.0)
        elif ahead.is_due(state.braked_m, v_mps, lead_s):
            now = brake(stepped(ahead.needed(state.braked_m, v_mps).effort), needed.target_mps)
        else:
            now = hold(LEAST_MPS)
        stops = replace(brake(stepped(needed.effort), needed.target_mps), way_m=begins_m - state.s_m)
        after = () if now.mode in BRAKES else (replace(stops, in_s=stops.way_m / LEAST_MPS),)
        way_m, wheel_n = section.end_m - state.s_m, force_n(ahead, now, state)
        return Guidance(
            now=now, following=after, target_m=way_m, target_s=way_m / max(now.speed_mps, 1.0), force_n=wheel_n,
            reference_force_n=wheel_n,
        )  # fmt: skip

    def show(self, kept: Kept, state: TrainState, place: SpeedsAllowed) -> Guidance:
        """Guidance that follows the reference, without a reason; `reference_force_n` is for the exact effort."""
        scene, memory = self._begin(kept, state, place), self._memory
        replan, now_ns = kept.reference.replan, state.now_ns
        imposed = replan.cause in IMPOSED and replan.time_ns > memory.since_ns
        chosen, due_s, memory, put_off = self._chosen(scene, memory, imposed=imposed)
        one, before, mode, back, efforts = chosen.one, memory.shown, memory.mode, memory.back, memory.efforts
        changed = not repeats(one, before) or (one.mode in BRAKES and one.effort_ratio != before.effort_ratio)
        if chosen.brakes and math.isfinite(chosen.at_m):
            efforts = {**efforts, chosen.at_m: -one.effort_ratio}
        if chosen.guarded:
            mode, back = Lead.GUARD, None
        elif mode is Lead.SILENT or (mode is Lead.GUARD and not chosen.brakes):
            mode = Lead.FOLLOW
        memory = replace(
            memory, shown=one, mode=mode, back=back, efforts=efforts, since_ns=now_ns if changed else memory.since_ns,
            due_ns=memory.due_ns if alike(one, before) else now_ns + round(due_s / NS),
        )  # fmt: skip
        in_s = max((memory.due_ns - now_ns) * NS, 0.0)
        now = replace(one, way_m=in_s * state.v_mps, in_s=in_s)
        after = following(scene, memory, now, put_off)
        memory = replace(memory, announced=memory.noted(after, now_ns), noted_ns=now_ns)
        self._memory = memory
        next_s = in_s if in_s > 0.0 or not after else after[0].in_s
        self._next_ns = now_ns + round(next_s / NS)
        goal_m = self._goal_m(scene, memory, chosen)
        exact = replace(now, effort_ratio=-chosen.exact) if 0.0 < chosen.exact < -now.effort_ratio else now
        self.phase = scene.steps[memory.step].number
        return Guidance(
            now=now, following=after, target_m=max(goal_m - state.s_m, 0.0), target_s=scene.foreseen.passes_s(goal_m),
            force_n=force_n(scene.ahead, now, state), reference_force_n=force_n(scene.ahead, exact, state),
            replan=replan,
        )  # fmt: skip

    def _begin(self, kept: Kept, state: TrainState, place: SpeedsAllowed) -> Sight:
        """The scene of this second; with another reference, the timeline starts again."""
        schedule = kept.reference.schedule
        if self._ahead is None or self._ahead.section is not schedule.section:
            self._ahead = BrakingAhead.of(schedule.section)
            self._memory = replace(self._memory, efforts={})
        if schedule is not self._schedule:
            self._schedule, self._steps = schedule, timeline(schedule)
            self._memory = at_step(self._memory, 0)
        if not 0 <= (state.now_ns - self._memory.noted_ns) * NS <= FORGOTTEN_S:
            self._memory = replace(self._memory, shown=Instruction())
        scene = Sight(schedule, self._steps, kept.forecast, state, place, self._ahead)
        self._memory = advanced(scene, self._memory)
        return scene

    def _chosen(
        self, scene: Sight, memory: Memory, *, imposed: bool
    ) -> tuple[Proposal, float, Memory, Instruction | None]:
        """The proposal shown, the time (s) until it is due, the memory, and a change that waits to be announced."""
        state, shown = scene.state, memory.shown
        stands = Proposal(shown, max((memory.due_ns - state.now_ns) * NS, 0.0), memory.mode)
        if stands_at_mark(scene.ahead, shown, state):
            return stands, stands.in_s, memory, None
        asked = guarded(scene, memory, stands)
        harder = shown.mode in BRAKES and asked.one.effort_ratio < shown.effort_ratio
        is_safe = shown.mode not in KIND_OF or (alike(shown, asked.one) and not harder)
        freely, memory = wanted(scene, memory)
        one = guarded(scene, memory, freely)
        early = self._early(scene, memory, is_safe=is_safe)
        if early is not None and (early[0].brakes or not one.guarded):
            return early[0], early[1].due_s, early[2], None
        if not is_safe and asked.brakes and not one.guarded and memory.mode is not Lead.FOLLOW:
            one = asked  # The limits require a brake later than the guide does.
        stood = (state.now_ns - memory.since_ns) * NS >= STANDS_S
        slower = one.one.speed_mps < state.v_mps - SAME_MPS and not one.guarded
        if imposed and stood and slower and shown.mode in TRACTION:
            # An external cause requires a lower speed: stop accelerating now, but brake only after an announcement.
            return Proposal(hold(one.one.speed_mps)) if one.brakes else one, 0.0, memory, None
        next_s = _next_s(scene, memory.step, one)
        opens = opening(memory, one, state, is_safe=is_safe, next_s=next_s)
        if has_led(memory, one.one, state) and 0.0 < opens.due_s < math.inf:
            # The target speed is reached: hold it (a brake is released). Any other instruction is announced first.
            notice = replace(one.one, in_s=opens.due_s, way_m=opens.due_s * state.v_mps)
            return guarded(scene, memory, Proposal(hold(shown.speed_mps))), 0.0, memory, notice
        if opens.now:
            return one, opens.due_s, memory, _rest(scene, memory, freely, one)
        put_off = _rest(scene, memory, freely, one)
        if KIND_OF.get(one.one.mode) is not KIND_OF.get(shown.mode) and 0.0 < opens.due_s < math.inf:
            put_off = replace(one.one, in_s=opens.due_s, way_m=opens.due_s * state.v_mps)
        kept = one._replace(one=shown) if one.brakes and shown.mode in BRAKES else stands
        return kept, stands.in_s, memory, put_off

    def _early(self, scene: Sight, memory: Memory, *, is_safe: bool) -> tuple[Proposal, Opening, Memory] | None:
        """The next step if it is to be shown now, shortly before it begins; otherwise None."""
        number, state = memory.step + 1, scene.state
        if number >= len(scene.steps) or not (is_safe or scene.steps[number].kind is InstructionKind.BRAKE):
            return None
        step, here = scene.steps[number], scene.steps[memory.step]
        still_brakes = here.kind is InstructionKind.BRAKE and state.v_mps > here.speed_mps + SAME_MPS
        if still_brakes and step.kind is not InstructionKind.BRAKE:
            return None
        lead_s, due_s = LEADS_S[step.kind], scene.due_s(number)
        if step.kind is InstructionKind.BRAKE:
            lead_s = brake_lead_s(scene, memory.shown) + _sooner_s(scene, state.s_m, state.v_mps)
        if step.kind is InstructionKind.TRACTION and step.speed_mps > scene.place.limit_mps:
            lead_s = 0.0
        if due_s > lead_s:
            return None
        one, then = wanted(scene, at_step(memory, number))
        one = guarded(scene, then, one)
        next_s = _next_s(scene, number, one)
        opens = opening(then, one, state, is_safe=True, next_s=next_s, lead_s=lead_s)
        return (one, opens, then) if opens.now else None

    def _goal_m(self, scene: Sight, memory: Memory, chosen: Proposal) -> float:
        """The place (m) where the instruction shown has led to its speed, or ends."""
        step, one, state = scene.steps[memory.step], chosen.one, scene.state
        goal_m = chosen.at_m if math.isfinite(chosen.at_m) and chosen.at_m > state.s_m else math.inf
        if chosen.brakes:
            way = way_m(scene.ahead, -one.effort_ratio, one.speed_mps, state)
            return goal_m if math.isfinite(goal_m) else state.s_m + way
        if one.mode is not Regime.COAST:
            return step.to_m
        section = scene.schedule.section
        lower = section.envelope_mps < one.speed_mps - SAME_READING_MPS
        lower &= section.node_m > max(state.s_m, step.from_m)
        return min(step.to_m, goal_m, float(section.node_m[np.argmax(lower)]) if lower.any() else math.inf)


def _sooner_s(scene: Sight, s_m: float, v_mps: float) -> float:
    """The time (s) before its place in the reference at which a brake begins, with the error of the position."""
    return scene.ahead.sooner_s(s_m, v_mps) + scene.state.ahead_m / max(v_mps, 1.0)


def _next_s(scene: Sight, number: int, one: Proposal) -> float:
    """Time (s) until the change that follows the wanted instruction: the next step, or an earlier brake."""
    brake_s = begins_s(scene, one.one.speed_mps) if one.mode is Lead.CREEP else math.inf
    if one.one.mode is Regime.COAST:
        guard = foreseen_brake(scene, one.one, one.in_s)
        brake_s = math.inf if guard is None else guard.in_s
    return min(scene.due_s(number + 1), brake_s)


def _rest(scene: Sight, memory: Memory, freely: Proposal, one: Proposal) -> Instruction | None:
    """The step that a brake of the guard interrupts and that continues after it; None if it is over by then."""
    if not (one.brakes and one.guarded) or freely.brakes or is_own_end(freely.one, one.one):
        return None
    if freely.one.mode is Regime.COAST and freely.one.speed_mps > one.one.speed_mps - SAME_MPS:
        return None
    in_s = one.in_s + lasts_s(scene, one.one)
    if scene.due_s(memory.step + 1) < in_s + STANDS_S:
        return None
    return replace(freely.one, in_s=in_s, way_m=in_s * 0.5 * (scene.state.v_mps + one.one.speed_mps))


def force_n(ahead: BrakingAhead, now: Instruction, state: TrainState) -> float:
    """The wheel force (N) with which a driver follows an instruction, without overshooting its speed."""
    s_m, v_mps = state.s_m, max(state.v_mps, 0.1)
    if now.mode in BRAKES:
        return ahead.force_n(-now.effort_ratio, s_m, v_mps)
    if now.mode is Regime.COAST:
        return 0.0
    train, closing_mps2 = ahead.section.train, (now.speed_mps - v_mps) / BACK_IN_S
    wanted_n = ahead.section.resistance_n(s_m, v_mps) + train.inertial_mass_kg * closing_mps2
    most_n = float(traction_limit(v_mps, train)) * (now.effort_ratio if now.mode in TRACTION else 1.0)
    least_n = 0.0 if now.mode in TRACTION else ahead.force_n(1.0, s_m, v_mps)
    return min(max(wanted_n, least_n), most_n)


# --- the gate: the only hysteresis. When a wanted instruction replaces the one shown ----------------------------------


class Opening(NamedTuple):
    """Whether a wanted instruction is shown now, and the time (s) until it is due."""

    now: bool
    due_s: float


def opening(
    memory: Memory, wanted: Proposal, state: TrainState, *, is_safe: bool, next_s: float, lead_s: float | None = None
) -> Opening:
    """The decision whether a wanted instruction replaces the one shown.

    It must have been announced for `STANDS_S` when it is due, and the one shown must have been shown as long, unless
    the latter is no longer safe (`is_safe`) or has led to its speed; a brake for limits does not wait. A hold or
    coasting that would last for less than `STANDS_S` before the next change (in `next_s`) is not shown.
    """
    one, shown, now_ns, v_mps = wanted.one, memory.shown, state.now_ns, state.v_mps
    if shown.mode not in KIND_OF or not is_safe:
        return Opening(True, wanted.in_s)
    stands_s = max(STANDS_S - (now_ns - memory.since_ns) * NS, 0.0)
    if repeats(one, shown):
        return Opening(stands_s <= 0.0 or one.effort_ratio < shown.effort_ratio, wanted.in_s)
    brakes, brakes_on = one.mode in BRAKES, one.mode in BRAKES and shown.mode in BRAKES
    if brakes_on and (
        one.effort_ratio < shown.effort_ratio or one.speed_mps < shown.speed_mps + SAME_MPS or reached(shown, v_mps)
    ):
        return Opening(True, 0.0)  # The driver does not release the brake between two brake instructions.
    if reached(shown, v_mps):
        due_s = 0.0 if is_own_end(one, shown) else memory.lacks_s(one, now_ns, 0.0)
        is_now = due_s <= 0.0
    elif is_own_end(one, shown) or KIND_OF[one.mode] is KIND_OF[shown.mode]:
        due_s, is_now = max(wanted.in_s, stands_s), stands_s <= 0.0
    else:
        stands_s = 0.0 if brakes else stands_s
        lacks_s = memory.lacks_s(one, now_ns, wanted.in_s) if wanted.waits else 0.0
        due_s = max(wanted.in_s + lacks_s, stands_s)
        lead_s = LEADS_S[KIND_OF[one.mode]] if lead_s is None else lead_s
        if wanted.mode is Lead.BACK_DOWN and brakes:
            due_s = max(due_s, lead_s)
        is_now = stands_s <= 0.0 and due_s <= lead_s
    if one.mode in (Regime.COAST, Regime.CRUISE) and next_s - due_s < STANDS_S:
        return Opening(False, math.inf)
    return Opening(is_now, due_s)


def has_led(memory: Memory, one: Instruction, state: TrainState) -> bool:
    """Whether a brake or coasting has reached its target speed, and the wanted instruction is not just to hold it."""
    shown, v_mps = memory.shown, state.v_mps
    ended = reached(shown, v_mps) and one.mode not in BRAKES
    if shown.mode is Regime.COAST and one.mode is Regime.CRUISE:
        ended = -OFF_MPS < v_mps - shown.speed_mps <= SAME_MPS and (state.now_ns - memory.since_ns) * NS >= STANDS_S
    return ended and not is_own_end(one, shown)


def reached(shown: Instruction, v_mps: float) -> bool:
    """Whether a brake has reached its speed."""
    return shown.mode in BRAKES and shown.speed_mps > SAME_MPS and v_mps <= shown.speed_mps + SAME_MPS


# --- what is announced: the next two changes, or the brake of the guard if it comes first ------------------------


def following(scene: Sight, memory: Memory, now: Instruction, put_off: Instruction | None) -> tuple[Instruction, ...]:
    """The next changes after the instruction shown; `put_off` is one that waits until it has been announced."""
    found: list[Instruction] = []
    for number in range(memory.step + 1, len(scene.steps)):
        if len(found) >= AHEAD:
            break
        last = found[-1] if found else now
        one = said(scene, number, now if number == memory.step + 1 else NOTHING)
        if one is None or repeats(one, last) or is_own_end(one, last):
            continue
        if one.mode in BRAKES or one.mode in TRACTION or scene.due_s(number + 1) - scene.due_s(number) >= STANDS_S:
            found.append(one)
    found = _guarded(scene, memory, now, found)
    found = [_waiting(scene, memory, now, one) if k == 0 else one for k, one in enumerate(found)]
    if put_off is not None and put_off.speed_mps <= scene.ahead.allowed_mps(scene.state.braked_m + put_off.way_m):
        found = sorted([put_off, *found], key=lambda one: one.in_s)
    return _allowed(scene, now, found)


def said(scene: Sight, number: int, now: Instruction = NOTHING) -> Instruction | None:
    """The instruction of a step as announced after `now`; None if the train's speed makes the step unnecessary."""
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
        sooner_s = _sooner_s(scene, step.from_m, passes_mps)
        way_m, in_s = max(way_m - sooner_s * passes_mps, 0.0), in_s - sooner_s
    one = _instruction(scene, step)
    if step.kind is InstructionKind.COAST and in_s < BRIEF_S and now.mode in KIND_OF:
        one = coasting(scene, now, number).one  # As it will be shown.
    return replace(one, way_m=way_m, in_s=max(in_s, 0.0))


def _instruction(scene: Sight, step: GuideStep) -> Instruction:
    if step.kind is InstructionKind.TRACTION:
        return traction(step.effort, step.speed_mps)
    if step.kind is InstructionKind.HOLD:
        return hold(step.speed_mps)
    if step.kind is InstructionKind.COAST:
        return coast(step.speed_mps)
    return brake(max(planned_effort(scene, step), STEP_RATIO), step.speed_mps)


def _waiting(scene: Sight, memory: Memory, now: Instruction, one: Instruction) -> Instruction:
    """The next change, due only after the present instruction has been shown long enough; a brake does not wait."""
    if one.mode in BRAKES or now.mode not in KIND_OF:
        return one
    stands_s = STANDS_S - (scene.state.now_ns - memory.since_ns) * NS
    return one if one.in_s >= stands_s else replace(one, in_s=stands_s, way_m=stands_s * scene.state.v_mps)


def _guarded(scene: Sight, memory: Memory, now: Instruction, found: list[Instruction]) -> list[Instruction]:
    """The changes, with the next brake early enough for a driver who follows the instruction shown."""
    found = _after_brake(scene, now, found) if now.mode in BRAKES else found
    guard = foreseen_brake(scene, now, max((memory.due_ns - scene.state.now_ns) * NS, 0.0))
    if found and found[0].mode is Regime.COAST and (guard is None or guard.in_s > found[0].in_s):
        after = foreseen_brake(scene, found[0], found[0].in_s)
        guard = after if after is not None and after.in_s < found[0].in_s + STANDS_S else guard
        found = found[1:] if guard is after is not None else found  # It would end immediately.
    before_m = scene.state.s_m + found[0].way_m if found else math.inf
    planned = found[0] if found and found[0].mode in BRAKES else None
    is_braked = guard is None or (now.mode in BRAKES and guard.one.speed_mps > now.speed_mps - SAME_MPS)
    if guard is None or is_braked or scene.state.s_m + guard.one.way_m >= before_m:
        return found
    if planned is not None and guard.one.speed_mps < planned.speed_mps + SAME_MPS:
        return [replace(planned, way_m=guard.one.way_m, in_s=guard.in_s), *found[1:]]
    return found if scene.state.s_m + guard.one.way_m >= before_m - BEGUN_M else [guard.one, *found[:1]]


def _after_brake(scene: Sight, now: Instruction, found: list[Instruction]) -> list[Instruction]:
    """The changes after a brake: the first when it has reached its speed; further brakes lead to lower speeds."""
    while found and found[0].mode in BRAKES and found[0].speed_mps > now.speed_mps - SAME_MPS:
        found = found[1:]
    ends_s = lasts_s(scene, now)
    if found and found[0].mode in BRAKES:  # One who brakes as shown may be there sooner than one on the reference.
        ends_m = now.way_m + way_m(scene.ahead, -now.effort_ratio, now.speed_mps, scene.state)
        sooner_s = now.in_s + ends_s + max(found[0].way_m - ends_m, 0.0) / max(now.speed_mps, 1.0)
        return [replace(found[0], in_s=min(found[0].in_s, sooner_s)), *found[1:]]
    if not found or found[0].in_s >= ends_s or any(one.in_s <= ends_s for one in found[1:]):
        return found
    return [replace(found[0], in_s=ends_s, way_m=0.5 * (scene.state.v_mps + now.speed_mps) * ends_s), *found[1:]]


def _allowed(scene: Sight, now: Instruction, found: list[Instruction]) -> tuple[Instruction, ...]:
    """The changes without repetitions, each speed reduced to the limit where it applies.

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
