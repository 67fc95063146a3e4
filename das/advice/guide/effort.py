"""The braking effort as it is shown: one for each place to brake for, which changes rarely.

A braking effort is the braking force as a share of what the motors can brake with at the present speed.
"""

from __future__ import annotations

import math

from das.advice.braking import AT_MARK_M, LEAST_MPS2, BrakingAhead, NeededBrake
from das.advice.goal import OVERSPEED_MPS, TrainState
from das.advice.guide.memory import Memory
from das.advice.guide.timeline import SAME_MPS, STANDS_S
from das.advice.shown import STOP_BY_EYE_M

STEP_RATIO, FRICTION_STEP_RATIO = 0.05, 0.5
"""The steps in which efforts are shown, rounded up: the first within the effort of the motors, the second above it,
because no driver sets the friction brake more finely."""
ANSWERED_S = 4.0
"""The reaction time (s) for which a larger effort is sufficient when it is shown, so that it grows only once."""
BEGUN_S = 2.0
"""The delay (s) of the driver for which the effort first shown for a lower limit is sufficient."""
GROWN_RATIO = 1.6
"""The largest ratio of the effort shown to the one needed now, when more is needed."""
LACKS_RATIO = 0.05
"""The missing share of the effort up to which a brake for the stop keeps it: the last metres are by eye."""
LESS_RATIO = 0.6
"""The needed share of the effort shown below which a smaller one is shown: above it, the driver eases off himself."""
SAME_EFFORT = 1e-3


def shown_effort(
    ahead: BrakingAhead, needed: NeededBrake, memory: Memory, state: TrainState, begin_m: float = -math.inf
) -> float:
    """The effort to show for a needed brake that begins at `begin_m`, if that is still ahead."""
    kept, slows = memory.efforts.get(needed.at_m), needed.target_mps > SAME_MPS
    if kept is None:
        least = _answered(ahead, needed, state, begin_m) if slows else 0.0
        return max(stepped(needed.effort), least)
    lacking = LACKS_RATIO if not slows and needed.at_m - state.s_m >= STOP_BY_EYE_M else SAME_EFFORT
    if _ends(needed, state.v_mps) or _nearly_enough(ahead, kept, needed, state):
        return kept
    if needed.effort > kept * (1.0 + lacking):
        if ahead.section.end_m - state.s_m <= AT_MARK_M:
            return kept + STEP_RATIO * 4.0  # A driver does not notice less, and it would have to grow again.
        return max(stepped(needed.effort), _answered(ahead, needed, state, begin_m))
    ends_soon = slows and (state.v_mps - needed.target_mps) < STANDS_S * rate_mps2(ahead, kept, state)
    eased = needed.effort < kept * LESS_RATIO and begin_m <= state.braked_m and not ends_soon
    return stepped(needed.effort) if eased else kept


def stepped(effort: float) -> float:
    """An effort rounded up to the steps of the display."""
    step = STEP_RATIO if effort <= 1.0 else FRICTION_STEP_RATIO
    return max(math.ceil(effort / step - SAME_EFFORT) * step, STEP_RATIO)


def rate_mps2(ahead: BrakingAhead, effort: float, state: TrainState) -> float:
    """The deceleration (m/s²) that an effort gives the train here, at least one that ends."""
    return max(_slows_mps2(ahead, effort, state), LEAST_MPS2)


def slows(ahead: BrakingAhead, effort: float, state: TrainState) -> bool:
    """Whether an effort slows the train here: on a steep descent, the motors alone may not."""
    return _slows_mps2(ahead, effort, state) > LEAST_MPS2


def _slows_mps2(ahead: BrakingAhead, effort: float, state: TrainState) -> float:
    braked_mps2 = -ahead.force_n(effort, state.s_m, state.v_mps) / ahead.section.train.inertial_mass_kg
    return braked_mps2 - ahead.rolls_mps2(state.s_m, state.v_mps)


def way_m(ahead: BrakingAhead, effort: float, to_mps: float, state: TrainState) -> float:
    """The way (m) in which an effort brings the train down to a speed."""
    return max(state.v_mps**2 - to_mps**2, 0.0) / (2.0 * rate_mps2(ahead, effort, state))


def _answered(ahead: BrakingAhead, needed: NeededBrake, state: TrainState, begin_m: float) -> float:
    """An effort that is enough though the driver acts late; with the friction brake only once that is needed."""
    late_m = max(state.braked_m + state.v_mps * ANSWERED_S, begin_m + state.v_mps * BEGUN_S)
    answered = ahead.effort_to(min(late_m, needed.at_m), state.v_mps, needed.at_m, needed.target_mps)
    slows = needed.target_mps > SAME_MPS
    most = math.inf if slows and needed.effort > 1.0 else 1.0
    return stepped(min(answered, GROWN_RATIO * needed.effort, most))


def _nearly_enough(ahead: BrakingAhead, kept: float, needed: NeededBrake, state: TrainState) -> bool:
    """Whether an effort is too small, but ends too little above a lower speed to be noticed."""
    above = state.v_mps > ahead.allowed_mps(state.braked_m) + SAME_MPS
    if needed.target_mps <= SAME_MPS or needed.effort <= kept or above:
        return False
    left_m = max(needed.at_m - state.braked_m, 0.0)
    ends_w = state.v_mps**2 - 2.0 * rate_mps2(ahead, kept, state) * left_m
    return ends_w <= (needed.target_mps + SAME_MPS) ** 2


def _ends(needed: NeededBrake, v_mps: float) -> bool:
    """Whether a train has nearly slowed down to a lower speed."""
    return needed.target_mps > SAME_MPS and 0.0 < v_mps - needed.target_mps <= OVERSPEED_MPS
