"""Restrictions with a window of time: when the advice keeps to them."""

from __future__ import annotations

import pytest

from das.bus import das_pb2
from das.bus.topics import RESTRICTION
from das.cab.situation import Situation
from das.domain.restriction import COUNTS_AFTER_S, COUNTS_BEFORE_S, Restriction
from tests.support.driven_node import START_NS, DrivenNode, S
from tests.support.small_trips import FRONTS, LINE, TRAIN, SmallTrip, at, ns, trip


def slow(from_s: float | None = None, until_s: float | None = None) -> Restriction:
    """A restriction ahead of and behind the small trip's train, with a window by the trip's clock (None: open)."""
    window = (0 if moment_s is None else ns(moment_s) for moment_s in (from_s, until_s))
    return Restriction(1000.0, 4500.0, 10.0, *window)


def test_a_restriction_is_kept_until_its_window_has_closed_and_no_longer() -> None:
    made = trip()
    made.set_restrictions([slow(until_s=70.0)])
    assert at(made, 60, 2000.0, 10.0).limit_mps == 10.0
    last_s = 70 + round(COUNTS_AFTER_S) - 1
    assert at(made, last_s, 2200.0, 10.0).limit_mps == 10.0
    after = at(made, last_s + 1, 2210.0, 10.0)
    assert after.limit_mps == 30.0
    assert after.horizon_speed_mps[-1] > 11.0
    assert any("restriction lifted" in news.text for news in made.take_news())


@pytest.mark.parametrize("begins_s", [61.0, 600.0, 61.0 + COUNTS_BEFORE_S])
def test_a_restriction_that_is_still_to_begin_counts_soon_enough_to_brake(begins_s: float) -> None:
    made = trip()
    made.set_restrictions([slow(from_s=begins_s)])
    counts = begins_s - COUNTS_BEFORE_S <= 60.0
    assert at(made, 60, 2000.0, 24.0).limit_mps == (10.0 if counts else 30.0)
    advice = at(made, 61, 2024.0, 24.0)
    assert advice.limit_mps == advice.advised_speed_mps == 10.0
    assert advice.advised_force_n < -5e4


def test_one_of_tomorrow_does_not_slow_the_train_of_today() -> None:
    free, made = trip(), trip()
    made.set_restrictions([slow(from_s=86_400.0)])
    assert at(made, 60, 2000.0, 24.0) == at(free, 60, 2000.0, 24.0)


def test_a_clock_that_is_set_back_brings_a_restriction_back() -> None:
    made = trip()
    made.set_restrictions([slow(until_s=70.0)])
    assert at(made, 90, 2000.0, 20.0).limit_mps == 30.0
    assert made.legs.situation.at(ns(65)).restrictions == (slow(),)
    assert at(made, 91, 2020.0, 20.0).limit_mps == 30.0
    made.legs.prepare(ns(65))
    assert made.leg.planner.limit_mps(2020.0) == 10.0


def test_while_the_time_is_not_known_every_restriction_counts() -> None:
    made = SmallTrip(Situation(route=LINE, vehicle=TRAIN), FRONTS)
    made.set_restrictions([slow(until_s=70.0), slow(from_s=86_400.0)])
    assert made.legs.situation.at(0).restrictions == (slow(), slow())
    assert made.legs.situation.at(ns(60)).restrictions == (slow(),)
    assert made.legs.situation.at(ns(90)).restrictions == ()


def test_a_node_keeps_to_windows_of_a_list_that_is_sent_only_once() -> None:
    node = DrivenNode()
    window = {"valid_from_ns": START_NS, "valid_until_ns": START_NS + 60 * S}
    one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=6_000.0, limit_mps=10.0, **window)
    node.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + S, restrictions=[one]))
    assert node.tick(50).limit_mps == 10.0
    assert node.tick(60 + COUNTS_AFTER_S).limit_mps > 40.0
