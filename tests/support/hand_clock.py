"""A clock that a test sets."""

from __future__ import annotations

from das.domain.clocks import Clocks
from das.domain.units import NS


class HandClock:
    """The time that a test sets (ns since 1970), in place of the wall's; its seconds go with it."""

    def __init__(self, time_ns: int) -> None:
        self.time_ns = time_ns

    def __call__(self) -> int:
        return self.time_ns

    def seconds(self) -> float:
        return self.time_ns * NS

    @property
    def clocks(self) -> Clocks:
        """Both clocks of a recorder."""
        return Clocks(now_ns=self, seconds=self.seconds)
