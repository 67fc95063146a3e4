"""Phases of a schedule: what to do on a stretch of line, and up to which speed."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from das.solver.kernels import schedule as kernels


class PhaseKind(IntEnum):
    """What a driver does in a phase, with the numbers that the kernels know."""

    TRACTION = kernels.TRACTION
    """A share of the largest traction effort; with a share of 0 a hill accelerates the train."""
    HOLD = kernels.HOLD
    """The speed is held, by traction or by brakes."""
    COAST = kernels.COAST
    """No effort at all."""
    BRAKE = kernels.BRAKE
    """A share of the largest effort of the electric brake, until the lower speed ahead is reached."""
    CURVE = kernels.CURVE
    """The brakes keep the train on the braking curve of a limit or stop ahead."""


BRAKES = (PhaseKind.BRAKE, PhaseKind.CURVE)
"""The kinds in which a train brakes."""


class Phase(NamedTuple):
    """What to do on a stretch: kind, share of effort, the section's interval where it begins, speed to reach (m/s)."""

    kind: PhaseKind
    share: float
    begin: int
    target_mps: float

    @property
    def rolls_up(self) -> bool:
        """Whether the train coasts up to the speed."""
        return self.kind is PhaseKind.TRACTION and self.share == 0.0
