"""How a human driver handles the controller, measured at every look over whole days: no bursts of effort, and advice
done as it is said.

`DAS_PROPERTY_SEEDS=20 pytest tests/property/test_driver_habits.py` drives more days (8 minutes on one core).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby, pairwise
from typing import Final, NamedTuple

import pytest

from das.advice.regimes import Regime
from sim.drivers.cab import AT_STOP_M, CabView
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.plant.kernels import Command
from sim.world.in_process import InProcess
from sim.world.loop import LOOK_S, World
from sim.world.scenario import load_scenario
from sim.world.service import Service, make_day
from tests.support.flat_days import service_for

pytestmark = pytest.mark.nightly

SEEDS = int(os.environ.get("DAS_PROPERTY_SEEDS", "3"))
BURSTS_PER_MIN = 0.1
"""So many bursts a minute there may be."""
OF_FOUR_MODES = 0.13
"""So many there are under four modes, which themselves change 18 times a minute (measured over 20 days: 0.099)."""
SETS_RATIO: Final = 0.02
"""A controller that is nearer to 0 than this share of its scale is at 0; beyond that it sets traction or brakes."""
EFFORT_RATIO, BURST_S = 0.1, 4.0
"""Traction or brakes over this share of the scale for less than this time (s) are a burst."""
HAND_S: Final = 1.0
"""A hand takes up to this long to bring the controller back from a brake to 0."""
SET_S: Final = 3.0
"""After this long an advised effort should be set."""
BELOW_MPS: Final = 3.0
"""This far (m/s) below the speed that the driver may or should reach, only the advice decides what the driver sets."""
MOVES_MPS: Final = 0.5
"""A train slower than this counts as standing."""
TRACTION: Final = (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION)

WITH_MODES: Final = tuple(one for one in Presentation if presenter_of(one).says_mode)
"""The presentations that say how to drive."""


class ControllerLook(NamedTuple):
    """What was set at a look, and the mode and effort of the advice followed (mode None: none was followed).

    `below_mps`: how far the speed is below what the driver may or should reach. `braking`: by the driver's own margins
    a limit or a stop asks for brakes.
    """

    time_s: float
    speed_mps: float
    lever_ratio: float
    mode: int | None
    advised_ratio: float
    below_mps: float
    braking: bool


@dataclass
class WatchedHand:
    """A human driver whose every look is kept."""

    human: HumanDriver
    looks: list[ControllerLook] = field(default_factory=list)

    def command(self, cab: CabView) -> Command:
        """What the driver sets."""
        command = self.human.command(cab)
        heeded, handling = self.human._display.heeded, self.human.handling
        view = heeded.view if heeded.by_effort else None
        may_mps = min(self.human._foresight.outlook(cab).allowed_mps(cab.s_m), cab.limit_mps)
        if view is not None and presenter_of(view.presentation).speed_is(view.mode) is SpeedIs.TO_REACH:
            may_mps = min(may_mps, view.shown_speed_mps)
        mode, advised = (None, 0.0) if view is None else (view.mode, view.lever_ratio)
        below_mps = may_mps - cab.speed_mps
        self.looks.append(
            ControllerLook(cab.time_s, cab.speed_mps, command.value, mode, advised, below_mps, handling._braking)
        )
        return command


class WatchedDay(NamedTuple):
    """The looks of a day, and how far off its stops the train stood (m)."""

    looks: list[ControllerLook]
    off_m: list[float]


class Braked(NamedTuple):
    """How long a driver followed advice to coast (s), and how much of that time the driver braked.

    `unasked_s`: braked although, by the driver's own margins, neither a limit nor a stop asked for it; `all_s`: braked
    for any reason.
    """

    told_s: float
    unasked_s: float
    all_s: float


def watched_day(service: Service, presentation: Presentation, seed: int) -> WatchedDay:
    """Drive a day with the human driver of its seed."""
    day = make_day(service, seed)
    human = day.driver(DriverKind.HUMAN, FrictionPolicy.AS_MEASURED)
    assert isinstance(human, HumanDriver)
    watched = WatchedHand(human)
    link = InProcess(service, guide=presenter_of(presentation).needs_guide)
    run = World(day, watched, presentation, link).run()
    arrivals = [arrival for _, arrival in run.legs]
    off_m = [state.s_m - stop.position_m for state, stop in zip(arrivals, service.stops[1:], strict=True)]
    return WatchedDay(watched.looks, off_m)


def bursts_s(looks: Sequence[ControllerLook]) -> Iterator[float]:
    """Duration (s) of each burst: a short stretch of traction or brakes over a tenth of the scale, not at a stand."""

    def side(look: ControllerLook) -> int:
        return (look.lever_ratio > EFFORT_RATIO) - (look.lever_ratio < -EFFORT_RATIO)

    for which, stretch in groupby(looks, side):
        kept = list(stretch)
        lasted_s = LOOK_S * len(kept)
        if which and lasted_s < BURST_S - 0.5 * LOOK_S and min(look.speed_mps for look in kept) > MOVES_MPS:
            yield lasted_s


def bursts_per_min(days: Sequence[WatchedDay]) -> float:
    """Bursts per minute of driving."""
    moving_s = LOOK_S * sum(look.speed_mps > MOVES_MPS for day in days for look in day.looks)
    return 60.0 * sum(1 for day in days for _ in bursts_s(day.looks)) / moving_s


def braked_under_coast(days: Sequence[WatchedDay]) -> Braked:
    """How long drivers braked while they followed advice to coast."""
    told_s = unasked_s = all_s = 0.0
    for day in days:
        since_s = coasts_s = 0.0
        for look in day.looks:
            coasts = look.mode == Regime.COAST and look.speed_mps > MOVES_MPS
            coasts_s = coasts_s + LOOK_S if coasts else 0.0
            since_s = since_s + LOOK_S if coasts and not look.braking else 0.0
            brakes = look.lever_ratio < -SETS_RATIO
            told_s += LOOK_S * coasts
            unasked_s += LOOK_S * (since_s > HAND_S and brakes)
            all_s += LOOK_S * (coasts_s > HAND_S and brakes)
    return Braked(told_s, unasked_s, all_s)


def set_at_full(days: Sequence[WatchedDay]) -> list[float]:
    """What was set (−1 … 1) at each look at which 100 % had been advised for a while and nothing else decided."""
    found = []
    for day in days:
        since_s = 0.0
        for look in day.looks:
            # A driver who waits at a stop sets nothing, whatever was shown last.
            goes = look.mode in TRACTION and look.speed_mps > 0
            full = goes and look.advised_ratio > 0.995 and look.below_mps > BELOW_MPS
            since_s = since_s + LOOK_S if full else 0.0
            if since_s > SET_S:
                found.append(look.lever_ratio)
    return found


def braked_at_a_stand_s(days: Sequence[WatchedDay]) -> float:
    """How long (s) drivers braked a standing train while they followed advice to accelerate."""
    looks = (look for day in days for look in day.looks)
    return LOOK_S * sum(x.mode in TRACTION and x.speed_mps <= 0 and x.lever_ratio < 0 for x in looks)


@cache
def service() -> Service:
    return service_for(load_scenario("clear-day"))


PRESENTATIONS = list(Presentation)
OF_MODES = [one for one in PRESENTATIONS if one in WITH_MODES]


@cache
def days(presentation: Presentation) -> tuple[WatchedDay, ...]:
    return tuple(watched_day(service(), presentation, seed) for seed in range(SEEDS))


@pytest.mark.parametrize("presentation", PRESENTATIONS)
def test_efforts_are_no_bursts(presentation: Presentation) -> None:
    most = OF_FOUR_MODES if presentation is Presentation.FOUR_MODE else BURSTS_PER_MIN
    watched = days(presentation)
    moving_min = LOOK_S / 60.0 * sum(look.speed_mps > MOVES_MPS for day in watched for look in day.looks)
    # Bursts are whole: over one day of 38 min the bound of 3.8 is 4. One day has 0 to 7 of them (over 20 days the guide
    # has 0.07 a minute), so that a mean needs some days.
    assert bursts_per_min(watched) * moving_min <= math.ceil(most * moving_min) + 1e-9


@pytest.mark.parametrize("presentation", OF_MODES)
def test_nobody_brakes_who_is_told_to_coast_unless_a_limit_or_a_stop_asks_for_it(presentation: Presentation) -> None:
    """A driver answers for limits and stops himself: he brakes for them his own way, whatever is advised."""
    braked = braked_under_coast(days(presentation))
    assert braked.told_s > 100.0 * SEEDS
    assert braked.unasked_s / braked.told_s <= 0.01, f"{braked.unasked_s:.1f} of {braked.told_s:.0f} s"
    assert braked.all_s >= braked.unasked_s


@pytest.mark.parametrize("presentation", [Presentation.SPEED_AND_EFFORT, Presentation.GUIDE])
def test_all_that_is_advised_is_set(presentation: Presentation) -> None:
    """At 100 % advice the controller is at 99 % at least, except in lapses: the end of the scale is a stop."""
    set_to = set_at_full(days(presentation))
    assert len(set_to) > 80
    assert sum(one >= 0.99 for one in set_to) / len(set_to) >= 0.95


@pytest.mark.parametrize("presentation", OF_MODES)
def test_nobody_brakes_at_a_stand_who_is_told_to_go(presentation: Presentation) -> None:
    assert braked_at_a_stand_s(days(presentation)) == 0.0


@pytest.mark.parametrize("presentation", PRESENTATIONS)
def test_every_stop_is_within_the_bound(presentation: Presentation) -> None:
    """A human means to stand at most 5 m off the mark; further off than 10 m the train would not be at its stop."""
    off_m = [abs(off) for day in days(presentation) for off in day.off_m]
    assert len(off_m) == SEEDS * 3
    assert max(off_m) <= AT_STOP_M


def test_looks_follow_each_other() -> None:
    """The measures above count looks: there is one every 0.2 s."""
    for day in days(Presentation.SPEED_AND_EFFORT):
        spans = [after.time_s - before.time_s for before, after in pairwise(day.looks)]
        assert max(spans) == pytest.approx(LOOK_S, abs=1e-6)
