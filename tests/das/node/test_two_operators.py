"""Two sessions that say what the train is to do: one counts, the other when the first is gone; over real sessions."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.access import LISTENERS, write_bus_folder
from das.bus.config import BusFile
from das.bus.session import Bus, Presence, Presences, endpoint, free_ports
from das.bus.topics import ADVICE, EVENT, JOURNEY, POSITION, RESTRICTION, TARGET, Received, Topic, decoded
from das.cab.guard import MOST_GONE, MOST_RIVALS, Operator
from das.cab.heard import Kind, PublisherSeen, RestrictionsHeard
from tests.support import node_process
from tests.support.driven_node import START_NS, TRAIN, DrivenNode, S, journey, restrictions
from tests.support.node_process import FLAT, a_journey, process

OPERATOR = """
import sys, time
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import RESTRICTION
places = [das_pb2.Restrictions.Restriction(start_m=0.0, end_m=6000.0, limit_mps=float(x)) for x in sys.argv[3:]]
with Bus("T1", listen=sys.argv[1], connect=[sys.argv[2]]) as bus:
    # The clock of this one is an hour behind.
    bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=time.time_ns() - 3600 * 10**9, restrictions=places))
    time.sleep(600)
"""


class Told(DrivenNode):
    """A node of the bus's clock that hears several sessions, and is told by hand which of them are there."""

    def say(self, source: str, topic: Topic, message: Any) -> None:
        self.tell(topic, message, source)

    def see(self, source: str, *, there: bool, topic: Topic = RESTRICTION) -> None:
        self.sink.seen.append(Presence(topic, source, there))


def named_list(source: str, second: float, limit_mps: float | None) -> tuple[str, Topic, Any]:
    if limit_mps is None:
        return source, RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + round(second * S))
    return source, RESTRICTION, restrictions(second, limit_mps)


@pytest.fixture
def cab() -> Told:
    """The session `a` has said 10 m/s everywhere; the list that every cab begins with is of a session that is gone."""
    made = Told()
    made.see("", there=False)
    made.say(*named_list("a", 10, 10.0))
    assert made.tick(11).limit_mps == 10.0
    return made


def test_a_second_operators_list_is_not_heeded_and_advice_waits_while_they_differ(cab: Told) -> None:
    for second in (12, 13, 14):
        cab.say(*named_list("b", second, None))
    silent = cab.tick(15)
    assert (silent.mode, silent.cause) == (das_pb2.MODE_NONE, Cause.TWO_OPERATORS)
    assert silent.reason.text == "two publishers send different restrictions: a and b"
    assert cab.sink.events().count("restriction: two publishers: what b says is not heeded while a is there") == 1
    cab.say(*named_list("b", 16, 10.0))
    assert cab.tick(17).limit_mps == 10.0


def test_when_the_first_is_gone_what_the_other_says_then_counts_whatever_its_clock_says(cab: Told) -> None:
    """Which of the two is right nobody knows: the other one may not have heard of the restriction."""
    cab.say(*named_list("b", -3000, 20.0))
    cab.say(*named_list("b", -2999, 15.0))
    assert cab.tick(13).mode == das_pb2.MODE_NONE
    cab.see("a", there=False)
    cab.say(*named_list("b", -2999, 15.0))  # The bus has kept it, and says it again.
    advice = cab.tick(14)
    assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.TWO_OPERATORS)
    assert advice.reason.text.endswith("a and b; one of them is gone, the other has to send its list again")
    cab.say(*named_list("b", -2998, 15.0))
    assert cab.tick(15).limit_mps == 15.0
    assert "restriction: b counts from now on, a is gone" in cab.sink.events()
    cab.say(*named_list("b", -2990, None))
    assert cab.tick(16).limit_mps > 40.0


def test_when_the_first_is_gone_one_that_said_the_same_counts_at_once(cab: Told) -> None:
    cab.say(*named_list("b", 12, 10.0))
    cab.see("a", there=False)
    assert cab.tick(13).limit_mps == 10.0
    assert "restriction: b counts from now on, a is gone" in cab.sink.events()


def test_when_the_second_is_gone_advice_waits_for_a_list_of_the_first(cab: Told) -> None:
    cab.say(*named_list("b", 12, None))
    assert cab.tick(13).mode == das_pb2.MODE_NONE
    cab.see("b", there=False)
    cab.say(*named_list("a", 10, 10.0))  # The bus has kept it, and says it again.
    assert "one of them is gone" in cab.tick(14).reason.text
    cab.say(*named_list("a", 15, 10.0))
    assert cab.tick(15).limit_mps == 10.0
    cab.say(*named_list("b", 12, None))  # heard late: nobody stands by it any more
    assert cab.tick(16).limit_mps == 10.0


def test_two_that_agree_again_give_advice_though_one_is_gone(cab: Told) -> None:
    cab.say(*named_list("b", 12, 15.0))
    assert cab.tick(12).mode == das_pb2.MODE_NONE
    cab.see("b", there=False)
    cab.say(*named_list("b", 13, 10.0))  # It was on the way when its publisher went.
    assert cab.tick(14).limit_mps == 10.0


def test_an_operator_that_is_gone_and_back_is_the_same_one(cab: Told) -> None:
    cab.see("a", there=False)
    assert cab.tick(12).limit_mps == 10.0
    cab.see("a", there=True)
    cab.say(*named_list("a", 10, 10.0))
    cab.say(*named_list("b", 13, None))
    assert "send different restrictions" in cab.tick(14).reason.text


def test_one_that_was_taken_over_from_and_is_back_is_the_second(cab: Told) -> None:
    cab.see("a", there=False)
    cab.say(*named_list("b", 12, 15.0))
    assert cab.tick(13).limit_mps == 15.0
    cab.see("a", there=True)
    assert "send different restrictions: b and a" in cab.tick(14).reason.text
    cab.say(*named_list("a", 11, 15.0))
    assert cab.tick(15).limit_mps == 15.0


def test_a_second_one_that_was_away_still_says_what_it_said_last(cab: Told) -> None:
    cab.say(*named_list("b", 12, 10.0))
    cab.see("b", there=False)
    assert cab.tick(13).limit_mps == 10.0
    cab.say(*named_list("b", 12, 20.0))  # on the way before it was known that it is back
    assert cab.tick(14).limit_mps == 10.0
    cab.see("b", there=True)
    assert "send different restrictions: a and b" in cab.tick(15).reason.text


def test_what_a_second_session_says_that_cannot_be_read_makes_nobody_the_publisher(cab: Told) -> None:
    cab.node.take(decoded(RESTRICTION, RESTRICTION.key(TRAIN), b"\xff", "b"))
    assert "send different restrictions: a and b" in cab.tick(12).reason.text
    cab.see("b", there=False)
    cab.say(*named_list("a", 13, 10.0))
    assert cab.tick(13).limit_mps == 10.0
    cab.see("a", there=False)
    cab.node.take(decoded(RESTRICTION, RESTRICTION.key(TRAIN), b"\xff", "c"))
    assert "cannot be read" in cab.tick(14).reason.text
    cab.say(*named_list("d", 1, 12.0))
    assert cab.tick(15).limit_mps == 12.0


def test_a_second_operators_journey_and_targets_are_not_heeded_until_the_first_is_gone(cab: Told) -> None:
    """The advice goes on: a journey of the first one is still what was ordered."""
    cab.say("a", TARGET, das_pb2.Targets(time_ns=START_NS))
    late = [das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=START_NS)]
    late.append(das_pb2.Journey.Stop(name="C", s_m=6_000.0, arrival_ns=START_NS + 900 * S))
    cab.say("b", JOURNEY, journey(stops=late))
    cab.say("b", TARGET, das_pb2.Targets(time_ns=START_NS + 12 * S, targets=[{"stop": "B", "arrival_ns": START_NS}]))
    advice = cab.tick(13)
    assert advice.mode != das_pb2.MODE_NONE
    assert "journey A – C" not in cab.sink.events()
    for topic in (JOURNEY, TARGET):
        assert f"{topic.name}: two publishers: what b says is not heeded" in cab.sink.events()
    cab.see("", there=False, topic=JOURNEY)
    cab.tick(14)
    assert "journey A – C" in cab.sink.events()


def test_without_word_of_who_is_there_the_first_publisher_counts(cab: Told) -> None:
    for second in range(12, 40):
        cab.say(*named_list("b", second, None))
        assert "send different restrictions" in cab.tick(second).reason.text


def later(second: float, arrives_s: float) -> Any:
    stops = journey().stops
    stops[1].arrival_ns = START_NS + round(arrives_s * S)
    return journey(time_ns=START_NS + round(second * S), stops=stops)


def test_a_restarted_operator_without_a_token_is_heeded_where_its_journey_is_newer() -> None:
    """The old timetable went on driving the advice before."""
    node = Told(told=False)
    node.say("a", JOURNEY, later(0, 300))
    node.say("a", RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    for second in range(1, 5):
        node.tick(second)
    assert node.sink.events().count("journey: a has no liveliness token") == 1
    assert "publisher_detection=True" in node.sink.events()
    node.say("b", JOURNEY, later(5, 400))
    for second in (5, 6):
        advice = node.tick(second)
    assert "journey: b counts from now on, a has no liveliness token and its order is older" in node.sink.events()
    assert advice.predicted_arrival_ns > START_NS + 350 * S
    node.say("b", JOURNEY, later(7, 320))
    assert node.tick(7).predicted_arrival_ns < START_NS + 350 * S


def test_an_older_journey_of_another_operator_is_not_heeded_nor_one_of_two_that_both_speak() -> None:
    node = Told(told=False)
    node.say("a", RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    node.say("a", JOURNEY, later(4, 300))
    for second in range(1, 7):
        node.tick(second)
    node.say("b", JOURNEY, later(3, 400))
    assert node.tick(7).predicted_arrival_ns < START_NS + 350 * S
    node.say("b", JOURNEY, later(8, 400))
    node.tick(8)
    assert node.tick(9).predicted_arrival_ns > START_NS + 350 * S
    node.say("a", JOURNEY, later(10, 300))  # It is there after all.
    for second in range(10, 15):
        assert node.tick(second).predicted_arrival_ns > START_NS + 350 * S


def test_a_publisher_with_a_token_is_neither_blamed_nor_overtaken() -> None:
    node = Told(told=False)
    node.say("a", RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    node.say("a", JOURNEY, later(0, 300))
    for topic in (JOURNEY, RESTRICTION):
        node.see("a", there=True, topic=topic)
    for second in range(1, 6):
        node.tick(second)
    node.say("b", JOURNEY, later(6, 400))
    for second in range(6, 9):
        assert node.tick(second).predicted_arrival_ns < START_NS + 350 * S
    assert "liveliness" not in node.sink.events()


def test_restrictions_of_a_restarted_operator_without_a_token_count_where_none_is_left_out(cab: Told) -> None:
    for second in range(12, 16):
        cab.tick(second)
    both = [*restrictions(16, 10.0).restrictions, *restrictions(16, 5.0).restrictions]
    cab.say("b", RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + 16 * S, restrictions=both))
    assert cab.tick(16).limit_mps == 5.0
    cab.say(*named_list("a", 17, 10.0))  # It is there after all, and says something else.
    assert "send different restrictions" in cab.tick(17).reason.text


def test_sessions_without_end_are_not_kept_without_end() -> None:
    operator, seen = Operator(), partial(PublisherSeen, kind=Kind.RESTRICTION)

    def message(source: str) -> RestrictionsHeard:
        return RestrictionsHeard(time_ns=1, restrictions=(), source=source)

    assert operator.counts(message("first"))
    for i in range(3 * MOST_GONE):
        assert not operator.counts(message(f"rival {i}"))
    assert (len(operator._said), len(operator._there)) == (MOST_RIVALS + 1, 0)
    assert operator.see(seen(source="first", there=False)) is not None
    for i in range(3 * MOST_GONE):
        operator.see(seen(source=f"other {i}", there=False))
    assert (len(operator._said), len(operator._there)) == (MOST_RIVALS + 1, MOST_GONE)
    assert operator.counts(message("next"))  # It is not forgotten that the first one is gone.
    assert operator.contradiction() == ""


def test_a_session_is_gone_when_its_last_token_is() -> None:
    presences, key = Presences(), RESTRICTION.key(TRAIN)
    for publisher in (6, 7):
        presences.note(RESTRICTION, f"{key}/@adv/pub/ab12/{publisher}/_", there=True)
    assert presences.take() == [Presence(RESTRICTION, "ab12", True)]
    presences.note(RESTRICTION, f"{key}/@adv/pub/ab12/6/_", there=False)
    assert presences.take() == [Presence(RESTRICTION, "ab12", True)]
    presences.note(RESTRICTION, f"{key}/@adv/pub/ab12/7/_", there=False)
    presences.note(RESTRICTION, f"{key}/something/else", there=True)
    assert presences.take() == [Presence(RESTRICTION, "ab12", False)]
    assert presences.take() == []


# --- real sessions -----------------------------------------------------------------------------------------------


def a_list(limit_mps: float | None, behind_s: float = 0.0) -> das_pb2.Restrictions:
    places = [das_pb2.Restrictions.Restriction(start_m=0.0, end_m=6_000.0, limit_mps=limit_mps)] if limit_mps else []
    return das_pb2.Restrictions(time_ns=time.time_ns() - round(behind_s * S), restrictions=places)


def until(
    bus: Bus, wanted: Callable[[Received], bool], child: subprocess.Popen[str], tells_mps: float | None = None
) -> Any:
    """The first message that is wanted, while the train stands at its departure stop, and is told a limit."""

    def stand() -> None:
        if tells_mps is not None:
            bus.publish(RESTRICTION, a_list(tells_mps))
        bus.publish(POSITION, das_pb2.Position(time_ns=time.time_ns(), s_m=0.0, speed_mps=0.0))

    return node_process.until(bus, wanted, child, stand)


def limited(limit_mps: float) -> Callable[[Received], bool]:
    return lambda r: r.topic is ADVICE and r.message.mode != das_pb2.MODE_NONE and r.message.limit_mps == limit_mps


def contested(received: Received) -> bool:
    return received.topic is ADVICE and received.message.cause == Cause.TWO_OPERATORS


@contextmanager
def started(simulator: Bus, *places: str) -> Iterator[subprocess.Popen[str]]:
    simulator.publish(JOURNEY, a_journey(time.time_ns() - 60 * S, 660.0))
    arguments = (*FLAT, "--train", TRAIN, "--rate", "5", *places)
    with process("das.node", *arguments) as child:
        yield child


@contextmanager
def operator(at: str, node_at: str, *limits: str) -> Iterator[subprocess.Popen[bytes]]:
    child = subprocess.Popen([sys.executable, "-c", OPERATOR, at, node_at, *limits])
    try:
        yield child
    finally:
        child.kill()
        child.wait()


@pytest.mark.nightly
def test_operators_that_are_killed_and_come_back_over_the_bus() -> None:
    node_at, simulator_at, first_at, second_at = (endpoint(port) for port in free_ports(4))
    connect = [word for at in (simulator_at, first_at, second_at) for word in ("--connect", at)]
    with (
        Bus(TRAIN, listen=simulator_at, connect=[node_at], hear=(ADVICE, EVENT)) as simulator,
        started(simulator, "--listen", node_at, *connect) as child,
    ):
        with operator(first_at, node_at, "10"):
            until(simulator, limited(10.0), child)
            with Bus(TRAIN, listen=second_at, connect=[node_at]) as second:
                second.publish(RESTRICTION, a_list(None))
                until(simulator, contested, child)
                second.publish(RESTRICTION, a_list(10.0))
                until(simulator, limited(10.0), child)
        # Killed: its list is kept till another comes, which is heeded though its clock is an hour behind.
        with operator(first_at, node_at, "12"):
            until(simulator, limited(12.0), child)
            with Bus(TRAIN, listen=second_at, connect=[node_at]) as second:
                second.publish(RESTRICTION, a_list(15.0, behind_s=7200.0))
                until(simulator, contested, child)
                second.publish(RESTRICTION, a_list(12.0, behind_s=7100.0))
                until(simulator, limited(12.0), child)
                second.publish(RESTRICTION, a_list(20.0, behind_s=7000.0))
                until(simulator, contested, child)


@pytest.mark.nightly
def test_nodes_that_are_started_anew_agree_that_two_living_operators_differ() -> None:
    """Whichever of the two lists each of them hears first."""
    node_at, simulator_at, first_at, second_at = (endpoint(port) for port in free_ports(4))
    connect = [word for at in (simulator_at, first_at, second_at) for word in ("--connect", at)]
    with Bus(TRAIN, listen=simulator_at, connect=[node_at], hear=(ADVICE,)) as simulator:
        with (
            Bus(TRAIN, listen=first_at, connect=[node_at]) as first,
            Bus(TRAIN, listen=second_at, connect=[node_at]) as second,
        ):
            first.publish(RESTRICTION, a_list(10.0))
            second.publish(RESTRICTION, a_list(None))
            for _ in range(2):
                with started(simulator, "--listen", node_at, *connect) as child:
                    until(simulator, contested, child)
        with (
            Bus(TRAIN, listen=first_at, connect=[node_at]) as first,
            started(simulator, "--listen", node_at, *connect) as child,
        ):
            first.publish(RESTRICTION, a_list(10.0))
            until(simulator, limited(10.0), child)


@pytest.mark.slow
def test_who_is_there_is_known_over_mutual_tls_with_access_control(tmp_path: Path) -> None:
    ports = dict(zip(LISTENERS, free_ports(len(LISTENERS)), strict=True))
    folder = tmp_path / "bus"
    write_bus_folder(folder, TRAIN, ports, days=1.0)
    site = {"hear": (ADVICE, EVENT), "file": BusFile(folder / "simulator.json5")}
    with Bus(TRAIN, **site) as simulator, started(simulator, "--bus", str(folder / "node.json5")) as child:  # type: ignore[arg-type]
        simulator.publish(RESTRICTION, a_list(10.0))
        until(simulator, limited(10.0), child)
        second = Bus(TRAIN, file=BusFile(folder / "simulator.json5"))
        second._config.insert_json5("listen/endpoints", "[]")
        with second:
            second.publish(RESTRICTION, a_list(None))
            until(simulator, contested, child)
        until(simulator, limited(10.0), child, tells_mps=10.0)
