"""The gate: the only hysteresis. When an instruction that is wanted may take the place of the one shown."""

from __future__ import annotations

import math
from typing import NamedTuple

from das.advice.advice import Instruction
from das.advice.goal import TrainState
from das.advice.guide.guard import BRAKE_LEAD_S, Proposal
from das.advice.guide.memory import Lead, Memory, is_own_end, repeats
from das.advice.guide.timeline import COAST_LEAD_S, SAME_MPS, STANDS_S
from das.advice.regimes import BRAKES, KIND_OF, InstructionKind, Regime
from das.domain.units import NS

LEADS_S = {
    InstructionKind.COAST: COAST_LEAD_S,
    InstructionKind.BRAKE: BRAKE_LEAD_S,
    InstructionKind.TRACTION: 2.0,
    InstructionKind.HOLD: 0.0,
}
"""The time (s) before it is due at which each kind is shown: an acceleration early enough to be seen by a driver who
looks when it is due."""


class Opening(NamedTuple):
    """Whether a wanted instruction is shown now, and in what time (s) it is due."""

    now: bool
    due_s: float


def opening(
    memory: Memory, wanted: Proposal, state: TrainState, *, is_safe: bool, next_s: float, lead_s: float | None = None
) -> Opening:
    """When a wanted instruction takes the place of the one shown.

    It must have been announced for `STANDS_S` when it is due, and the one shown must have stood as long. Exceptions:
    the one shown is not safe any more (`is_safe`); a brake has reached its speed; the speed that the one shown leads to
    is reached; a brake that limits ask for does not wait. A hold or coasting that would stand for less than `STANDS_S`
    before the change after it, in `next_s`, is not shown.
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
        return Opening(True, 0.0)  # Nobody releases in between.
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
    """Whether a brake, or coasting that is to end, has led to its speed, and something else than its hold is wanted."""
    shown, v_mps = memory.shown, state.v_mps
    ended = reached(shown, v_mps) and one.mode not in BRAKES
    if shown.mode is Regime.COAST and one.mode is Regime.CRUISE:
        ended = v_mps <= shown.speed_mps + SAME_MPS and (state.now_ns - memory.since_ns) * NS >= STANDS_S
    return ended and not is_own_end(one, shown)


def reached(shown: Instruction, v_mps: float) -> bool:
    """Whether a brake has reached its speed."""
    return shown.mode in BRAKES and shown.speed_mps > SAME_MPS and v_mps <= shown.speed_mps + SAME_MPS
