"""What the sensors of a train measure: position fixes (where it is, how fast it runs) and the forces at the wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

LEAST_SD_M: Final = 0.5
"""Least standard deviation (m) of a position; a smaller stated one is raised to it, as no receiver is believed to be
better."""
LEAST_SD_MPS: Final = 0.02
"""Least standard deviation (m/s) of a speed; a smaller stated one is raised to it, as no odometer is believed to be
better."""
SPEED_LATE_S: Final = 1.75
"""Delay (s) of a speed whose sender states no deviation: one standard deviation for receivers that filter their speeds
(two recorded trips: 0.75 and 2.5 s)."""
OVERSPEED_RATIO: Final = 1.3
"""Multiple of the train's largest speed above which a speed is a fault of the sensor."""


class Quality(IntEnum):
    """The quality of a fix as its sender states it; the numbers are those of the bus message."""

    UNKNOWN = 0
    GOOD = 1
    DEGRADED = 2
    INVALID = 3


class Deviations(NamedTuple):
    """One standard deviation each of a measured position (m) and of a measured speed (m/s)."""

    position_m: float
    speed_mps: float


USUAL: Final = {
    Quality.GOOD: Deviations(5.0, 0.2),
    Quality.UNKNOWN: Deviations(10.0, 0.3),
    Quality.DEGRADED: Deviations(30.0, 0.5),
}
"""Standard deviations of a fix that states none, by its quality (assumptions)."""


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


def deviations(fix: PositionFix) -> Deviations:
    """Return the standard deviations of a fix: those that it states, otherwise those usual for its quality.

    Raises ValueError for a fix that its sender marked as unusable: such a fix has no deviations.
    """
    if fix.quality not in USUAL:
        raise ValueError("a fix marked as unusable has no deviations")
    position_m, speed_mps = USUAL[fix.quality]
    if fix.uncertainty_m > 0:
        position_m = max(fix.uncertainty_m, LEAST_SD_M)
    if fix.speed_uncertainty_mps > 0:
        speed_mps = max(fix.speed_uncertainty_mps, LEAST_SD_MPS)
    return Deviations(position_m, speed_mps)


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Measured wheel forces (N) of the motors and of the friction brake at a time (ns since 1970)."""

    time_ns: int
    force_el_n: float
    """The force of the motors: traction is > 0, the electric brake < 0."""
    force_friction_n: float
    """The force of the friction brake, <= 0."""
