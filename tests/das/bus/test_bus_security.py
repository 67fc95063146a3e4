"""The bus over mutual TLS with access control: node and recorder as real processes, and those who should not get in."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zenoh

from das.bus import codec, das_pb2
from das.bus.access import LISTENERS, bus_folder, write_bus_folder
from das.bus.config import BusFile
from das.bus.recording import read_recording
from das.bus.session import Bus, free_ports
from das.bus.topics import (
    ADVICE,
    EFFORT,
    EVENT,
    JOURNEY,
    POSITION,
    RECORDER,
    RESTRICTION,
    STATUS,
    Received,
    Topic,
    decoded,
)
from das.cab.heard import JourneyHeard
from sim.world.lockstep import Lockstep, Processes

TRAIN = "T1"
TIMEOUT_S = 120.0
LOG_TIMEOUT_S = 20.0
REFUSED = "zenoh_link_tls::unicast"
"""In the line in which Zenoh logs a connection that it refused."""
RUST_LOG = "warn,zenoh::net::routing::hat=error,zenoh::net::routing::interceptor=trace"
ROUTE = ("--route", "flat-6km", "--vehicle", "re460-ic")


@dataclass
class Site:
    """A node and a recorder with certificates of their own, and the simulator's side in this process."""

    folder: Path
    foreign: Path
    simulator: Bus
    cab: Bus
    said: dict[str, Path]
    recording: Path
    processes: dict[str, subprocess.Popen[bytes]]

    def log(self, name: str) -> str:
        return self.said[name].read_text()

    def until_logged(self, name: str, text: str) -> None:
        deadline = time.monotonic() + LOG_TIMEOUT_S
        while text not in self.log(name):
            assert time.monotonic() < deadline, f"{text!r} is not in what the {name} said:\n{self.log(name)}"
            self.drive()
            time.sleep(0.1)

    def drive(self, s_m: float = 0.0) -> None:
        """Say where the train stands, as the simulator may."""
        now_ns = time.time_ns()
        self.simulator.publish(POSITION, das_pb2.Position(time_ns=now_ns, s_m=s_m, speed_mps=0.0))

    def until(self, bus: Bus, wanted: Callable[[Received], bool]) -> Any:
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            received = bus.receive(0.2)
            if received is not None and received.message is not None and wanted(received):
                return received.message
            for name, process in self.processes.items():
                assert process.poll() is None, self.log(name)
            self.drive()
        return pytest.fail("waited too long\n" + self.log("node"))


def start(module: str, said: Path, *arguments: str) -> subprocess.Popen[bytes]:
    with said.open("wb") as log:
        command = [sys.executable, "-m", module, "--train", TRAIN, *arguments]
        return subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "RUST_LOG": RUST_LOG})


def journey(now_ns: int) -> das_pb2.Journey:
    stops = [
        das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=now_ns),
        das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=now_ns + 600 * 10**9),
    ]
    return das_pb2.Journey(time_ns=now_ns, train=TRAIN, route_id="flat-6km", vehicle_id="re460-ic", stops=stops)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    base = tmp_path_factory.mktemp("site")
    ports = dict(zip(LISTENERS, free_ports(len(LISTENERS)), strict=True))
    folder, foreign, out = base / "bus", base / "foreign", base / "run.mcap"
    for path in (folder, foreign):
        write_bus_folder(path, TRAIN, ports, days=1.0)
    said = {name: base / f"{name}.log" for name in ("node", "recorder")}
    with ExitStack() as stack:
        simulator = stack.enter_context(
            Bus(TRAIN, hear=(STATUS, RECORDER, ADVICE, EVENT), file=BusFile(folder / "simulator.json5"))
        )
        # Before there is a node: it has to fetch the journey when it comes, which access control must let it.
        simulator.publish(JOURNEY, journey(time.time_ns()))
        simulator.publish(RESTRICTION, das_pb2.Restrictions(time_ns=time.time_ns()))
        cab = stack.enter_context(Bus(TRAIN, hear=(ADVICE, POSITION), file=BusFile(folder / "cab.json5")))
        node = start("das.node", said["node"], *ROUTE, "--bus", str(folder / "node.json5"))
        out_arguments = ("--out", str(out), "--bus", str(folder / "recorder.json5"))
        recorder = start("das.recorder", said["recorder"], *out_arguments)
        processes = {"node": node, "recorder": recorder}
        for process in processes.values():
            stack.callback(process.wait)
            stack.callback(process.kill)
        made = Site(folder, foreign, simulator, cab, said, out, processes)
        # Whichever test is the first one: both are there.
        made.until(simulator, lambda r: r.topic is RECORDER)
        made.until(simulator, lambda r: r.topic is STATUS and r.message.state == das_pb2.Status.STATE_ADVISING)
        yield made


def attacker(path: Path, **tls: Any) -> zenoh.Config:
    """The configuration of one who has the files of a role and does as he likes: no access control of his own."""
    config = BusFile(path).config(TRAIN)
    config.insert_json5("access_control/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    for key, value in tls.items():
        config.insert_json5(f"transport/link/tls/{key}", json.dumps(value))
    return config


def tried(config: zenoh.Config, puts: dict[str, bytes], seconds: float = 1.0) -> int:
    """Say things on a session of one's own for a while; returns how many peers it got."""
    with zenoh.open(config) as session:
        end = time.monotonic() + seconds
        peers = 0
        while time.monotonic() < end:
            peers = max(peers, len(session.info.peers_zid()))
            for key, payload in puts.items():
                session.put(key, payload)
            time.sleep(0.1)
        return peers


FALSE_POSITION = das_pb2.Position(time_ns=2**62, s_m=5_999.0, speed_mps=1.0).SerializeToString()
FALSE_ADVICE = das_pb2.Advice(mode=das_pb2.MODE_FULL_TRACTION, reason=das_pb2.Reason(text="false")).SerializeToString()


def advised(site: Site) -> Any:
    while site.simulator.receive(0) is not None:
        pass
    return site.until(site.simulator, lambda r: r.topic is ADVICE and r.message.mode != das_pb2.MODE_NONE)


def test_who_may_is_heard_and_the_node_that_comes_late_gets_the_journey(site: Site) -> None:
    site.until(site.simulator, lambda r: r.topic is STATUS and r.message.state == das_pb2.Status.STATE_ADVISING)
    site.until(site.simulator, lambda r: r.topic is RECORDER and r.message.messages > 0)
    assert advised(site).s_m == pytest.approx(0.0, abs=100.0)
    site.until(site.cab, lambda r: r.topic is ADVICE and r.message.mode != das_pb2.MODE_NONE)
    assert REFUSED not in site.log("node") + site.log("recorder")


def test_a_foreign_authority_is_refused_and_logged(site: Site) -> None:
    before = site.log("node").count(REFUSED)
    assert tried(attacker(site.foreign / "simulator.json5"), {POSITION.key(TRAIN): FALSE_POSITION}) == 0
    assert site.log("node").count(REFUSED) > before
    assert advised(site).s_m < 1_500.0


def test_without_a_certificate_nobody_gets_in(site: Site) -> None:
    before = site.log("node").count(REFUSED)
    nameless = attacker(
        site.folder / "cab.json5", connect_certificate=None, connect_private_key=None, enable_mtls=False
    )
    assert tried(nameless, {POSITION.key(TRAIN): FALSE_POSITION}) == 0
    assert site.log("node").count(REFUSED) > before
    plain = attacker(site.folder / "cab.json5")
    plain.insert_json5("transport/link/protocols", '["tcp"]')
    port = plain.get_json("connect/endpoints").partition("127.0.0.1:")[2].partition('"')[0]
    plain.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    before = site.log("node").count(REFUSED)
    assert tried(plain, {POSITION.key(TRAIN): FALSE_POSITION}) == 0
    assert site.log("node").count(REFUSED) > before
    assert advised(site).s_m < 1_500.0


@pytest.mark.nightly
def test_a_cab_that_says_where_the_train_is_has_no_effect_and_is_logged(site: Site) -> None:
    everything = {
        POSITION.key(TRAIN): FALSE_POSITION,
        f"das/*/{POSITION.name}": FALSE_POSITION,
        JOURNEY.key(TRAIN): b"",
        ADVICE.key(TRAIN): FALSE_ADVICE,
    }
    assert tried(attacker(site.folder / "cab.json5"), everything) >= 2
    site.until_logged("node", f"unauthorized to Put (ingress) on das/{TRAIN}/position")
    site.until_logged("node", "unauthorized to Put (ingress) on das/*/position")
    site.until_logged("node", f"unauthorized to Put (ingress) on das/{TRAIN}/journey")
    site.until_logged("recorder", f"unauthorized to Put (ingress) on das/{TRAIN}/advice")
    assert advised(site).s_m < 1_500.0


@pytest.mark.nightly
def test_a_simulator_that_advises_is_not_heard_and_is_logged(site: Site) -> None:
    assert tried(attacker(site.folder / "simulator.json5"), {ADVICE.key(TRAIN): FALSE_ADVICE}) >= 2
    site.until_logged("recorder", f"unauthorized to Put (ingress) on das/{TRAIN}/advice")
    heard = []
    while (received := site.cab.receive(0)) is not None:
        heard.append(received)
    assert any(r.topic is ADVICE for r in heard)
    assert all(r.message.reason.text != "false" for r in heard if r.topic is ADVICE)


@pytest.mark.parametrize(
    ("role", "others"),
    [
        ("sensors", (RESTRICTION, JOURNEY)),
        pytest.param("operator", (POSITION, EFFORT), marks=pytest.mark.slow),
    ],
)
def test_sensors_and_operator_may_not_say_what_the_other_one_says(
    site: Site, role: str, others: tuple[Topic, ...]
) -> None:
    assert tried(attacker(site.folder / f"{role}.json5"), {topic.key(TRAIN): FALSE_POSITION for topic in others}) >= 2
    for topic in others:
        site.until_logged("node", f"unauthorized to Put (ingress) on {topic.key(TRAIN)}")
    assert advised(site).s_m < 1_500.0


@pytest.mark.nightly
def test_sensors_and_an_operator_with_certificates_of_their_own_get_advice(tmp_path: Path) -> None:
    ports = dict(zip(LISTENERS, free_ports(len(LISTENERS)), strict=True))
    folder, log = tmp_path / "bus", tmp_path / "node.log"
    write_bus_folder(folder, TRAIN, ports, days=1.0)
    with (
        Bus(TRAIN, file=BusFile(folder / "operator.json5")) as operator,
        Bus(TRAIN, hear=(ADVICE,), file=BusFile(folder / "sensors.json5")) as sensors,
    ):
        operator.publish(JOURNEY, journey(time.time_ns()))
        operator.publish(RESTRICTION, das_pb2.Restrictions(time_ns=time.time_ns()))
        node = start("das.node", log, *ROUTE, "--bus", str(folder / "node.json5"))
        try:
            deadline, mode = time.monotonic() + TIMEOUT_S, das_pb2.MODE_NONE
            while mode == das_pb2.MODE_NONE:
                assert time.monotonic() < deadline, log.read_text()
                sensors.publish(POSITION, das_pb2.Position(time_ns=time.time_ns(), s_m=0.0, speed_mps=0.0))
                received = sensors.receive(0.2)
                mode = received.message.mode if received is not None else mode
        finally:
            node.kill()
            node.wait()


@pytest.mark.nightly
def test_two_who_may_say_where_the_train_is_withdraw_the_advice(site: Site) -> None:
    """A second simulator has the right certificate: only the node can see that one of them is wrong."""
    with zenoh.open(attacker(site.folder / "simulator.json5")) as session:

        def both(received: Received) -> bool:
            session.put(POSITION.key(TRAIN), FALSE_POSITION)
            return received.topic is ADVICE and "two publishers of the position" in received.message.reason.text

        assert site.until(site.simulator, both).mode == das_pb2.MODE_NONE
    assert advised(site).s_m < 1_500.0


@pytest.mark.nightly
def test_floods_and_giants_of_the_right_sender_do_not_stop_the_advice(site: Site) -> None:
    """10 000 positions at once, a journey of 1 MB and one the bus does not even take."""
    for _ in range(10_000):
        site.drive()
    first = journey(time.time_ns())
    for stops in (50_000, 200_000):
        giant = das_pb2.Journey()
        giant.CopyFrom(first)
        giant.stops.extend([das_pb2.Journey.Stop(s_m=1.0)] * stops)
        site.simulator.publish(JOURNEY, giant)
    site.until(site.simulator, lambda r: r.topic is EVENT and "50002 stops, more than 200" in r.message.message)
    assert advised(site).s_m < 1_500.0


@pytest.mark.nightly
def test_a_simulation_runs_with_an_identity_for_each_of_its_processes(tmp_path: Path) -> None:
    ports = dict(zip(LISTENERS, free_ports(len(LISTENERS)), strict=True))
    write_bus_folder(tmp_path / "bus", TRAIN, ports, days=1.0)
    start_ns = 1_800_000_000 * 10**9
    processes = Processes(
        train=TRAIN,
        node_arguments=ROUTE,
        out=tmp_path / "run.mcap",
        metadata={},
        start_ns=start_ns,
        bus=bus_folder(tmp_path / "bus", False, TRAIN),
    )
    with Lockstep(processes) as lockstep:
        heard = codec.decode(decoded(JOURNEY, "", journey(start_ns).SerializeToString()), 0)
        assert isinstance(heard, JourneyHeard)
        lockstep.begin(heard)
        lockstep.send(RESTRICTION, das_pb2.Restrictions(time_ns=start_ns))
        for tick in range(1, 4):
            now_ns = start_ns + tick * 10**9
            lockstep.send(POSITION, das_pb2.Position(time_ns=now_ns, s_m=0.0, speed_mps=0.0))
            assert lockstep.ask(now_ns, tick).mode != das_pb2.MODE_NONE
        lockstep.finish(start_ns + 4 * 10**9)
    assert lockstep.traffic.recorded[ADVICE.name] == 3
    assert lockstep.traffic.lost == 0


@pytest.mark.nightly
def test_what_was_recorded_is_what_the_right_ones_said(site: Site) -> None:
    """Last: ends node and recorder."""
    for process in site.processes.values():
        process.terminate()
    assert [process.wait(20) for process in site.processes.values()] == [0, 0]
    recording = read_recording(site.recording)
    assert recording.complete
    advice = [m.message for m in recording.of(ADVICE)]
    assert len(advice) > 3
    assert all(message.reason.text != "false" for message in advice)
