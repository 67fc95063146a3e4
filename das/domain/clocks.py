"""The clocks of the machine: the defaults for code that takes a clock as an argument."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

MONOTONIC_S = time.monotonic
"""Seconds since an arbitrary start, without jumps: for periodic work."""
WALL_STOPWATCH = time.perf_counter
"""Seconds since an arbitrary start at the finest resolution: for measuring durations."""


@dataclass(frozen=True, kw_only=True)
class Clocks:
    """The two clocks of a process: the time of day, and seconds for periodic work."""

    now_ns: Callable[[], int] = time.time_ns
    """The time of day (ns since 1970); it jumps when the clock is set."""
    seconds: Callable[[], float] = MONOTONIC_S
    """Seconds without jumps."""


WALL = Clocks()
"""Real time."""
