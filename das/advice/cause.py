"""Why there is no advice, as data. `das.cab.withdrawal` decides the cause; `das.advice.wording` puts it into words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from das.estimate.estimate import Problem, ProblemKind


class Cause(IntEnum):
    """Why advice is withdrawn, in the order in which causes are checked; the numbers are those of the bus message."""

    NONE = 0
    """Advice is given."""
    TWO_PUBLISHERS = 1
    """Two publishers send positions of the train, and nobody can tell which one is right."""
    TWO_OPERATORS = 2
    """Two publishers send different lists of restrictions."""
    RESTRICTIONS_UNHEEDED = 3
    """Restrictions were received that cannot be applied."""
    JOURNEY_REFUSED = 4
    """The last journey received was refused: it cannot be driven, or is not meant for this node."""
    INTERNAL_ERROR = 5
    """The program met an error that it was not prepared for."""
    NO_JOURNEY = 6
    """No journey has been received yet."""
    RESTRICTIONS_UNTOLD = 7
    """No list of restrictions has been received, not even an empty one."""
    SECTION_IMPOSSIBLE = 8
    """The section cannot be driven under the limits in force, or could not be solved."""
    NO_POSITION = 9
    """No position has been received yet."""
    POSITION_REJECTED = 10
    """The position received is impossible or unusable."""
    POSITION_STALE = 11
    """The last position is too old, or positions come too rarely."""
    POSITION_AHEAD = 12
    """The time stamp of the position is ahead of the clock."""
    POSITION_UNCERTAIN = 13
    """Position or speed is too uncertain."""
    OUTSIDE_SECTION = 14
    """The train is not on the section."""
    MOVING_UP = 15
    """The train moves up to the stop where the section begins."""
    PAST_STOP = 16
    """The train has run past its stop."""
    NO_PLAN = 17
    """From the train's state the end of the section cannot be reached."""
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
"""The cause of a withdrawal for each problem of a position."""


@dataclass(frozen=True)
class Withdrawal:
    """Why there is no advice: the cause and its facts. Fields that the cause does not need keep their defaults."""

    cause: Cause
    text: str = ""
    """Text from elsewhere: why a journey or section was refused, an error message, or the names of two publishers."""
    problem: Problem | None = None
    """What is wrong with the position; None if the position is not the cause."""
    position_m: float = 0.0
    """Where the train is (m), or how far it has run past its stop (m)."""
    section_m: tuple[float, float] = (0.0, 0.0)
    """The two ends of the section (m)."""
