"""What a run's lateness costs when plans for a time are compared."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import NDArray

NEAR_S, NEAR_AT_PLACE_S = 0.7, 0.3
"""The distances from the wanted time (s) within which an arrival, or the passing of a place with a window, is near
enough."""
LATE_RATIO, EARLY_RATIO, EARLY_S = 3.0, 0.7, 2.0
"""The cost of a second late and the worth of a second early, as multiples of the price of time, and the most early
seconds (s) that count: the price of a run that is early is too high."""


@overload
def lateness_s(late_s: float) -> float: ...
@overload
def lateness_s(late_s: NDArray[np.float64]) -> NDArray[np.float64]: ...
def lateness_s(late_s: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The seconds at the price of time that arriving late (s; early < 0) costs."""
    return LATE_RATIO * np.maximum(late_s, 0.0) + EARLY_RATIO * np.clip(late_s, -EARLY_S, 0.0)
