"""Who drives and what the display shows, by name, in a module that imports nothing heavy: command lines need it."""

from __future__ import annotations

from enum import StrEnum


class DriverKind(StrEnum):
    """Who drives."""

    PERFECT = "perfect"
    FAST = "fast"
    RMS = "rms"
    TIMETABLE = "timetable"
    HUMAN = "human"


class Presentation(StrEnum):
    """How much of the same advice the display shows."""

    NONE = "none"
    RMS = "rms"
    """One reduced maximum speed."""
    FOUR_MODE = "four-mode"
    """Full traction, a speed to hold, coasting, braking; and when the next of them begins."""
    VECTOR = "vector"
    """Speed and effort now, and for the next seconds."""
