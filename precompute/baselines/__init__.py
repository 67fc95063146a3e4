"""Baseline strategies of driving without an optimiser, and their names for command lines."""

from __future__ import annotations

from enum import StrEnum


class Strategy(StrEnum):
    """The strategy on a section: the optimum, or a baseline for comparison."""

    OPTIMAL = "optimal"
    FASTEST = "fastest"
    TOP_SPEED = "top-speed"
    FOUR_MODE = "four-mode"
