"""The node: as a real process over real Zenoh on loopback, and without sockets where no process is needed."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from das.advice.goal import UNHURRIED_S
from das.advice.reason import Reason
from das.advice.wording import words
from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EVENT,
    JOURNEY,
    PLAN,
    POSITION,
    RESTRICTION,
    STATUS,
    TARGET,
    Received,
    decoded,
)
from tests.support import driven_node
from tests.support.driven_node import DrivenNode, S
from tests.support.making import REPOSITORY
from tests.support.node_process import FLAT, START_NS, TRAIN, a_journey, node, process, refused, status, until

READY = das_pb2.Status.STATE_READY


def test_node_takes_a_journey_advises_at_ticks_and_finishes_when_told() -> None:
    with node("--clock", "bus", journey=a_journey()) as (bus, child):
        ready = until(bus, status(READY), child)
        assert ready.section.startswith("flat-6km 0–6000 m, re460-ic")
        assert ready.solve_s == 0.0  # the same on every machine
        states = [(1, 0.0, 0.0), (6, 10.0, 4.0), (80, 2_000.0, 35.0), (160, 5_000.0, 36.0)]
        for tick, (second, s_m, speed) in enumerate(states, 1):
            now = START_NS + second * S
            bus.publish(POSITION, das_pb2.Position(time_ns=now, s_m=s_m, speed_mps=speed))
            bus.publish(DELAY, das_pb2.Delay(time_ns=now, delay_s=5.0))
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=tick))
            advice = until(bus, lambda r: r.topic is ADVICE, child)
            assert (advice.tick, advice.time_ns) == (tick, now)
            assert advice.s_m == pytest.approx(s_m, abs=0.5)
            assert 0 < advice.position_sd_m <= 10.0  # nothing is said of quality and uncertainty
            assert advice.mode != das_pb2.MODE_NONE
            assert advice.source == das_pb2.Advice.SOURCE_SOLVED
            assert len(advice.horizon_speed_mps) == len(advice.horizon_force_n) == 30
            assert advice.advised_speed_mps <= advice.limit_mps + 1e-9
            assert advice.valid_until_ns > now
            if tick == 1:
                assert words(Reason.read(advice.reason)) == "least energy on time, operator says 5 s late"
        bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=9, command=das_pb2.Control.COMMAND_FINISH))
        assert child.wait(20) == 0


@pytest.mark.slow
def test_node_advises_once_a_second_by_the_wall_clock_and_does_not_obey_control() -> None:
    with node() as (bus, child):
        first = until(bus, lambda r: r.topic is ADVICE, child)
        second = until(bus, lambda r: r.topic is ADVICE, child)
        assert first.mode == das_pb2.MODE_NONE
        assert first.reason.text == "no journey yet"
        said = until(bus, lambda r: r.topic is STATUS and r.message.advices > 0, child)
        assert 0 < said.solve_s < 60
        assert 0 < said.last_advice_s < 10
        assert (second.time_ns - first.time_ns) * 1e-9 == pytest.approx(1.0, abs=0.4)
        bus.publish(CONTROL, das_pb2.Control(time_ns=5, tick=1, command=das_pb2.Control.COMMAND_FINISH))
        for _ in range(2):
            assert until(bus, lambda r: r.topic is ADVICE, child).time_ns > START_NS // 2
        child.send_signal(signal.SIGTERM)
        assert child.wait(20) == 0


def test_node_heeds_restrictions_targets_train_and_level() -> None:
    """A tick waits until the restrictions and targets that were sent before it are heard."""
    one = das_pb2.Restrictions.Restriction(start_m=2_500.0, end_m=3_500.0, limit_mps=15.0)
    target = das_pb2.Targets.Target(stop="B", arrival_ns=START_NS + 320 * S)
    driven = DrivenNode(told=False)
    driven.tell(JOURNEY, driven_node.journey(vehicle_id="re460-ic-igbt", level="l2"))
    assert "re460-ic-igbt, l2" in driven.sink.of(STATUS)[-1].section
    driven.tell(POSITION, das_pb2.Position(time_ns=START_NS, s_m=0.0, speed_mps=0.0))

    def ask(tick: int) -> None:
        told_ns = START_NS + tick * S
        driven.tell(POSITION, das_pb2.Position(time_ns=told_ns + 60 * S, s_m=2_600.0 + 14.0 * tick, speed_mps=14.0))
        told = {"restrictions_ns": told_ns, "targets_ns": START_NS + S}
        driven.tell(CONTROL, das_pb2.Control(time_ns=told_ns + 60 * S, tick=tick, **told))

    ask(1)
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + S, restrictions=[one]))
    assert driven.sink.of(ADVICE) == []
    driven.tell(TARGET, das_pb2.Targets(time_ns=START_NS + S, targets=[target]))
    advice = driven.last_advice()
    assert advice.tick == 1
    assert advice.limit_mps == 15.0
    assert advice.advised_speed_mps <= 15.0
    assert advice.predicted_arrival_ns >= START_NS + 318 * S
    ask(2)
    one.limit_mps = -1.0
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + 2 * S, restrictions=[one]))
    assert "restriction" in driven.sink.events()
    assert driven.last_advice().tick == 2
    assert "restrictions cannot be applied" in driven.last_advice().reason.text


def test_a_node_that_is_restarted_takes_up_what_is_in_force() -> None:
    one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=3_500.0, limit_mps=15.0)
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = [*FLAT, "--train", TRAIN, "--listen", theirs, "--connect", ours, "--rate", "5"]
    with Bus(TRAIN, listen=ours, connect=[theirs], hear=(ADVICE, STATUS)) as bus:

        def stand() -> None:
            bus.publish(POSITION, das_pb2.Position(time_ns=time.time_ns(), s_m=0.0, speed_mps=0.0))

        start_ns = time.time_ns()
        bus.publish(JOURNEY, a_journey(start_ns - 60 * S, 260.0))
        bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=start_ns, restrictions=[one]))
        for _ in range(2):
            with process("das.node", *arguments) as child:

                def advised(received: Received, since_ns: int = time.time_ns()) -> bool:
                    is_advice = received.topic is ADVICE and received.message.time_ns > since_ns
                    return is_advice and received.message.limit_mps == 15.0

                assert until(bus, advised, child, stand).advised_speed_mps <= 15.0


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--route", "nowhere"], "nowhere: not a bundled route"),
        (["--clock", "moon"], "'moon' is not one of 'wall', 'bus'"),
        (["--train", "a/b"], "train name 'a/b'"),
        (["--rate", "9"], "--rate 9: expected 0.2 to 5 Hz"),
        (["--tables", "/nowhere"], "no such folder of tables"),
        (["--tables", "/nowhere", "--no-guide"], "--tables /nowhere: tables have the guide's departures: expected no"),
        (["--listen", "tcp/0.0.0.0:7447"], "the bus stays on this machine"),
    ],
)
def test_node_refuses_bad_arguments_in_one_line(arguments: list[str], message: str) -> None:
    assert message in refused("das.node", *FLAT, *arguments)


@pytest.mark.nightly
def test_node_says_when_its_port_is_taken() -> None:
    taken = endpoint(free_ports(1)[0])
    with Bus(TRAIN, listen=taken):
        said = refused("das.node", *FLAT, "--listen", taken)
    assert f"bus: cannot open {taken}" in said
    assert "in use" in said


@pytest.mark.nightly
def test_the_example_of_the_documentation_is_advised() -> None:
    example = (REPOSITORY / "docs" / "examples" / "connect.py").read_text(encoding="utf-8")
    ours, theirs = (endpoint(port) for port in free_ports(2))
    example = example.replace("tcp/127.0.0.1:7448", ours).replace("tcp/127.0.0.1:7447", theirs)
    with process("das.node", *FLAT, "--train", "IC1", "--listen", theirs, "--connect", ours) as child:
        user = subprocess.Popen([sys.executable, "-u", "-c", example], stdout=subprocess.PIPE, text=True)
        assert user.stdout is not None
        said = ""
        while "least energy on time" not in said:
            said = user.stdout.readline()
            assert said, "the example ended"
        assert float(said.split(": ")[1].removesuffix(" km/h\n")) > 0
        user.kill()
        user.communicate()
        child.send_signal(signal.SIGTERM)
        heard = child.communicate(timeout=30)[0]
    assert "IC1: journey A – B" in heard


@contextmanager
def own_publisher(old: str = "", new: str = "") -> Iterator[tuple[Bus, subprocess.Popen[str]]]:
    """A node, a listener beside it, and docs/examples/own_publisher.py with a part of it replaced."""
    example = (REPOSITORY / "docs" / "examples" / "own_publisher.py").read_text(encoding="utf-8")
    assert old in example
    ours, theirs, mine = (endpoint(port) for port in free_ports(3))
    example = example.replace("tcp/127.0.0.1:7448", ours).replace("tcp/127.0.0.1:7447", theirs).replace(old, new)
    with (
        process("das.node", *FLAT, "--train", "IC1", "--listen", theirs, "--connect", ours) as child,
        Bus("IC1", listen=mine, connect=[theirs], hear=[ADVICE, EVENT]) as bus,
    ):
        user = subprocess.Popen([sys.executable, "-u", "-c", example])
        try:
            yield bus, child
        finally:
            user.kill()
            user.communicate()


def test_the_publisher_of_the_documentation_is_heeded_and_not_complained_of() -> None:
    """The page's program uses Zenoh alone; the node advises from it and complains of nothing."""
    begun: list[int] = []

    def advised_for_some_time(received: Received) -> bool:
        if received.topic is ADVICE and received.message.mode != das_pb2.MODE_NONE:
            begun.append(received.message.time_ns)
        return bool(begun) and begun[-1] - begun[0] > 5 * 10**9

    with own_publisher() as (bus, child):
        until(bus, advised_for_some_time, child)
        child.send_signal(signal.SIGTERM)
        said = child.communicate(timeout=30)[0]  # All that the node said, also before the listener was there.
    assert "journey A – B" in said
    wrong = ("liveliness", "sender's time stamp", "ignored", "times what", "not heeded", "refused")
    assert [word for word in wrong if word in said] == []


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("old", "new", "cure"),
    [
        ("publisher_detection=True", "publisher_detection=False", "journey: .* has no liveliness token: .*publisher_d"),
        ("speed_mps=speed_mps", "speed_mps=3.6 * speed_mps", "are 3.6 times what the positions cover: send m/s, not k"),
    ],
)
def test_a_publisher_that_lacks_something_is_told_the_cure(old: str, new: str, cure: str) -> None:
    with own_publisher(old, new) as (bus, child):
        until(bus, lambda r: r.topic is EVENT and re.search(cure, r.message.message) is not None, child)


# --- without sockets ---------------------------------------------------------------------------------------------


def test_node_publishes_its_plan_and_events_and_is_finished_when_told() -> None:
    driven = DrivenNode()
    assert "journey A – B" in driven.sink.events()
    driven.tell(POSITION, das_pb2.Position(time_ns=START_NS, s_m=0.0, speed_mps=0.0))
    driven.tell_time(0)
    (plan,) = driven.sink.of(PLAN)
    assert len(plan.s_m) == len(plan.t_s) == len(plan.speed_mps) == len(plan.force_n) > 50
    assert plan.t_s[-1] == pytest.approx(300.0 + UNHURRIED_S, abs=0.3)
    assert not driven.node.finished
    driven.tell(CONTROL, das_pb2.Control(time_ns=START_NS, tick=2, command=das_pb2.Control.COMMAND_FINISH))
    assert driven.node.finished


def test_node_says_that_positions_are_rejected_and_the_estimate_restarted() -> None:
    driven = DrivenNode()
    for second in range(61, 69):
        driven.tick(second, 20.0 * second + (500.0 if second > 63 else 0.0))
    assert [text for text in driven.sink.events().splitlines() if text.startswith("position")] == [
        "position: rejected, the position jumped by 500 m",
        "position: estimate restarted at 1840 m",
    ]


@pytest.mark.parametrize("stated_mps", [0.0, 0.02])
@pytest.mark.parametrize("factor", [1.0, 3.6])
def test_a_node_started_on_a_running_train_advises_once_the_way_has_confirmed_the_speed(
    factor: float, stated_mps: float
) -> None:
    """Speeds in km/h were taken for m/s in the first three advices, however exact their sender said they were."""
    driven, advised, why = DrivenNode(stood=False), [], []
    for second in range(61, 91):
        now_ns, said_mps = START_NS + second * S, 11.0 * factor
        position = das_pb2.Position(
            time_ns=now_ns, s_m=11.0 * second, speed_mps=said_mps, speed_uncertainty_mps=stated_mps
        )
        driven.tell(POSITION, position, "sensors")
        driven.tell_time(second)
        advised.append(driven.last_advice().mode != das_pb2.MODE_NONE)
        why.append(driven.last_advice().reason.text)
    assert why[:3] == ["the speed is not yet confirmed by the way"] * 3
    if factor == 1.0:
        assert advised == [False] * 5 + [True] * 25
    else:
        assert not any(advised)
        assert why[-1].startswith("the speeds are 3.6 times what the positions cover")


def stops(*times: tuple[float, float | None, float | None]) -> dict[str, Any]:
    """Stops by position (m), arrival and departure (s)."""
    made = [das_pb2.Journey.Stop(s_m=s_m) for s_m, _, _ in times]
    for stop, (_, arrival_s, departure_s) in zip(made, times, strict=True):
        if arrival_s is not None:
            stop.arrival_ns = START_NS + round(arrival_s * S)
        if departure_s is not None:
            stop.departure_ns = START_NS + round(departure_s * S)
    return {"stops": made}


REFUSED: dict[str, dict[str, Any]] = {
    "it is for route 'elsewhere', this node has 'flat-6km'": {"route_id": "elsewhere"},
    "it is for the route in reverse, but this node is set to forwards": {"reversed": True},
    "it is for train 'T2', this node is for 'T1'": {"train": "T2"},
    "expected one in the direction of the route": stops((0.0, None, 0.0), (1e10, 300.0, None)),
    "it has 1 stops, expected at least 2": stops((0.0, None, None)),
    "it is for vehicle '../x', this node knows CH_Stadler_FLIRT_TPF, CH_Stadler_KISS_SBB": {"vehicle_id": "../x"},
    "no load 'full'": {"load": "full"},
    "level 'l9': expected one of l0-noreg": {"level": "l9"},
    "timetable: the departure from stop 2 is before the arrival there": stops(
        (0.0, None, 0.0), (3e3, 200.0, 199.0), (6e3, 400.0, None)
    ),
    "the arrival is not after the departure": stops((0.0, None, 0.0), (6e3, 0.0, None)),
    "the first stop has no departure": stops((0.0, None, None), (6e3, 0.0, None)),
    "the last stop has no arrival": stops((0.0, None, 0.0), (6e3, None, None)),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_a_journey_that_cannot_be_driven_is_refused_with_the_reason(reason: str) -> None:
    driven = DrivenNode()
    driven.tell(JOURNEY, driven_node.journey(**REFUSED[reason]))
    said, silent = driven.sink.of(STATUS)[-1], driven.tick(51)
    for text in (said.reason, silent.reason.text):
        assert text.startswith("journey refused: ")
        assert reason in text
    assert (said.state, silent.mode) == (das_pb2.Status.STATE_WITHDRAWN, das_pb2.MODE_NONE)
    driven.tell(JOURNEY, driven_node.journey())
    assert driven.tick(52).mode != das_pb2.MODE_NONE


def test_node_survives_times_at_the_ends_of_the_clock() -> None:
    driven, last = DrivenNode(), 2**63 - 1
    for now in (last, -last, 0):
        message = driven_node.journey()
        message.stops[1].arrival_ns = last
        driven.tell(JOURNEY, message)
        driven.tell(POSITION, das_pb2.Position(time_ns=now, s_m=10.0, speed_mps=4.0))
        driven.tell(CONTROL, das_pb2.Control(time_ns=now, tick=1))
    driven.tell(JOURNEY, driven_node.journey())
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    assert [driven.tick(second).mode != das_pb2.MODE_NONE for second in (50, 51, 52)][-1]


def test_node_ignores_what_it_cannot_read_and_says_so() -> None:
    driven = DrivenNode()
    driven.node.take(decoded(POSITION, POSITION.key(TRAIN), b"\xff\xff\xff\xff"))
    driven.tick(51)
    assert "position: a message that cannot be read" in driven.sink.events()
