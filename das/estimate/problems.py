"""What can be wrong with a position, as data: the words for people are made in `das.advice.wording`."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import NamedTuple


class ProblemKind(StrEnum):
    """Why a fix was rejected, or why the estimated position cannot be used. The comment says what `value` holds."""

    NO_POSITION = "no-position"
    """Nothing has been heard of the train's position."""
    MARKED_UNUSABLE = "marked-unusable"
    """The sender itself marked the fix as unusable."""
    NOT_A_NUMBER = "not-a-number"
    SPEED_IMPOSSIBLE = "speed-impossible"
    """A speed (m/s) that this train cannot have."""
    POSITION_IMPOSSIBLE = "position-impossible"
    """A position (m) that no line has."""
    TOO_UNCERTAIN = "too-uncertain"
    """A fix whose own stated standard deviation (m) is so large that it is of no use."""
    UNCERTAINTY_IMPOSSIBLE = "uncertainty-impossible"
    """A stated standard deviation that cannot be."""
    SPEED_JUMPED = "speed-jumped"
    """By how much (m/s) the measured speed differs from the expected one."""
    JUMPED = "jumped"
    """By how much (m) the measured position lies ahead of the expected one."""
    JUMPED_BACK = "jumped-back"
    """By how much (m) the measured position lies behind the expected one."""
    FROZEN = "frozen"
    """The position (m) at which the receiver stands still although the train moves."""
    STALE = "stale"
    """The age (s) of the last fix."""
    RARE = "rare"
    """The time (s) between two fixes, which is too long."""
    AHEAD_OF_CLOCK = "ahead-of-clock"
    """By how much (s) the fix is ahead of the clock."""
    POSITION_UNCERTAIN = "position-uncertain"
    """The standard deviation (m) of the estimated position."""
    SPEED_UNCERTAIN = "speed-uncertain"
    """The standard deviation (m/s) of the estimated speed."""


class Problem(NamedTuple):
    """A kind of problem and the figure that belongs to it (SI units; NaN where the kind needs none)."""

    kind: ProblemKind
    value: float = math.nan
