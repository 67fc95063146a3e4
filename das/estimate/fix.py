"""A position fix: one message of the sensors that says where the train is and how fast it runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from das.estimate.settings import Deviations, SensorSettings


class Quality(IntEnum):
    """The quality of a fix as its sender states it; the numbers are those of the bus message."""

    UNKNOWN = 0
    GOOD = 1
    DEGRADED = 2
    INVALID = 3


@dataclass(frozen=True, kw_only=True)
class PositionFix:
    """The position of the train's head (m) and its speed (m/s) as sensors measured them at a time (ns since 1970)."""

    time_ns: int
    s_m: float
    """The position on the route; NaN if it was not measured."""
    speed_mps: float
    """The speed; NaN if it was not measured."""
    uncertainty_m: float = math.nan
    """One standard deviation of the position; 0 or NaN if the sender states none."""
    speed_uncertainty_mps: float = math.nan
    """One standard deviation of the speed; 0 or NaN if the sender states none."""
    quality: Quality = Quality.GOOD

    def repeats(self, other: PositionFix) -> bool:
        """Whether this fix states the same position and the same speed as another one."""
        return self.s_m == other.s_m and self.speed_mps == other.speed_mps


def deviations(fix: PositionFix, sensors: SensorSettings) -> Deviations:
    """Return the standard deviations of a fix: those that it states, otherwise those usual for its quality.

    Raises ValueError for a fix that its sender marked as unusable: such a fix has no deviations.
    """
    if fix.quality is Quality.GOOD:
        position_m, speed_mps = sensors.good
    elif fix.quality is Quality.UNKNOWN:
        position_m, speed_mps = sensors.unknown
    elif fix.quality is Quality.DEGRADED:
        position_m, speed_mps = sensors.degraded
    else:
        raise ValueError("a fix marked as unusable has no deviations")
    if fix.uncertainty_m > 0:
        position_m = max(fix.uncertainty_m, sensors.least_position_sd_m)
    if fix.speed_uncertainty_mps > 0:
        speed_mps = max(fix.speed_uncertainty_mps, sensors.least_speed_sd_mps)
    return Deviations(position_m, speed_mps)
