"""Runs in closed loop over the real bus: what a user runs, short."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus import das_pb2
from das.bus.recording import Recording, read_recording
from das.bus.session import endpoint, free_ports
from das.bus.topics import (
    ADVICE,
    CAB,
    CONTROL,
    DECISION,
    DELAY,
    EFFORT,
    ESTIMATE,
    EVENT,
    JOURNEY,
    LOG,
    MEASURES,
    PLAN,
    POSITION,
    RESTRICTION,
    SAVING,
    STATUS,
    TRUTH,
)
from das.cab.heard import EffortHeard, Heard, PositionHeard
from das.domain.units import KMH, NS, kwh
from sim.drive.drive import Drive
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.in_process import InProcess
from sim.world.lockstep import Counts, Traffic
from sim.world.loop import Tick, World
from sim.world.scenario import read_scenario
from sim.world.service import make_day, prepare_service
from tests.support.flat_days import Alone, service_of
from tests.support.making import das_sim, in_a_process, refusal, wait_until
from tests.support.recordings import advices_so_far

EVENTFUL = """
schema_version = 1
scenario = {id = "eventful", title = "All at once", route = "line.toml", vehicle = "re460-ic"}
timetable = {departure = "2026-11-21T08:04:00Z", buffer_percent = 20, dwell_s = 20}
truth.head_wind_kmh = 10
sensors = {force_noise_percent = 2}
disturbances = [
    {kind = "departure-delay", stop = "A", delay_s = {min = 2, max = 9}},
    {kind = "restriction", from_m = 1200, to_m = 1500, speed_kmh = 50, announced_m = 900},
    {kind = "node-restart", at_s = 70},
    {kind = "signal-stop", at_m = 4500, seen_m = 900, clears_after_s = {min = 60, max = 80}},
    {kind = "sensor-fault", fault = "dropout", from_s = 40, for_s = 6},
    {kind = "bus-outage", from_s = 100, for_s = 8},
]
"""
LINE = """
schema_version = 1
route = {id = "line", name = "Two short sections", length_km = 5.5}
stops = [{name = "A", position_km = 0.0}, {name = "B", position_km = 2.5}, {name = "C", position_km = 5.5}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0.0, 90.0], [3.0, 110.0]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0.0, 2.0], [2.0, -3.0]]}
"""


class Hears(Alone):
    """A link that keeps what the node would be told."""

    def __init__(self) -> None:
        self.heard: list[Heard] = []

    def exchange(self, tick: Tick) -> None:
        self.heard += tick.told


def payloads(path: Path) -> dict[str, list[bytes]]:
    """Every message of a recording by topic, as bytes."""
    messages = read_recording(path).messages
    return {name: [entry.message.SerializeToString() for entry in entries] for name, entries in messages.items()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("world")
    (folder / "eventful.toml").write_text(EVENTFUL)
    (folder / "line.toml").write_text(LINE)
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> dict[str, Any]:
    """The eventful day with a human driver, over the bus."""
    done = das_sim("run", "eventful.toml", "--seed", "4", "--out", "a.mcap", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


@pytest.fixture(scope="module")
def recording(folder: Path, found: dict[str, Any]) -> Recording:
    return read_recording(folder / found["file"])


def test_the_recording_is_whole_and_says_how_it_was_made(recording: Recording, found: dict[str, Any]) -> None:
    assert recording.complete
    heard = (POSITION, EFFORT, DELAY, JOURNEY, RESTRICTION, CONTROL)
    for topic in (*heard, ADVICE, PLAN, ESTIMATE, STATUS, EVENT, TRUTH, CAB, DECISION, MEASURES, LOG):
        assert recording.of(topic), topic.name
    run = recording.metadata["run"]
    assert (run["kind"], run["scenario"], run["seed"], run["driver"], run["advice"]) == (
        *("run", "eventful", "4"),
        *("human", "guide"),
    )
    assert "signal at km 4.5 at danger, seen 900 m ahead" in run["happens"]
    assert all(len(run[f"{name}_sha256"]) == 64 for name in ("scenario", "route", "vehicle"))
    assert {"eventful.toml", "line.toml", "re460-ic.toml"} <= set(recording.attachments)
    assert found["messages_lost"] == 0
    ticks = found["advices_given"] + found["advices_withdrawn"]
    assert len(recording.of(ADVICE)) == ticks == found["simulated_s"] - 8 - 2
    assert len(recording.of(TRUTH)) == len(recording.of(CAB)) == found["simulated_s"]


def test_the_run_is_what_the_scenario_says(recording: Recording, found: dict[str, Any]) -> None:
    stops = {stop["name"]: stop for stop in found["stops"]}
    assert 2 <= stops["A"]["departed_late_s"] <= 14
    assert stops["B"]["departed_s"] >= max(stops["B"]["arrived_s"] + 20, stops["B"]["due_arrival_s"] + 20)
    assert abs(stops["C"]["stopping_error_m"]) < 10
    truth = recording.columns(TRUTH, "time_ns", "s_m", "speed_mps", "adhesion_ratio", "head_wind_mps")
    assert truth["head_wind_mps"] == pytest.approx(10 * KMH)
    assert (truth["adhesion_ratio"] == 1).all()
    at_signal = np.abs(truth["s_m"] - 4500) < 20
    assert (truth["speed_mps"][at_signal] == 0).sum() > 5
    restricted = (truth["s_m"] > 1200) & (truth["s_m"] < 1700)
    assert truth["speed_mps"][restricted].max() <= 50 * KMH + 1.0
    told = [m.message.restrictions for m in recording.of(RESTRICTION)]
    assert [len(one) for one in told] == [0, 1, 0]  # that there are none yet is told as well
    assert (told[1][0].start_m, told[1][0].end_m) == (1200, 1500)
    said = [m.message.message for m in recording.of(LOG)]
    for text in ("departed A", "arrived B", "departed B", "arrived C", "restriction to 50 km/h", "bus outage, 8 s"):
        assert any(text in one for one in said), text
    for text in ("localisation: dropout", "signal at km 4.5 at danger", "signal at km 4.5 clear", "the node is killed"):
        assert any(text in one for one in said), text


def test_energies_of_the_recording_are_those_of_the_result(recording: Recording, found: dict[str, Any]) -> None:
    last = recording.of(TRUTH)[-1].message
    gone_j = last.resistance_j + last.component_loss_j + last.friction_brake_j + last.unreturned_j
    assert last.auxiliary_j == 0  # part of this train's losses
    total = sum(found[f"{name}_kwh"] for name in ("resistance", "component_loss", "friction_brake", "unreturned"))
    assert gone_j / 3.6e6 == pytest.approx(total, rel=1e-9)
    assert last.energy_input_j / 3.6e6 == pytest.approx(found["energy_kwh"] + found["energy_at_stops_kwh"], rel=1e-9)
    shares = ("component_loss", "resistance", "friction_brake", "unreturned", "comfort")
    assert sum(found[f"{name}_ratio"] for name in shares) == pytest.approx(1.0)
    assert found["energy_kwh"] > found["energy_optimum_kwh"] > 0


def test_the_recording_holds_the_measures_of_the_result_and_gives_them_again(
    recording: Recording, found: dict[str, Any]
) -> None:
    (entry,) = recording.of(MEASURES)
    said, again = entry.message, Drive(recording=recording).figures.stability
    assert found["advice_changes_per_min"] > 0
    assert said.advice_changes_per_min == found["advice_changes_per_min"] == pytest.approx(again.changes_per_min)
    assert said.reversals == found["reversals"] == again.reversals
    assert said.shortest_mode_s == found["shortest_mode_s"] == pytest.approx(again.shortest_mode_s)
    assert said.shown_s == pytest.approx(again.shown_s)
    assert found["warnings"] == ([again.warning] if again.warning else [])
    told = Drive(recording=recording).figures.as_dict()
    told = {name: value for name, value in told.items() if not name.startswith(("over_limit", "signals", "beyond"))}
    assert told["instructions"] > 10
    assert told == {name: found[name] for name in told}


def test_the_recording_holds_what_was_taken_above_the_optimum(recording: Recording, found: dict[str, Any]) -> None:
    (entry,) = recording.of(SAVING)
    said = entry.message
    assert said.measured
    assert kwh(said.driven_j) == pytest.approx(found["energy_kwh"], rel=1e-9)
    assert kwh(said.optimum_j) == pytest.approx(found["energy_optimum_kwh"], rel=1e-9)
    assert said.likely_low_j == said.likely_high_j == pytest.approx(said.driven_j - said.optimum_j)
    assert sum(one.driven_j for one in said.sections) == pytest.approx(said.driven_j)
    assert sum(one.optimum_j for one in said.sections) == pytest.approx(said.optimum_j)


def test_no_advice_is_shown_while_the_node_is_away(recording: Recording) -> None:
    start_ns = recording.of(JOURNEY)[0].message.stops[0].departure_ns
    shown = {
        round((m.message.time_ns - start_ns) * NS): m.message.presentation != das_pb2.Cab.PRESENTATION_NONE
        for m in recording.of(CAB)
    }
    heard = {round((m.message.time_ns - start_ns) * NS) for m in recording.of(ADVICE)}
    assert not {70, 71, *range(100, 108)} & heard
    assert {69, 72, 99, 108} <= heard
    assert shown[99]
    assert shown[102]  # still valid
    assert not any(shown[second] for second in range(103, 108))
    assert not any(shown[second] for second in (44, 45))  # dropout
    assert shown[76]  # once the way has confirmed the speeds to a node that was started on the way
    assert shown[109]


def test_a_restarted_node_takes_the_journey_again(recording: Recording) -> None:
    ready = [m for m in recording.of(STATUS) if m.message.state == das_pb2.Status.STATE_READY and not m.message.advices]
    assert len(ready) == 2
    counts = [m.message.advices for m in recording.of(STATUS)]
    assert counts.count(1) == 2  # counted from the start again
    assert len(recording.of(JOURNEY)) == 1
    assert all(m.message.solve_s == m.message.last_advice_s == 0 for m in recording.of(STATUS))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_recording_byte_for_byte(folder: Path, found: dict[str, Any]) -> None:
    """Every topic, in two processes with two nodes and recorders; another seed differs."""
    done = in_a_process("sim.cli", "run", "eventful.toml", "--seed", "4", "--out", "b.mcap", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    first, second = payloads(folder / found["file"]), payloads(folder / "b.mcap")
    assert first.keys() == second.keys()
    for name, messages in first.items():
        assert messages == second[name], name


@pytest.mark.slow
def test_without_a_bus_the_train_runs_the_same(folder: Path, recording: Recording) -> None:
    service = prepare_service(read_scenario(folder / "eventful.toml"))
    driver, link = make_driver(DriverKind.HUMAN, service.line, seed=4), InProcess(service, guide=True)
    states = World(make_day(service, 4), driver, Presentation.GUIDE, link).run().states
    truth = recording.columns(TRUTH, "time_ns", "s_m", "speed_mps", "energy_input_j")
    assert [state.s_m for state in states[:-1]] == truth["s_m"].tolist()
    assert [state.speed_mps for state in states[:-1]] == truth["speed_mps"].tolist()
    assert [state.input_j for state in states[:-1]] == truth["energy_input_j"].tolist()
    assert (np.diff(truth["time_ns"]) == 10**9).all()
    assert link.cab.learning is not None
    found, told = link.cab.learning.calibrator.estimates, recording.of(ESTIMATE)[-1].message
    assert (found.mass_ratio, found.resistance_ratio, found.samples) == (
        *(told.mass_ratio, told.resistance_ratio, told.samples),
    )
    assert found.samples >= 2


def test_efforts_are_those_of_the_train_with_their_own_noise(folder: Path, recording: Recording) -> None:
    truth = recording.columns(TRUTH, "time_ns", "force_el_n", "force_friction_n")
    effort = recording.columns(EFFORT, "time_ns", "force_el_n", "force_friction_n")
    at = np.searchsorted(truth["time_ns"], effort["time_ns"])
    assert (truth["time_ns"][at] == effort["time_ns"]).all()
    works = np.abs(truth["force_el_n"][at]) > 1e3
    off = effort["force_el_n"][works] / truth["force_el_n"][at][works] - 1
    assert off.std() == pytest.approx(0.02, rel=0.3)
    assert abs(off.mean()) < 4 * 0.02 / np.sqrt(works.sum())
    # The day, its positions and what the train does are the same without them.
    (folder / "silent.toml").write_text(EVENTFUL.replace("force_noise_percent = 2", ""))
    driven, told = [], []
    for name in ("silent.toml", "eventful.toml"):
        service, link = service_of(folder / name), Hears()
        driver = make_driver(DriverKind.TIMETABLE, service.line)
        driven.append(World(make_day(service, 4), driver, Presentation.NONE, link).run().states)
        told.append(link.heard)
    assert driven[0] == driven[1]
    assert any(isinstance(one, PositionHeard) for one in told[0])
    assert told[0] == [one for one in told[1] if not isinstance(one, EffortHeard)] != told[1]


@pytest.mark.nightly
def test_the_run_can_be_looked_at(folder: Path, recording: Recording) -> None:
    pytest.importorskip("rerun")
    done = das_sim("view", recording.path.name, "--save", "a.rrd", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "a.rrd").stat().st_size > 50_000


@pytest.mark.slow
def test_ctrl_c_ends_a_run_cleanly_with_a_whole_recording(folder: Path) -> None:
    command = ["run", "eventful.toml", "--pace", "20", "--driver", "perfect", "--out", "cut.mcap"]
    child = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *command], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    wait_until(lambda: advices_so_far(folder / "cut.mcap") >= 20)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 130
    assert "recorded so far: cut.mcap" in said
    assert "Traceback" not in said
    assert read_recording(folder / "cut.mcap").complete


@pytest.mark.nightly
def test_a_full_disk_ends_the_run_in_one_line_and_what_was_recorded_can_be_read(
    folder: Path, found: dict[str, Any]
) -> None:
    resource = pytest.importorskip("resource")
    room = (folder / found["file"]).stat().st_size // 2
    done = subprocess.run(
        [sys.executable, "-m", "sim.cli", "run", "eventful.toml", "--seed", "4", "--out", "full.mcap"],
        cwd=folder, capture_output=True, text=True, timeout=300, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )  # fmt: skip
    assert done.returncode == 2
    assert "the recorder ended: full.mcap: cannot be written (File too large)" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(read_recording(folder / "full.mcap").of(ADVICE)) > 10


def test_tables_of_a_run_in_process(folder: Path) -> None:
    done = das_sim("run", "eventful.toml", "--in-process", "--advice", "none", "--driver", "timetable", cwd=folder)
    assert done.returncode == 0, done.stderr
    for text in ("All at once", "eventful, seed 0, driver timetable, advice none", "comfort systems", "× real time"):
        assert text in " ".join(done.stdout.split()) or text == "All at once"
    assert "written" not in done.stdout
    assert sorted(path.suffix for path in folder.iterdir() if path.is_dir()) == []


def test_the_list_of_scenarios(folder: Path) -> None:
    listed = json.loads(in_a_process("sim.cli", "list", "scenarios", "--json", cwd=folder).stdout)
    assert len(listed) == 12
    assert all(one["title"] and one["description"] for one in listed.values())
    assert "Slippery rail" in das_sim("list", "scenarios", cwd=folder).stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "nothing: not a bundled scenario"),
        (
            ["clear-day", "--driver", "nobody"],
            "--driver nobody: expected one of perfect, literal, fast, top-speed, timetable, human, external, desk, or",
        ),
        (
            ["clear-day", "--advice", "all"],
            "Invalid value for '--advice': Value error, 'all' is not one of 'none', 'deviation', 'top-speed',",
        ),
        (["clear-day", "--pace", "fast"], "--pace fast: expected max, real or a multiple of real time"),
        (["clear-day", "--out", "no/where.mcap"], "no such folder"),
        (["clear-day", "--out", "x.mcap", "--in-process"], "--out x.mcap: a run --in-process records nothing"),
        (["clear-day", "--driver", "desk"], "--driver desk: a person drives at the desk: run das-sim desk clear-day"),
        (["eventful.toml", "--overwrite", "--out", "eventful.toml"], "would replace the scenario that is read"),
        (["eventful.toml", "--overwrite", "--out", "line.toml"], "would replace the route that is read"),
        (["eventful.toml", "--train", "a/b", "--out", "x.mcap"], "train name 'a/b'"),
        (["eventful.toml", "--level", "own"], "own"),
    ],
)
def test_bad_input_of_run_is_one_line(folder: Path, arguments: list[str], message: str) -> None:
    before = (folder / "eventful.toml").read_text()
    assert message in refusal("run", *arguments, cwd=folder)
    assert (folder / "eventful.toml").read_text() == before
    assert not (folder / "x.mcap").exists()


def test_lost_messages_are_counted() -> None:
    traffic = Traffic(counts=Counts(advised=3))
    traffic.sent.update({"position": 3, "log": 2})
    traffic.recorded.update({"position": 2, "log": 2, "advice": 3, "plan": 1})
    assert traffic.lost == 1
    assert replace(traffic, counts=Counts(advised=3, withdrawn=2)).lost == 3


@pytest.mark.nightly
def test_a_child_whose_parent_ended_before_it_began_ends_as_well(tmp_path: Path) -> None:
    """Or a run killed while its recorder starts would leave it behind: its parent is not the one it is told of."""
    own, other = (endpoint(port) for port in free_ports(2))
    arguments = ["--with-parent", "1", "--train", "t", "--listen", own, "--connect", other, "--out", "x.mcap"]
    done = subprocess.run(
        [sys.executable, "-m", "das.recorder", *arguments], cwd=tmp_path, capture_output=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.mcap").stat().st_size > 0
