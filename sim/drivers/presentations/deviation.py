"""The presentation of earliness and lateness, without advice on how to drive."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from das.advice import wording
from das.advice.wording import Language
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import LaneState, Presenter, Shown, whole

DEVIATION_STEP_S: Final = 5.0
"""Least change (s) of a deviation that counts as new advice."""


class DeviationPresenter(Presenter):
    """A display of the lateness (s; early < 0) against the planned run for the timetable."""

    number = 5
    phrase = "how early or late the train is, and nothing about how to drive"
    meaning = "seconds early or late, updated every 35 s, and nothing about how to drive"
    says_mode = False
    lane = LaneState("early or late", "#9a8f6b", standing=True)

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        return None if math.isnan(deviation_s) else replace(blank, deviation_s=deviation_s)

    def read(self, view: AdviceView) -> Shown:
        return Shown(deviation_s=whole(view.deviation_s))

    def item(self, view: AdviceView) -> tuple[int, ...]:
        return (round(view.deviation_s / DEVIATION_STEP_S),)

    def headline(self, view: AdviceView, language: Language = Language.EN) -> str:
        return wording.deviation(view.deviation_s, language)


PRESENTER: Final = DeviationPresenter()
