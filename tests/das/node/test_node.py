"""The node and the recorder as real processes over real Zenoh on loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from das.advice.settings import DEFAULT
from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.session import Bus, check_endpoint, endpoint, free_ports
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EVENT,
    JOURNEY,
    PLAN,
    POSITION,
    RECORDER,
    RESTRICTION,
    STATUS,
    TARGET,
    TOPICS,
    Received,
    topic_of,
)
from das.domain.errors import DasError
from das.recorder.command import main as recorder_main
from tests.support.making import REPOSITORY

TRAIN = "T1"
START_NS = 1_800_000_000_000_000_000
TIMEOUT_S = 120.0


@contextmanager
def process(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    child = subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


@contextmanager
def node(*extra: str) -> Iterator[tuple[Bus, subprocess.Popen[str]]]:
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = [
        "--route",
        "flat-6km",
        "--vehicle",
        "re460-ic",
        "--train",
        TRAIN,
        "--listen",
        theirs,
        "--connect",
        ours,
    ]
    hear = (ADVICE, STATUS, PLAN, EVENT)
    with (
        process("das.node", *arguments, *extra) as child,
        Bus(TRAIN, listen=ours, connect=[theirs], hear=hear) as bus,
    ):
        if "--no-restrictions" not in extra:
            bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=1))
        yield bus, child


def until(bus: Bus, wanted: Callable[[Received], bool], child: subprocess.Popen[str] | None = None) -> Any:
    """The first message that is wanted; fails after a while or when the process ends."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        received = bus.receive(0.2)
        if received is not None and received.message is not None and wanted(received):
            return received.message
        if child is not None and child.poll() is not None:
            pytest.fail(f"the process ended: {child.communicate()[0]}")
    return pytest.fail("waited too long")


def status(state: int) -> Callable[[Received], bool]:
    return lambda r: r.topic is STATUS and r.message.state == state


def journey(route: str = "flat-6km", arrival_s: float = 240.0) -> das_pb2.Journey:
    return das_pb2.Journey(
        time_ns=START_NS,
        train=TRAIN,
        route_id=route,
        vehicle_id="re460-ic",
        stops=[
            das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=START_NS),
            das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=START_NS + round(arrival_s * 1e9)),
        ],
    )


@pytest.mark.processes
@pytest.mark.slow
def test_node_takes_a_journey_advises_at_ticks_and_stops_on_sigterm() -> None:
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus.publish(JOURNEY, journey())
        ready = until(bus, status(das_pb2.Status.STATE_READY), child)
        assert ready.section.startswith("flat-6km 0–6000 m, re460-ic")
        assert ready.solve_s == 0.0  # the same on every machine
        states = [(1, 0.0, 0.0), (6, 10.0, 4.0), (80, 2_000.0, 35.0), (160, 5_000.0, 38.0)]
        for tick, (second, s_m, speed) in enumerate(states, 1):
            now = START_NS + second * 10**9
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
                assert advice.reason == "depart when cleared: least energy on time, operator says 5 s late"
        child.send_signal(signal.SIGTERM)
        assert child.wait(20) == 0


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_says_that_positions_are_rejected_and_taken_up_anew() -> None:
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus.publish(JOURNEY, journey())
        until(bus, status(das_pb2.Status.STATE_READY), child)
        said = []
        for tick in range(1, 9):
            now, off_m = START_NS + (60 + tick) * 10**9, 500.0 if tick > 3 else 0.0
            fix = das_pb2.Position(time_ns=now, s_m=2_000.0 + 30.0 * tick + off_m, speed_mps=30.0, uncertainty_m=3.0)
            bus.publish(POSITION, fix)
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=tick))
            while not (received := bus.receive(TIMEOUT_S)) or received.topic is not ADVICE:
                assert received is not None
                if received.topic is EVENT and "position" in received.message.message:
                    said.append((tick, received.message.message))
        assert said == [
            (4, "position: rejected, the position jumped by 500 m"),
            (7, "position: taken up anew at 2710 m"),
        ]


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_publishes_its_plan_and_events() -> None:
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus.publish(JOURNEY, journey())
        until(bus, lambda r: r.topic is EVENT and "journey A – B" in r.message.message, child)
        bus.publish(POSITION, das_pb2.Position(time_ns=START_NS, s_m=0.0, speed_mps=0.0))
        bus.publish(CONTROL, das_pb2.Control(time_ns=START_NS, tick=1))
        plan = until(bus, lambda r: r.topic is PLAN, child)
        assert len(plan.s_m) == len(plan.t_s) == len(plan.speed_mps) == len(plan.force_n) > 50
        assert plan.t_s[-1] == pytest.approx(240.0 + DEFAULT.plan.unhurried_s, abs=0.3)
        bus.publish(CONTROL, das_pb2.Control(time_ns=START_NS, tick=2, command=das_pb2.Control.COMMAND_FINISH))
        assert child.wait(20) == 0


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_advises_once_a_second_by_the_wall_clock() -> None:
    with node() as (bus, child):
        first = until(bus, lambda r: r.topic is ADVICE, child)
        second = until(bus, lambda r: r.topic is ADVICE, child)
        assert first.mode == das_pb2.MODE_NONE
        assert first.reason == "no journey yet"
        said = until(bus, lambda r: r.topic is STATUS and r.message.advices > 0, child)
        assert 0 < said.solve_s < 60
        assert 0 < said.last_advice_s < 10
        assert (second.time_ns - first.time_ns) * 1e-9 == pytest.approx(1.0, abs=0.4)


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_refuses_a_foreign_journey_with_the_reason() -> None:
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus.publish(JOURNEY, journey(route="elsewhere"))
        said = until(bus, status(das_pb2.Status.STATE_WITHDRAWN), child)
        assert said.reason == "journey refused: it is for route 'elsewhere', this node has 'flat-6km'"
        bus.publish(CONTROL, das_pb2.Control(time_ns=START_NS, tick=1))
        assert until(bus, lambda r: r.topic is ADVICE, child).mode == das_pb2.MODE_NONE
        bus.publish(JOURNEY, journey())
        until(bus, status(das_pb2.Status.STATE_READY), child)


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_refuses_journeys_it_cannot_drive() -> None:
    wrong = {
        "it drives the route in reverse, this node has it forwards": {"reversed": True},
        "it is for train 'T2', this node is for 'T1'": {"train": "T2"},
        "expected one that leads forwards on the route": {
            "stops": [{"s_m": 0.0, "departure_ns": START_NS}, {"s_m": 1e10, "arrival_ns": START_NS + 300 * 10**9}]
        },
        "it has 1 stops, expected at least 2": {"stops": [{"s_m": 0.0}]},
        "it is for vehicle '../x', this node knows re460-ic, re460-ic-igbt": {"vehicle_id": "../x"},
        "no load 'full'": {"load": "full"},
        "level 'l9': expected one of l0-noreg": {"level": "l9"},
        "timetable: the departure from stop 2 is before the arrival there": {
            "stops": [
                {"s_m": 0.0, "departure_ns": START_NS},
                {"s_m": 3e3, "arrival_ns": START_NS + 200 * 10**9, "departure_ns": START_NS + 199 * 10**9},
                {"s_m": 6e3, "arrival_ns": START_NS + 400 * 10**9},
            ]
        },
        "the arrival is not after the departure": {"arrival_s": 0.0},
        "the first stop has no departure": {"stops": [{"s_m": 0.0}, {"s_m": 6e3, "arrival_ns": START_NS}]},
        "the last stop has no arrival": {"stops": [{"s_m": 0.0, "departure_ns": START_NS}, {"s_m": 6e3}]},
    }
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        for reason, change in wrong.items():
            message = journey(arrival_s=change.pop("arrival_s", 240.0))
            if "stops" in change:
                del message.stops[:]
            message.MergeFrom(das_pb2.Journey(**change))
            bus.publish(JOURNEY, message)
            said = until(bus, lambda r: r.topic is STATUS and "journey refused" in r.message.reason, child)
            assert reason in said.reason


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_with_the_wall_clock_does_not_obey_control() -> None:
    with node() as (bus, child):
        until(bus, lambda r: r.topic is ADVICE, child)
        bus.publish(CONTROL, das_pb2.Control(time_ns=5, tick=1, command=das_pb2.Control.COMMAND_FINISH))
        for _ in range(2):
            assert until(bus, lambda r: r.topic is ADVICE, child).time_ns > START_NS // 2
        assert child.poll() is None


@pytest.mark.processes
def test_node_heeds_restrictions_targets_train_and_level_over_the_bus() -> None:
    """Kept for late subscribers, so that a node that was restarted knows them; a tick waits until they are heard."""
    one = das_pb2.Restrictions.Restriction(start_m=2_500.0, end_m=3_500.0, limit_mps=15.0)
    target = das_pb2.Targets.Target(stop="B", arrival_ns=START_NS + 300 * 10**9)
    now = START_NS + 60 * 10**9
    position = das_pb2.Position(time_ns=now, s_m=2_600.0, speed_mps=14.0)
    with node("--clock", "bus") as (bus, child):

        def ask(tick: int) -> Any:
            bus.publish(POSITION, position)
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=tick, restrictions_ns=5, targets_ns=6))
            return until(bus, lambda r: r.topic is ADVICE and r.message.tick == tick, child)

        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        message = journey()
        message.vehicle_id, message.level = "re460-ic-igbt", "l2"
        bus.publish(JOURNEY, message)
        ready = until(bus, status(das_pb2.Status.STATE_READY), child)
        assert "re460-ic-igbt, l2" in ready.section
        bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=5, restrictions=[one]))
        bus.publish(TARGET, das_pb2.Targets(time_ns=6, targets=[target]))
        advice = ask(1)
        assert advice.limit_mps == 15.0
        assert advice.advised_speed_mps <= 15.0
        assert advice.predicted_arrival_ns >= START_NS + 298 * 10**9
        one.limit_mps = -1.0
        bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=7, restrictions=[one]))
        until(bus, lambda r: r.topic is EVENT and "restriction" in r.message.message, child)
        assert "restrictions that cannot be heeded" in ask(2).reason


@pytest.mark.processes
@pytest.mark.slow
def test_a_node_that_is_restarted_takes_up_what_is_in_force() -> None:
    one = das_pb2.Restrictions.Restriction(start_m=2_500.0, end_m=3_500.0, limit_mps=15.0)
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = ["--route", "flat-6km", "--vehicle", "re460-ic", "--train", TRAIN, "--listen", theirs]
    with Bus(TRAIN, listen=ours, connect=[theirs], hear=(ADVICE, STATUS)) as bus:
        start_ns = time.time_ns()
        message = journey()
        message.time_ns = start_ns
        message.stops[0].departure_ns = start_ns - 60 * 10**9
        message.stops[1].arrival_ns = start_ns + 200 * 10**9
        bus.publish(JOURNEY, message)
        bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=start_ns, restrictions=[one]))
        for _ in range(2):
            with process("das.node", *arguments, "--connect", ours, "--rate", "5") as child:
                begun_ns = time.time_ns()

                def advised(received: Received, since_ns: int = begun_ns) -> bool:
                    now = time.time_ns()
                    bus.publish(POSITION, das_pb2.Position(time_ns=now, s_m=2_600.0, speed_mps=0.0))
                    is_advice = received.topic is ADVICE and received.message.time_ns > since_ns
                    return is_advice and received.message.limit_mps == 15.0

                bus.publish(POSITION, das_pb2.Position(time_ns=begun_ns, s_m=2_600.0, speed_mps=0.0))
                assert until(bus, advised, child).advised_speed_mps <= 15.0
                child.kill()
                child.wait()


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_node_survives_times_at_the_ends_of_the_clock() -> None:
    last = 2**63 - 1
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        for now in (last, -last, 0):
            message = journey()
            message.stops[1].arrival_ns = last
            bus.publish(JOURNEY, message)
            bus.publish(POSITION, das_pb2.Position(time_ns=now, s_m=10.0, speed_mps=4.0))
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=1))
        bus.publish(JOURNEY, journey())
        # Journeys come by a subscriber of their own: when they are taken is not ordered with the positions.
        for tick in range(2, 100):
            bus.publish(POSITION, das_pb2.Position(time_ns=START_NS + tick, s_m=10.0, speed_mps=4.0))
            bus.publish(CONTROL, das_pb2.Control(time_ns=START_NS + tick, tick=tick))
            advice = until(bus, lambda r, tick=tick: r.topic is ADVICE and r.message.tick == tick, child)
            if advice.mode != das_pb2.MODE_NONE:
                break
            time.sleep(0.05)
        assert advice.mode != das_pb2.MODE_NONE


def test_docs_list_every_topic() -> None:
    page = (REPOSITORY / "docs" / "reference" / "bus.md").read_text()
    for topic in TOPICS:
        name = topic.message.DESCRIPTOR.full_name
        assert f"| `{topic.key('<train>')}` | `{name}` |" in page


@pytest.mark.more
@pytest.mark.processes
def test_node_ignores_what_it_cannot_read_and_says_so() -> None:
    with node("--clock", "bus") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus._session.put(POSITION.key(TRAIN), b"\xff\xff\xff\xff")
        until(bus, lambda r: r.topic is EVENT and "position: a message that cannot be read" in r.message.message, child)
        assert child.poll() is None


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--route", "nowhere", "--vehicle", "re460-ic"], "nowhere: not a bundled route"),
        (["--route", "flat-6km", "--vehicle", "re460-ic", "--clock", "moon"], "'moon' is not one of 'wall', 'bus'"),
        (["--route", "flat-6km", "--vehicle", "re460-ic", "--train", "a/b"], "train name 'a/b'"),
        (["--route", "flat-6km", "--vehicle", "re460-ic", "--rate", "9"], "--rate 9: expected 0.2 to 5 Hz"),
        (["--route", "flat-6km", "--vehicle", "re460-ic", "--tables", "/nowhere"], "no such folder of tables"),
        (
            ["--route", "flat-6km", "--vehicle", "re460-ic", "--listen", "tcp/0.0.0.0:7447"],
            "the bus stays on this machine",
        ),
    ],
)
def test_node_refuses_bad_arguments_in_one_line(arguments: list[str], message: str) -> None:
    with process("das.node", *arguments) as child:
        said, _ = child.communicate(timeout=60)
        assert child.returncode == 2
    assert message in said
    assert len(said.strip().splitlines()) == 1


@pytest.mark.more
@pytest.mark.processes
def test_node_says_when_its_port_is_taken() -> None:
    taken = endpoint(free_ports(1)[0])
    with (
        Bus(TRAIN, listen=taken),
        process("das.node", "--route", "flat-6km", "--vehicle", "re460-ic", "--listen", taken) as child,
    ):
        said, _ = child.communicate(timeout=60)
        assert child.returncode == 2
    assert f"bus: cannot open {taken}" in said
    assert "in use" in said
    assert len(said.strip().splitlines()) == 1


def send_and_record(out: Path, ticks: int) -> tuple[subprocess.Popen[str], Any]:
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = ["--train", TRAIN, "--listen", theirs, "--connect", ours, "--out", str(out)]
    child = subprocess.Popen([sys.executable, "-m", "das.recorder", *arguments])
    with Bus(TRAIN, listen=ours, connect=[theirs], hear=(RECORDER,)) as bus:
        until(bus, lambda r: r.topic is RECORDER)
        for tick in range(1, ticks + 1):
            now = START_NS + tick * 10**9
            bus.publish(POSITION, das_pb2.Position(time_ns=now, s_m=float(tick)))
            bus.publish(CONTROL, das_pb2.Control(time_ns=now, tick=tick))
        until(bus, lambda r: r.topic is RECORDER and r.message.tick == ticks)
    return child, None


@pytest.mark.more
@pytest.mark.processes
def test_recorder_writes_everything_in_order_and_finishes_on_sigterm(tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    child, _ = send_and_record(out, 500)
    child.send_signal(signal.SIGTERM)
    assert child.wait(20) == 0
    recording = read_recording(out)
    assert recording.complete
    assert [m.message.s_m for m in recording.of(POSITION)] == [float(i) for i in range(1, 501)]
    assert [m.message.tick for m in recording.of(CONTROL)] == list(range(1, 501))
    assert recording.of(CONTROL)[-1].log_time_ns == START_NS + 500 * 10**9


@pytest.mark.processes
def test_a_killed_recorder_loses_nothing_older_than_a_second(tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    child, _ = send_and_record(out, 300)
    time.sleep(1.5)
    os.kill(child.pid, signal.SIGKILL)
    child.wait(20)
    recording = read_recording(out)
    assert not recording.complete
    assert len(recording.of(POSITION)) == 300


@pytest.mark.more
@pytest.mark.processes
def test_a_recorder_started_anew_keeps_what_was_recorded(tmp_path: Path) -> None:
    for name, ticks in (("run.mcap", 20), ("run-2.mcap", 30)):
        child, _ = send_and_record(tmp_path / "run.mcap", ticks)
        child.send_signal(signal.SIGTERM)
        assert child.wait(20) == 0
        assert len(read_recording(tmp_path / name).of(POSITION)) == ticks
    assert len(read_recording(tmp_path / "run.mcap").of(POSITION)) == 20


@pytest.mark.more
@pytest.mark.processes
def test_recorder_names_a_file_it_cannot_write() -> None:
    with process(
        "das.recorder", "--train", TRAIN, "--listen", endpoint(free_ports(1)[0]), "--out", "/nowhere/x.mcap"
    ) as child:
        said, _ = child.communicate(timeout=60)
        assert child.returncode == 2
    assert said.strip() == "error: /nowhere/x.mcap: cannot be written (No such file or directory)"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--metadata", "{nope"], "error: --metadata: not valid JSON (Expecting"),
        (["--metadata", "[1]"], "error: --metadata: expected a JSON object of texts"),
        (["--attach", "/nowhere/x"], "error: /nowhere/x: cannot be read (No such file or directory)"),
        (["--listen", "x"], "error: endpoint 'x': expected tcp/127.0.0.1:PORT"),
    ],
)
def test_recorder_refuses_bad_arguments_and_writes_nothing(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run.mcap"
    with pytest.raises(SystemExit) as ended:
        recorder_main(["--train", TRAIN, "--listen", endpoint(free_ports(1)[0]), "--out", str(out), *arguments])
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith(message)
    assert not out.exists()


def test_the_session_listens_on_loopback_only_and_does_not_scout() -> None:
    with Bus(TRAIN, listen=endpoint(free_ports(1)[0])) as bus:
        settings = bus._config
        assert settings.get_json("scouting/multicast/enabled") == "false"
        assert settings.get_json("scouting/gossip/enabled") == "false"
        port = int(str(bus.listen).rpartition(":")[2])
        loopback = "0100007F"
        for table in ("tcp", "tcp6", "udp", "udp6"):
            path = Path("/proc/net") / table
            for line in path.read_text().splitlines()[1:] if path.exists() else []:
                address, _, number = line.split()[1].rpartition(":")
                assert int(number, 16) != port or address == loopback


@pytest.mark.parametrize(
    "text", ["tcp/0.0.0.0:7447", "udp/127.0.0.1:7447", "tcp/127.0.0.1:0", "tcp/127.0.0.1:99999", "x"]
)
def test_endpoints_off_this_machine_are_refused(text: str) -> None:
    with pytest.raises(DasError, match=r"expected tcp/127\.0\.0\.1:PORT"):
        check_endpoint(text)


def test_registry_keys_are_unique_and_lead_back_to_their_topic() -> None:
    assert len({topic.key(TRAIN) for topic in TOPICS}) == len(TOPICS)
    assert all(topic_of(topic.key(TRAIN)) is topic for topic in TOPICS)
    assert topic_of("das/T1/nothing") is None


def test_a_late_subscriber_gets_the_last_journey() -> None:
    ours, theirs = (endpoint(port) for port in free_ports(2))
    with Bus(TRAIN, listen=ours) as sender:
        sender.publish(JOURNEY, journey())
        with Bus(TRAIN, listen=theirs, connect=[ours], hear=(JOURNEY,)) as late:
            assert until(late, lambda r: r.topic is JOURNEY).route_id == "flat-6km"


def test_zenoh_default_session_is_never_opened() -> None:
    """Only das/bus/session.py opens a session."""
    root = REPOSITORY
    files = [path for folder in ("das", "sim", "precompute") for path in (root / folder).rglob("*.py")]
    users = [path.relative_to(root).as_posix() for path in files if "zenoh.open" in path.read_text()]
    assert users == ["das/bus/session.py"]


@pytest.mark.more
@pytest.mark.processes
def test_the_example_of_the_documentation_is_advised() -> None:
    text = (REPOSITORY / "docs" / "how-to" / "connect-to-the-bus.md").read_text(encoding="utf-8")
    example = text.split("```python\n")[1].split("```")[0]
    ours, theirs = (endpoint(port) for port in free_ports(2))
    example = example.replace("tcp/127.0.0.1:7448", ours).replace("tcp/127.0.0.1:7447", theirs)
    arguments = ["--route", "flat-6km", "--vehicle", "re460-ic", "--train", "IC1", "--listen", theirs]
    with process("das.node", *arguments, "--connect", ours) as child:
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
