"""The coach's advice: plain frozen values, as sent over the bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from das.advice.regimes import Regime


class ReplanCause(IntEnum):
    """Why the coach made a new reference; the numbers are those of the bus message."""

    NONE = 0
    """There is no reference."""
    START = 1
    """There was no reference before: a section begins, the train departs, or advice is given again after a pause."""
    GOAL = 2
    """The wanted arrival has changed."""
    LINE = 3
    """Limits, line or train have changed since the reference was made."""
    POINT = 4
    """A point ahead has a new window of time, or would be passed outside its window."""
    LATE = 5
    """With the reference before, the train would arrive too late."""
    EARLY = 6
    """With the reference before, the train would arrive too early, and slower driving saves energy."""
    ENERGY = 7
    """The reference before would need more energy than a new one."""
    LOST = 8
    """The reference before cannot be kept from where the train is."""

    @property
    def label(self) -> str:
        """The name of the cause in events, tests and tables, e.g. `energy`."""
        return self.name.lower()


@dataclass(frozen=True, kw_only=True)
class Instruction:
    """One thing for the driver to do: the mode, the speed to reach or hold, the effort, and where and when it begins.

    `effort_ratio` > 0 is a share of the largest traction at the present speed. `effort_ratio` < 0 is a share of the
    largest electric brake at the present speed (of all brakes if there is no electric one); below -1 the friction brake
    is used as well. It is NaN for a speed to hold. `way_m` and `in_s` are the distance and time until the instruction
    begins; 0: it is due.
    """

    mode: Regime = Regime.NONE
    speed_mps: float = math.nan
    effort_ratio: float = math.nan
    way_m: float = 0.0
    in_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Replan:
    """Why and when (ns since 1970) the coach made its reference, and what it gains over the one before (J, s)."""

    cause: ReplanCause = ReplanCause.NONE
    time_ns: int = 0
    gain_j: float = 0.0
    gain_s: float = 0.0
    """By how much (s) the arrival is nearer to the wanted time."""


@dataclass(frozen=True, kw_only=True)
class Coaching:
    """What the driver should do now and next, and what it saves.

    `target_m` and `target_s` are distance and time to where the speed of `now` is reached, or no longer held. `force_n`
    is the wheel force of `now` at the present speed. `reference_force_n` is the force that keeps the reference here;
    it differs while braking, because the effort shown is rounded up. `worth_j` is what following the instruction saves
    compared with going on at the present speed first, for the same arrival.
    """

    now: Instruction
    following: tuple[Instruction, ...] = ()
    target_m: float = 0.0
    target_s: float = 0.0
    force_n: float = 0.0
    reference_force_n: float = 0.0
    reason: str = ""
    worth_j: float = 0.0
    replan: Replan = Replan()
