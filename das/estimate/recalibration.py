"""Which mass and resistance to plan with, and when to plan anew because of them."""

from __future__ import annotations

from das.domain.conditions import Conditions
from das.domain.units import NS
from das.estimate.calibration_settings import DEFAULT, ReplanSettings
from das.estimate.ratios import Estimates


class Recalibration:
    """Holds the conditions that the plan is made with, and says when the estimates call for others."""

    def __init__(self, conditions: Conditions | None = None, settings: ReplanSettings = DEFAULT.replan) -> None:
        self._planned = self.conditions = conditions or Conditions()
        """The conditions that the plan is made with."""
        self._settings = settings
        self._changed_ns: int | None = None

    def due(self, estimates: Estimates, now_ns: int) -> Conditions | None:
        """Return other conditions to plan with from now on; None where those of the plan are near enough.

        The conditions change at most once in `every_s` of the settings, except that doubted forces bring back those of
        the start at once.
        """
        if estimates.doubt is not None and self.conditions != self._planned:
            self.conditions = self._planned
            return self.conditions
        if not estimates.differs(self.conditions, self._settings):
            return None
        if self._changed_ns is not None and abs(now_ns - self._changed_ns) * NS < self._settings.every_s:
            return None
        self.conditions, self._changed_ns = estimates.applied(self.conditions), now_ns
        return self.conditions
