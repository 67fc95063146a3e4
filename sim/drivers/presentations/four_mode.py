"""The four modes of classical driving: full traction, a speed to hold, coasting, full brake."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from das.advice.regimes import Regime
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.presentations.presenter import (
    FOUR_MODES,
    Hands,
    Presenter,
    Shown,
    ShownRegime,
    SimplerLook,
    known_mode,
    whole,
)

if TYPE_CHECKING:
    from sim.drivers.knowledge import Outlook


class FourModePresenter(Presenter):
    """A display of a mode, the speed to hold if the mode holds one, and the next mode with its time."""

    number = 2
    phrase = "four modes"
    meaning = "full traction, a speed to hold, coasting or braking, and when the next of them begins"
    is_simpler = True

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        if not isinstance(advice, SimplerLook):
            return None
        mode = int(advice.four_mode)
        holds = mode == Regime.CRUISE
        departs_held = mode == Regime.DEPART and int(advice.next_four_mode) == Regime.CRUISE
        return replace(
            blank,
            mode=mode,
            speed_mps=advice.advised_speed_mps if holds else math.nan,
            display_speed_mps=advice.display_speed_mps if holds else math.nan,
            next_mode=int(advice.next_four_mode),
            next_change_s=advice.next_four_change_s,
            next_speed_mps=advice.departure_speed_mps if departs_held else math.nan,
        )

    def shown_mode(self, advice: Any) -> ShownRegime:
        """The mode of the full advice, reduced to one of four; other displayed values are in the cab messages."""
        mode = known_mode(advice.mode)
        return ShownRegime(FOUR_MODES.get(mode, mode), float(advice.advised_speed_mps))

    def read(self, view: AdviceView) -> Shown:
        mode = Regime(view.mode)
        return Shown(mode=mode, speed_kmh=whole(view.shown_speed_mps / KMH) if mode is Regime.CRUISE else None)

    def set_by(self, hands: Hands, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """Full traction, no effort, or the effort that holds the speed; advised braking uses the motors alone."""
        view, handling = view.departure, hands.handling
        if view.mode == Regime.CRUISE:
            return handling.held(cab, outlook, min(view.shown_speed_mps, allowed_mps))
        if view.mode == Regime.FULL_TRACTION:
            return 1.0
        if view.mode == Regime.FULL_BRAKE:
            return handling.efforts.lever_ratio(-handling.efforts.electric_n)
        return 0.0


PRESENTER: Final = FourModePresenter()
