"""A driver who follows the horizon of an advice message exactly, is always cleared, and departs as soon as advised."""

from __future__ import annotations

from typing import Any

from das.advice.regimes import Regime

DEPARTS_MPS = 0.5
"""The speed of a train (m/s) one second after it has departed."""


def after_a_second_mps(advice: Any) -> float:
    """The speed (m/s), one second later, of a cleared train whose driver follows an advice message."""
    return DEPARTS_MPS if advice.mode == Regime.DEPART else float(advice.horizon_speed_mps[0])
