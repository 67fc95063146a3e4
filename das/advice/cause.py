"""Why there is no advice, as data. `das.cab.withdrawal` decides it; `das.advice.wording` says it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from das.estimate.estimate import Problem, ProblemKind


class Cause(IntEnum):
    """Why advice is withdrawn, in the order in which it is decided; the numbers are those of the bus message."""

    NONE = 0
    """Advice is given."""
    TWO_PUBLISHERS = 1
    """Two publishers say where the train is, and one of them is wrong."""
    TWO_OPERATORS = 2
    """Two publishers say which restrictions are in force, and they differ."""
    RESTRICTIONS_UNHEEDED = 3
    """Restrictions were received that cannot be heeded."""
    JOURNEY_REFUSED = 4
    """The last journey received cannot be driven, or is not for this node."""
    INTERNAL_ERROR = 5
    """Something went wrong in the program that nobody foresaw."""
    NO_JOURNEY = 6
    """No journey has been heard yet."""
    RESTRICTIONS_UNTOLD = 7
    """No list of restrictions has been heard, not even an empty one."""
    SECTION_IMPOSSIBLE = 8
    """The section cannot be driven under what is in force, or could not be solved."""
    NO_POSITION = 9
    """Nothing has been heard of the train's position."""
    POSITION_REJECTED = 10
    """The position received is impossible or unusable."""
    POSITION_STALE = 11
    """The last position is too old, or positions come too rarely."""
    POSITION_AHEAD = 12
    """The position is ahead of the clock."""
    POSITION_UNCERTAIN = 13
    """Position or speed are too uncertain."""
    OUTSIDE_SECTION = 14
    """The train is not on the section."""
    MOVING_UP = 15
    """The train moves up to the stop where the section begins."""
    PAST_STOP = 16
    """The train has run past its stop."""
    NO_PLAN = 17
    """From this state the section cannot be finished."""
    TWO_NODES = 18
    """Another node advises this train as well."""

    @property
    def label(self) -> str:
        """The name of the cause in events, tests and tables, e.g. `position-stale`."""
        return self.name.lower().replace("_", "-")


OF_PROBLEM = {
    ProblemKind.NO_POSITION: Cause.NO_POSITION,
    ProblemKind.MARKED_UNUSABLE: Cause.POSITION_REJECTED,
    ProblemKind.NOT_A_NUMBER: Cause.POSITION_REJECTED,
    ProblemKind.SPEED_IMPOSSIBLE: Cause.POSITION_REJECTED,
    ProblemKind.POSITION_IMPOSSIBLE: Cause.POSITION_REJECTED,
    ProblemKind.TOO_UNCERTAIN: Cause.POSITION_REJECTED,
    ProblemKind.UNCERTAINTY_IMPOSSIBLE: Cause.POSITION_REJECTED,
    ProblemKind.SPEED_JUMPED: Cause.POSITION_REJECTED,
    ProblemKind.JUMPED: Cause.POSITION_REJECTED,
    ProblemKind.JUMPED_BACK: Cause.POSITION_REJECTED,
    ProblemKind.FROZEN: Cause.POSITION_REJECTED,
    ProblemKind.STALE: Cause.POSITION_STALE,
    ProblemKind.RARE: Cause.POSITION_STALE,
    ProblemKind.AHEAD_OF_CLOCK: Cause.POSITION_AHEAD,
    ProblemKind.POSITION_UNCERTAIN: Cause.POSITION_UNCERTAIN,
    ProblemKind.SPEED_UNCERTAIN: Cause.POSITION_UNCERTAIN,
}
"""The cause that follows from each problem of a position."""


@dataclass(frozen=True)
class Withdrawal:
    """Why there is no advice, with the facts that belong to the cause; what a cause does not need stays empty."""

    cause: Cause
    text: str = ""
    """Words from another part of the program: why a journey or section is refused, the error, two publishers' names."""
    problem: Problem | None = None
    """What is wrong with the position."""
    position_m: float = 0.0
    """Where the train is, or how far it ran past its stop."""
    section_m: tuple[float, float] = (0.0, 0.0)
    """The section's two ends."""
