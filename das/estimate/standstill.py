"""Whether the train stands, and whether a receiver that repeats its position has frozen: both judged by the speeds."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.fix import PositionFix, deviations
from das.estimate.localisation_settings import LocalisationSettings, StandstillSettings

STANDSTILL_MPS: Final = 0.3
"""A train with an estimated or measured speed below this counts as standing when stops and departures are judged."""


def slow_mps(speed_sd_mps: float, settings: StandstillSettings) -> float:
    """Return the largest measured speed (m/s) that may be noise on a standing train."""
    return max(settings.slow_mps, settings.slow_sds * speed_sd_mps)


class Standstill:
    """Judges whether a train stands.

    A train stands after its speeds were near 0 for a while. It has set off when one speed is clearly higher, or when
    several are somewhat higher. While no speed is measured, no train counts as standing.
    """

    def __init__(self, settings: StandstillSettings) -> None:
        self.stands = False
        """Whether the train stands."""
        self._settings = settings
        self._speeds_mps: deque[float] = deque(maxlen=settings.creep_fixes)
        self._slow = False
        self._since_ns: int | None = None

    def notice(self, fix: PositionFix, speed_sd_mps: float, expected_mps: float) -> None:
        """Judge anew with the next fix, for which the estimate expects a speed (m/s)."""
        tuning = self._settings
        was_slow, self._slow = self._slow, fix.speed_mps <= slow_mps(speed_sd_mps, tuning)
        self._speeds_mps.append(fix.speed_mps)
        if self.stands:
            doubtful = fix.speed_mps <= max(tuning.slow_mps, tuning.sets_off_sds * speed_sd_mps)
            self.stands = (self._slow or (was_slow and doubtful)) and not self._creeps(speed_sd_mps)
            self._since_ns = self._since_ns if self.stands else None
        elif not self._slow or expected_mps > tuning.expected_slow_mps:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = fix.time_ns
        else:
            self.stands = (fix.time_ns - self._since_ns) * NS >= tuning.stands_after_s

    def _creeps(self, speed_sd_mps: float) -> bool:
        """Whether the mean of the last speeds is too high for a standing train."""
        tuning = self._settings
        mean_mps = sum(self._speeds_mps) / tuning.creep_fixes
        return mean_mps > max(tuning.slow_mps, tuning.sets_off_sds * speed_sd_mps / math.sqrt(tuning.creep_fixes))


class FrozenReceiver:
    """Notices a receiver that has frozen, by the way that the speeds make while the position stays the same."""

    def __init__(self, settings: LocalisationSettings) -> None:
        self._settings = settings
        self._first: PositionFix | None = None
        self._repeated_ns = 0
        self._way_m = 0.0

    @property
    def first(self) -> PositionFix | None:
        """The first of the accepted fixes in a row that repeat each other; None before any fix was accepted."""
        return self._first

    def judge(self, fix: PositionFix) -> Problem | None:
        """Return the problem of a fix whose position stays the same although its speeds say that it must not."""
        first, silent_s = self._first, (fix.time_ns - self._repeated_ns) * NS
        if first is None or fix.s_m != first.s_m or silent_s > self._settings.restart.silence_s:
            self._way_m = 0.0
            return None
        self._repeated_ns = fix.time_ns
        position_sd_m, speed_sd_mps = deviations(fix, self._settings.sensors)
        moves = fix.speed_mps > slow_mps(speed_sd_mps, self._settings.standstill)
        self._way_m = self._way_m + fix.speed_mps * silent_s if moves else 0.0
        tuning = self._settings.frozen
        most_m = tuning.way_m if fix.repeats(first) else max(tuning.way_m, tuning.coarse_sds * position_sd_m)
        return Problem(ProblemKind.FROZEN, fix.s_m) if self._way_m > most_m else None

    def accept(self, fix: PositionFix, *, begins: bool) -> None:
        """Take note of a fix that was accepted. `begins` says that the estimate begins anew with it."""
        if begins or self._first is None or not fix.repeats(self._first):
            self._first = fix
        self._repeated_ns = fix.time_ns
