"""Whether a fix can be true: by itself, after what is expected, and after another fix.

Rejected fixes are collected as well: enough of them that agree with each other show that the estimate was wrong.
"""

from __future__ import annotations

import math

from das.domain.units import NS
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.fix import PositionFix, Quality, deviations
from das.estimate.localisation_settings import Deviations, GateSettings, LocalisationSettings, PossibleSettings
from das.estimate.track_filter import Track, position_variance


def impossible(fix: PositionFix, settings: PossibleSettings, *, fastest_mps: float, has_state: bool) -> Problem | None:
    """Return why a fix cannot be true whatever was heard before; None where it can.

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
    """Return how a fix is further off than noise and the train can make it; None where it is not.

    `expected` is the state expected at the fix and `before` the last one; a fix that lies behind `before` is off as
    well, because trains do not roll back. A speed or position that was not measured is never off.
    """
    off_mps = fix.speed_mps - expected.v
    if abs(off_mps) > max(gate.sds * math.sqrt(expected.vv + sds.speed_mps**2), gate.least_mps):
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
    """Collects rejected fixes in a row that agree with each other, and says when there are enough to begin anew."""

    def __init__(self, settings: LocalisationSettings, fastest_mps: float) -> None:
        self._settings, self._fastest_mps = settings, fastest_mps
        self._first: PositionFix | None = None
        self._last: PositionFix | None = None
        self._count = 0

    def outlast(self, time_ns: int) -> bool:
        """Whether there are rejected fixes that are not yet too old at a time."""
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
