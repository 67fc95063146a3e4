"""Keeps advice safe: stronger braking if the train is too fast or above its plan, and a safe one of the four modes."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from das.advice.braking import ABOVE_MPS, BRAKED_MORE, braking_mode
from das.advice.goal import COASTS_IN_S, OVERSPEED_MPS, TrainState
from das.advice.plan import Floats
from das.advice.planner import Planner
from das.advice.regimes import Regime

BEFORE_S: Final = 4.0
"""Full braking is shown this long before it is needed: advice is valid for 3 s, and the brakes need time to act."""
SLOW_MPS: Final = 4.0
"""For a train slower than this, `BEFORE_M` and `LEAST_S` count instead of `BEFORE_S`."""
BEFORE_M: Final = 5.0
"""A slow train is shown full braking this far before it is needed, so that it stops at most this far short."""
LEAST_S: Final = 2.0
"""A slow train is shown full braking at least this long before it is needed: a driver takes this long to act."""
LATE_S = 2.0
"""A driver may take this long to do what is shown."""
NEXT_S = 1.0
"""The next advice comes after this time; a brake that is due by then is shown now."""
GAINS_MPS2 = 0.1
"""Below this acceleration the speed gained until the driver acts is negligible."""
AT_FOOT_MPS = 0.5
"""A train above the allowed speed by more than this, just before a lower limit, must use all of its brakes."""


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


class FourModes(NamedTuple):
    """Decides which of the four modes a train may be shown: full traction, hold a speed, coast, full brake.

    `held_mps` is the highest speed that the train may be told to hold (m/s), `excess_mps` is how much faster it is than
    allowed (m/s).
    """

    valid_for_s: float
    planner: Planner
    state: TrainState
    held_mps: float
    excess_mps: float

    def safe(self, four: Regime, mode: Regime) -> Regime:
        """The mode `four` if it is safe, else the one of the four modes that the limits and the stop ahead need.

        `mode` is what the other displays show. If they show braking to a train that is too fast, this is full braking,
        however weak theirs is.
        """
        planner, state, v_mps = self.planner, self.state, self.state.v_mps
        too_fast, pulls = self.excess_mps > OVERSPEED_MPS, four is Regime.FULL_TRACTION
        rolls = four is Regime.COAST or too_fast
        gained_mps2 = self._gained_mps2(four)
        gained_mps = max(gained_mps2, 0.0) * self.valid_for_s
        slowly_s = max(BEFORE_M / max(v_mps, 0.1), LEAST_S)
        before_s = slowly_s if v_mps <= SLOW_MPS else BEFORE_S
        soon_mps = max(v_mps, self.held_mps) if four is Regime.CRUISE else v_mps
        late = planner.brakes_late(state, soon_mps + (gained_mps if rolls else 0.0), before_s)
        if late or (too_fast and mode not in (Regime.CRUISE, Regime.COAST)):
            return Regime.FULL_BRAKE
        if pulls and (planner.brakes_late(state, v_mps + gained_mps, before_s) or too_fast):
            return Regime.CRUISE if self._may_creep() and not too_fast else Regime.COAST
        if pulls and self.excess_mps + gained_mps > OVERSPEED_MPS:
            return Regime.CRUISE  # Full traction would soon take the train above the limit.
        above = self.excess_mps + gained_mps > 0.0
        if rolls and above and gained_mps2 * COASTS_IN_S > -self.excess_mps:
            return Regime.CRUISE  # Coasting would not come down to the limit.
        return four

    def _may_creep(self) -> bool:
        """Whether a slow train may be told to hold a speed instead: it would stand short of its stop if it coasted."""
        before_s = max(BEFORE_M / max(self.held_mps, 0.1), LEAST_S)
        return self.state.v_mps <= SLOW_MPS and not self.planner.brakes_late(self.state, self.held_mps, before_s)

    def full_brake_due_s(self, four: Regime) -> float:
        """In how many whole seconds full braking must follow the mode `four`.

        Infinity if it need not while the advice is valid, or if `four` is full braking.
        """
        if four is Regime.FULL_BRAKE:
            return math.inf
        planner, valid_s = self.planner, math.ceil(self.valid_for_s)
        state = self.state._replace(ahead_m=planner.ahead.feared_m(self.state.braked_m) - self.state.s_m)
        gained_mps2 = max(self._gained_mps2(four), 0.0)
        for due_s in range(valid_s):
            held_mps = max(state.v_mps, self.held_mps)
            soon_mps = held_mps if four is Regime.CRUISE else state.v_mps + gained_mps2 * (due_s + 1)
            if planner.brakes_late(state, soon_mps, due_s + 1.0):
                return float(due_s)
        return math.inf

    def reaches(self, speed_mps: float) -> bool:
        """Whether full traction brings the train to a speed (m/s) while the advice is valid."""
        gained_mps2 = max(self._gained_mps2(Regime.FULL_TRACTION), 0.0)
        return self.state.v_mps + gained_mps2 * self.valid_for_s >= speed_mps

    def _gained_mps2(self, four: Regime) -> float:
        """The acceleration (m/s²) of the train with full traction if `four` is that, else when it coasts."""
        full = 1.0 if four is Regime.FULL_TRACTION else 0.0
        return self.planner.ahead.accelerates_mps2(full, self.state.s_m, self.state.v_mps)
