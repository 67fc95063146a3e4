"""Rejected fixes that agree with each other: enough of them show that the estimate was wrong."""

from __future__ import annotations

from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation_settings import LocalisationSettings
from das.estimate.plausibility import follows


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
