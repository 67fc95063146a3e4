"""A journey of another day than that of the node's clock is refused until the clock gets there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.topics import CONTROL, JOURNEY, POSITION, RESTRICTION
from das.cab.heard import JourneyHeard
from das.cab.orders import DAY_NS, is_of_another_day
from das.domain.journey import OrderedStop
from tests.support.driven_node import START_NS, DrivenNode, S, journey

HOUR = 3600.0


def received_at(hours: float) -> DrivenNode:
    """A node that receives the journey when its clock is this many hours after the departure."""
    driven = DrivenNode(told=False)
    driven.tell(CONTROL, das_pb2.Control(time_ns=START_NS + round(hours * HOUR * S), tick=0))
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS - 10 * DAY_NS))
    driven.tell(JOURNEY, journey(time_ns=START_NS - 10 * DAY_NS))
    return driven


def advice_at(driven: DrivenNode, hours: float) -> Any:
    """The advice for a train that stands at its departure stop."""
    now_ns = START_NS + round(hours * HOUR * S)
    driven.tell(POSITION, das_pb2.Position(time_ns=now_ns, s_m=0.0, speed_mps=0.0))
    driven.tell(CONTROL, das_pb2.Control(time_ns=now_ns, tick=1))
    return driven.last_advice()


@pytest.mark.parametrize("hours", [-25.0, 25.0, -200.0])
def test_a_journey_of_another_day_is_refused(hours: float) -> None:
    driven = received_at(hours)
    advice = advice_at(driven, hours)
    assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.JOURNEY_REFUSED)
    assert "it departs on 2027-01-15 08:00 UTC, more than a day from the node's clock (" in advice.reason.text


@pytest.mark.parametrize("hours", [-23.0, 23.0])
def test_a_journey_within_a_day_is_taken(hours: float) -> None:
    assert "journey A – B" in received_at(hours).sink.events()


def test_it_is_taken_when_the_clock_gets_to_its_day() -> None:
    """The operator sends a journey once, perhaps the day before; and a wrong clock is set right."""
    driven = received_at(-30.0)
    assert advice_at(driven, -29.9).cause == Cause.JOURNEY_REFUSED
    assert advice_at(driven, -23.5).cause != Cause.JOURNEY_REFUSED
    assert advice_at(driven, 0.01).mode != das_pb2.MODE_NONE
    assert driven.sink.events().count("journey A – B") == 1


def test_a_journey_received_before_there_is_a_clock_is_judged_by_the_first_tick() -> None:
    driven = DrivenNode()
    assert advice_at(driven, -26.0).cause == Cause.JOURNEY_REFUSED
    assert advice_at(driven, 0.01).mode != das_pb2.MODE_NONE


def test_a_long_journey_is_of_every_day_on_which_it_stops() -> None:
    stops = tuple(OrderedStop(str(day), 1e5 * day, 0, START_NS + day * DAY_NS) for day in range(5))
    journey = JourneyHeard(time_ns=0, route_id="", vehicle_id="", stops=stops)
    assert not any(is_of_another_day(journey, START_NS + day * DAY_NS) for day in range(-1, 6))
    assert is_of_another_day(journey, START_NS + 6 * DAY_NS)
    assert not is_of_another_day(journey, 0)
    assert not is_of_another_day(replace(journey, stops=()), START_NS)
