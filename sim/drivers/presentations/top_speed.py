"""One top speed (reduced maximum speed) with which the train is just in time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from das.advice import wording
from das.advice.regimes import Regime
from das.advice.wording import Language
from das.domain.units import KMH
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import LaneState, Presenter, Shown, SimplerLook, SpeedIs, speed_words, whole


class TopSpeedPresenter(Presenter):
    """A display of a top speed; while the train stands, also of the advice to depart once it is cleared."""

    number = 1
    phrase = "one maximum speed"
    meaning = "one reduced maximum speed at which the train is just in time"
    says_mode = False
    is_simpler = True
    lane = LaneState("a top speed", "#5f7d74")

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        if not isinstance(advice, SimplerLook):
            return None
        top_mps = advice.top_speed_mps
        # A train that has arrived has no top speed.
        return None if math.isnan(top_mps) else replace(blank, speed_mps=top_mps, display_speed_mps=top_mps)

    def speed_is(self, mode: int) -> SpeedIs:
        return SpeedIs.HIGHEST

    def read(self, view: AdviceView) -> Shown:
        return Shown(speed_kmh=whole(view.shown_speed_mps / KMH))

    def item(self, view: AdviceView) -> tuple[int, ...]:
        return (round(view.speed_mps),)

    def headline(self, view: AdviceView, language: Language = Language.EN) -> str:
        if view.mode == Regime.STOP:
            return super().headline(view, language)
        departs = f"{self.mode_words(view.mode, language)}, " if view.mode == Regime.DEPART else ""
        return departs + wording.top_speed(speed_words(view.shown_speed_mps), language)


PRESENTER: Final = TopSpeedPresenter()
