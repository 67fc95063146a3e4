"""A follower of the horizon of an advice, who departs as soon as he is told to, because he is always cleared."""

from __future__ import annotations

from typing import Any

from das.advice.regimes import Regime

DEPARTS_MPS = 0.5
"""The speed of a train one second after it has departed."""


def after_a_second_mps(advice: Any) -> float:
    """The speed in one second of a train that is cleared and does what an advice says."""
    return DEPARTS_MPS if advice.mode == Regime.DEPART else float(advice.horizon_speed_mps[0])
