"""The estimate of where the train is and how fast it runs, with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

from das.estimate.problems import Problem, ProblemKind

NOTHING_HEARD = Problem(ProblemKind.NO_POSITION)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Where the train is at a time (ns since 1970), how fast it runs, and whether advice may rest on that."""

    time_ns: int
    fix_time_ns: int = 0
    """The time of the last fix that went into the estimate; 0 where there is none."""
    s_m: float = math.nan
    speed_mps: float = math.nan
    position_sd_m: float = math.nan
    """One standard deviation of the position."""
    speed_sd_mps: float = math.nan
    """One standard deviation of the speed."""
    problem: Problem | None = NOTHING_HEARD
    """Why the estimate cannot be used; None where it can be used."""
    rejected: int = 0
    """How many fixes were rejected since the localisation began."""
    rejection: Problem | None = None
    """Why the last rejected fix was rejected; None where no fix was."""
    restarts: int = 0
    """How many times rejected fixes that agreed with each other made the estimate begin anew where they are."""
    clock_off_s: float = 0.0
    """The clock here less the time stamps of the fixes, as far as it is known (> 0: they are behind, or heard late)."""

    @property
    def usable(self) -> bool:
        """Whether advice may rest on the estimate."""
        return self.problem is None
