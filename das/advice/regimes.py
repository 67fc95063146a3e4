"""Driving regimes: what a driver does with the controller. `das.advice.plan` finds those of a run."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np


class Regime(IntEnum):
    """What to do with the controller; the numbers are those of the bus message."""

    NONE = 0
    FULL_TRACTION = 1
    REDUCED_TRACTION = 2
    CRUISE = 3
    COAST = 4
    REDUCED_BRAKE = 5
    FULL_BRAKE = 6
    FRICTION_BRAKE = 7
    STOP = 8
    DEPART = 9
    """The train stands; it may depart when it is cleared, and not before."""


TRACTION: Final = frozenset({Regime.FULL_TRACTION, Regime.REDUCED_TRACTION})
BRAKES: Final = frozenset({Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE})
FULL_RATIO: Final = 0.97
"""An effort that the coach shows counts as full if it is at least this share of the largest."""

EFFORT_ORDER = (
    Regime.FULL_TRACTION,
    Regime.REDUCED_TRACTION,
    Regime.CRUISE,
    Regime.NONE,
    Regime.STOP,
    Regime.DEPART,
    Regime.COAST,
    Regime.REDUCED_BRAKE,
    Regime.FULL_BRAKE,
    Regime.FRICTION_BRAKE,
)
"""The modes from the most traction to the most brake; a change forwards in this order is never delayed."""

ROLLING = np.array([Regime.REDUCED_TRACTION, Regime.COAST], dtype=np.int64)
"""Modes that count as cruising between two stretches of cruising if the speed changes by no more than a ripple."""

FOUR_MODES = np.arange(len(Regime))
"""Each mode as one of the four that the simplest display knows: traction, a speed to hold, coast, brake."""
FOUR_MODES[[Regime.REDUCED_TRACTION, Regime.REDUCED_BRAKE, Regime.FRICTION_BRAKE]] = (
    Regime.CRUISE,
    Regime.FULL_BRAKE,
    Regime.FULL_BRAKE,
)


def departure_regime(effort_ratio: float) -> Regime:
    """The mode of a departure with a share of the largest traction; NaN: as much as the speed to hold needs."""
    if math.isnan(effort_ratio):
        return Regime.CRUISE
    return Regime.FULL_TRACTION if effort_ratio >= FULL_RATIO else Regime.REDUCED_TRACTION


def mode_name(mode: Regime) -> str:
    """A mode in words."""
    return "no advice" if mode is Regime.NONE else mode.name.lower().replace("_", " ")
