"""What the coach says: plain frozen values, as the bus carries them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from das.advice.regimes import Regime


class ReplanCause(IntEnum):
    """Why the reference was made anew; the numbers are those of the bus message."""

    NONE = 0
    """There is no reference."""
    START = 1
    """There was no reference before: a new leg, or advice is given again."""
    GOAL = 2
    """The time of arrival is another one."""
    LINE = 3
    """Limits, line or train are not those that the reference was made for."""
    POINT = 4
    """A point ahead has another window of time, or would be passed outside of it."""
    LATE = 5
    """Keeping the reference would mean to arrive too late."""
    EARLY = 6
    """Keeping the reference would mean to arrive too early, and a slower run saves energy."""
    ENERGY = 7
    """Keeping the reference would cost more energy than a new one."""
    LOST = 8
    """The reference cannot be kept to from where the train is."""

    @property
    def label(self) -> str:
        """The name of the cause in events, tests and tables, e.g. `energy`."""
        return self.name.lower()


@dataclass(frozen=True, kw_only=True)
class Instruction:
    """One thing to do: the mode, the speed to reach or to hold, with what effort, and where and when it begins.

    `effort_ratio` is a share of the largest traction at the present speed (> 0), or of the largest electric brake at
    the present speed (< 0; of all brakes where there is none; below -1 with the friction brake as well). It is NaN for
    a speed to hold. `way_m` and `in_s` lead from the train to where the instruction begins; 0: it is due.
    """

    mode: Regime = Regime.NONE
    speed_mps: float = math.nan
    effort_ratio: float = math.nan
    way_m: float = 0.0
    in_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Replan:
    """Why and when (ns since 1970) the reference was made, and what it gains over the one before it (J, s)."""

    cause: ReplanCause = ReplanCause.NONE
    time_ns: int = 0
    gain_j: float = 0.0
    gain_s: float = 0.0
    """By how much nearer to the wanted time the train arrives."""


@dataclass(frozen=True, kw_only=True)
class Coaching:
    """What the driver should do now and after it, and what it is worth.

    `target_m` and `target_s` are way and time to where the speed of `now` is reached, or to the end of holding it.
    `force_n` is the wheel force of `now` at the present speed. `reference_force_n` is the force that keeps to the
    reference here: a brake is shown with one effort, and the reference brakes along its curve. `worth_j` is what
    following the instruction from here saves against going on at the present speed, at the same arrival.
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
