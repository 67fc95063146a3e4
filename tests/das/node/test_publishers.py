"""Publishers of one train: two of its efforts, two nodes, and a sender whose messages bear no time stamp of its own."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
import zenoh

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.session import Bus, Presence, endpoint, free_ports
from das.bus.topics import EFFORT, ESTIMATE, JOURNEY, POSITION, RESTRICTION, STATUS, TARGET, Topic
from das.cab.cab import CabSettings
from das.cab.heard import UNSTAMPED
from tests.support.driven_node import START_NS, TRAIN, DrivenNode, S, journey, restrictions

PLAIN = {"mode": "peer", "listen/endpoints": [], "scouting/multicast/enabled": False, "scouting/gossip/enabled": False}
TIMEOUT_S = 30.0


# --- two publishers ----------------------------------------------------------------------------------------------


def effort(second: int, force_n: float) -> das_pb2.Effort:
    return das_pb2.Effort(time_ns=START_NS + second * S, force_el_n=force_n)


def test_two_publishers_of_the_effort_switch_calibration_off() -> None:
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second, 20e3), source="sensor-a")
        if 10 <= second < 15:
            driven.tell(EFFORT, effort(second, 15e3), source="sensor-b")
        assert driven.tick(second).mode != 0  # the advice goes on with the train as planned
    events = driven.sink.events()
    assert "effort: one of a second publisher (sensor-b) was ignored" in events
    assert "calibration off: two publishers of the efforts" in events
    assert "calibration on again" in events
    doubts = [estimate.doubt for estimate in driven.sink.of(ESTIMATE)]
    assert doubts[0] == ""
    assert "two-publishers" in doubts
    assert doubts[-1] == ""


def test_one_publisher_of_the_effort_is_not_doubted() -> None:
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second, 20e3), source="sensor-a")
        driven.tick(second)
    assert "calibration off" not in driven.sink.events()


def test_efforts_by_another_clock_than_the_positions_switch_calibration_off() -> None:
    """Forces of 1 s ago, set against the acceleration of now, make a train of another mass."""
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second - 1, 20e3), source="sensor-a")
        assert driven.tick(second).mode != 0
    assert "calibration off: the clocks of efforts and positions differ" in driven.sink.events()
    assert driven.sink.of(ESTIMATE)[-1].doubt == "clocks"


def test_a_node_says_nothing_while_another_one_advises_its_train() -> None:
    driven = DrivenNode()
    assert driven.tick(1).mode != das_pb2.MODE_NONE
    driven.sink.seen.append(Presence(STATUS, "other", there=True))
    silent = driven.tick(2)
    assert (silent.mode, silent.cause) == (das_pb2.MODE_NONE, Cause.TWO_NODES)
    assert silent.reason.text == "another node advises this train as well: other"
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


# --- without time stamps -----------------------------------------------------------------------------------------


@contextmanager
def plain_sender(place: str, *, stamps: bool) -> Iterator[zenoh.Session]:
    """A localisation that somebody wrote with Zenoh alone."""
    config = zenoh.Config()
    for key, value in {**PLAIN, "connect/endpoints": [place], "timestamping/enabled": stamps}.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


def sources(bus: Bus, senders: list[zenoh.Session]) -> set[str]:
    """The sources of the positions that come from each of the senders."""
    found: dict[float, str] = {}
    ends = time.monotonic() + TIMEOUT_S
    while len(found) < len(senders) and time.monotonic() < ends:
        for number, sender in enumerate(senders):
            sender.put(POSITION.key(TRAIN), das_pb2.Position(time_ns=1, s_m=number).SerializeToString())
        received = bus.receive(0.2)
        if received is not None:
            found[received.message.s_m] = received.source
    assert len(found) == len(senders)
    return set(found.values())


@pytest.mark.nightly
def test_the_bus_tells_senders_without_time_stamps_from_those_that_stamp() -> None:
    place = endpoint(*free_ports(1))
    with Bus(TRAIN, listen=place, hear=[POSITION]) as bus, ExitStack() as stack:
        unstamped = [stack.enter_context(plain_sender(place, stamps=False)) for _ in range(2)]
        assert sources(bus, unstamped) == {UNSTAMPED}
        stamping = stack.enter_context(plain_sender(place, stamps=True))
        while (received := bus.receive(0.5)) is not None:
            assert received.source == UNSTAMPED
        assert sources(bus, [stamping]) == {str(stamping.zid())}


@pytest.mark.nightly
@pytest.mark.parametrize("topic", [JOURNEY, RESTRICTION, TARGET], ids=lambda topic: topic.name)
def test_the_bus_tells_operators_without_time_stamps_as_well(topic: Topic) -> None:
    place = endpoint(*free_ports(1))
    with Bus(TRAIN, listen=place, hear=[topic]) as bus, ExitStack() as stack:
        senders = [stack.enter_context(plain_sender(place, stamps=stamps)) for stamps in (False, True)]
        for sender, expected in zip(senders, (UNSTAMPED, str(senders[1].zid())), strict=True):
            ends, received = time.monotonic() + TIMEOUT_S, None
            while received is None and time.monotonic() < ends:
                sender.put(topic.key(TRAIN), topic.message(time_ns=1).SerializeToString())
                received = bus.receive(0.2)
            assert received is not None
            assert received.source == expected
            while bus.receive(0.3) is not None:
                pass


def tell(driven: DrivenNode, topic: Topic, second: float, source: str, s_m: float | None = None) -> None:
    now_ns = START_NS + round(second * S)
    if topic is POSITION:
        message = das_pb2.Position(time_ns=now_ns, s_m=20.0 * second if s_m is None else s_m, speed_mps=20.0)
        driven.tell(topic, message, source)
    else:
        driven.tell(topic, das_pb2.Effort(time_ns=now_ns, force_el_n=10e3), source)


def test_two_localisations_without_stamps_withdraw_the_advice() -> None:
    """Two of them, 25 m apart, were averaged before."""
    driven = DrivenNode()
    driven.tell_time(0)
    for second in range(1, 6):
        tell(driven, POSITION, second, UNSTAMPED)
        tell(driven, POSITION, second, UNSTAMPED, 20.0 * second + 25.0)
        driven.tell_time(second)
        advice = driven.last_advice()
        assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.TWO_PUBLISHERS)
        assert "time stamp" in advice.reason.text
    assert "without its sender's time stamp" in driven.sink.events()


def test_one_without_stamps_beside_one_that_stamps_is_a_second_publisher() -> None:
    driven = DrivenNode()
    driven.tell_time(0)
    for second in range(1, 6):
        tell(driven, POSITION, second, "a")
        tell(driven, POSITION, second, UNSTAMPED, 20.0 * second + 25.0)
        driven.tell_time(second)
        advice = driven.last_advice()
        assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.TWO_PUBLISHERS)
    for second in range(6, 12):  # It falls silent.
        tell(driven, POSITION, second, "a")
        driven.tell_time(second)
    assert driven.last_advice().mode != das_pb2.MODE_NONE


def test_efforts_without_stamps_switch_calibration_off() -> None:
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 16):
        tell(driven, EFFORT, second, UNSTAMPED)
        assert driven.tick(second).mode != das_pb2.MODE_NONE
    assert driven.sink.of(ESTIMATE)[-1].doubt == "two-publishers"


def test_restrictions_without_stamps_end_the_advice_until_others_are_heard() -> None:
    """A second operator's looser list replaced the first one's before."""
    driven = DrivenNode()
    driven.tell(RESTRICTION, restrictions(1, 10.0), UNSTAMPED)
    advice = driven.tick(2)
    assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.RESTRICTIONS_UNHEEDED)
    assert "without its sender's time stamp" in advice.reason.text
    assert advice.reason.text.endswith("set its clock right")  # It was cut at a comma before.
    driven.tell(RESTRICTION, restrictions(3, 15.0))
    advice = driven.tick(4)
    assert advice.mode != das_pb2.MODE_NONE
    assert advice.limit_mps == pytest.approx(15.0)


@pytest.mark.parametrize("topic", [JOURNEY, TARGET], ids=lambda topic: topic.name)
def test_a_journey_or_targets_without_stamps_change_nothing(topic: Topic) -> None:
    driven, plain = DrivenNode(), DrivenNode()
    late_ns = START_NS + 500 * S
    told = (
        journey(
            time_ns=START_NS + 1, stops=[*journey().stops[:1], das_pb2.Journey.Stop(s_m=3_000.0, arrival_ns=late_ns)]
        )
        if topic is JOURNEY
        else das_pb2.Targets(time_ns=START_NS + 1, targets=[das_pb2.Targets.Target(stop="B", arrival_ns=late_ns)])
    )
    driven.tell(topic, told, UNSTAMPED)
    assert driven.tick(2) == plain.tick(2)
    assert f"{topic.name}: one without its sender's time stamp" in driven.sink.events()
    assert "was ignored: switch on timestamping in the sender's Zenoh configuration" in driven.sink.events()
    assert driven.tick(3).mode != das_pb2.MODE_NONE
