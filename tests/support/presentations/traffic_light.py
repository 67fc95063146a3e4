"""A made-up presentation: green to drive on, amber to let the train roll, red to brake; nothing else is shown."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from das.advice.regimes import Regime
from das.advice.wording import Language
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.knowledge import Outlook
from sim.drivers.presentations.presenter import Hands, LaneState, Presenter, Shown, SimplerLook

LIGHTS: Final = {Regime.COAST: "amber", Regime.FULL_BRAKE: "red"}


class TrafficLightPresenter(Presenter):
    """The presenter of one of three lights."""

    number = 17
    phrase = "a traffic light"
    meaning = "green, amber or red"
    is_simpler = True
    lane = LaneState("a light", "#123456")

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        return replace(blank, mode=int(advice.four_mode)) if isinstance(advice, SimplerLook) else None

    def read(self, view: AdviceView) -> Shown:
        return Shown(mode=Regime(view.mode))

    def set_by(self, hands: Hands, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        if view.mode == Regime.COAST:
            return 0.0
        if view.mode == Regime.FULL_BRAKE:
            return hands.set_effort(-0.5)
        return hands.handling.held(cab, outlook, allowed_mps)

    def headline(self, view: AdviceView, language: Language = Language.EN) -> str:
        return LIGHTS.get(Regime(view.mode), "green")


PRESENTER: Final = TrafficLightPresenter()
