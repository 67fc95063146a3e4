"""The clock of the sensors: by how much it and the clock here differ, and whether it was set between two fixes."""

from __future__ import annotations

import math
import statistics
from collections import deque

from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation_settings import ClockSettings, ClockStepSettings
from das.estimate.track_filter import Track


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


class ClockSteps:
    """Notices a step of the sensors' clock: the time stamps come irregularly, but the train ran as if they had not.

    A receiver sends its fixes at a steady rate. Where a time stamp does not fit that rate, either a fix was lost, or
    the clock was set. The way that the train has made since the last fix tells which of the two is nearer to the truth.
    """

    def __init__(self, settings: ClockStepSettings) -> None:
        self._settings = settings
        self._spans_s: deque[float] = deque(maxlen=settings.rate_fixes)
        self._stamp_ns: int | None = None

    def take(self, fix: PositionFix, x: Track, span_s: float) -> float:
        """Return by how much the clock was set since the fix before (s; 0: it was not).

        The state `x` is that of the last accepted fix, and this one is stamped `span_s` after it.
        """
        since_s = (fix.time_ns - self._stamp_ns) * NS if self._stamp_ns is not None else 0.0
        step_s = self._step_s(since_s, fix, x, span_s)
        if step_s or since_s > 0 or self._stamp_ns is None:
            self._stamp_ns = fix.time_ns
        if since_s > 0 and not step_s:
            self._spans_s.append(since_s)
        return step_s

    @property
    def _usual_s(self) -> float | None:
        """The time between two time stamps at the receiver's steady rate; None where it has none."""
        if len(self._spans_s) < self._settings.rate_fixes:
            return None
        usual_s = statistics.median(self._spans_s)
        least_s = self._settings.least_s
        odd = sum(abs(span_s - max(round(span_s / usual_s), 1) * usual_s) > least_s for span_s in self._spans_s)
        return usual_s if odd <= self._settings.odd_fixes else None

    def _step_s(self, since_s: float, fix: PositionFix, x: Track, span_s: float) -> float:
        """The step of the clock (s) since the last time stamp, which is `since_s` before this one; 0: there was none.

        Where the time stamp is irregular, as many fixes may have been lost as the way tells. A step is believed where
        the position is near to where the step puts it, and not to where none would. In the noise none is looked for.
        """
        usual_s, settings = self._usual_s, self._settings
        if usual_s is None or abs(since_s - usual_s) <= settings.least_s:
            return 0.0
        off_m = fix.s_m - x.s - x.b - (x.v + 0.5 * x.a * span_s) * span_s
        steps_s = (since_s - count * usual_s for count in range(1, settings.lost_fixes + 2))
        step_s = min(steps_s, key=lambda step_s: abs(off_m + x.v * step_s))
        way_m = x.v * abs(step_s)
        can_be = abs(step_s) <= settings.largest_s and way_m > math.sqrt(x.bb)
        return step_s if can_be and abs(off_m + x.v * step_s) < 0.5 * way_m else 0.0
