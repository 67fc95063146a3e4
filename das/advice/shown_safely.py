"""Keeps advice safe: stronger braking if the train is too fast or above its plan."""

from __future__ import annotations

from das.advice.braking import ABOVE_MPS, BRAKED_MORE, braking_mode
from das.advice.goal import TrainState
from das.advice.plan import Floats
from das.advice.planner import Planner
from das.advice.regimes import Regime

LATE_S = 2.0
"""Longest time (s) that a driver may take to do what is shown."""
NEXT_S = 1.0
"""Time (s) until the next advice; a brake that is due by then is shown now."""
GAINS_MPS2 = 0.1
"""Acceleration (m/s²) below which the speed gained until the driver acts is negligible."""
AT_FOOT_MPS = 0.5
"""Excess over the allowed speed (m/s), just before a lower limit, above which a train must use all of its brakes."""


def braked_enough(
    mode: Regime, force_n: float, state: TrainState, planner: Planner, planned_mps: float, *, too_fast: bool
) -> tuple[Regime, float]:
    """The mode and force (N) to show: those given, or those of the braking that the limits and the stop need.

    Braking is needed if it is due soon, or if the train is too fast.
    """
    ahead, allowed_mps = planner.ahead, planner.allowed_for(state)
    gained_mps2 = (force_n - ahead.section.resistance_n(state.s_m, state.v_mps)) / ahead.section.train.inertial_mass_kg
    pulls = force_n > 0.0 and gained_mps2 > GAINS_MPS2
    if pulls:
        # A driver who starts the next brake late must not be too fast by then.
        until_s = NEXT_S + LATE_S
        if not ahead.is_due(state.braked_m, state.v_mps + gained_mps2 * until_s, until_s):
            # A driver who cuts off traction late must not be above the limit by then.
            room_mps2 = max(min(planner.limit_mps(state.s_m), allowed_mps) - state.v_mps, 0.0) / until_s
            too_much_n = max(gained_mps2 - room_mps2, 0.0) * ahead.section.train.inertial_mass_kg
            return mode, max(force_n - too_much_n, 0.0)
        mode, force_n = Regime.COAST, 0.0
    rolls_above = state.v_mps > allowed_mps and gained_mps2 > 0.0
    back = too_fast or rolls_above
    effort = ahead.back_under(state.s_m, state.v_mps, allowed_mps).effort if back else 0.0
    above = too_fast or pulls or state.v_mps > planned_mps + ABOVE_MPS
    within_s, more_ratio = (LATE_S, BRAKED_MORE) if above else (NEXT_S, 1.0)
    if ahead.is_due(state.braked_m, state.v_mps, within_s):
        effort = max(effort, ahead.needed(state.braked_m, state.v_mps).effort)
    elif state.v_mps > allowed_mps + AT_FOOT_MPS and allowed_mps < planner.limit_mps(state.s_m):
        effort = ahead.largest(state.s_m, state.v_mps)
    needed_n = ahead.force_n(more_ratio * effort, state.s_m, state.v_mps)
    return (braking_mode(effort), needed_n) if effort > 0.0 and needed_n < force_n else (mode, force_n)


def kept_behind(
    speeds_mps: Floats, advised_mps: float, state: TrainState, planned_m: Floats, planner: Planner
) -> Floats:
    """The horizon speeds of a train that is too fast, lowered to what is allowed on the way to the planned positions.

    The plan brakes from the train's speed, while the horizon shows no speed above the allowed one. A driver who follows
    the horizon therefore falls behind the planned positions `planned_m`, and may still be under a lower limit that the
    plan has already left.
    """
    kept, at_m, before = speeds_mps.copy(), state.s_m, advised_mps
    for i, to_m in enumerate(planned_m.tolist()):
        kept[i] = min(kept[i], planner.lowest_allowed_mps(at_m, max(at_m, to_m)))
        at_m, before = at_m + 0.5 * (before + kept[i]), kept[i]
    return kept
