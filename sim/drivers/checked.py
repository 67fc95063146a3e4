"""What a driver from outside may answer: a command whose numbers a train can understand."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any, Final

from das.domain.errors import DasError
from sim.plant.kernels import FORCE, LEVER, NO_LIMIT_N, SPEED, Command

MOST_SPEED_MPS: Final = 200.0
MOST_RATE_MPS2: Final = 10.0
MOST_GAIN_PER_S: Final = 100.0

_VALUES: Final = {
    FORCE: ("the wheel force", -NO_LIMIT_N, NO_LIMIT_N, "N"),
    LEVER: ("the lever's ratio", -1.0, 1.0, ""),
    SPEED: ("the speed to hold", 0.0, MOST_SPEED_MPS, "m/s"),
}
"""By the law of a command: what its value is, and the range of it."""


def checked(answer: Any, who: str, time_s: float) -> Command:
    """The answer of a driver at a moment (s on the cab's clock), its numbers as plain floats.

    Raises DasError for anything but a Command, and for numbers that are NaN or out of range; `who` begins the message.
    """
    where = f"{who}: at {time_s:.1f} s it answered"
    if not isinstance(answer, Command):
        raise DasError(
            f"{where} {_short(answer)}: expected a Command, made by lever, force or speed of sim.plant.plant"
        )
    if answer.law not in _VALUES:
        raise DasError(f"{where} a Command of law {_short(answer.law)}: expected one made by lever, force or speed")
    name, low, high, unit = _VALUES[answer.law]
    return Command(
        answer.law,
        _within(answer.value, where, name, (low, high, unit)),
        _within(answer.rate_mps2, where, "rate_mps2", (-MOST_RATE_MPS2, MOST_RATE_MPS2, "m/s²")),
        _within(answer.force_n, where, "force_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.gain_per_s, where, "gain_per_s", (0.0, MOST_GAIN_PER_S, "1/s")),
        _within(answer.low_n, where, "low_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.high_n, where, "high_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.friction_ratio, where, "friction_ratio", (0.0, 1.0, "")),
    )


def _within(value: Any, where: str, name: str, limits: tuple[float, float, str]) -> float:
    low, high, unit = limits
    known = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not known or not low <= value <= high:
        raise DasError(f"{where} {name} = {_short(value)}: expected {low:g} to {high:g}{f' {unit}' if unit else ''}")
    return float(value)


def _short(value: Any) -> str:
    """A value as Python writes it, in a few letters; a user's own type may fail at that."""
    try:
        text = repr(value)
    except Exception:
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}…"
