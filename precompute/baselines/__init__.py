"""Baseline strategies: how trains are driven without an optimiser; and their names, which command lines need."""

from __future__ import annotations

from enum import StrEnum


class Strategy(StrEnum):
    """How a section is driven: the optimum, or a baseline to compare it with."""

    OPTIMAL = "optimal"
    FASTEST = "fastest"
    TOP_SPEED = "top-speed"
    FOUR_MODE = "four-mode"
