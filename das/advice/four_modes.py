"""A display of four modes: which of its modes are safe for a train, and when full brakes are due."""

from __future__ import annotations

import math
from typing import NamedTuple

from das.advice.goal import COASTS_IN_S, OVERSPEED_MPS, TrainState
from das.advice.planner import Planner
from das.advice.regimes import Regime
from das.advice.settings import DisplaySettings


class FourModes(NamedTuple):
    """What a train in a state may be told by four modes: all traction, a speed to hold, coasting and full brakes.

    `held_mps` is the highest speed that it may be told to hold, `excess_mps` how much faster it is than allowed (m/s).
    """

    settings: DisplaySettings
    planner: Planner
    state: TrainState
    held_mps: float
    excess_mps: float

    def safe(self, four: Regime, mode: Regime) -> Regime:
        """One of the four, or what limits and the stop ahead ask for: a weak brake is not shown as coasting then.

        `mode` is what other displays show.
        """
        settings, planner, state, v_mps = self.settings, self.planner, self.state, self.state.v_mps
        too_fast, pulls = self.excess_mps > OVERSPEED_MPS, four is Regime.FULL_TRACTION
        rolls = four is Regime.COAST or too_fast
        gained_mps2 = self._gained_mps2(four)
        gained_mps = max(gained_mps2, 0.0) * settings.valid_for_s
        four_settings = settings.four
        slowly_s = max(four_settings.before_m / max(v_mps, 0.1), four_settings.least_s)
        before_s = slowly_s if v_mps <= four_settings.slow_mps else four_settings.before_s
        soon_mps = max(v_mps, self.held_mps) if four is Regime.CRUISE else v_mps
        late = planner.brakes_late(state, soon_mps + (gained_mps if rolls else 0.0), before_s)
        if late or (too_fast and mode not in (Regime.CRUISE, Regime.COAST)):
            return Regime.FULL_BRAKE
        if pulls and (planner.brakes_late(state, v_mps + gained_mps, before_s) or too_fast):
            return Regime.COAST
        if pulls and self.excess_mps + gained_mps > OVERSPEED_MPS:
            return Regime.CRUISE  # All traction would soon carry the train above the limit.
        above = self.excess_mps + gained_mps > 0.0
        if rolls and above and gained_mps2 * COASTS_IN_S > -self.excess_mps:
            return Regime.CRUISE  # Coasting would not come down to the limit.
        return four

    def full_brake_due_s(self, four: Regime) -> float:
        """In how many whole seconds one of the modes ends in full brakes; inf: not while the advice is valid."""
        if four is Regime.FULL_BRAKE:
            return math.inf
        planner, valid_s = self.planner, math.ceil(self.settings.valid_for_s)
        state = self.state._replace(ahead_m=planner.ahead.feared_m(self.state.braked_m) - self.state.s_m)
        gained_mps2 = max(self._gained_mps2(four), 0.0)
        for due_s in range(valid_s):
            held_mps = max(state.v_mps, self.held_mps)
            soon_mps = held_mps if four is Regime.CRUISE else state.v_mps + gained_mps2 * (due_s + 1)
            if planner.brakes_late(state, soon_mps, due_s + 1.0):
                return float(due_s)
        return math.inf

    def _gained_mps2(self, four: Regime) -> float:
        """The acceleration of the train with all traction, or of one that coasts."""
        full = 1.0 if four is Regime.FULL_TRACTION else 0.0
        return self.planner.ahead.accelerates_mps2(full, self.state.s_m, self.state.v_mps)
