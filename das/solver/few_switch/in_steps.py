"""A schedule whose speeds are those that a driver is told: whole steps, or limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

from das.domain.errors import InfeasibleError
from das.domain.units import KMH
from das.solver.few_switch.few_switch import NotchRegime
from das.solver.few_switch.phases import ends_of
from das.solver.few_switch.schedule import Schedule, Scheduled
from das.solver.few_switch.scheduling import moved
from das.solver.few_switch.settings import PolishSettings

SAME_MPS = 0.03
"""Speeds that differ by less than this (m/s) are the same."""
LITTLE_MPS, LITTLE_CHANGE_S = 6.0 * KMH, 0.08
"""A change of speed by less than `LITTLE_MPS` costs the energy of full power for `LITTLE_CHANGE_S`."""
EARLY_S = 1.0
"""A schedule that is early by no more than this (s) is slow enough."""
NEAR_LIMIT_MPS = 0.2
"""A speed this near (m/s) to a limit is that of the limit."""
ROLLS_MPS = 1.5 * KMH
"""A train that stays faster than the speed to hold by more than this (m/s) rolls, as down a hill, and holds nothing."""


class Choice(Enum):
    """Which of the two steps around a speed to take."""

    CHEAPER = "cheaper"
    LOWER = "lower"
    HIGHER = "higher"

    def admits(self, step_mps: float, speed_mps: float) -> bool:
        """Whether a step may be taken for a speed."""
        if self is Choice.LOWER:
            return step_mps <= speed_mps + SAME_MPS
        return self is Choice.CHEAPER or step_mps >= speed_mps - SAME_MPS


class Rounding(NamedTuple):
    """How to round speeds: the size of a step (m/s), which step to take, and how the phases are then moved."""

    step_mps: float
    choice: Choice
    polish: PolishSettings


REACHED = (NotchRegime.TRACTION, NotchRegime.HOLD)


def in_steps(found: Scheduled, time_s: float, s_m: float, v_mps: float, rounding: Rounding) -> Scheduled:
    """A schedule for `time_s` from a state, with speeds to reach and to hold in whole steps, or those of limits.

    If the choice is free, the phases are then moved to where the schedule costs least, and the speeds by whole steps.
    Where a speed or a place would stall the train, it stays as it was.
    """
    best = _rounded(found, time_s, s_m, v_mps, rounding)
    if rounding.choice is Choice.CHEAPER:
        step_mps, polish = rounding.step_mps, rounding.polish
        best = _slower(best, time_s, s_m, v_mps, step_mps)
        whole = replace(polish, steps_mps=(step_mps,) * len(polish.steps_mps))
        better = moved(best, time_s, s_m, v_mps, whole).as_run(s_m, v_mps)
        better = _slower(_rounded(better, time_s, s_m, v_mps, rounding), time_s, s_m, v_mps, step_mps)
        best = better if better.cost_j(time_s) < best.cost_j(time_s) else best
    return best.with_its_brakes(s_m, v_mps)


def _rounded(found: Scheduled, time_s: float, s_m: float, v_mps: float, rounding: Rounding) -> Scheduled:
    """The schedule with each speed to reach or to hold at a step or limit near it."""
    best = found
    for first, last in _alike(found.schedule):
        speed_mps, steps = best.schedule.phases[first].target_mps, _around(best, first, last, rounding.step_mps)
        speeds = [one for one in steps if rounding.choice.admits(one, speed_mps)]
        tried = [_with_speed(best, first, last, speed, s_m, v_mps) for speed in speeds]
        feasible = [one for one in tried if one is not None]
        best = min(feasible, key=lambda one: one.cost_j(time_s) + _change_j(one.schedule, first), default=best)
    return best


def _slower(found: Scheduled, time_s: float, s_m: float, v_mps: float, step_mps: float) -> Scheduled:
    """The schedule with speeds one step lower where that costs less: rounded one by one, they may be too fast."""
    best = found
    for first, last in _alike(found.schedule):
        if best.forecast.time_s > time_s - EARLY_S:
            break
        lower_mps = best.schedule.phases[first].target_mps - step_mps
        tried = None if lower_mps < step_mps else _with_speed(best, first, last, lower_mps, s_m, v_mps)
        if tried is not None and tried.cost_j(time_s) < best.cost_j(time_s):
            best = tried
    return best


def _change_j(schedule: Schedule, number: int) -> float:
    """The price (J) of a speed that differs by little from that of the phase before: no driver sees the sense of it."""
    if number == 0:
        return 0.0
    differs_mps = abs(schedule.phases[number].target_mps - schedule.phases[number - 1].target_mps)
    little = SAME_MPS < differs_mps < LITTLE_MPS
    return LITTLE_CHANGE_S * schedule.section.train.traction_power_w if little else 0.0


def rounded_mps(speed_mps: float, step_mps: float, limit_mps: float, highest_mps: float) -> float:
    """The speed to tell a driver instead of one at which a phase ends: the limit there, or the nearest step.

    It is at most `highest_mps`, which is below the limit on a braking curve.
    """
    if abs(speed_mps - limit_mps) < NEAR_LIMIT_MPS and limit_mps < highest_mps + SAME_MPS:
        return limit_mps
    nearest = round(speed_mps / step_mps) * step_mps
    return nearest if nearest <= highest_mps else math.floor(highest_mps / step_mps) * step_mps


def _alike(schedule: Schedule) -> Iterator[tuple[int, int]]:
    """First and last numbers of successive phases that lead to one speed and hold it; some coast to it first."""
    phases, first = schedule.phases, 0
    while first < len(phases):
        last = first
        while (
            last + 1 < len(phases)
            and phases[last + 1].kind in REACHED
            and abs(phases[last + 1].target_mps - phases[first].target_mps) < SAME_MPS
        ):
            last += 1
        by_effort = phases[first].kind is NotchRegime.BRAKE and schedule.brakes_by_effort(first)
        if by_effort or phases[last].kind in REACHED:
            yield first, last
        first = last + 1


def _around(found: Scheduled, first: int, last: int, step_mps: float) -> tuple[float, ...]:
    """The speeds (m/s) to try instead of that of some phases: the steps below and above it, or the limit above it."""
    schedule = found.schedule
    speed_mps = schedule.phases[first].target_mps
    begin, end = schedule.phases[first].begin, ends_of(schedule.phases, schedule.run)[last]
    limits = schedule.section.limit_mps[begin:end]
    highest_mps = float(limits[limits > speed_mps - NEAR_LIMIT_MPS].min(initial=math.inf))
    if abs(speed_mps - highest_mps) < NEAR_LIMIT_MPS:
        return (highest_mps,)
    if speed_mps < step_mps:
        return ()
    lower_mps = math.floor(speed_mps / step_mps + SAME_MPS) * step_mps
    if abs(speed_mps - lower_mps) < SAME_MPS:
        return (lower_mps,)
    return (lower_mps, min(lower_mps + step_mps, highest_mps))


def _with_speed(
    found: Scheduled, first: int, last: int, speed_mps: float, s_m: float, v_mps: float
) -> Scheduled | None:
    """The schedule with another speed in some phases; None if the train stalls with it, or rolls faster throughout."""
    phases = list(found.schedule.phases)
    phases[first : last + 1] = [one._replace(target_mps=speed_mps) for one in phases[first : last + 1]]
    try:
        tried = Scheduled(*replace(found.schedule, phases=tuple(phases)).settled(s_m, v_mps), found.lambda_w)
    except InfeasibleError:
        return None
    held_mps = tried.forecast.speeds_mps[phases[last].begin : ends_of(phases, tried.schedule.run)[last] + 1]
    faster, slower = held_mps > speed_mps + ROLLS_MPS, held_mps <= speed_mps + ROLLS_MPS  # Behind the train: neither.
    rolls = phases[last].kind is NotchRegime.HOLD and faster.any() and not slower.any()
    return None if rolls else tried
