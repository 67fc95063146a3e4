"""By how much the time stamps of positions and the clock here differ, estimated from when the positions are heard."""

from __future__ import annotations

import statistics
from collections import deque

from das.domain.units import NS
from das.estimate.localisation_settings import ClockSettings


class ClockDifference:
    """Collects how long after its time stamp each position was heard; their median is the difference.

    A clock that is behind ours and messages that take long look alike, so that the difference is all that is known: the
    train may be anywhere on the way that it covers in that time. The median leaves out single messages that were held
    up. A simulation's clock stands still between ticks; what is heard in between, or
    before the first tick, was heard at the next one.
    """

    def __init__(self, settings: ClockSettings) -> None:
        self._settings = settings
        self._ticked_ns = 0
        self._waiting: list[int] = []
        self._heard: deque[tuple[int, float]] = deque(maxlen=settings.most_fixes)
        self.seconds = 0.0
        """The clock here less the time stamps (s): > 0 where the positions are late, or their clock is behind."""
        self._newest_s = 0.0

    @property
    def doubt_s(self) -> float:
        """By how much the age of the newest position may be wrong (s).

        That is the difference, or that of the newest position alone: after a step of a clock it is the first to know.
        """
        return max(abs(self.seconds), abs(self._newest_s))

    def set(self, step_s: float) -> None:
        """Take note that the clock here was set by a time (s): until the next position, it is in doubt by that."""
        self._waiting.clear()
        self._heard.clear()
        self._newest_s = step_s

    def hear(self, stamp_ns: int, heard_ns: int) -> None:
        """Take note of a position with a time stamp, heard at a time of our clock (0: not known; ns since 1970)."""
        if heard_ns > self._ticked_ns > 0:
            self._note(stamp_ns, heard_ns)
        elif len(self._waiting) < self._settings.most_fixes:
            self._waiting.append(stamp_ns)

    def tick(self, now_ns: int) -> None:
        """Take note of the time (ns since 1970)."""
        for stamp_ns in self._waiting:
            self._note(stamp_ns, now_ns)
        self._waiting.clear()
        self._ticked_ns = now_ns
        known_s = [late_s for at_ns, late_s in self._heard if abs(now_ns - at_ns) * NS <= self._settings.memory_s]
        if known_s:
            self.seconds = statistics.median(known_s)

    def _note(self, stamp_ns: int, heard_ns: int) -> None:
        late_s = (heard_ns - stamp_ns) * NS
        if abs(late_s) <= self._settings.largest_s:
            self._heard.append((heard_ns, late_s))
            self._newest_s = late_s
