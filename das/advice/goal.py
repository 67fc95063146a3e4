"""The inputs of all advice: the train's state and the goal of its section, with common rules."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

from das.advice.shown import OVERSPEED_MPS, SAME_READING_MPS
from das.domain.errors import DasError
from das.domain.journey import Window
from das.domain.units import NS

LONGEST_RATIO: Final = 2.5
"""Longest plan as a multiple of the least time from its state: with more time left, the train waits at the stop."""
AT_END_M: Final = 1.0
"""Last distance (m) before the end of the section, over which no plan is made: the train is to stop."""
AT_STOP_M: Final = 50.0
"""Distance (m) from a stop within which a standing train is at it; a train further beyond has run past it."""
UNHURRIED_S: Final = 0.5
"""Planned lateness (s) of an arrival: recovering the time of effort build-up would cost 0.4 % of energy on 6 km."""
DEVIATION_NAMED_S: Final = 5.0
"""Earliness or lateness (s) from which the reason of the advice states it."""


@dataclass(frozen=True, kw_only=True)
class PassingTarget:
    """A point of the line (m), the earliest and latest time to pass it (ns since 1970; None: any), and the reason."""

    s_m: float
    earliest_ns: int | None = None
    latest_ns: int | None = None
    reason: str = ""

    def __post_init__(self) -> None:
        if self.earliest_ns is not None and self.latest_ns is not None and self.latest_ns < self.earliest_ns:
            raise DasError(f"target at {self.s_m:.0f} m: the latest time is before the earliest")

    def window(self, now_ns: int) -> Window:
        """The window (s from now) in which to pass the point."""
        earliest_s = -math.inf if self.earliest_ns is None else (self.earliest_ns - now_ns) * NS
        latest_s = math.inf if self.latest_ns is None else (self.latest_ns - now_ns) * NS
        return Window(earliest_s=earliest_s, latest_s=latest_s)


class TrainState(NamedTuple):
    """A train at a moment: time (ns since 1970), position (m), speed (m/s), and how much further ahead it may be (m)
    than the plans for braking assume."""

    now_ns: int
    s_m: float
    v_mps: float
    ahead_m: float = 0.0

    @property
    def braked_m(self) -> float:
        """The position (m) from which braking for limits and the stop ahead is computed."""
        return self.s_m + self.ahead_m


class SpeedsAllowed(NamedTuple):
    """The highest safe speed and the limit over the train (m/s), and whether the driver is warned of overspeed."""

    allowed_mps: float
    limit_mps: float
    too_fast: bool = False


def is_too_fast(excess_mps: float, *, told: bool = False) -> bool:
    """Whether an excess over the allowed speed (m/s) calls for a warning; `told`: the warning is already shown."""
    return excess_mps > (SAME_READING_MPS if told else OVERSPEED_MPS)


@dataclass(frozen=True, kw_only=True)
class Goal:
    """The times that the train has to keep on a section.

    `departure_ns` and `due_ns` are departure and arrival by the timetable (ns since 1970; 0: none). `target_ns` is the
    arrival that traffic management wants (None: `due_ns`). `passing` is the next point that must be passed in a window
    of time, `operator_delay_s` the delay that the operator stated; None if there is none. `counts`: punctuality counts
    at the stop ahead, as at the last stop of a journey; at other stops, an early train waits.
    """

    departure_ns: int = 0
    due_ns: int = 0
    target_ns: int | None = None
    passing: PassingTarget | None = None
    operator_delay_s: float | None = None
    counts: bool = True

    @cached_property
    def arrival_ns(self) -> int:
        """The arrival to aim at (ns since 1970): traffic management's, else the timetable's."""
        return self.target_ns if self.target_ns is not None else self.due_ns

    def left_s(self, now_ns: int) -> float:
        """The time (s) left until the arrival; < 0 once it has passed."""
        return (self.arrival_ns - now_ns) * NS

    def aimed_s(self, now_ns: int) -> float:
        """The time (s) that a plan made now may take to the end of the section."""
        return self.left_s(now_ns) + UNHURRIED_S
