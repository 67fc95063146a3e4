"""The loss levels by name. Every command line imports this module at startup, so it imports nothing heavy."""

from __future__ import annotations

from enum import StrEnum


class Level(StrEnum):
    """Realism of the loss model (Nold & Corman 2024, section 3); OWN: the losses in the vehicle's file."""

    L0_NOREG = "l0-noreg"
    L0_REG = "l0-reg"
    L1 = "l1"
    L2 = "l2"
    L3 = "l3"
    OWN = "own"
