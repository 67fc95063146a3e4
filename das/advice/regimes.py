"""Driving regimes, called modes: what the driver does with the controller."""

from __future__ import annotations

import math
from enum import IntEnum, StrEnum
from typing import Final


class Regime(IntEnum):
    """A driving mode: what to do with the controller. The numbers are those of the bus message."""

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
    """The train stands and may depart as soon as it is cleared."""


TRACTION: Final = frozenset({Regime.FULL_TRACTION, Regime.REDUCED_TRACTION})
BRAKES: Final = frozenset({Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE})


class InstructionKind(StrEnum):
    """A kind of instruction, whatever its speed and effort."""

    TRACTION = "traction"
    HOLD = "hold"
    COAST = "coast"
    BRAKE = "brake"


KIND_OF: Final[dict[int, InstructionKind]] = {
    **dict.fromkeys(TRACTION, InstructionKind.TRACTION),
    Regime.CRUISE: InstructionKind.HOLD,
    Regime.COAST: InstructionKind.COAST,
    **dict.fromkeys(BRAKES, InstructionKind.BRAKE),
}
"""The kind of each mode that is an instruction for a moving train."""
FULL_RATIO: Final = 0.97
"""Share of the largest effort from which an effort shown by the guide counts as full."""


def departure_regime(effort_ratio: float) -> Regime:
    """The mode of a departure with a share of the largest traction (NaN: the traction needed to hold a speed)."""
    if math.isnan(effort_ratio):
        return Regime.CRUISE
    return Regime.FULL_TRACTION if effort_ratio >= FULL_RATIO else Regime.REDUCED_TRACTION


def mode_name(mode: Regime) -> str:
    """A mode in words."""
    return "no advice" if mode is Regime.NONE else mode.name.lower().replace("_", " ")
