"""The words of the coach: why an instruction is given, as drivers would say it."""

from __future__ import annotations

from typing import NamedTuple

from das.advice.passing import PassingTarget
from das.advice.regimes import Regime
from das.advice.wording import deviation
from das.domain.units import KM, KMH, NS


class Aim(NamedTuple):
    """What an instruction leads to: a speed (m/s; 0: a stop), where (m), and the name of the stop."""

    speed_mps: float
    at_m: float
    stop: str = ""


def reason(mode: Regime, speed_mps: float, ahead: Aim | None, late_s: float) -> str:
    """Why a driver is told to do something; `ahead` is the limit or stop that comes next, if one is near."""
    place = "" if ahead is None else f" for {_named(ahead)}"
    if mode is Regime.COAST:
        return f"coast{place}{_spare(late_s)}"
    if mode in (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE):
        return f"brake{place}"
    if mode is Regime.CRUISE:
        return f"hold {speed_mps / KMH:.0f}{_spare(late_s)}"
    return f"accelerate to {speed_mps / KMH:.0f}{_spare(late_s)}"


def slow_for_point(point: PassingTarget, now_ns: int, clock: str) -> str:
    """A train that must not pass a point before a time; `clock` is that time of day."""
    why = f"{point.reason}: " if point.reason else ""
    seconds = (point.earliest_ns - now_ns) * NS if point.earliest_ns is not None else 0.0
    return f"slow: {why}km {point.s_m / KM:.1f} not before {clock}, in {seconds:.0f} s"


def too_fast(excess_mps: float) -> str:
    """A train above what limits and the stop allow."""
    return f"{excess_mps / KMH:.0f} km/h too fast"


def _named(ahead: Aim) -> str:
    if ahead.speed_mps < 0.5 and ahead.stop:
        return ahead.stop
    return f"the {ahead.speed_mps / KMH:.0f} at km {ahead.at_m / KM:.1f}"


def _spare(late_s: float) -> str:
    """How early or late the train is, where that is worth saying."""
    if late_s <= -5.0:
        return f", {-late_s:.0f} s spare"
    return f", {deviation(late_s)}" if late_s >= 5.0 else ""
