"""Restrictions that bind nowhere on the route: somebody may have counted from elsewhere, so that it is said."""

from __future__ import annotations

import pytest

from das.bus import das_pb2
from das.bus.topics import RESTRICTION
from tests.support.driven_node import START_NS, DrivenNode, S


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([(20e3, 21e3)], "restriction: one of 10 m/s from 20000 to 21000 m is off the route (0 to 6000 m)"),
        ([(-900.0, -100.0)], "restriction: one of 10 m/s from -900 to -100 m is off the route"),
        ([(20e3, 21e3), (1e3, 2e3), (6e3, 7e3)], "one of 10 m/s from 20000 to 21000 m and 1 more is off the route"),
        ([(5.9e3, 7e3)], ""),
        ([(-100.0, 10.0)], ""),
        ([], ""),
    ],
)
def test_a_restriction_wholly_off_the_route_is_an_event(places: list[tuple[float, float]], said: str) -> None:
    driven = DrivenNode()
    told = [das_pb2.Restrictions.Restriction(start_m=a, end_m=b, limit_mps=10.0) for a, b in places]
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + S, restrictions=told))
    advice = driven.tick(2)
    assert advice.mode != das_pb2.MODE_NONE
    assert said in driven.sink.events()
    assert ("off the route" in driven.sink.events()) is bool(said)
