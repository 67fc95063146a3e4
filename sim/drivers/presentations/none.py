"""No advice: the display is blank."""

from __future__ import annotations

from typing import Any, Final

from sim.drivers.cab import AdviceView
from sim.drivers.presentations.presenter import Presenter


class NonePresenter(Presenter):
    """Shows nothing."""

    number = 0
    phrase = meaning = "no advice"
    says_mode = says_effort = False

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        return None


PRESENTER: Final = NonePresenter()
