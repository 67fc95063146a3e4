"""Drivers by rule: as fast as allowed, under one reduced maximum speed, or keeping time without advice."""

from __future__ import annotations

import math

from das.domain.units import KMH
from sim.drivers.cab import Cab, Presentation
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.tracking import hold, stand, stop_at, under_ceiling
from sim.plant.plant import Command

LATE_BRAKING = Habit(braking_mps2=0.9)
"""Full service braking of a passenger train (assumption)."""
EASY_BRAKING = Habit(braking_mps2=0.5)
"""Comfortable service braking (assumption)."""
ANTICIPATION_S = 0.8
"""Dead time and half the build-up of an effort: so much earlier a practised driver acts."""
JUDGED_EVERY_S = 15.0
"""A driver who keeps time compares clock and timetable this often."""
SPARE_S = 2.0
"""He means to arrive this much early: the last metres take longer than one thinks."""
ROLL_MPS = 8.0 * KMH
"""He lets the train roll up to this much above the speed that would do, before he brakes it."""


class FastDriver:
    """As fast as allowed, and brakes late."""

    def __init__(self, line: LineKnowledge, habit: Habit = LATE_BRAKING) -> None:
        self.foresight = Foresight(line, habit)

    def command(self, cab: Cab) -> Command:
        return stand(cab) or self._drive(cab, self.foresight.outlook(cab), math.inf)

    def _drive(self, cab: Cab, outlook: Outlook, top_mps: float, roll_mps: float = 0.0) -> Command:
        """Under the ceiling and a top speed; up to `roll_mps` above the top without brakes."""
        stopping = stop_at(cab, outlook, cab.halt_m, self.foresight.habit.braking_mps2)
        if stopping is not None:
            return stopping
        rolls = top_mps < cab.speed_mps <= top_mps + roll_mps
        ceiling = under_ceiling(cab, outlook, ANTICIPATION_S, 0.0 if rolls else math.inf)
        if rolls or top_mps >= ceiling.value:
            return ceiling
        return hold(cab, outlook, top_mps if cab.speed_mps <= top_mps else min(top_mps + roll_mps, ceiling.value))


class RmsDriver(FastDriver):
    """Holds one reduced maximum speed: the display's, or the one that is judged on departure to keep the timetable."""

    def __init__(self, line: LineKnowledge, habit: Habit = EASY_BRAKING) -> None:
        super().__init__(line, habit)
        self._rule = TimeRule()

    def command(self, cab: Cab) -> Command:
        outlook = self.foresight.outlook(cab)
        return stand(cab) or self._drive(cab, outlook, shown_cap(cab) or self._rule.cap_mps(cab, outlook))


class TimetableDriver(FastDriver):
    """Keeps time without advice: judges its highest speed anew every while, and rolls where it is too fast."""

    def __init__(self, line: LineKnowledge, habit: Habit = EASY_BRAKING) -> None:
        super().__init__(line, habit)
        self._rule = TimeRule(JUDGED_EVERY_S)

    def command(self, cab: Cab) -> Command:
        outlook = self.foresight.outlook(cab)
        return stand(cab) or self._drive(cab, outlook, self._rule.cap_mps(cab, outlook), ROLL_MPS)


class TimeRule:
    """Experience: the one highest speed with which the rest of the way takes the time that is left."""

    def __init__(self, every_s: float = math.inf) -> None:
        self._every_s = every_s
        self._journey: tuple[float, float] | None = None
        self._judged_s, self._cap_mps = -math.inf, math.inf

    def cap_mps(self, cab: Cab, outlook: Outlook) -> float:
        """That speed, judged on departure for a stop and then every while; not towards a signal at danger."""
        journey = (cab.stop_m, cab.arrival_s)
        due = journey != self._journey or cab.time_s - self._judged_s >= self._every_s
        if due and cab.signal_m >= cab.stop_m:
            self._journey, self._judged_s = journey, cab.time_s
            left_s = max(cab.arrival_s - cab.time_s - SPARE_S, 0.0)
            self._cap_mps = outlook.cap_for(left_s, cab.s_m, cab.speed_mps)
        return self._cap_mps


def shown_cap(cab: Cab) -> float | None:
    """The reduced maximum speed on the display, where it shows one."""
    view = cab.shown
    shows = view is not None and view.presentation is Presentation.RMS and view.speed_mps > 0
    return view.speed_mps if view is not None and shows else None
