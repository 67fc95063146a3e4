"""The full advice: speed and effort now, and for the next seconds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from das.advice.regimes import Regime
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.presentations.presenter import END_STOP_RATIO, Hands, Presenter

if TYPE_CHECKING:
    from sim.drivers.knowledge import Outlook
    from sim.drivers.tracking import SpeedAndEffortFollower


class SpeedAndEffortPresenter(Presenter):
    """A display of speed and effort now and for the next seconds, and of the next change of driving regime."""

    number = 3
    phrase = "the present speed and effort"
    meaning = "speed and effort now and for the next seconds, updated every second"

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        departs = blank.mode == Regime.DEPART
        return replace(
            blank,
            speed_mps=advice.advised_speed_mps,
            display_speed_mps=advice.display_speed_mps,
            lever_ratio=advice.advised_force_ratio,
            force_n=advice.advised_force_n,
            horizon_speed_mps=tuple(advice.horizon_speed_mps),
            horizon_force_n=tuple(advice.horizon_force_n),
            next_mode=int(advice.next_mode),
            next_change_s=advice.next_change_s,
            next_change_m=advice.next_change_m,
            next_speed_mps=advice.departure_speed_mps if departs else math.nan,
            next_effort_ratio=advice.departure_force_ratio if departs else math.nan,
        )

    def item(self, view: AdviceView) -> tuple[int, ...]:
        return (view.mode,)

    def set_by(self, hands: Hands, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """The advised effort, corrected if the speed differs from the advised speed.

        There is no correction while the advice is to coast, or to accelerate with the controller at its end.
        """
        if view.mode == Regime.COAST:
            return 0.0
        if view.mode == Regime.DEPART or math.isnan(view.lever_ratio):
            return hands.to_speed(cab, outlook, view.departure, allowed_mps)
        effort = hands.set_effort(view.lever_ratio)
        if view.lever_ratio > END_STOP_RATIO:
            return effort
        more = hands.handling.corrected(cab, outlook, view.foreseen_mps(cab.time_s))
        return min(max(effort + more, -1.0), 1.0)

    def follower(self) -> SpeedAndEffortFollower:
        from sim.drivers.tracking import SpeedAndEffortFollower

        return SpeedAndEffortFollower()


PRESENTER: Final = SpeedAndEffortPresenter()
