"""The advice to the driver, with its parts: plain frozen values, as sent over the bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from das.advice.reason import NO_REASON, Reason
from das.advice.regimes import Regime
from das.domain.errors import DasError
from das.estimate.estimate import ProblemKind


class Cause(IntEnum):
    """Why advice is withdrawn, in the order in which causes are checked; the numbers are those of the bus message."""

    NONE = 0
    """Advice is given."""
    TWO_PUBLISHERS = 1
    """Two publishers send positions of the train, and it is unknown which one is right."""
    TWO_OPERATORS = 2
    """Two publishers send different lists of restrictions."""
    RESTRICTIONS_UNHEEDED = 3
    """Restrictions were received that cannot be applied."""
    JOURNEY_REFUSED = 4
    """The last journey received was refused: it cannot be driven, or is meant for another node."""
    INTERNAL_ERROR = 5
    """An unforeseen error occurred in the program."""
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
    """The train draws forward to the stop where the section begins."""
    PAST_STOP = 16
    """The train has run past its stop."""
    NO_PLAN = 17
    """The end of the section cannot be reached from the train's state."""
    TWO_NODES = 18
    """Another node advises the train as well."""
    STANDS_ON_LINE = 19
    """The train stands where it has no stop, and only the driver knows why."""
    DRIVER_BRAKES = 20
    """The driver brakes although the advice is to accelerate or to hold a speed."""

    @property
    def is_quiet(self) -> bool:
        """Whether advice continues without being shown, because the driver has reasons unknown to the advice."""
        return self in (Cause.STANDS_ON_LINE, Cause.DRIVER_BRAKES)

    @property
    def label(self) -> str:
        """The name of the cause in events, tests and tables, e.g. `position-stale`."""
        return self.name.lower().replace("_", "-")


OF_PROBLEM = {
    **dict.fromkeys(ProblemKind, Cause.POSITION_REJECTED),
    ProblemKind.NO_POSITION: Cause.NO_POSITION,
    ProblemKind.STALE: Cause.POSITION_STALE,
    ProblemKind.RARE: Cause.POSITION_STALE,
    ProblemKind.AHEAD_OF_CLOCK: Cause.POSITION_AHEAD,
    ProblemKind.SPEED_UNCONFIRMED: Cause.POSITION_UNCERTAIN,
    ProblemKind.POSITION_UNCERTAIN: Cause.POSITION_UNCERTAIN,
    ProblemKind.SPEED_UNCERTAIN: Cause.POSITION_UNCERTAIN,
}
"""Cause of the withdrawal for each problem with a position."""


class Withdrawal(NamedTuple):
    """Why there is no advice: the cause, and the text that only this case has: an error message, names or figures."""

    cause: Cause
    text: str = ""


class ReplanCause(IntEnum):
    """Why the guide made a new reference; the numbers are those of the bus message."""

    NONE = 0
    """There is no reference."""
    START = 1
    """There was no reference before: a section begins, the train departs, or advice resumes after a pause."""
    GOAL = 2
    """The wanted arrival has changed."""
    LINE = 3
    """Limits, line or train have changed since the reference was made."""
    POINT = 4
    """A point ahead has a new window of time, or would be passed outside its window."""
    LATE = 5
    """The train would arrive too late with the previous reference."""
    EARLY = 6
    """The train would arrive too early with the previous reference, and slower driving saves energy."""
    ENERGY = 7
    """The previous reference would need more energy than a new one."""
    LOST = 8
    """The train cannot follow the previous reference from its state."""


@dataclass(frozen=True, kw_only=True)
class Instruction:
    """One instruction to the driver: the mode, the speed to reach or hold, the effort, and where and when it begins.

    `effort_ratio` > 0 is a share of the largest traction at the present speed. `effort_ratio` < 0 is a share of the
    largest electric brake at the present speed (of all brakes if there is no electric one); below -1 the friction brake
    is used as well. It is NaN for a speed to hold. `way_m` and `in_s` are the distance and time until the instruction
    begins; 0 if it is due.
    """

    mode: Regime = Regime.NONE
    speed_mps: float = math.nan
    effort_ratio: float = math.nan
    way_m: float = 0.0
    in_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Replan:
    """Why and when (ns since 1970) the guide made its reference, and what it gains over the previous one (J, s)."""

    cause: ReplanCause = ReplanCause.NONE
    time_ns: int = 0
    gain_j: float = 0.0
    gain_s: float = 0.0
    """Time (s) by which the arrival is nearer to the wanted one."""


@dataclass(frozen=True, kw_only=True)
class Guidance:
    """The present and the next instructions, with a reason if the present instruction does not make it obvious.

    `target_m` and `target_s` are the distance and time to the place where the speed of `now` is reached, or where
    holding it ends. `force_n` is the wheel force of `now` at the present speed. `reference_force_n` is the force that
    keeps the reference here; while braking, `force_n` differs from it because the effort shown is rounded up.
    `lever_ratio` is the effort of `now` on the controller's scale (−1 … 1); NaN if no effort is shown: for a speed to
    hold, and to brake by eye.
    """

    now: Instruction
    following: tuple[Instruction, ...] = ()
    target_m: float = 0.0
    target_s: float = 0.0
    force_n: float = 0.0
    reference_force_n: float = 0.0
    lever_ratio: float = 0.0
    reason: Reason = NO_REASON
    replan: Replan = Replan()


class Source(IntEnum):
    """The basis of advice; the numbers are those of the bus message.

    TABLE: a reference finished offline. SOLVED: solved on board. FALLBACK: nothing is solved (yet).
    """

    NONE = 0
    TABLE = 1
    SOLVED = 2
    FALLBACK = 3


@dataclass(frozen=True, kw_only=True)
class Timetable:
    """Departure from the stop where the section begins and arrival at the stop where it ends (ns since 1970)."""

    departure_ns: int
    arrival_ns: int

    def check(self) -> None:
        """Raise DasError if the arrival is not after the departure."""
        if self.arrival_ns <= self.departure_ns:
            raise DasError("timetable: the arrival is not after the departure")


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One advice message; fields, units and signs are those of the message in das.proto.

    Mode NONE means that advice is withdrawn: `cause` is the code of the cause, `reason` its text. In mode DEPART the
    driver waits until the train is cleared: advised speed, force and horizon are those of a standing train, and
    `next_mode`, `departure_speed_mps` and `departure_force_ratio` (a share of the available traction) say how to
    depart. In every other mode `departure_speed_mps` and `departure_force_ratio` are 0. `replaced_parts` is the number
    of parts that the last word replaced.
    """

    time_ns: int
    position_time_ns: int = 0
    s_m: float = math.nan
    speed_mps: float = math.nan
    mode: Regime = Regime.NONE
    advised_speed_mps: float = math.nan
    advised_force_n: float = math.nan
    advised_force_ratio: float = math.nan
    horizon_speed_mps: tuple[float, ...] = ()
    horizon_force_n: tuple[float, ...] = ()
    next_mode: Regime = Regime.NONE
    next_change_m: float = math.nan
    next_change_s: float = math.nan
    predicted_arrival_ns: int = 0
    predicted_deviation_s: float = math.nan
    buffer_ratio: float = math.nan
    energy_to_go_j: float = math.nan
    source: Source = Source.NONE
    reason: Reason = NO_REASON
    valid_until_ns: int = 0
    limit_mps: float = math.nan
    position_sd_m: float = math.nan
    display_speed_mps: float = math.nan
    cause: Cause = Cause.NONE
    guide: Guidance | None = None
    departure_speed_mps: float = 0.0
    departure_force_ratio: float = 0.0
    replaced_parts: int = 0
