"""The clocks of this machine. Whatever needs the time is given a clock; these are the ones it is given by default."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

WALL_NS = time.time_ns
"""The time of day (ns since 1970); it jumps where somebody sets it."""
MONOTONIC_S = time.monotonic
"""Seconds since a moment in the past; they never jump. For what is due every while."""
WALL_STOPWATCH = time.perf_counter
"""Seconds since a moment in the past, as finely as they can be had. For how long something took."""


@dataclass(frozen=True, kw_only=True)
class Clocks:
    """The two clocks of something that tells the time and does things every while."""

    now_ns: Callable[[], int] = WALL_NS
    """The time of day (ns since 1970)."""
    seconds: Callable[[], float] = MONOTONIC_S
    """Seconds that never jump."""


WALL = Clocks()
"""Real time."""
