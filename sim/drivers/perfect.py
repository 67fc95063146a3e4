"""The perfect follower: does what the full advice says as exactly as the train lets."""

from __future__ import annotations

import math

from das.advice.modes import Mode
from sim.drivers.cab import AdviceView, CabView, Efforts
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge, Outlook
from sim.drivers.presentations.presenter import Follower, presenter_of
from sim.drivers.rule_settings import FOLLOWING, RULE
from sim.drivers.rules import FastDriver, TimetableDriver
from sim.drivers.tracking import hold, stand
from sim.plant.plant import Command


class PerfectDriver:
    """Does what a display that says enough for it says; with any other, or without advice, keeps time as it can."""

    def __init__(self, line: LineKnowledge) -> None:
        self._alone, self._minding = TimetableDriver(line), FastDriver(line)
        self._followers: dict[Presentation, Follower | None] = {}

    def command(self, cab: CabView) -> Command:
        view = cab.shown
        follower = None if view is None else self._follower(view.presentation)
        if view is None or follower is None:
            return self._alone.command(cab)
        if (cab.restrictions or cab.signal_m < cab.stop_m) and self._must_mind(cab):
            return self._minding.command(cab)
        outlook = self._alone.foresight.outlook(cab)
        if view.mode == Mode.DEPART:
            self._followers.clear()
            return stand(cab) or self._depart(cab, view.departure, outlook)
        return stand(cab) or follower.command(cab, view, outlook) or self._alone.command(cab)

    def _follower(self, presentation: Presentation) -> Follower | None:
        """The driver who follows a presentation exactly, the same on every section; None where it says too little."""
        if presentation not in self._followers:
            self._followers[presentation] = presenter_of(presentation).follower()
        return self._followers[presentation]

    def _depart(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        """Set the train in motion as the advice says, now that it is cleared."""
        target = min(view.speed_mps, cab.limit_mps)
        if math.isnan(view.lever_ratio):
            return hold(cab, outlook, target)
        most_n = view.lever_ratio * Efforts.at(cab.speed_mps, outlook.train).traction_n
        return hold(cab, outlook, target, high_n=max(most_n, 0.0))

    def _must_mind(self, cab: CabView) -> bool:
        """Whether the train is near the highest speed that a restriction or signal allows; the advice may not know."""
        soon_m = cab.s_m + cab.speed_mps * RULE.anticipation_s
        return cab.speed_mps > self._minding.foresight.outlook(cab).allowed_mps(soon_m) - FOLLOWING.minded_mps
