"""Modes: what a driver does with the controller. `das.advice.classifying` tells the modes of a run's intervals."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np


class Mode(IntEnum):
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


FULL_RATIO: Final = 0.97
"""An effort of the coach from this share of the largest on counts as full."""

EFFORT_ORDER = (
    Mode.FULL_TRACTION,
    Mode.REDUCED_TRACTION,
    Mode.CRUISE,
    Mode.NONE,
    Mode.STOP,
    Mode.DEPART,
    Mode.COAST,
    Mode.REDUCED_BRAKE,
    Mode.FULL_BRAKE,
    Mode.FRICTION_BRAKE,
)
"""The modes from the most traction to the most brake; a change forwards in this order is never delayed."""

ROLLING = np.array([Mode.REDUCED_TRACTION, Mode.COAST], dtype=np.int64)
"""These modes count as cruising between two stretches of it, where the speed changes by no more than a ripple."""

FOUR_MODES = np.arange(len(Mode))
"""Each mode as one of the four that the simplest display knows: traction, a speed to hold, coast, brake."""
FOUR_MODES[[Mode.REDUCED_TRACTION, Mode.REDUCED_BRAKE, Mode.FRICTION_BRAKE]] = (
    Mode.CRUISE,
    Mode.FULL_BRAKE,
    Mode.FULL_BRAKE,
)


def departure_mode(effort_ratio: float) -> Mode:
    """The mode that begins when a train departs with a share of the largest traction; NaN: as a speed to hold needs."""
    if math.isnan(effort_ratio):
        return Mode.CRUISE
    return Mode.FULL_TRACTION if effort_ratio >= FULL_RATIO else Mode.REDUCED_TRACTION


def mode_name(mode: Mode) -> str:
    """A mode in words."""
    return "no advice" if mode is Mode.NONE else mode.name.lower().replace("_", " ")
