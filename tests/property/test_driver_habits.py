"""How a human driver handles the controller, over whole days: no bursts of effort, and advice done as it is said.

`DAS_PROPERTY_SEEDS=20 pytest tests/property/test_driver_habits.py` drives more days (8 minutes on one core).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby, pairwise
from typing import NamedTuple

import pytest

from das.advice.modes import Mode
from sim.drivers.cab import AT_STOP_M, CabView
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.plant import Command
from sim.world.day import make_day
from sim.world.in_process import InProcess
from sim.world.loop import LOOK_S, World
from sim.world.scenario import load_scenario
from sim.world.service import Service, prepare_service

pytestmark = pytest.mark.slow
SEEDS = int(os.environ.get("DAS_PROPERTY_SEEDS", "1"))
EFFORT_RATIO, BURST_S, BURSTS_PER_MIN = 0.1, 4.0, 0.1
"""Traction or brakes over this share of the scale for less than this are a burst; so many a minute there may be."""
OF_FOUR_MODES = 0.13
"""So many there are under four modes, which themselves change 18 times a minute (measured over 20 days: 0.099)."""
SETS_RATIO = 0.02
"""A controller nearer to 0 than this is at 0."""
HAND_S = 1.0
"""A hand takes up to this long to bring the controller back from a brake to 0."""
SET_S = 3.0
"""Effort that has been advised for this long is set."""
BELOW_MPS = 3.0
"""So far below what he may or shall drive at, nothing but the advice decides what he sets."""
TRACTION = (Mode.FULL_TRACTION, Mode.REDUCED_TRACTION)


class Look(NamedTuple):
    """What was set at a look, by which advice (mode and effort; None if he follows none), and how far below limits."""

    time_s: float
    speed_mps: float
    lever_ratio: float
    mode: int | None
    advised_ratio: float
    below_mps: float
    braking: bool


@dataclass
class Watched:
    """A human driver of whom every look is kept."""

    human: HumanDriver
    looks: list[Look] = field(default_factory=list)

    def command(self, cab: CabView) -> Command:
        command = self.human.command(cab)
        heeded, handling = self.human._display.heeded, self.human._handling
        view = heeded.view if heeded.by_effort else None
        may_mps = min(self.human._foresight.outlook(cab).allowed_mps(cab.s_m), cab.limit_mps)
        if view is not None and view.presentation is Presentation.COACH:
            may_mps = min(may_mps, view.shown_speed_mps)
        mode, advised = (None, 0.0) if view is None else (view.mode, view.lever_ratio)
        self.looks.append(
            Look(
                cab.time_s, cab.speed_mps, command.value, mode, advised, may_mps - cab.speed_mps, handling.needs_brakes
            )
        )
        return command


class Day(NamedTuple):
    """The looks of a day, and how far off its stops the train stood (m)."""

    looks: list[Look]
    off_m: list[float]


@cache
def service() -> Service:
    return prepare_service(load_scenario("clear-day"))


@cache
def days(presentation: Presentation) -> tuple[Day, ...]:
    return tuple(driven(presentation, seed) for seed in range(SEEDS))


def driven(presentation: Presentation, seed: int) -> Day:
    day = make_day(service(), seed)
    human = day.driver(DriverKind.HUMAN)
    assert isinstance(human, HumanDriver)
    watched = Watched(human)
    link = InProcess(service(), coach=presentation is Presentation.COACH)
    run = World(day, watched, presentation, link).run()
    arrivals = [arrival for _, arrival in run.legs]
    stops = service().stops[1:]
    return Day(watched.looks, [state.s_m - stop.position_m for state, stop in zip(arrivals, stops, strict=True)])


def bursts(looks: list[Look]) -> Iterator[float]:
    """How long (s) each stretch of traction or of brakes over a tenth lasted that was a burst; at a stand none is."""

    def side(look: Look) -> int:
        return (look.lever_ratio > EFFORT_RATIO) - (look.lever_ratio < -EFFORT_RATIO)

    for which, stretch in groupby(looks, side):
        kept = list(stretch)
        lasted_s = LOOK_S * len(kept)
        if which and lasted_s < BURST_S - 0.5 * LOOK_S and min(look.speed_mps for look in kept) > 0.5:
            yield lasted_s


def shown(*but: Presentation) -> list[Presentation]:
    return [one for one in Presentation if one not in but]


@pytest.mark.parametrize("presentation", shown())
def test_efforts_are_no_bursts(presentation: Presentation) -> None:
    moving_min = sum(look.speed_mps > 0.5 for day in days(presentation) for look in day.looks) * LOOK_S / 60.0
    found = [burst for day in days(presentation) for burst in bursts(day.looks)]
    most = OF_FOUR_MODES if presentation is Presentation.FOUR_MODE else BURSTS_PER_MIN
    # Bursts are whole: over one day of 38 min the bound of 3.8 is 4 (over five days the coach has 0.06 a minute).
    assert len(found) <= math.ceil(most * moving_min), f"{len(found)} in {moving_min:.0f} min"


@pytest.mark.parametrize("presentation", [Presentation.FOUR_MODE, Presentation.VECTOR, Presentation.COACH])
def test_nobody_brakes_who_is_told_to_coast_unless_a_limit_or_a_stop_asks_for_it(presentation: Presentation) -> None:
    """A driver answers for limits and stops himself: he brakes for them his own way, whatever is advised."""
    told = braked = 0.0
    for day in days(presentation):
        since_s = 0.0
        for look in day.looks:
            coasts = look.mode == Mode.COAST and look.speed_mps > 0.5
            since_s = since_s + LOOK_S if coasts and not look.braking else 0.0
            told += LOOK_S * coasts
            braked += LOOK_S * (since_s > HAND_S and look.lever_ratio < -SETS_RATIO)
    assert told > 100.0 * SEEDS
    assert braked / told <= 0.01, f"{braked:.1f} of {told:.0f} s"


@pytest.mark.parametrize("presentation", [Presentation.VECTOR, Presentation.COACH])
def test_all_that_is_advised_is_set(presentation: Presentation) -> None:
    """At 100 % advice the controller is at 99 % at least: the end of the scale is a stop."""
    set_to = []
    for day in days(presentation):
        since_s = 0.0
        for look in day.looks:
            # A driver who waits at a stop sets nothing, whatever he saw last.
            goes = look.mode in TRACTION and look.speed_mps > 0
            full = goes and look.advised_ratio > 0.995 and look.below_mps > BELOW_MPS
            since_s = since_s + LOOK_S if full else 0.0
            if since_s > SET_S:
                set_to.append(look.lever_ratio)
    assert len(set_to) > 100
    assert sum(set_to) / len(set_to) >= 0.99


@pytest.mark.parametrize("presentation", [Presentation.FOUR_MODE, Presentation.VECTOR, Presentation.COACH])
def test_nobody_brakes_at_a_stand_who_is_told_to_go(presentation: Presentation) -> None:
    for day in days(presentation):
        wrong = [x for x in day.looks if x.mode in TRACTION and x.speed_mps <= 0 and x.lever_ratio < 0]
        assert not wrong


@pytest.mark.parametrize("presentation", shown())
def test_every_stop_is_within_the_bound(presentation: Presentation) -> None:
    """A human means to stand at most 5 m off the mark; further off than 10 m the train would not be at its stop."""
    off_m = [abs(off) for day in days(presentation) for off in day.off_m]
    assert len(off_m) == SEEDS * 3
    assert max(off_m) <= AT_STOP_M


def test_looks_follow_each_other() -> None:
    """The measures above count looks: there is one every 0.2 s."""
    for day in days(Presentation.NONE):
        spans = [after.time_s - before.time_s for before, after in pairwise(day.looks)]
        assert max(spans) == pytest.approx(LOOK_S, abs=1e-6)
