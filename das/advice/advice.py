"""One advice to the driver, with its parts: plain frozen values, as sent over the bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from das.advice.cause import Cause
from das.advice.coach.coaching import Coaching
from das.advice.regimes import Regime
from das.domain.errors import DasError


class Source(IntEnum):
    """What advice is based on; the numbers are those of the bus message.

    TABLE: optima solved offline. SOLVED: optima solved on board. FALLBACK: no optimum is known (yet).
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
    """One advice; fields, units and signs are those of the message in das.proto.

    Mode NONE means that advice is withdrawn: `cause` says why, and `reason` says it in words. In mode DEPART the
    driver waits until the train is cleared: advised speed, force and horizon are those of a standing train, and
    `next_mode`, `departure_speed_mps` and `departure_force_ratio` (a share of the available traction) say how to
    depart. In every other mode `departure_speed_mps` and `departure_force_ratio` are 0.
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
    reason: str = ""
    valid_until_ns: int = 0
    limit_mps: float = math.nan
    position_sd_m: float = math.nan
    display_speed_mps: float = math.nan
    reduced_max_speed_mps: float = math.nan
    four_mode: Regime = Regime.NONE
    next_four_mode: Regime = Regime.NONE
    next_four_change_s: float = math.nan
    cause: Cause = Cause.NONE
    coach: Coaching | None = None
    departure_speed_mps: float = 0.0
    departure_force_ratio: float = 0.0
