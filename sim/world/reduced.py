"""The reduced maximum speed that the RMS presentation of the advice shows."""

from __future__ import annotations

import math

from sim.drivers.cab import Cab
from sim.drivers.knowledge import Foresight, LineKnowledge
from sim.drivers.rules import EASY_BRAKING, TimeRule

JUDGED_EVERY_S = 30.0


class ReducedSpeed:
    """The one highest speed with which a train that brakes comfortably keeps the timetable from here.

    Judged on departure and then every while.
    """

    def __init__(self, line: LineKnowledge) -> None:
        self._foresight, self._rule = Foresight(line, EASY_BRAKING), TimeRule(JUDGED_EVERY_S)
        self._speed_mps = math.nan

    def at(self, cab: Cab) -> float:
        """That speed (m/s); at a stop the last one, NaN before the first."""
        if not cab.shall_stand:
            self._speed_mps = self._rule.cap_mps(cab, self._foresight.outlook(cab))
        return self._speed_mps
