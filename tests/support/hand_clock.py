"""A clock that the test sets by hand."""

from __future__ import annotations

from das.domain.clocks import Clocks
from das.domain.units import NS


class HandClock:
    """A clock that shows the time set by the test (ns since 1970) instead of the system time."""

    def __init__(self, time_ns: int) -> None:
        self.time_ns = time_ns

    def __call__(self) -> int:
        return self.time_ns

    def seconds(self) -> float:
        return self.time_ns * NS

    @property
    def clocks(self) -> Clocks:
        """The two clocks that a recorder needs, both set by this one."""
        return Clocks(now_ns=self, seconds=self.seconds)
