"""The stops and the time windows of a journey, as the cab receives them and plans with them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self


class OrderedStop(NamedTuple):
    """A stop of a journey as ordered: its name, its position (m), and its times (ns since 1970; 0: none)."""

    name: str
    s_m: float
    arrival_ns: int = 0
    departure_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class Window:
    """The window of an event (s on the journey's clock); infinite bounds are open."""

    earliest_s: float = -math.inf
    latest_s: float = math.inf

    @classmethod
    def at(cls, time_s: float) -> Self:
        """The window that consists of one time."""
        return cls(earliest_s=time_s, latest_s=time_s)


ANY_TIME = Window()
