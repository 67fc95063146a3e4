"""How a human driver handles the controller, over whole days: no bursts of effort, and advice done as it is said.

`DAS_PROPERTY_SEEDS=20 pytest tests/property/test_driver_habits.py` drives more days (8 minutes on one core).
"""

from __future__ import annotations

import math
import os
from functools import cache
from itertools import pairwise

import pytest

from sim.drivers.cab import AT_STOP_M
from sim.drivers.kinds import Presentation
from sim.world.loop import LOOK_S
from sim.world.scenario import load_scenario
from sim.world.service import Service
from tests.support.driver_habits import (
    MOVES_MPS,
    WITH_MODES,
    WatchedDay,
    braked_at_a_stand_s,
    braked_under_coast,
    bursts_per_min,
    set_at_full,
    watched_day,
)
from tests.support.flat_days import service_for

pytestmark = pytest.mark.nightly

SEEDS = int(os.environ.get("DAS_PROPERTY_SEEDS", "3"))
BURSTS_PER_MIN = 0.1
"""So many bursts a minute there may be."""
OF_FOUR_MODES = 0.13
"""So many there are under four modes, which themselves change 18 times a minute (measured over 20 days: 0.099)."""


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
    # Bursts are whole: over one day of 38 min the bound of 3.8 is 4. One day has 0 to 7 of them (over 20 days the coach
    # has 0.07 a minute), so that a mean needs some days.
    assert bursts_per_min(watched) * moving_min <= math.ceil(most * moving_min) + 1e-9


@pytest.mark.parametrize("presentation", OF_MODES)
def test_nobody_brakes_who_is_told_to_coast_unless_a_limit_or_a_stop_asks_for_it(presentation: Presentation) -> None:
    """A driver answers for limits and stops himself: he brakes for them his own way, whatever is advised."""
    braked = braked_under_coast(days(presentation))
    assert braked.told_s > 100.0 * SEEDS
    assert braked.unasked_s / braked.told_s <= 0.01, f"{braked.unasked_s:.1f} of {braked.told_s:.0f} s"
    assert braked.all_s >= braked.unasked_s


@pytest.mark.parametrize("presentation", [Presentation.VECTOR, Presentation.COACH])
def test_all_that_is_advised_is_set(presentation: Presentation) -> None:
    """At 100 % advice the controller is at 99 % at least: the end of the scale is a stop."""
    set_to = set_at_full(days(presentation))
    assert len(set_to) > 80
    assert sum(set_to) / len(set_to) >= 0.99


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
    for day in days(Presentation.VECTOR):
        spans = [after.time_s - before.time_s for before, after in pairwise(day.looks)]
        assert max(spans) == pytest.approx(LOOK_S, abs=1e-6)
