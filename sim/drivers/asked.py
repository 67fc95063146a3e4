"""The action that a driving instruction requires: the only interpretation, used by all simulated drivers."""

from __future__ import annotations

import math
from enum import Enum

from das.advice.regimes import KIND_OF, InstructionKind


class Asked(Enum):
    """The action that an instruction requires of the driver of a train at a certain speed.

    Only `ACCELERATE` and `HOLD` allow traction. Braking for limits, stops and signals is the driver's own decision.
    """

    ACCELERATE = "the effort shown"
    HOLD = "the effort that holds the speed shown"
    COAST = "neither traction nor brakes, at any speed"
    BRAKE = "the brake with the effort shown"
    BRAKE_BY_EYE = "the brake that the driver considers right for the stopping point"
    KEEP_BELOW = "no traction, and brakes only against exceeding the speed shown"


def asked(mode: int, to_mps: float, effort_ratio: float, speed_mps: float, *, reached: bool = False) -> Asked | None:
    """The action that an instruction requires at a speed; None if its mode does not show how to drive.

    `to_mps` is the speed to reach or to hold (NaN: none is shown), `effort_ratio` is NaN if no effort is shown.
    `reached`: the train has had the speed to reach since the instruction became due.
    """
    kind = KIND_OF.get(mode)
    if kind is InstructionKind.TRACTION:
        return Asked.HOLD if reached or speed_mps >= to_mps else Asked.ACCELERATE
    if kind is InstructionKind.HOLD:
        return Asked.HOLD
    if kind is InstructionKind.COAST:
        return Asked.COAST
    if kind is InstructionKind.BRAKE:
        if math.isnan(effort_ratio) and to_mps <= 0:
            return Asked.BRAKE_BY_EYE
        return Asked.KEEP_BELOW if reached or speed_mps <= to_mps else Asked.BRAKE
    return None
