"""The clocks of this machine. Code that needs the time takes a clock as an argument; these are the defaults."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

WALL_NS = time.time_ns
"""The time of day (ns since 1970); it jumps when somebody sets the clock."""
MONOTONIC_S = time.monotonic
"""Seconds since some moment in the past, which never jump: for periodic work."""
WALL_STOPWATCH = time.perf_counter
"""Seconds since some moment in the past, in the finest resolution: for measuring how long something took."""


@dataclass(frozen=True, kw_only=True)
class Clocks:
    """The two clocks of a process: the time of day, and seconds for periodic work."""

    now_ns: Callable[[], int] = WALL_NS
    """The time of day (ns since 1970)."""
    seconds: Callable[[], float] = MONOTONIC_S
    """Seconds that never jump."""


WALL = Clocks()
"""Real time."""
