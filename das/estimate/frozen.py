"""Whether a receiver has frozen: it repeats its last position although the train moves."""

from __future__ import annotations

from das.domain.units import NS
from das.estimate.fix import PositionFix, deviations
from das.estimate.localisation_settings import LocalisationSettings
from das.estimate.problems import Problem, ProblemKind
from das.estimate.standstill import slow_mps


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
