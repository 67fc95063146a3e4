"""The unit of the measured speeds: whether they are a known multiple of what the measured positions cover.

A sender of km/h in place of m/s is wrong by 3.6, one of mm/s (or of positions in km) by 1000. Neither the filter nor
its gates can tell: a speed of 40 is as possible as one of 11. Nor can the deviation that the sender states: whoever
sends another unit is as sure of it. So no speed is used before the way has confirmed it, unless the train stood.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.fix import PositionFix, Quality, deviations
from das.estimate.settings import LocalisationSettings

FACTORS: Final = (3.6, 1000.0)
"""Speeds in km/h in place of m/s; speeds in mm/s, or positions in km in place of m."""


class SpeedScale:
    """Compares the measured speeds of the last seconds with the way between the measured positions."""

    def __init__(self, settings: LocalisationSettings) -> None:
        self._settings = settings
        self._fixes: deque[PositionFix] = deque()
        self.factor = 1.0
        """The factor by which the speeds are too high; 1 unless it is a known one."""
        self._confirmed = False

    @property
    def unconfirmed(self) -> bool:
        """Whether speeds are measured, but neither the way nor a train that stood has confirmed their unit yet."""
        return bool(self._fixes) and not self._confirmed

    @property
    def problem(self) -> Problem | None:
        """The problem of every fix while the speeds are a multiple of what the positions cover; else None."""
        return Problem(ProblemKind.SPEED_UNIT, self.factor) if self.factor != 1.0 else None

    def judge(self, fix: PositionFix) -> Problem | None:
        """Return the problem of a fix whose speed, like those before it, is a multiple of what the positions cover.

        It is a problem until the speeds fit the way again. Any fix may be given, also one that is rejected elsewhere.
        """
        if fix.quality is Quality.INVALID or not math.isfinite(fix.s_m):
            return self.problem
        tuning, fixes = self._settings.scale, self._fixes
        if fixes and not 0 < (fix.time_ns - fixes[-1].time_ns) * NS <= tuning.longest_gap_s:
            if fix.time_ns == fixes[-1].time_ns:
                return self.problem
            fixes.clear()
        if not math.isfinite(fix.speed_mps):
            return self.problem
        fixes.append(fix)
        if abs(fix.speed_mps) <= self._settings.standstill.expected_slow_mps:
            self._confirmed = True  # A train that stands has the same speed in every unit.
        window_s = tuning.window_s if self._confirmed else tuning.first_window_s
        while len(fixes) > tuning.least_fixes and (fix.time_ns - fixes[1].time_ns) * NS >= window_s:
            fixes.popleft()
        if len(fixes) >= tuning.least_fixes:
            self._compare(list(fixes))
        return self.problem

    def _compare(self, fixes: list[PositionFix]) -> None:
        """Find the factor from the fixes of the last seconds; it stays where these do not tell."""
        tuning = self._settings.scale
        steps = list(itertools.pairwise(fixes))
        ways_m = [after.s_m - before.s_m for before, after in steps]
        said_m = [
            0.5 * (max(before.speed_mps, 0.0) + max(after.speed_mps, 0.0)) * (after.time_ns - before.time_ns) * NS
            for before, after in steps
        ]
        way_m, all_m = sum(ways_m), sum(said_m)
        sensors = self._settings.sensors
        position_sd_m = deviations(fixes[-1], sensors).position_m
        error_m = max(tuning.sds * math.sqrt(2.0) * position_sd_m, tuning.least_m)
        # Speeds that come late are too high while the train brakes.
        late_m = 2.0 * sensors.speed_late_s * max(fixes[0].speed_mps - fixes[-1].speed_mps, 0.0)
        if way_m <= 0 or max(way_m, all_m) <= error_m:
            return
        ratios = [said / way if way > 0 else math.inf for said, way in zip(said_m, ways_m, strict=True)]
        each = statistics.median(ratios)
        self._confirmed |= self.factor == 1.0 and way_m - all_m / FACTORS[0] > error_m
        for factor in (1.0, *FACTORS):
            told = factor == 1.0 or all_m - way_m > error_m + late_m
            if told and all(1.0 / tuning.off < ratio / factor < tuning.off for ratio in (all_m / way_m, each)):
                self.factor = factor
