"""A sheet of paper: instructions by kilometre, fixed before departure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

from das.advice.regimes import TRACTION, Regime
from sim.drivers.cab import AdviceView
from sim.drivers.presentations.guide import GuidePresenter


class SheetLook(NamedTuple):
    """The driver's reading of the sheet at a moment (ns since 1970), in place of the on-board system's advice. `mode`,
    `speed_mps` and `effort_ratio` are those of the line for the train's position, `force_n` its wheel force, `way_m`
    the distance to the beginning of the next line. The `next_…` fields are of that line, `next_change_s` at the present
    speed.
    """

    time_ns: int
    valid_until_ns: int
    mode: int
    speed_mps: float = math.nan
    effort_ratio: float = math.nan
    force_n: float = math.nan
    way_m: float = math.nan
    next_mode: int = Regime.NONE
    next_change_s: float = math.nan
    next_speed_mps: float = math.nan
    next_effort_ratio: float = math.nan


class SheetPresenter(GuidePresenter):
    """Shows the line of the sheet for the train's position, and the next line."""

    number = 6
    phrase = "a sheet of paper (what to do from which kilometre on, fixed before departure)"
    meaning = "on paper, what to do from which kilometre on, up to which speed and with what effort; it never changes"
    needs_guide = False

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        if not isinstance(advice, SheetLook):
            return None
        return replace(
            blank,
            speed_mps=advice.speed_mps,
            display_speed_mps=advice.speed_mps,
            lever_ratio=advice.effort_ratio if advice.mode in TRACTION else math.nan,
            force_n=advice.force_n,
            next_mode=advice.next_mode,
            next_change_s=advice.next_change_s,
            next_speed_mps=advice.next_speed_mps,
            next_effort_ratio=advice.next_effort_ratio,
            target_way_m=advice.way_m,
        )


PRESENTER: Final = SheetPresenter()
