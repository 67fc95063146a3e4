"""Names of drivers and of displays; this module imports nothing heavy, because command lines need it."""

from __future__ import annotations

from enum import StrEnum
from typing import Final


class DriverKind(StrEnum):
    """The driver of a simulated train."""

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
    COACH = "coach"
    """What to do now, up to which speed and with what effort, and the next two changes."""


class FrictionPolicy(StrEnum):
    """Which brake a human driver uses where the motors could brake: a habit, or a rule of the railway."""

    AS_MEASURED = "as-measured"
    """A share of the braking effort (`friction_ratio`) by friction, whatever the display shows."""
    ELECTRIC_FIRST = "electric-first"
    """Friction only where the motors cannot give what is asked."""
    BY_ADVICE = "by-advice"
    """As measured, but electric first while the driver follows advice on effort: advice changes the habit."""


FOLLOWED_EXACTLY: Final = (Presentation.VECTOR, Presentation.COACH)
"""What the perfect driver follows; under any other presentation it keeps time as it can."""
