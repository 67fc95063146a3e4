"""The measurements of a train's sensors, and the estimate from them, with its uncertainty and its problems.

Problems are data; `das.advice.wording` puts them into words.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final, NamedTuple

STALE_AFTER_S: Final = 3.0
"""Largest age (s) of the last fix, and largest time (s) it may be ahead of the clock, for the estimate to be used."""
LEAST_SD_M: Final = 0.5
"""Least standard deviation (m) of a position, whatever the sender states."""
LEAST_SD_MPS: Final = 0.02
"""Least standard deviation (m/s) of a speed, whatever the sender states."""
SPEED_LATE_S: Final = 1.75
"""Standard deviation (s) of the delay of a measured speed, if the sender states no deviation of the speed: receivers
filter their speeds (two recorded trips: delays of 0.75 and 2.5 s)."""
OVERSPEED_RATIO: Final = 1.3
"""Multiple of the train's largest speed above which a measured speed is treated as a sensor fault."""


class Quality(IntEnum):
    """The quality of a fix as its sender states it; the numbers are those of the bus message."""

    UNKNOWN = 0
    GOOD = 1
    DEGRADED = 2
    INVALID = 3


class Deviations(NamedTuple):
    """The standard deviations of a measured position (m) and of a measured speed (m/s)."""

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
    """The standard deviations of a fix: those that it states, otherwise those usual for its quality.

    Raises ValueError for a fix that its sender marked as unusable: it has no deviations.
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


class ProblemKind(StrEnum):
    """Why a fix was rejected, or why the estimate cannot be used; each kind defines the value of the problem."""

    NO_POSITION = "no-position"
    """No position of the train has been received. There is no value."""
    MARKED_UNUSABLE = "marked-unusable"
    """The sender itself marked the fix as unusable. There is no value."""
    NOT_A_NUMBER = "not-a-number"
    """Position or speed is infinite, or both are missing, or the position is missing without an estimate. No value."""
    SPEED_IMPOSSIBLE = "speed-impossible"
    """The train cannot have the speed of the fix. The value is that speed (m/s)."""
    POSITION_IMPOSSIBLE = "position-impossible"
    """The position of the fix is outside the range possible on any line. The value is that position (m)."""
    TOO_UNCERTAIN = "too-uncertain"
    """The fix states too large a standard deviation of its position to be of use. The value is that deviation (m)."""
    UNCERTAINTY_IMPOSSIBLE = "uncertainty-impossible"
    """The fix states a negative or absurdly large standard deviation. The value is that deviation (m or m/s)."""
    SPEED_JUMPED = "speed-jumped"
    """The measured speed is too far from the expected one. The value is by how much it is higher (m/s)."""
    SPEED_UNIT = "speed-unit"
    """The measured speeds are those from the positions times the factor of a wrong unit. The value is that factor."""
    SPEED_UNCONFIRMED = "speed-unconfirmed"
    """The distance between the positions has not confirmed the measured speed yet. The value is that speed (m/s)."""
    JUMPED = "jumped"
    """The measured position is too far ahead of the expected one. The value is by how much (m)."""
    JUMPED_BACK = "jumped-back"
    """The measured position is too far behind the expected one. The value is by how much (m)."""
    FROZEN = "frozen"
    """The receiver repeats a position although the train moves. The value is that position (m)."""
    STALE = "stale"
    """The last accepted fix is too old. The value is its age (s)."""
    RARE = "rare"
    """Fixes come too rarely. The value is the shorter of the last two times between fixes (s)."""
    AHEAD_OF_CLOCK = "ahead-of-clock"
    """The last accepted fix is ahead of the clock. The value is by how much (s)."""
    POSITION_UNCERTAIN = "position-uncertain"
    """The estimated position is too uncertain. The value is its standard deviation (m)."""
    SPEED_UNCERTAIN = "speed-uncertain"
    """The estimated speed is too uncertain. The value is its standard deviation (m/s)."""


class Problem(NamedTuple):
    """A kind of problem and the value that belongs to it, in SI units; NaN if the kind has none."""

    kind: ProblemKind
    value: float = math.nan


NO_POSITION_YET = Problem(ProblemKind.NO_POSITION)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Position and speed of the train at a time (ns since 1970), and whether advice may be based on them."""

    time_ns: int
    fix_time_ns: int = 0
    """The time of the last fix that went into the estimate; 0 if there is none."""
    s_m: float = math.nan
    speed_mps: float = math.nan
    position_sd_m: float = math.nan
    """One standard deviation of the position."""
    speed_sd_mps: float = math.nan
    """One standard deviation of the speed."""
    problem: Problem | None = NO_POSITION_YET
    """Why the estimate cannot be used; None if it can be used."""
    rejected: int = 0
    """Fixes that were rejected since the localisation began."""
    rejection: Problem | None = None
    """Why the last rejected fix was rejected; None if no fix was."""
    restarts: int = 0
    """Restarts of the estimate because rejected fixes agreed with each other."""
    clock_off_s: float = 0.0
    """Our clock minus the time stamps of the fixes, as far as known; > 0: stamps are behind, or fixes arrive late."""

    @property
    def usable(self) -> bool:
        """Whether advice may be based on the estimate."""
        return self.problem is None
