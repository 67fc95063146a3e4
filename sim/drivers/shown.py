"""What of an advice a driver reads off the display: the mode, a speed in whole km/h, a step of the controller."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from das.advice.modes import Mode
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, Presentation

EFFORT_STEP_RATIO: Final = 0.2
"""Effort is read in steps of this share of the controller: nobody reads it, or sets it, more closely."""


class Shown(NamedTuple):
    """What is read off a display; None for what it does not show. `effort` is a number of steps, braking < 0."""

    mode: Mode | None = None
    speed_kmh: int | None = None
    effort: int | None = None
    deviation_s: int | None = None

    @classmethod
    def of(cls, view: AdviceView) -> Shown:
        """What is read off an advice as it is presented; a speed that has no form of its own is rounded to km/h."""
        speed_mps = view.speed_mps if math.isnan(view.display_speed_mps) else view.display_speed_mps
        speed_kmh = _whole(speed_mps / KMH)
        match view.presentation:
            case Presentation.DEVIATION:
                return cls(deviation_s=_whole(view.deviation_s))
            case Presentation.RMS:
                return cls(speed_kmh=speed_kmh)
            case Presentation.FOUR_MODE:
                mode = Mode(view.mode)
                return cls(mode=mode, speed_kmh=speed_kmh if mode is Mode.CRUISE else None)
            case _:
                return cls(
                    mode=Mode(view.mode), speed_kmh=speed_kmh, effort=_whole(view.lever_ratio / EFFORT_STEP_RATIO)
                )


def _whole(value: float) -> int | None:
    return None if math.isnan(value) else round(value)
