"""Whether a fix can be true: by itself, compared with the estimate, and after another fix.

The module also judges whether the train stands, and whether a receiver has frozen, both by the measured speeds.
Rejected fixes are collected: enough of them that agree with each other show that the estimate was wrong.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from das.domain.units import NS
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.fix import PositionFix, Quality, deviations
from das.estimate.settings import (
    Deviations,
    GateSettings,
    LocalisationSettings,
    PossibleSettings,
    StandstillSettings,
)
from das.estimate.track_filter import Track, position_variance, speed_variance

STANDSTILL_MPS: Final = 0.3
"""A train with an estimated or measured speed below this counts as standing when stops and departures are judged."""


def impossible(fix: PositionFix, settings: PossibleSettings, *, fastest_mps: float, has_state: bool) -> Problem | None:
    """Return why a fix cannot be true, whatever came before it; None if it can.

    A fix without a position is possible only where there is a state (`has_state`) that its speed carries on.
    """
    s_m, speed_mps = fix.s_m, fix.speed_mps
    if fix.quality is Quality.INVALID:
        return Problem(ProblemKind.MARKED_UNUSABLE)
    nothing = math.isnan(s_m) and (math.isnan(speed_mps) or not has_state)
    if nothing or math.isinf(s_m) or math.isinf(speed_mps):
        return Problem(ProblemKind.NOT_A_NUMBER)
    if not (math.isnan(speed_mps) or settings.backwards_mps <= speed_mps <= fastest_mps):
        return Problem(ProblemKind.SPEED_IMPOSSIBLE, speed_mps)
    if abs(s_m) > settings.largest_m:
        return Problem(ProblemKind.POSITION_IMPOSSIBLE, s_m)
    if fix.uncertainty_m > settings.largest_stated_sd_m:
        return Problem(ProblemKind.TOO_UNCERTAIN, fix.uncertainty_m)
    for stated in (fix.uncertainty_m, fix.speed_uncertainty_mps):
        if stated < 0 or stated > settings.largest_m:
            return Problem(ProblemKind.UNCERTAINTY_IMPOSSIBLE, stated)
    return None


def surprise(
    fix: PositionFix, sds: Deviations, *, expected: Track, before: Track, gate: GateSettings
) -> Problem | None:
    """Return how a fix deviates more than noise and the train explain; None if it does not.

    `expected` is the state expected at the fix and `before` the last one. A fix behind `before` deviates as well,
    because trains do not roll back. A speed or position that was not measured never deviates.
    """
    off_mps = fix.speed_mps - expected.v - expected.c
    if abs(off_mps) > max(gate.sds * math.sqrt(speed_variance(expected) + sds.speed_mps**2), gate.least_mps):
        return Problem(ProblemKind.SPEED_JUMPED, off_mps)
    off_m, back_m = fix.s_m - expected.s - expected.b, fix.s_m - before.s - before.b
    if off_m > _gate_m(expected, sds, gate):
        return Problem(ProblemKind.JUMPED, off_m)
    if off_m < -_gate_m(expected, sds, gate) or back_m < -_gate_m(before, sds, gate):
        return Problem(ProblemKind.JUMPED_BACK, -off_m)
    return None


def _gate_m(x: Track, sds: Deviations, gate: GateSettings) -> float:
    """Return how far (m) a measured position may lie off the position of a state."""
    return max(gate.sds * math.sqrt(position_variance(x) + sds.position_m**2), gate.least_m)


def follows(before: PositionFix, fix: PositionFix, settings: LocalisationSettings, fastest_mps: float) -> bool:
    """Return whether one train can have been at both fixes.

    Between them it ran at speeds between the two measured ones; where none was measured, at any speed that the train
    can have.
    """
    span_s, way_m = (fix.time_ns - before.time_ns) * NS, fix.s_m - before.s_m
    speeds = [x for x in (before.speed_mps, fix.speed_mps) if not math.isnan(x)] or [0.0, fastest_mps]
    gate, position_sd_m = settings.gate, deviations(fix, settings.sensors).position_m
    slack_m = max(gate.sds * position_sd_m, gate.least_m) + settings.motion.hard_mps2 * span_s**2
    return min(speeds) * span_s - slack_m <= way_m <= max(speeds) * span_s + slack_m


class Doubts:
    """Collects rejected fixes in a row that agree with each other; enough of them make the estimate begin anew."""

    def __init__(self, settings: LocalisationSettings, fastest_mps: float) -> None:
        self._settings, self._fastest_mps = settings, fastest_mps
        self._first: PositionFix | None = None
        self._last: PositionFix | None = None
        self._count = 0

    def outlast(self, time_ns: int) -> bool:
        """Whether there are rejected fixes, the last of them not too old at a time (ns since 1970)."""
        last = self._last
        return last is not None and (time_ns - last.time_ns) * NS <= self._settings.restart.silence_s

    def add(self, fix: PositionFix) -> bool:
        """Add a rejected fix; return whether the estimate has to begin anew with it.

        A fix that does not agree with the first and the last collected one replaces them all. A fix that is not newer
        than the last one changes nothing.
        """
        first, last = self._first, self._last
        if first is None or last is None:
            first, self._count = fix, 0
        elif fix.time_ns <= last.time_ns:
            return False
        elif not (self._follow(last, fix) and self._follow(first, fix)):
            first, self._count = fix, 0
        self._first, self._last = first, fix
        self._count += 1
        enough = self._settings.restart
        return self._count >= enough.fixes and (fix.time_ns - first.time_ns) * NS >= enough.span_s

    def clear(self) -> None:
        """Forget all rejected fixes, because a fix was accepted."""
        self._first = self._last = None
        self._count = 0

    def _follow(self, before: PositionFix, fix: PositionFix) -> bool:
        return follows(before, fix, self._settings, self._fastest_mps)


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
    """Detects a frozen receiver: by its speeds the train moves on while the position stays the same."""

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
        """Return the problem of a fix whose position stays the same although the speeds show that the train moves."""
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
