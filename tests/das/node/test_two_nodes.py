"""Two nodes of one train: each of them notices the other and says nothing until it is gone."""

from __future__ import annotations

import time

import pytest

from das.advice.cause import Cause
from das.bus import das_pb2
from das.bus.session import Bus, Presence, endpoint, free_ports
from das.bus.topics import STATUS
from tests.support.driven_node import TRAIN, DrivenNode

TIMEOUT_S = 30.0


def test_a_node_says_nothing_while_another_one_advises_its_train() -> None:
    driven = DrivenNode()
    assert driven.tick(1).mode != das_pb2.MODE_NONE
    driven.sink.seen.append(Presence(STATUS, "other", there=True))
    silent = driven.tick(2)
    assert (silent.mode, silent.cause) == (das_pb2.MODE_NONE, Cause.TWO_NODES)
    assert silent.reason == "another node advises this train as well: other"
    assert "another node" in driven.sink.events()
    driven.sink.seen.append(Presence(STATUS, "other", there=False))
    assert driven.tick(3).mode != das_pb2.MODE_NONE


def seen(bus: Bus) -> Presence:
    ends = time.monotonic() + TIMEOUT_S
    while time.monotonic() < ends:
        if found := bus.presences():
            return found[-1]
        time.sleep(0.05)
    raise AssertionError("nothing was seen")


@pytest.mark.processes
def test_the_bus_tells_a_node_of_another_but_not_of_itself() -> None:
    first, second = (endpoint(port) for port in free_ports(2))
    with Bus(TRAIN, listen=first) as one:
        one.watch([STATUS])
        one.publish(STATUS, das_pb2.Status())
        with Bus(TRAIN, listen=second, connect=[first]) as other:
            other.watch([STATUS])
            other.publish(STATUS, das_pb2.Status())
            here, there = seen(one), seen(other)
            assert here.there
            assert there.there
            assert here.source != there.source
        assert not seen(one).there
