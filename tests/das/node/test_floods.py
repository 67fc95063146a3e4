"""Floods of messages that are valid one by one: restrictions, each of which calls for another plan, and journeys."""

from __future__ import annotations

from typing import Any

import pytest
from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.session import MOST_SENDERS, Inbox
from das.bus.topics import EVENT, JOURNEY, POSITION, RESTRICTION, STATUS, Topic, decoded
from das.cab.legs import Legs
from tests.support.driven_node import START_NS, TRAIN, DrivenNode, S, journey, restrictions


def put(inbox: Inbox, topic: Topic, message: Message, source: str = "a") -> None:
    inbox.put(decoded(topic, topic.key(TRAIN), message.SerializeToString(), source))


def drained(inbox: Inbox) -> list[Any]:
    found = []
    while (received := inbox.get(0.0, skip_outdated=True)) is not None:
        found.append(received)
    return found


def position(second: float) -> das_pb2.Position:
    return das_pb2.Position(time_ns=START_NS + round(second * S), s_m=20.0 * second, speed_mps=20.0)


def test_of_a_flood_of_restrictions_the_newest_is_heeded_and_no_position_waits_for_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To plan for each of them took 33 ms, so that positions waited behind 1 000 of them for 33 s."""
    heeded: list[Any] = []
    set_restrictions = Legs.set_restrictions
    monkeypatch.setattr(
        Legs, "set_restrictions", lambda legs, told: (heeded.append(told), set_restrictions(legs, told))
    )
    driven, inbox = DrivenNode(), Inbox()
    driven.tell_time(0)
    driven.tell(RESTRICTION, restrictions(0.5, 30.0))
    heeded.clear()
    for number in range(900):
        put(inbox, RESTRICTION, restrictions(1.0 + 0.004 * number, 10.0 + 0.01 * number), "")
        if number % 250 == 0:
            put(inbox, POSITION, position(1.0 + 0.004 * number), "sensor")
    for received in drained(inbox):
        driven.node.take(received)
    assert len(heeded) == 1
    assert heeded[0][0].limit_mps == pytest.approx(18.99)


def test_messages_that_are_not_outdated_are_kept_in_order() -> None:
    inbox = Inbox()
    put(inbox, RESTRICTION, restrictions(5.0, 10.0))
    put(inbox, POSITION, position(1.0))
    put(inbox, RESTRICTION, restrictions(4.0, 20.0))  # Older: a replay, which outdates nothing.
    put(inbox, RESTRICTION, restrictions(6.0, 30.0), "b")
    put(inbox, JOURNEY, journey())
    put(inbox, POSITION, position(2.0))
    found = [(one.topic.name, one.source) for one in drained(inbox)]
    assert found == [
        ("restriction", "a"), ("position", "a"), ("restriction", "a"), ("restriction", "b"), ("journey", "a"),
        ("position", "a"),
    ]  # fmt: skip


def test_one_that_cannot_be_read_is_not_skipped() -> None:
    inbox = Inbox()
    inbox.put(decoded(RESTRICTION, RESTRICTION.key(TRAIN), b"\xff\xff", "a"))
    put(inbox, RESTRICTION, restrictions(6.0, 10.0))
    assert [one.message is None for one in drained(inbox)] == [True, False]


def test_a_recorder_gets_every_message() -> None:
    inbox = Inbox()
    for number in range(20):
        put(inbox, RESTRICTION, restrictions(number, 10.0))
    count = 0
    while inbox.get(0.0) is not None:
        count += 1
    assert count == 20


def test_many_senders_are_forgotten_one_by_one() -> None:
    inbox = Inbox()
    for number in range(3 * MOST_SENDERS):
        put(inbox, JOURNEY, journey(), f"sender {number}")
    assert len(drained(inbox)) == 3 * MOST_SENDERS


def test_a_flood_of_journeys_is_no_flood_of_events() -> None:
    """900 of them made 900 events and 900 messages of status a second."""
    driven = DrivenNode()
    driven.tick(1)
    before = len(driven.sink.of(EVENT)), len(driven.sink.of(STATUS))
    for number in range(500):
        driven.tell(JOURNEY, journey(time_ns=START_NS + S + number))
    driven.tick(2)
    driven.tick(3)
    events, statuses = len(driven.sink.of(EVENT)) - before[0], len(driven.sink.of(STATUS)) - before[1]
    assert events <= 10
    assert statuses <= 10
    for number in range(500):
        driven.tell(JOURNEY, journey(time_ns=START_NS + 4 * S + number, route_id="elsewhere"))
    driven.tick(5)
    assert len(driven.sink.of(EVENT)) - before[0] <= 25
    assert len(driven.sink.of(STATUS)) - before[1] <= 25
