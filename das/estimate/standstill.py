"""Whether the train stands, judged by the speeds that are measured."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation_settings import StandstillSettings

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
