"""The estimate of where the train is and how fast it runs, with its uncertainty, and what can be wrong with it.

Problems are data: the words for people are made in `das.advice.wording`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple


class ProblemKind(StrEnum):
    """Why a fix was rejected, or why the estimate cannot be used; each kind says what the value of the problem is."""

    NO_POSITION = "no-position"
    """No position of the train has been received. There is no value."""
    MARKED_UNUSABLE = "marked-unusable"
    """The sender itself marked the fix as unusable. There is no value."""
    NOT_A_NUMBER = "not-a-number"
    """The fix states an infinite position or speed, or neither of them, or no position while there is no estimate.
    There is no value."""
    SPEED_IMPOSSIBLE = "speed-impossible"
    """The train cannot have the speed of the fix. The value is that speed (m/s)."""
    POSITION_IMPOSSIBLE = "position-impossible"
    """No line has the position of the fix. The value is that position (m)."""
    TOO_UNCERTAIN = "too-uncertain"
    """The fix states too large a standard deviation of its position to be of use. The value is that deviation (m)."""
    UNCERTAINTY_IMPOSSIBLE = "uncertainty-impossible"
    """The fix states a negative or absurdly large standard deviation. The value is that deviation (m or m/s)."""
    SPEED_JUMPED = "speed-jumped"
    """The measured speed is too far from the expected one. The value is by how much it is higher (m/s)."""
    SPEED_UNIT = "speed-unit"
    """The measured speeds are a multiple of what the positions cover. The value is the factor."""
    SPEED_UNCONFIRMED = "speed-unconfirmed"
    """The way between the positions has not confirmed the measured speed yet. The value is that speed (m/s)."""
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
    """Where the train is at a time (ns since 1970), how fast it runs, and whether advice may rest on that."""

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
    """The clock here less the time stamps of the fixes, as far as known (> 0: they are behind, or come late)."""

    @property
    def usable(self) -> bool:
        """Whether advice may rest on the estimate."""
        return self.problem is None
