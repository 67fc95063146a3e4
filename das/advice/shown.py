"""The figures that a driver reads, computed once, on board: speeds in whole km/h, efforts on the controller's scale."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from das.advice.advice import Guidance, Instruction
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.domain.units import KMH

SPEED_BAND_RATIO: Final = 0.75
"""Share of a step, from its middle, beyond which the true speed changes the displayed one."""
SPEED_STEP_MPS: Final = 1.0 * KMH
"""Step (m/s) of the speeds that a driver reads."""
TARGET_STEP_MPS: Final = 5.0 * KMH
"""Step (m/s) of the speeds shown to a driver to reach or to hold, unless they are limits."""
REACTS_S: Final = 2.0
"""Longest time (s) that a driver may take to follow what is shown."""
STOP_BY_EYE_M: Final = 300.0
"""Last distance (m) before the stop: a driver brakes by eye, with no effort shown, if no lower limit is ahead."""
SAME_READING_MPS: Final = 0.5 * KMH
"""Largest excess over the allowed speed (m/s) that looks the same to a driver."""
OVERSPEED_MPS: Final = 0.5
"""Largest excess (m/s) over the allowed speed without a warning that the train is too fast."""


def step_below(speed_mps: float) -> float:
    """The highest displayable speed (m/s) that is not above a speed."""
    return math.floor(speed_mps / SPEED_STEP_MPS + 1e-9) * SPEED_STEP_MPS


def steady_step(speed_mps: float, shown_mps: float) -> float:
    """A continuously changing speed (m/s), rounded down to a whole step; the step shown stays while it is near.

    `shown_mps` is the step shown (NaN: none), near if its middle is at most `SPEED_BAND_RATIO` steps from the speed.
    """
    away_mps = abs(speed_mps - (shown_mps + 0.5 * SPEED_STEP_MPS))
    return shown_mps if away_mps <= SPEED_BAND_RATIO * SPEED_STEP_MPS else step_below(speed_mps)


def target_below(speed_mps: float) -> float:
    """The highest whole step of speeds to reach or to hold (m/s) that is not above a speed."""
    return math.floor(speed_mps / TARGET_STEP_MPS) * TARGET_STEP_MPS


def lever_ratio(force_n: float, largest_n: tuple[float, float]) -> float:
    """A wheel force (N) on the controller's scale (−1 … 1); `largest_n`: the forces of traction and both brakes."""
    traction_n, brakes_n = largest_n
    most_n = traction_n if force_n >= 0 else brakes_n
    return min(max(force_n / most_n, -1.0), 1.0) if most_n > 0 else 0.0


def as_read(guidance: Guidance, largest_n: tuple[float, float], *, sees_mark: bool = False) -> Guidance:
    """The guide's advice as a driver reads it: rounded speeds, and the effort of the instruction.

    An acceleration keeps its effort up to its speed. A speed to hold has no effort, nor has the end of a brake for a
    stop if the driver `sees_mark`. `largest_n` are the largest forces (N) of traction and both brakes at this speed.
    """
    now = guidance.now
    by_eye = sees_mark and now.mode in BRAKES and step_below(now.speed_mps) == 0.0
    if by_eye:
        now = replace(now, mode=Regime.REDUCED_BRAKE, effort_ratio=math.nan)
    if by_eye or now.mode is Regime.CRUISE:
        shown_ratio = math.nan
    elif now.mode in TRACTION:
        shown_ratio = now.effort_ratio
    else:
        shown_ratio = lever_ratio(guidance.force_n, largest_n)
    following = tuple(map(_in_steps, guidance.following))
    return replace(guidance, now=_in_steps(now), following=following, lever_ratio=shown_ratio)


def _in_steps(one: Instruction) -> Instruction:
    """The instruction with its speed in whole steps."""
    speed_mps = step_below(one.speed_mps)
    return one if speed_mps == one.speed_mps else replace(one, speed_mps=speed_mps)
