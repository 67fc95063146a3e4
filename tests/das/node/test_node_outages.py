"""The node while the processes around it are killed, frozen and come back; and told by a clock that jumps."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from das.bus import das_pb2
from das.bus.recorder import RecordingFile
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, EVENT, JOURNEY, PLAN, POSITION, RECORDER, RESTRICTION, STATUS, Received, decoded
from das.cab.cab import Cab
from das.cab.orders import Post, Trains
from das.cab.outputs import MOST_A_SECOND
from das.cab.situation import Situation
from das.domain.errors import DasError
from das.node.node import Node, WallClock
from sim.world.lockstep import Process
from tests.support.driven_node import FRONTS, ROUTE, START_NS, TRAIN, VEHICLE, S, Sink, journey
from tests.support.hand_clock import HandClock
from tests.support.node_process import FLAT, until

TIMEOUT_S = 120.0
LONGER_THAN_THE_LEASE_S = 2.5
SIMULATOR = """
import sys, time
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import JOURNEY, POSITION
with Bus("T1", listen=sys.argv[1], connect=sys.argv[2:]) as bus:
    stops = [
        das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=time.time_ns() - 60 * 10**9),
        das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=time.time_ns() + 300 * 10**9),
    ]
    train = dict(route_id="flat-6km", vehicle_id="re460-ic")
    bus.publish(JOURNEY, das_pb2.Journey(time_ns=time.time_ns(), stops=stops, **train))
    while True:
        bus.publish(POSITION, das_pb2.Position(time_ns=time.time_ns(), s_m=0.0, speed_mps=0.0))
        time.sleep(0.2)
"""


@contextmanager
def python(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process whose log is on a full disk."""
    with open("/dev/full", "wb") as full:
        child = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL, stderr=full)
    try:
        yield child
    finally:
        child.kill()
        child.wait()


def given(received: Received) -> bool:
    return received.topic is ADVICE and received.message.mode != das_pb2.MODE_NONE


def withdrawn(received: Received) -> bool:
    return received.topic is ADVICE and received.message.mode == das_pb2.MODE_NONE


@pytest.mark.nightly
def test_simulator_recorder_and_node_killed_or_frozen_and_back(tmp_path: Path) -> None:
    """Every process in turn, the log of all of them on a full disk."""
    node_at, simulator_at, recorder_at, cab_at = (endpoint(port) for port in free_ports(4))
    others = [word for at in (simulator_at, recorder_at, cab_at) for word in ("--connect", at)]
    of_node = ("-m", "das.node", *FLAT, "--train", TRAIN, "--rate", "5", "--listen", node_at, *others)
    none = das_pb2.Restrictions(time_ns=time.time_ns())
    of_simulator = ("-c", SIMULATOR, simulator_at, node_at)
    of_recorder = ("--train", TRAIN, "--listen", recorder_at, "--connect", node_at, "--out", str(tmp_path / "run.mcap"))
    with (
        Bus(TRAIN, listen=cab_at, connect=[node_at, recorder_at], hear=(ADVICE, RECORDER)) as bus,
        python(*of_node) as node,
        python("-m", "das.recorder", *of_recorder) as recorder,
        python(*of_simulator) as simulator,
    ):
        bus.publish(RESTRICTION, none)
        until(bus, given)
        until(bus, lambda r: r.topic is RECORDER and r.message.messages > 0)
        recorder.kill()
        later_ns = time.time_ns() + S
        until(bus, lambda r: given(r) and r.message.time_ns > later_ns)

        simulator.send_signal(signal.SIGSTOP)
        assert "s old" in until(bus, withdrawn).reason.text
        simulator.send_signal(signal.SIGCONT)
        until(bus, given)
        simulator.kill()
        assert "s old" in until(bus, withdrawn).reason.text
        with python(*of_simulator):
            until(bus, given)
            node.send_signal(signal.SIGSTOP)
            time.sleep(LONGER_THAN_THE_LEASE_S)
            one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=3_500.0, limit_mps=15.0)
            bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=time.time_ns(), restrictions=[one]))
            node.send_signal(signal.SIGCONT)
            assert until(bus, lambda r: given(r) and r.message.limit_mps == 15.0).advised_speed_mps <= 15.0
        node.send_signal(signal.SIGTERM)
        assert node.wait(20) == 0


@pytest.mark.nightly
def test_a_disk_that_is_full_when_only_the_summary_is_missing_is_said(tmp_path: Path) -> None:
    """The recorder may write as many bytes as one message takes, but not what makes the file whole."""
    resource = pytest.importorskip("resource")
    ours, theirs = (endpoint(port) for port in free_ports(2))
    status, key, out = das_pb2.Status(time_ns=S), STATUS.key(TRAIN), tmp_path / "run.mcap"
    unfinished = RecordingFile(tmp_path / "unfinished.mcap")
    unfinished.add(STATUS, key, status, S)
    unfinished.flush()
    taken = (tmp_path / "unfinished.mcap").stat().st_size
    unfinished.close()
    room = (taken + (tmp_path / "unfinished.mcap").stat().st_size) // 2
    of_recorder = ("--train", TRAIN, "--listen", theirs, "--connect", ours, "--out", str(out))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))  # who is started inherits it
    try:
        recorder = Process("recorder", "das.recorder", of_recorder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    with recorder, Bus(TRAIN, listen=ours, connect=[theirs], hear=(RECORDER,)) as bus:
        bus.publish(STATUS, status)
        until(bus, lambda r: r.topic is RECORDER and r.message.messages == 1)
        deadline = time.monotonic() + TIMEOUT_S
        while out.stat().st_size < 0.8 * taken and time.monotonic() < deadline:  # till the message is on the disk
            recorder.check()
            time.sleep(0.05)
        with pytest.raises(DasError, match=r"the recorder ended: .*run\.mcap: cannot be written \(File too large\)"):
            recorder.finish()


@pytest.mark.nightly
def test_a_node_that_is_stopped_while_it_compiles_ends_at_once(tmp_path: Path) -> None:
    ours, theirs = (endpoint(port) for port in free_ports(2))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "das.node", *FLAT, "--train", TRAIN, "--listen", theirs, "--connect", ours]
    with Bus(TRAIN, listen=ours, connect=[theirs], hear=(STATUS,)) as bus:
        child = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        assert bus.receive(TIMEOUT_S) is not None  # starting
        child.send_signal(signal.SIGTERM)
        said = child.communicate(timeout=TIMEOUT_S)[1]
    assert (child.returncode, said) == (130, "stopped\n")


class WallNode:
    """A node without sockets that goes by a clock which the test sets; its train stood two hours before."""

    def __init__(self) -> None:
        self.sink, self.clock = Sink(), HandClock(START_NS)
        post = Post(train=TRAIN, route=ROUTE, trains=Trains(VEHICLE, VEHICLE))
        cab = Cab(post, Situation(route=ROUTE, vehicle=VEHICLE), FRONTS)
        self.node = Node(self.sink, cab, WallClock(self.clock.clocks))  # type: ignore[arg-type]
        self.tell(POSITION, das_pb2.Position(time_ns=START_NS - 7_200 * S, s_m=0.0, speed_mps=0.0))

    def tell(self, topic: Any, message: Any) -> None:
        self.node.take(decoded(topic, topic.key(TRAIN), message.SerializeToString(), "simulator"))

    def tick(self) -> Any:
        """The advice for the moment that the clock shows."""
        self.node.tick(self.clock())
        return self.sink.of(ADVICE)[-1]

    def run_at(self, time_ns: int, s_m: float) -> Any:
        """Set the clock, tell a position, and take the advice."""
        self.clock.time_ns = time_ns
        self.tell(POSITION, das_pb2.Position(time_ns=time_ns, s_m=s_m, speed_mps=10.0))
        return self.tick()


def test_a_node_whose_clock_was_wrong_when_it_was_told_knows_it_when_the_clock_is_right() -> None:
    one = das_pb2.Restrictions.Restriction(start_m=500.0, end_m=3_500.0, limit_mps=15.0)
    driven = WallNode()
    driven.clock.time_ns = START_NS - 3600 * S
    driven.tell(JOURNEY, journey())
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS, restrictions=[one]))
    assert "3600 s ahead of the clock" in driven.tick().reason.text
    advice = driven.run_at(START_NS + S, 1_000.0)
    assert advice.mode != das_pb2.MODE_NONE
    assert advice.limit_mps == 15.0


def test_a_clock_set_back_does_not_hold_back_the_plan() -> None:
    driven = WallNode()
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=1))
    driven.tell(JOURNEY, journey())
    for moment_ns, plans in ((START_NS, 1), (START_NS + S, 1), (START_NS - 3600 * S, 2)):
        driven.run_at(moment_ns, 1_000.0)
        if moment_ns < START_NS:  # the state from ahead of the clock was forgotten
            driven.run_at(moment_ns + S, 1_010.0)
        assert len(driven.sink.of(PLAN)) == plans


def test_what_a_flood_costs_and_what_is_refused_is_said_in_moderation() -> None:
    driven = WallNode()
    for i in range(40):
        driven.sink.dropped += 10
        driven.clock.time_ns = START_NS + i * S // 20
        driven.tick()
        driven.tell(JOURNEY, journey(route_id=f"elsewhere {i}", stops=[]))
    events = [one.message for one in driven.sink.of(EVENT)]
    assert sum(text.startswith("journey refused") for text in events) == 2 * MOST_A_SECOND
    assert sum(text.startswith("no advice: journey refused") for text in events) == 1
    driven.clock.time_ns = START_NS + 3 * S
    driven.tick()
    dropped = [one.message for one in driven.sink.of(EVENT) if "dropped" in one.message]
    assert dropped == [f"{n} messages were dropped: too many at once" for n in (10, 200, 190)]
