"""The reason of advice, as a code with its figures and names; `das.advice.wording` puts it into words."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any


class ReasonCode(IntEnum):
    """The kinds of reasons; the numbers are those of the bus message."""

    NONE = 0
    """The advice needs no reason."""
    TEXT = 1
    """`text` states why there is no advice, or is an error message."""
    TOO_FAST = 2
    """The train is faster by `speed_mps` than limits and the stop allow."""
    LIMIT = 3
    """The limit `speed_mps` begins at `at_m`."""
    RESTRICTION = 4
    """A temporary restriction to `speed_mps` begins at `at_m`."""
    STOP = 5
    """The train stops at `stop`."""
    POINT_EARLIEST = 6
    """The point at `at_m` may not be passed before `time_ns`; `text` states why."""
    POINT_MISSED = 7
    """The point at `at_m` is passed after `time_ns`, the end of its window; `text` states why it has one."""
    ARRIVAL = 8
    """The train arrives late or early, by `late_s`."""
    ARRIVED = 9
    """The train stands at its stop, where it arrived `late_s` late."""
    DEPARTURE = 10
    """The train waits for its departure at `time_ns`."""
    NO_PLAN = 11
    """The train is too fast for any plan; `text` is the planner's error message."""
    FASTEST_SAFE = 12
    """No optimum is known yet: the advice is the fastest safe run."""
    AS_BEFORE = 13
    """No optimum is known yet: the advice is the last plan, reduced to what is allowed now."""
    FASTEST = 14
    """The train runs as fast as possible, and arrives `late_s` late."""
    LEAST_ENERGY = 15
    """The advice is the run of least energy; the train arrives `late_s` late."""
    WAITS_AT_STOP = 16
    """The advice is the run of least energy; the train arrives early by `-late_s`, and waits at `stop`."""
    ON_TIME = 17
    """The train arrives on time with the least energy."""
    ON_TIME_TOLD_LATE = 18
    """The train arrives on time with the least energy; the operator states that it is `late_s` late."""


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A reason: its code, and the figures and names that the code needs; the others are NaN, 0 or empty.

    `late_s` is how late the train arrives (early < 0; NaN: not to be stated). `text` is the operator's text about a
    point, or an error message.
    """

    code: ReasonCode = ReasonCode.NONE
    speed_mps: float = math.nan
    at_m: float = math.nan
    time_ns: int = 0
    late_s: float = math.nan
    stop: str = ""
    text: str = ""

    def __bool__(self) -> bool:
        """Whether there is a reason to show."""
        return self.code is not ReasonCode.NONE

    @classmethod
    def of_text(cls, text: str) -> Reason:
        """The reason that is only a text."""
        return cls(code=ReasonCode.TEXT, text=text)

    @classmethod
    def read(cls, other: Any) -> Reason:
        """The reason with the fields of an object that has the same ones, such as a message of the bus.

        An unknown code, as in the recording of a later version, and a code that is not set give no reason.
        """
        if isinstance(other, Reason):
            return other
        if other.code == ReasonCode.NONE or other.code not in set(ReasonCode):
            return cls()
        values = {one.name: getattr(other, one.name) for one in fields(cls)}
        known = {name: value for name, value in values.items() if value == value}  # noqa: PLR0124
        return cls(**{**known, "code": ReasonCode(other.code)})  # The default NaN makes equal reasons compare as equal.


NO_REASON = Reason()
