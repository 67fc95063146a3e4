"""The unit of the measured speeds: whether they are a known multiple of the speeds that follow from the positions.

A sender of km/h in place of m/s is wrong by 3.6, one of mm/s (or of positions in km) by 1000, one that converts twice
by 1/3.6. Neither the filter nor its gates can detect this: a speed of 40 is as plausible as one of 11. The stated
deviation does not help either, because it is just as small in another unit. Until the distance covered has determined
the unit, the uncertainty of a speed includes all units that are still possible, unless the train stood.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.fix import SPEED_LATE_S, PositionFix, Quality, deviations
from das.estimate.plausibility import EXPECTED_SLOW_MPS, LARGEST_M

OFF_FACTOR: Final = 1.4
"""Factor within which both the whole distance and the median step must yield the scale: a jump of the position, or a
spinning wheel, affects only one of the two."""
WINDOW_S: Final = 10.0
"""Time (s) whose fixes are compared."""
FIRST_WINDOW_S: Final = 60.0
"""Time (s) whose fixes are compared until the speeds are confirmed; a slow train needs longer."""
OTHER_UNIT_PROBABILITY: Final = 0.5
"""Probability, before anything is compared, that a sender sends another unit."""
LEAST_FIXES: Final = 4
"""Least number of fixes that are compared, at any rate."""
LONGEST_GAP_S: Final = 6.0
"""After a longer time without a fix, the comparison restarts."""
APART_SDS: Final = 4.0
"""Standard deviations of the difference of two positions by which the distances by speeds and by positions must differ
to detect another unit or to exclude all others permanently."""
APART_LEAST_M: Final = 10.0
"""Least difference (m) of the two distances, for any stated accuracy of the sensors."""
FACTORS: Final = (3.6, 1.0 / 3.6, 1000.0, 0.001)
"""Speeds in km/h for m/s, or m/s converted once too often; speeds in mm/s or positions in km, or the reverse."""
NEAREST: Final = FACTORS[:2]
"""Factors that are compared; the distance covered excludes all others much earlier."""


class SpeedScale:
    """Compares the measured speeds of the last seconds with the distance between the measured positions."""

    def __init__(self) -> None:
        self._fixes: deque[PositionFix] = deque()
        self.factor = 1.0
        """The factor by which the speeds are too high; 1 unless it is a known one."""
        self._confirmed = False
        self._unit_sd_ratio = 0.0

    def unit_sd_mps(self, speed_mps: float) -> float:
        """Return one standard deviation of a speed (m/s) from the units that neither distance nor standstill has
        excluded."""
        return 0.0 if self._confirmed or not self._fixes else self._unit_sd_ratio * speed_mps

    @property
    def problem(self) -> Problem | None:
        """The problem of every fix while the speeds are a multiple of those from the positions; else None."""
        return Problem(ProblemKind.SPEED_UNIT, self.factor) if self.factor != 1.0 else None

    def judge(self, fix: PositionFix) -> Problem | None:
        """Return the problem of a fix whose speed, like those before it, is a multiple of the one from the positions.

        It remains a problem until the speeds match the distance again. Any fix may be given, also one that is rejected
        elsewhere.
        """
        fixes = self._fixes
        if fix.quality is Quality.INVALID or not abs(fix.s_m) <= LARGEST_M:
            return self.problem
        if fixes and not 0 < (fix.time_ns - fixes[-1].time_ns) * NS <= LONGEST_GAP_S:
            if fix.time_ns == fixes[-1].time_ns:
                return self.problem
            fixes.clear()
        if not abs(fix.speed_mps) <= LARGEST_M:
            return self.problem
        fixes.append(fix)
        if abs(fix.speed_mps) <= EXPECTED_SLOW_MPS:
            self._confirmed = True  # A train that stands has the same speed in every unit.
        window_s = WINDOW_S if self._confirmed else FIRST_WINDOW_S
        while len(fixes) > LEAST_FIXES and (fix.time_ns - fixes[1].time_ns) * NS >= window_s:
            fixes.popleft()
        self._compare(list(fixes))
        return self.problem

    def _compare(self, fixes: list[PositionFix]) -> None:
        """Find the factor from the fixes of the last seconds; it is unchanged if they are inconclusive."""
        steps = list(itertools.pairwise(fixes))
        ways_m = [after.s_m - before.s_m for before, after in steps]
        said_m = [
            0.5 * (max(before.speed_mps, 0.0) + max(after.speed_mps, 0.0)) * (after.time_ns - before.time_ns) * NS
            for before, after in steps
        ]
        way_m, all_m = sum(ways_m), sum(said_m)
        error_m = max(APART_SDS * math.sqrt(2.0) * deviations(fixes[-1]).position_m, APART_LEAST_M)
        self._weigh(way_m, all_m, error_m / APART_SDS)
        if len(fixes) < LEAST_FIXES or way_m <= 0 or max(way_m, all_m) <= error_m:
            return
        ratios = [said / way if way > 0 else math.inf for said, way in zip(said_m, ways_m, strict=True)]
        each = statistics.median(ratios)
        # Delayed speeds are too high while the train brakes, too low while it accelerates.
        late_m = 2.0 * SPEED_LATE_S * (fixes[0].speed_mps - fixes[-1].speed_mps)
        for factor in (1.0, *FACTORS):
            sign = math.copysign(1.0, factor - 1.0)
            told = factor == 1.0 or sign * (all_m - way_m) > error_m + max(sign * late_m, 0.0)
            if told and all(1.0 / OFF_FACTOR < ratio / factor < OFF_FACTOR for ratio in (all_m / way_m, each)):
                self.factor = factor

    def _weigh(self, way_m: float, said_m: float, sd_m: float) -> None:
        """Weigh the nearest other units by how well each explains the distance (Bayes), whose deviation is `sd_m`."""
        least = 0.5 * ((way_m - said_m) / sd_m) ** 2
        against = [0.5 * ((way_m - said_m / factor) / sd_m) ** 2 - least for factor in NEAREST]
        self._confirmed |= self.factor == 1.0 and min(against) > 0.5 * APART_SDS**2
        other = OTHER_UNIT_PROBABILITY / len(NEAREST)
        odds = [other * math.exp(min(-one, 700.0)) for one in against]
        squares = sum(odd * (1.0 - 1.0 / factor) ** 2 for odd, factor in zip(odds, NEAREST, strict=True))
        self._unit_sd_ratio = math.sqrt(squares / (1.0 - OTHER_UNIT_PROBABILITY + sum(odds)))
