"""The full advice: speed and effort now, and for the next seconds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from das.advice.regimes import Regime
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.handling import HAND
from sim.drivers.presentations.presenter import Hands, Presenter
from sim.drivers.tracking import FOLLOWING, RULE, TRACKING, hold, needed_braking_mps2
from sim.plant.kernels import Command, electric_effort
from sim.plant.plant import force, speed

if TYPE_CHECKING:
    from sim.drivers.knowledge import Outlook


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

        There is no correction while the advice is to coast, or at the end of the controller's scale.
        """
        if view.mode == Regime.COAST:
            return 0.0
        if view.mode == Regime.DEPART or math.isnan(view.lever_ratio):
            return hands.to_speed(cab, outlook, view.departure, allowed_mps)
        effort = hands.set_effort(view.lever_ratio)
        if abs(view.lever_ratio) > HAND.end_stop_ratio:
            return effort
        more = hands.handling.corrected(cab, outlook, view.foreseen_mps(cab.time_s))
        return min(max(effort + more, -1.0), 1.0)

    def follower(self) -> SpeedAndEffortFollower:
        return SpeedAndEffortFollower()


class SpeedAndEffortFollower:
    """Feeds the advised force forward and corrects the speed."""

    def command(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command for the present advice; None if the stop is still too far away to brake for it."""
        since_s = cab.time_s - view.time_s
        speeds = (view.speed_mps, *view.horizon_speed_mps)
        forces = (view.force_n, *view.horizon_force_n)
        train = outlook.train
        if _between(speeds, since_s + FOLLOWING.stopping_s) <= 0:
            needed = needed_braking_mps2(cab, cab.halt_m)
            if needed < FOLLOWING.least_braking_mps2:
                return None
            return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - train.inertial_mass_kg * needed)
        now = _between(speeds, since_s)
        if now > cab.limit_mps:
            return hold(cab, outlook, cab.limit_mps)
        rate = (_between(speeds, since_s + TRACKING.ahead_s) - now) / TRACKING.ahead_s
        # Brakes are applied early and released late; traction is applied late and released early.
        ahead_n = min(_between(forces, since_s + lead_s) for lead_s in (RULE.anticipation_s, FOLLOWING.release_s))
        # No more friction brake than planned.
        low_n = min(ahead_n, _between(forces, since_s), -electric_effort(cab.speed_mps, 1.0, train))
        return speed(now, rate_mps2=rate, force_n=ahead_n, gain_per_s=TRACKING.gain_per_s, low_n=low_n)


def _between(values: tuple[float, ...], at_s: float) -> float:
    """A value of a horizon in steps of 1 s, linear between the steps; outside the horizon, the value at its end."""
    x = min(max(at_s, 0.0), len(values) - 1.0)
    i = min(int(x), len(values) - 2)
    return values[i] + (x - i) * (values[i + 1] - values[i])


PRESENTER: Final = SpeedAndEffortPresenter()
