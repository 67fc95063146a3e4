"""Plausibility of a fix: by itself, against the estimate, and after other fixes; and whether the train stands.

Rejected fixes that agree with each other show that the estimate was wrong, not the fixes.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.estimate import SPEED_LATE_S, Deviations, PositionFix, Problem, ProblemKind, Quality, deviations
from das.estimate.track_filter import HARD_MPS2, Track, position_variance, speed_variance

BACKWARDS_MPS: Final = -0.3
"""Speed (m/s) below which the sensor has a fault; a negative speed above it is noise of a standing train."""
LARGEST_M: Final = 1e7
"""Largest position or stated uncertainty (m); no line is 10 000 km long, so a larger value is a sensor fault."""
LARGEST_STATED_SD_M: Final = 200.0
"""Largest stated standard deviation (m) of a usable fix: a less certain fix could be anywhere and hide any jump."""
GATE_SDS: Final = 5.0
"""Standard deviations above which a fix is rejected: noise exceeds them less than once in a million fixes."""
GATE_LEAST_M: Final = 10.0
"""Deviation (m) up to which a position is never rejected, however exact the sensors claim to be."""
GATE_LEAST_MPS: Final = 1.0
"""Deviation (m/s) up to which a speed is never rejected, however exact the sensors claim to be."""
SLOW_MPS: Final = 0.1
"""Measured speed (m/s) up to which a train may be standing, however exact the odometer claims to be."""
SLOW_SDS: Final = 2.5
"""Standard deviations up to which a train with a measured speed may be standing."""
EXPECTED_SLOW_MPS: Final = 0.5
"""Estimated speed (m/s) above which a train does not count as standing, whatever speed was measured last."""
STANDS_AFTER_S: Final = 2.0
"""Time (s) after which a train that may be standing counts as standing; a single slow fix may be noise."""
SETS_OFF_SDS: Final = 3.3
"""Standard deviations above which one speed ends a standstill: noise alone is that large once in 2 000 fixes."""
CREEP_FIXES: Final = 5
"""Number of speeds whose mean also ends a standstill, although each alone may be noise."""
FROZEN_WAY_M: Final = 2.0
"""Distance (m) from the measured speeds beyond which a position that stays the same is frozen."""
COARSE_SDS: Final = 4.0
"""Multiple of the position's standard deviation that the distance from the speeds must also exceed if the speeds still
change: a coarse receiver repeats its position for a while."""
SILENCE_S: Final = 30.0
"""Time (s) without an accepted fix after which the estimate is dropped; the next fix begins a new one."""
AGREEING_FIXES: Final = 4
"""Rejected fixes in a row that, if they agree with each other, show that the estimate was wrong, not the fixes."""
AGREEING_SPAN_S: Final = 2.0
"""Least time (s) spanned by rejected fixes that agree; at 20 Hz four of them arrive within 0.2 s."""
STANDSTILL_MPS: Final = 0.3
"""Estimated or measured speed (m/s) below which a train counts as standing when stops and departures are judged."""


def impossible(fix: PositionFix, *, fastest_mps: float, has_state: bool) -> Problem | None:
    """Why a fix cannot be true, whatever came before it; None if it can.

    A fix without a position is possible only if there is a state (`has_state`) for its speed to continue.
    """
    s_m, speed_mps = fix.s_m, fix.speed_mps
    if fix.quality is Quality.INVALID:
        return Problem(ProblemKind.MARKED_UNUSABLE)
    nothing = math.isnan(s_m) and (math.isnan(speed_mps) or not has_state)
    if nothing or math.isinf(s_m) or math.isinf(speed_mps):
        return Problem(ProblemKind.NOT_A_NUMBER)
    if not (math.isnan(speed_mps) or BACKWARDS_MPS <= speed_mps <= fastest_mps):
        return Problem(ProblemKind.SPEED_IMPOSSIBLE, speed_mps)
    if abs(s_m) > LARGEST_M:
        return Problem(ProblemKind.POSITION_IMPOSSIBLE, s_m)
    if fix.uncertainty_m > LARGEST_STATED_SD_M:
        return Problem(ProblemKind.TOO_UNCERTAIN, fix.uncertainty_m)
    for stated in (fix.uncertainty_m, fix.speed_uncertainty_mps):
        if stated < 0 or stated > LARGEST_M:
            return Problem(ProblemKind.UNCERTAINTY_IMPOSSIBLE, stated)
    return None


def surprise(fix: PositionFix, *, expected: Track, before: Track) -> Problem | None:
    """The problem of a fix that deviates more than noise and the train's motion explain; None if it does not.

    `expected` is the state expected at the fix and `before` the last one. A fix behind `before` deviates as well,
    because trains do not roll back. A speed or position that was not measured never deviates.
    """
    sds = deviations(fix)
    off_mps = fix.speed_mps - expected.v - expected.c
    if abs(off_mps) > max(GATE_SDS * math.sqrt(speed_variance(expected) + sds.speed_mps**2), GATE_LEAST_MPS):
        return Problem(ProblemKind.SPEED_JUMPED, off_mps)
    off_m, back_m = fix.s_m - expected.s - expected.b, fix.s_m - before.s - before.b
    if off_m > _gate_m(expected, sds):
        return Problem(ProblemKind.JUMPED, off_m)
    if off_m < -_gate_m(expected, sds) or back_m < -_gate_m(before, sds):
        return Problem(ProblemKind.JUMPED_BACK, -off_m)
    return None


def _gate_m(x: Track, sds: Deviations) -> float:
    """The largest distance (m) of a measured position from the position of a state."""
    return max(GATE_SDS * math.sqrt(position_variance(x) + sds.position_m**2), GATE_LEAST_M)


def follows(before: PositionFix, fix: PositionFix, fastest_mps: float) -> bool:
    """Whether one train can have been at both fixes.

    The train's speeds in between lie between the two measured ones; without a measured speed, any possible one counts.
    """
    span_s, way_m = (fix.time_ns - before.time_ns) * NS, fix.s_m - before.s_m
    speeds = [x for x in (before.speed_mps, fix.speed_mps) if not math.isnan(x)] or [0.0, fastest_mps]
    slack_m = max(GATE_SDS * deviations(fix).position_m, GATE_LEAST_M) + HARD_MPS2 * span_s**2
    return min(speeds) * span_s - slack_m <= way_m <= max(speeds) * span_s + slack_m


class Doubts:
    """Collects rejected fixes in a row that agree with each other; enough of them make the estimate restart."""

    def __init__(self, fastest_mps: float) -> None:
        self._fastest_mps = fastest_mps
        self._fixes: list[PositionFix] = []

    def outlast(self, time_ns: int) -> bool:
        """Whether there are rejected fixes, the last of them not too old at a time (ns since 1970)."""
        return bool(self._fixes) and (time_ns - self._fixes[-1].time_ns) * NS <= SILENCE_S

    def add(self, fix: PositionFix) -> bool:
        """Add a rejected fix; return whether the estimate has to restart with it.

        A fix that disagrees with the first or the last one replaces them all; a fix not newer than the last is ignored.
        """
        fixes = self._fixes
        if fixes and fix.time_ns <= fixes[-1].time_ns:
            return False
        if not all(follows(before, fix, self._fastest_mps) for before in (*fixes[-1:], *fixes[:1])):
            fixes.clear()
        fixes.append(fix)
        return len(fixes) >= AGREEING_FIXES and (fix.time_ns - fixes[0].time_ns) * NS >= AGREEING_SPAN_S

    def clear(self) -> None:
        """Forget all rejected fixes, because a fix was accepted."""
        self._fixes.clear()


def slow_mps(speed_sd_mps: float) -> float:
    """The largest measured speed (m/s) that may be noise on a standing train."""
    return max(SLOW_MPS, SLOW_SDS * speed_sd_mps)


class Standstill:
    """Judges whether a train stands.

    A train stands after its speeds were near 0 for a while. It has set off when one speed is clearly higher, or when
    the mean of several is somewhat higher. While no speed is measured, no train counts as standing.
    """

    def __init__(self) -> None:
        self.stands = False
        """Whether the train stands."""
        self._speeds_mps: deque[float] = deque(maxlen=CREEP_FIXES)
        self._slow = False
        self._since_ns: int | None = None

    def notice(self, fix: PositionFix, expected_mps: float) -> None:
        """Judge again with the next fix, for which the estimate expects a speed (m/s)."""
        speed_sd_mps = deviations(fix).speed_mps
        was_slow, self._slow = self._slow, fix.speed_mps <= slow_mps(speed_sd_mps)
        self._speeds_mps.append(fix.speed_mps)
        if self.stands:
            doubtful = fix.speed_mps <= max(SLOW_MPS, SETS_OFF_SDS * speed_sd_mps)
            self.stands = (self._slow or (was_slow and doubtful)) and not self._creeps(speed_sd_mps)
            self._since_ns = self._since_ns if self.stands else None
        elif not self._slow or expected_mps > EXPECTED_SLOW_MPS:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = fix.time_ns
        else:
            self.stands = (fix.time_ns - self._since_ns) * NS >= STANDS_AFTER_S

    def _creeps(self, speed_sd_mps: float) -> bool:
        """Whether the mean of the last speeds is too high for a standing train."""
        mean_mps = sum(self._speeds_mps) / CREEP_FIXES
        return mean_mps > max(SLOW_MPS, SETS_OFF_SDS * speed_sd_mps / math.sqrt(CREEP_FIXES))


class FrozenReceiver:
    """Detects a frozen receiver: its position stays the same although the measured speeds show that the train moves."""

    def __init__(self) -> None:
        self.first: PositionFix | None = None
        """The first of the accepted fixes in a row that repeat each other; None before any fix was accepted."""
        self._repeated_ns = 0
        self._way_m = 0.0

    def judge(self, fix: PositionFix) -> Problem | None:
        """The problem of a fix whose position stays the same although the speeds show that the train moves."""
        first, silent_s = self.first, (fix.time_ns - self._repeated_ns) * NS
        if first is None or fix.s_m != first.s_m or silent_s > SILENCE_S:
            self._way_m = 0.0
            return None
        self._repeated_ns = fix.time_ns
        position_sd_m, speed_sd_mps = deviations(fix)
        moves = fix.speed_mps > slow_mps(speed_sd_mps)
        self._way_m = self._way_m + fix.speed_mps * silent_s if moves else 0.0
        most_m = FROZEN_WAY_M if fix.repeats(first) else max(FROZEN_WAY_M, COARSE_SDS * position_sd_m)
        return Problem(ProblemKind.FROZEN, fix.s_m) if self._way_m > most_m else None

    def accept(self, fix: PositionFix, *, begins: bool) -> None:
        """Take note of a fix that was accepted. `begins`: the estimate restarts with it."""
        if begins or self.first is None or not fix.repeats(self.first):
            self.first = fix
        self._repeated_ns = fix.time_ns


OFF_FACTOR: Final = 1.4
"""Largest ratio of a candidate factor to the scale by the whole distance, and to the scale by the median step. A
jump of the position or a spinning wheel distorts only one of the two."""
WINDOW_S: Final = 10.0
"""Length (s) of the window of fixes compared."""
FIRST_WINDOW_S: Final = 60.0
"""Length (s) of the window until the speeds are confirmed; a slow train needs a longer one."""
OTHER_UNIT_PROBABILITY: Final = 0.5
"""Prior probability that a sender uses another unit."""
LEAST_FIXES: Final = 4
"""Number of fixes that are kept even if they are older than the window; fewer do not suffice to find a factor."""
LONGEST_GAP_S: Final = 6.0
"""Longest gap (s) between two fixes that the comparison bridges; a longer one restarts it."""
APART_SDS: Final = 4.0
"""Required difference between the distance from the speeds and that from the positions, in standard deviations of the
difference of two positions, to detect another unit or to rule out all others permanently."""
APART_LEAST_M: Final = 10.0
"""Least difference (m) of the distances from speeds and from positions, for any stated accuracy of the sensors."""
FACTORS: Final = (3.6, 1.0 / 3.6, 1000.0, 0.001)
"""Factors of unit errors: km/h sent as m/s, m/s divided by 3.6; speeds in mm/s (positions in km), or the reverse."""
NEAREST: Final = FACTORS[:2]
"""Factors weighed against each other; the distance covered rules out the other factors much earlier."""


class SpeedScale:
    """Compares the measured speeds of the last seconds with the distance between the measured positions."""

    def __init__(self) -> None:
        self._fixes: deque[PositionFix] = deque()
        self.factor = 1.0
        """The factor by which the speeds are too high: one of `FACTORS`, or 1."""
        self._confirmed = False
        self._unit_sd_ratio = 0.0

    def unit_sd_mps(self, speed_mps: float) -> float:
        """One standard deviation of a speed (m/s) due to the units that are not ruled out yet."""
        return 0.0 if self._confirmed or not self._fixes else self._unit_sd_ratio * speed_mps

    @property
    def problem(self) -> Problem | None:
        """The problem of every fix while the speeds have another unit than those from the positions; else None."""
        return Problem(ProblemKind.SPEED_UNIT, self.factor) if self.factor != 1.0 else None

    def judge(self, fix: PositionFix) -> Problem | None:
        """The problem of a fix whose speed, like those before it, has another unit than that from the positions.

        The problem remains until the speeds match the distance again. Any fix may be passed, even a rejected one.
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
        way_m, all_m = 0.0, 0.0
        ratios: list[float] = []
        for before, after in itertools.pairwise(fixes):
            way, mean_mps = after.s_m - before.s_m, 0.5 * (max(before.speed_mps, 0.0) + max(after.speed_mps, 0.0))
            said = mean_mps * (after.time_ns - before.time_ns) * NS
            way_m, all_m = way_m + way, all_m + said
            ratios.append(said / way if way > 0 else math.inf)
        error_m = max(APART_SDS * math.sqrt(2.0) * deviations(fixes[-1]).position_m, APART_LEAST_M)
        self._weigh(way_m, all_m, error_m / APART_SDS)
        if len(fixes) < LEAST_FIXES or way_m <= 0 or max(way_m, all_m) <= error_m:
            return
        each = statistics.median(ratios)
        # Delayed speeds are too high while the train brakes, too low while it accelerates.
        late_m = 2.0 * SPEED_LATE_S * (fixes[0].speed_mps - fixes[-1].speed_mps)
        for factor in (1.0, *FACTORS):
            sign = math.copysign(1.0, factor - 1.0)
            told = factor == 1.0 or sign * (all_m - way_m) > error_m + max(sign * late_m, 0.0)
            if told and all(1.0 / OFF_FACTOR < ratio / factor < OFF_FACTOR for ratio in (all_m / way_m, each)):
                self.factor = factor

    def _weigh(self, way_m: float, said_m: float, sd_m: float) -> None:
        """Weigh the nearest other units by how well each explains the distance (Bayes); its deviation is `sd_m`."""
        least = 0.5 * ((way_m - said_m) / sd_m) ** 2
        nearest, odds, squares = math.inf, 0.0, 0.0
        for factor in NEAREST:
            against = 0.5 * ((way_m - said_m / factor) / sd_m) ** 2 - least
            odd = OTHER_UNIT_PROBABILITY / len(NEAREST) * math.exp(min(-against, 700.0))
            nearest, odds, squares = min(nearest, against), odds + odd, squares + odd * (1.0 - 1.0 / factor) ** 2
        self._confirmed |= self.factor == 1.0 and nearest > 0.5 * APART_SDS**2
        self._unit_sd_ratio = math.sqrt(squares / (1.0 - OTHER_UNIT_PROBABILITY + odds))
