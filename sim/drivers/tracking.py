"""Driving under a ceiling and stopping at a mark: what every simulated driver can do with a controller."""

from __future__ import annotations

import math

from sim.drivers.cab import AT_STOP_M, CabView
from sim.drivers.knowledge import Outlook
from sim.drivers.rule_settings import TRACKING
from sim.plant.plant import COAST, Command, force, speed


class RollOff:
    """A train that is above a top speed that was lowered rolls down to it: no traction, and no brakes for that speed.

    `speed_mps` is to be called at every look.
    """

    def __init__(self) -> None:
        self._top_mps = self._slowest_mps = math.inf

    def speed_mps(self, top_mps: float, speed_mps: float) -> float | None:
        """The speed that the train has come down to, so that it does not speed up again; None if it does not roll."""
        lowered, self._top_mps = top_mps < self._top_mps, top_mps
        if speed_mps <= top_mps:
            self._slowest_mps = math.inf
        elif lowered or self._slowest_mps < math.inf:
            self._slowest_mps = min(self._slowest_mps, speed_mps)
        return self._slowest_mps if self._slowest_mps < math.inf else None


def under_ceiling(cab: CabView, outlook: Outlook, anticipation_s: float, high_n: float = math.inf) -> Command:
    """Keep to the highest speed allowed here and where a changed effort will have built up."""
    v, s = cab.speed_mps, cab.s_m
    soon_m = s + v * anticipation_s
    coming = outlook.allowed_mps(soon_m)
    after = outlook.allowed_mps(soon_m + v * TRACKING.ahead_s)
    rate = min((after - coming) / TRACKING.ahead_s, 0.0)
    return hold(cab, outlook, min(outlook.allowed_mps(s), coming, cab.limit_mps), rate, high_n)


def hold(cab: CabView, outlook: Outlook, speed_mps: float, rate_mps2: float = 0.0, high_n: float = math.inf) -> Command:
    """Hold a speed, or one that changes, with the force it is known to need here."""
    needed_n = outlook.train.inertial_mass_kg * rate_mps2 + outlook.resisting_n(cab.s_m, cab.speed_mps)
    return speed(speed_mps, rate_mps2=rate_mps2, force_n=needed_n, gain_per_s=TRACKING.gain_per_s, high_n=high_n)


def needed_braking_mps2(cab: CabView, mark_m: float) -> float:
    """The deceleration (m/s²) that ends at the mark: v²/(2·way); inf beyond the mark."""
    way_m = mark_m - cab.s_m
    return cab.speed_mps**2 / (2.0 * way_m) if way_m > 0 else math.inf


def stop_at(cab: CabView, outlook: Outlook, mark_m: float, planned_mps2: float) -> Command | None:
    """The command that stops the train at the mark; None while it is too early for that.

    It is asked for at every look, so that errors in force and resistance are corrected until the train stands.
    """
    if cab.speed_mps <= 0 or cab.speed_mps > TRACKING.stopping_mps:
        return None
    if cab.speed_mps < TRACKING.last_mps and mark_m - cab.s_m <= AT_STOP_M:
        return force(-outlook.train.inertial_mass_kg * planned_mps2)
    needed = needed_braking_mps2(cab, mark_m)
    if needed < TRACKING.stopping_ratio * planned_mps2:
        return None
    if mark_m - cab.s_m < TRACKING.last_m:
        needed = planned_mps2
    return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed)


def stand(cab: CabView) -> Command | None:
    """The command of a driver whose train rightly stands, held by its brakes; None if it does not."""
    return COAST if cab.shall_stand else None
