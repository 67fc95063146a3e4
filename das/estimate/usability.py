"""Whether a state may be used for advice: whether it is recent, regular and certain enough."""

from __future__ import annotations

import math

from das.estimate.localisation_settings import UseSettings
from das.estimate.problems import Problem, ProblemKind
from das.estimate.track_filter import Track


class Usability:
    """Judges whether a state is usable, with memory: advice must not come and go with every fix."""

    def __init__(self, settings: UseSettings) -> None:
        self._settings = settings
        self._intervals_s = (0.0, 0.0)
        self._stale, self._vague = False, False

    def accept(self, interval_s: float) -> None:
        """Take note of an accepted fix, a time after the one before (s)."""
        self._intervals_s = (self._intervals_s[1], interval_s)

    def is_ahead(self, age_s: float) -> bool:
        """Whether a state of this age is further ahead of the clock than clocks differ."""
        return age_s < -self._settings.stale_after_s

    def judge(self, x: Track, age_s: float, rejection: Problem | None) -> Problem | None:
        """Return why a state cannot be used, or None.

        `age_s` is the age of its last fix, and `rejection` says why fixes that are newer were rejected. A state that
        was stale is used again when fixes come often enough; one that was too uncertain, when it is well below the
        limits.
        """
        tuning = self._settings
        rare = self._stale and min(self._intervals_s) > tuning.stale_after_s
        self._stale = age_s > tuning.stale_after_s or rare
        ratio = tuning.recovered_ratio if self._vague else 1.0
        position_sd_m, speed_sd_mps = math.sqrt(x.ss), math.sqrt(x.vv)
        place_vague = position_sd_m > ratio * tuning.largest_position_sd_m
        speed_vague = speed_sd_mps > ratio * tuning.largest_speed_sd_mps
        self._vague = place_vague or speed_vague
        if self.is_ahead(age_s):
            return Problem(ProblemKind.AHEAD_OF_CLOCK, -age_s)
        if self._stale:
            return rejection or self._too_old(age_s)
        if place_vague:
            return Problem(ProblemKind.POSITION_UNCERTAIN, position_sd_m)
        return Problem(ProblemKind.SPEED_UNCERTAIN, speed_sd_mps) if speed_vague else None

    def _too_old(self, age_s: float) -> Problem:
        """Return the problem of a stale state: its last fix is too old, or its fixes come too rarely."""
        if age_s > self._settings.stale_after_s:
            return Problem(ProblemKind.STALE, age_s)
        return Problem(ProblemKind.RARE, min(self._intervals_s))
