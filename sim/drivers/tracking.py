"""Driving under a ceiling and stopping at a mark: what every simulated driver can do with a controller."""

from __future__ import annotations

import math

from sim.drivers.cab import AT_STOP_M, Cab
from sim.drivers.knowledge import Outlook
from sim.plant.plant import COAST, Command, force, speed

AHEAD_S = 0.2
"""A ceiling's slope is taken over this time."""
GAIN_PER_S = 0.5
"""Share of a speed error that is driven away per second."""
STOPPING_MPS = 10.0
"""Below this a train that brakes for its halt is braked by what the rest of the way needs."""
STOPPING_RATIO = 0.85
"""From this share of the planned deceleration on."""
LAST_M = 0.05
"""Nearer to the halt than this, and beyond it, brake as planned."""
LAST_MPS = 0.02
"""Slower than this at the halt, brake as planned: a train that resists more than known would creep on for ever."""


def under_ceiling(cab: Cab, outlook: Outlook, anticipation_s: float, high_n: float = math.inf) -> Command:
    """Keep to the highest speed allowed here and where a changed effort will have built up."""
    v, s = cab.speed_mps, cab.s_m
    soon_m = s + v * anticipation_s
    coming = outlook.allowed_mps(soon_m)
    after = outlook.allowed_mps(soon_m + v * AHEAD_S)
    rate = min((after - coming) / AHEAD_S, 0.0)
    return hold(cab, outlook, min(outlook.allowed_mps(s), coming, cab.limit_mps), rate, high_n)


def hold(cab: Cab, outlook: Outlook, speed_mps: float, rate_mps2: float = 0.0, high_n: float = math.inf) -> Command:
    """Hold a speed, or one that changes, with the force it is known to need here."""
    needed_n = outlook.train.inertial_mass_kg * rate_mps2 + outlook.resisting_n(cab.s_m, cab.speed_mps)
    return speed(speed_mps, rate_mps2=rate_mps2, force_n=needed_n, gain_per_s=GAIN_PER_S, high_n=high_n)


def needed_braking_mps2(cab: Cab, mark_m: float) -> float:
    """v²/(2·way): the deceleration that ends at the mark (inf beyond it)."""
    way_m = mark_m - cab.s_m
    return cab.speed_mps**2 / (2.0 * way_m) if way_m > 0 else math.inf


def stop_at(cab: Cab, outlook: Outlook, mark_m: float, planned_mps2: float) -> Command | None:
    """Brake so that the train stands at the mark; None while that is not yet the thing to do.

    Asked again at every look, so errors in force and resistance are corrected until the train stands.
    """
    if cab.speed_mps <= 0 or cab.speed_mps > STOPPING_MPS:
        return None
    if cab.speed_mps < LAST_MPS and mark_m - cab.s_m <= AT_STOP_M:
        return force(-outlook.train.inertial_mass_kg * planned_mps2)
    needed = needed_braking_mps2(cab, mark_m)
    if needed < STOPPING_RATIO * planned_mps2:
        return None
    if mark_m - cab.s_m < LAST_M:
        needed = planned_mps2
    return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed)


def stand(cab: Cab) -> Command | None:
    """Nothing to do while the train rightly stands (its brakes hold it)."""
    return COAST if cab.shall_stand else None
