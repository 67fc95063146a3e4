"""The loop at a pace, in which advice comes later than it was asked for, and departures before the train is cleared."""

from __future__ import annotations

from typing import Any

import pytest

from das.advice.advice import Advice
from sim.drivers.cab import CabView
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.presentations.presenter import Shown
from sim.plant.kernels import Command
from sim.plant.plant import lever
from sim.world.in_process import InProcess
from sim.world.loop import Tick, Told, World
from sim.world.service import Day
from tests.support.flat_days import flat_day


class Late(InProcess):
    """An on-board system that is asked at a pace: its advice comes at a later look, or never in the ticks `lost`."""

    def __init__(self, day: Day, lost: range) -> None:
        self._lost, self._coming, self.asked = lost, list[Advice](), 0
        super().__init__(day.service)

    def exchange(self, tick: Tick) -> Any:
        """Think, and answer later."""
        self.asked += 1
        advice = super().exchange(tick)
        if tick.number not in self._lost:
            self._coming = [advice]
        return None

    def newest(self) -> Any:
        """The answer, once."""
        return self._coming.pop() if self._coming else None


class Eyes:
    """A driver who remembers every cab that another one sees."""

    def __init__(self, day: Day) -> None:
        self._driver = day.driver(DriverKind.TIMETABLE)
        self.cabs: list[CabView] = []

    def command(self, cab: CabView) -> Command:
        self.cabs.append(cab)
        return self._driver.command(cab)


def test_at_a_pace_the_newest_advice_is_shown_while_it_is_valid_and_nobody_waits_for_it() -> None:
    """The advice of ticks 50 to 60 never comes: what is shown goes when it is valid no longer, and comes back after."""
    day = flat_day()
    link, driver = Late(day, range(50, 61)), Eyes(day)
    run = World(day, driver, Presentation.SPEED_AND_EFFORT, link).run()
    ticks = len(run.states) - 1
    assert link.asked == ticks
    assert run.counts.unheard == 11
    assert run.counts.advised + run.counts.withdrawn == ticks - 11
    first = [cab.shown for cab in driver.cabs[49 * 5 : 61 * 5 : 5]]
    assert first[0] is not None
    valid_s = first[0].valid_until_s
    for cab in driver.cabs[49 * 5 : 60 * 5]:
        assert (cab.shown is not None) == (cab.time_s <= valid_s)
    assert driver.cabs[60 * 5].shown is not None  # the advice of tick 61 comes at its first look
    assert Shown.of(first[0]).speed_kmh is not None


class Hasty:
    """A driver who pulls at once, and brakes to the stop in time."""

    def command(self, cab: CabView) -> Command:
        way_m = cab.stop_m - cab.s_m
        return lever(1.0 if cab.speed_mps < 20 and way_m > 1000 else -0.4 if cab.speed_mps**2 > 0.8 * way_m else 0.0)


class Logged(InProcess):
    """Keeps what is said about the run."""

    def __init__(self, day: Day) -> None:
        self.words: list[str] = []
        super().__init__(day.service)

    def tell(self, now_ns: int, told: Told) -> None:
        """Keep the sentences."""
        self.words += told.events


@pytest.mark.parametrize(("key", "leaves_s"), [("", 0.0), ("early_departure = 'counted'", -10.0)])
def test_a_driver_who_pulls_too_early_is_held_or_leaves_early_as_the_scenario_says(key: str, leaves_s: float) -> None:
    day = flat_day(key)
    link = Logged(day)
    run = World(day, Hasty(), Presentation.NONE, link).run()
    assert run.legs[0][0].time_s == pytest.approx(leaves_s, abs=0.5)
    (said,) = [text for text in link.words if text.startswith("departed")]
    assert ("before it was cleared" in said) == (leaves_s < 0)
