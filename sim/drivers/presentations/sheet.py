"""A sheet of paper: instructions by kilometre, fixed before departure."""

from __future__ import annotations

from typing import Any, Final

from sim.drivers.cab import AdviceView
from sim.drivers.presentations.guide import GuidePresenter


class SheetPresenter(GuidePresenter):
    """A display of the sheet's line for the train's position, and of the next line; both are read in simulated runs."""

    number = 6
    phrase = "a sheet of paper (what to do from which kilometre on, fixed before departure)"
    meaning = "on paper, what to do from which kilometre on, up to which speed and with what effort; it never changes"
    needs_guide = False

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        return None


PRESENTER: Final = SheetPresenter()
