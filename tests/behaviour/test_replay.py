"""Whole replays with real processes: what a user runs."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.advice.reason import ReasonCode
from das.bus import das_pb2
from das.bus.recording import read_recording
from das.bus.topics import (
    ADVICE,
    CAB,
    CONTROL,
    DELAY,
    EVENT,
    JOURNEY,
    LOCATION,
    LOG,
    PLAN,
    POSITION,
    SAVING,
    STATUS,
    TRUTH,
)
from das.domain.files.load import load_route, load_vehicle
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies.pictures import draw_first_minute
from sim.bundled.recorded_driver import HurriedDriver
from sim.cli.trips import bundled_recording
from sim.drive.comparison import EqualArrival
from sim.drive.drive import Drive
from sim.trips.estimate import estimate_run
from tests.support.hurried_plant import HurriedPlant, HurriedState
from tests.support.kept_figures import not_on_page, same_picture
from tests.support.make_trip import made_trip
from tests.support.making import REPOSITORY, das_sim, das_sim_json, in_a_process, refusal, wait_until
from tests.support.recordings import advices_so_far


@pytest.fixture(scope="module")
def default_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    folder = tmp_path_factory.mktemp("default")
    return in_a_process("sim.cli", cwd=folder), folder


GUIDE = das_pb2.Cab.PRESENTATION_GUIDE
DRIVER = "sim.bundled.recorded_driver:RecordedDriver"


def recordings(run: tuple[subprocess.CompletedProcess[str], Path]) -> tuple[Path, Path]:
    """The two recordings of a run of `das-sim` without arguments: the replay, and the drive with the guide."""
    found = sorted((run[1] / "recordings").glob("*.mcap"), key=lambda path: len(path.name))
    assert len(found) == 2
    assert found[1].name == f"{found[0].stem}-guide.mcap"
    return found[0], found[1]


@pytest.mark.slow
def test_das_sim_alone_compares_the_bundled_trip_with_the_guide(
    default_run: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    """At most 12 lines: both drives, one sentence with what its figures hang on, and how to look at them."""
    done, _ = default_run
    assert done.returncode == 0, done.stderr
    _, guided = recordings(default_run)
    lines = done.stdout.splitlines()
    assert len(lines) <= 11  # the last one is longer than 80 columns
    assert lines[-1].endswith(f"das-sim view recordings/{guided.name}")
    said = " ".join(lines[:-1])
    assert all(
        words in said for words in ("as recorded", "with the guide", "at the same arrival time", "simulated driver")
    )


@pytest.mark.slow
def test_readme_has_the_words_and_the_picture_of_das_sim_alone(
    default_run: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    """`python -m docs.studies.pictures readme` makes both again."""
    *printed, _ = default_run[0].stdout.splitlines()
    assert not_on_page((REPOSITORY / "README.md").read_text(encoding="utf-8"), printed) == []
    draw_first_minute(*recordings(default_run), tmp_path / "now.png")
    assert same_picture(REPOSITORY / "docs" / "images" / "first-minute.png", tmp_path / "now.png")


@pytest.mark.slow
def test_the_drive_with_the_guide_is_of_the_same_driver_train_and_brakes(
    default_run: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    """The figures that are printed are those of the two recordings, at equal arrival and with the motors first."""
    before, after = (Drive.read(path) for path in recordings(default_run))
    run = after.recording.metadata["run"]
    assert (run["driver"], run["advice"], run["friction_policy"]) == (DRIVER, "guide", "electric-first")
    assert all(one.message.presentation == GUIDE for one in after.recording.of(CAB)[20:-5])
    assert after.violations.over_limit_s == 0
    assert abs(after.late_s) < 30.0
    equal = EqualArrival.of(before, after, own=False)
    less_kwh = (before.energy.motors_first.driven_j - after.energy.motors_first.driven_j) / 3.6e6
    assert equal.more_j is not None
    optimum_j = 0.5 * (before.energy.motors_first.optimum_j + after.energy.motors_first.optimum_j)
    said = " ".join(default_run[0].stdout.split())
    printed = [int(one) for one in re.findall(r"(\d+) kWh less", said)]
    assert printed == pytest.approx([less_kwh, -equal.more_j / 3.6e6], abs=0.5)
    (percent,) = re.findall(r"(\d+) % of the optimum", said)
    assert int(percent) == pytest.approx(-100.0 * equal.more_j / optimum_j, abs=0.5)


@pytest.mark.nightly
def test_without_the_guide_the_driver_drives_the_recorded_trip_again(
    default_run: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    """On the train of the simulator of today, with another sequence of chances: 1 % of the energy, 15 s."""
    replayed, alone = recordings(default_run)[0], tmp_path / "alone.mcap"
    what_if = ("what-if", str(replayed), "--driver", DRIVER, "--advice", "none", "--out", str(alone))
    done = das_sim(*what_if, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    before, after = Drive.read(replayed), Drive.read(alone)
    assert abs(EqualArrival.of(before, after, own=False).ratio or math.inf) < 0.01
    assert abs(after.late_s - before.late_s) < 15.0


@pytest.mark.slow
def test_the_recording_holds_every_topic_and_its_inputs(
    default_run: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    """What was heard, said and used is in the recording; advice comes every second, never above the limit."""
    recording = read_recording(recordings(default_run)[0])
    assert recording.complete
    for topic in (POSITION, DELAY, JOURNEY, CONTROL, ADVICE, PLAN, STATUS, EVENT, TRUTH, LOCATION, SAVING, LOG):
        assert recording.of(topic), topic.name
    run = recording.metadata["run"]
    assert run["kind"] == "replay"
    assert len(run["trip_sha256"]) == len(run["route_sha256"]) == len(run["vehicle_sha256"]) == 64
    assert {"zurich-luzern.toml", "re460-ic.toml"} <= set(recording.attachments)
    advices = [m.message for m in recording.of(ADVICE)]
    assert [a.tick for a in advices] == list(range(1, len(advices) + 1))
    assert (np.diff([a.time_ns for a in advices]) == 10**9).all()
    given = [a for a in advices if a.mode]
    assert len(given) > 0.99 * len(advices)
    assert all(a.advised_speed_mps <= a.limit_mps + 1e-6 for a in given)


@pytest.mark.nightly
def test_replay_is_open_loop_and_repeatable(
    default_run: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    """The same recording through the node twice: the same advice, field by field."""
    done = das_sim("replay", str(bundled_recording()), "--out", "again.mcap", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    files = recordings(default_run)[0], tmp_path / "again.mcap"
    first, second = ([m.message.SerializeToString() for m in read_recording(file).of(ADVICE)] for file in files)
    assert first == second


@pytest.fixture(scope="module")
def short_trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up trip of four minutes."""
    folder = tmp_path_factory.mktemp("short")
    made_trip(folder / "made.mcap")
    return folder / "made.mcap"


@pytest.mark.nightly
def test_an_arrival_earlier_than_possible_gives_the_fastest_and_says_how_late(short_trip: Path, tmp_path: Path) -> None:
    """The lateness said is the least time minus the time left."""
    found = das_sim_json(
        "replay", str(short_trip), "--running-time", "150", "--delay", "20", "--out", "run.mcap", cwd=tmp_path
    )
    assert found["timetable_fit"] == "late"
    assert found["timetable_time_left_s"] == pytest.approx(130.0)
    assert found["timetable_late_s"] == pytest.approx(found["min_time_s"] - 130.0, abs=0.1)
    advice = read_recording(tmp_path / "run.mcap").of(ADVICE)[60].message
    assert advice.reason.code == ReasonCode.FASTEST
    assert advice.reason.late_s > 0.0


@pytest.mark.nightly
def test_speed_is_kept_in_real_time(short_trip: Path, tmp_path: Path) -> None:
    """So slow that the wall clock tells it from a replay that does not wait."""
    began = time.monotonic()
    found = das_sim_json("replay", str(short_trip), "--pace", "40", "--out", "run.mcap", cwd=tmp_path)
    assert found["real_time_factor"] <= 40.4
    assert time.monotonic() - began > found["advices"] / 40.4


@pytest.mark.nightly
def test_ctrl_c_ends_cleanly_with_a_whole_recording(short_trip: Path, tmp_path: Path) -> None:
    """The recording is complete and the user is told where it is."""
    child = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", "replay", str(short_trip), "--pace", "5", "--out", "run.mcap"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    out = tmp_path / "run.mcap"
    wait_until(lambda: advices_so_far(out) >= 20)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 130
    assert "recorded so far: run.mcap" in said
    assert "Traceback" not in said
    recording = read_recording(out)
    assert recording.complete
    assert len(recording.of(ADVICE)) >= 20


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_das_sim_that_is_ended_leaves_no_process_behind(short_trip: Path, tmp_path: Path, number: int) -> None:
    """Terminated or killed: node and recorder end as well, and the recording is complete."""
    out = tmp_path / "run.mcap"
    child = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", "replay", str(short_trip), "--pace", "5", "--out", out.name],
        cwd=tmp_path,
        stderr=subprocess.DEVNULL,
    )
    wait_until(lambda: advices_so_far(out) >= 5)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
    assert len(children) >= 2
    child.send_signal(number)
    child.wait(30)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in children), 20.0)
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]
    assert read_recording(out).complete


def test_a_recorded_trip_of_another_section_is_refused(tmp_path: Path) -> None:
    """A trip that goes beyond the section asked for is bad input."""
    said = refusal("replay", str(bundled_recording()), "--to", "Thalwil", "--out", "x.mcap", cwd=tmp_path)
    assert "beyond Thalwil" in said


FLAT = ("--route", "flat-6km", "--vehicle", "re460-ic")
BAD = [
    (["view", "junk.mcap", "--save", "junk.mcap"], "the output file is also an input"),
    (["replay", "nothing.csv", *FLAT, "--posts", "posts.csv"], "nothing.csv"),
    (["replay", "empty.csv", *FLAT, "--posts", "posts.csv"], "empty.csv"),
    (["replay", "nan.csv", *FLAT, "--posts", "posts.csv"], "nan.csv.*line 2"),
    (["replay", "far.csv", *FLAT, "--posts", "posts.csv"], "far.csv.*line 1"),
    (["replay", "good.csv", "--vehicle", "re460-ic"], "good.csv: a trip without a journey needs --route"),
    (["replay", "good.csv", *FLAT], "no geometry.*--posts"),
    (["replay", "good.csv", "--route", "unit.json", "--vehicle", "re460-ic"], "unit.json: stops.unit = 'miles'"),
    (["replay", "good.csv", "--route", "down.json", "--vehicle", "re460-ic"], "down.json: gradients"),
    (["replay", "good.csv", *FLAT, "--pace", "fast"], "--pace fast"),
    (["replay", "good.csv", *FLAT, "--running-time", "-5"], "--running-time -5"),
    (["replay", "good.csv", *FLAT, "--delay", "nan"], "--delay nan"),
    (["replay", "good.csv", *FLAT, "--out", "no/where.mcap"], "no such folder"),
    (["replay", "junk.mcap"], "junk.mcap"),
    (["view", "junk.mcap", "--save", "x.rrd"], "junk.mcap"),
    (["view", "nothing.mcap", "--save", "x.rrd"], "nothing.mcap"),
    (["make-trip", *FLAT, "--out", "x.mcap"], "run instead: das-sim run SCENARIO --advice none"),
]


@pytest.fixture(scope="module")
def bad_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad")
    posts = "\n".join(f"47.0,{8 + 0.0131 * k:.6f},{3490000 + k}" for k in range(7)) + "\n"
    (folder / "posts.csv").write_text(posts)
    good = [
        f"47.0,{8 + 0.0131 * 6 * i / 60:.6f},{0 if i in (0, 60) else 90},{1_600_000_000_000 + 4000 * i}"
        for i in range(61)
    ]
    (folder / "good.csv").write_text("\n".join(good) + "\n")
    (folder / "empty.csv").write_text("")
    (folder / "nan.csv").write_text("\n".join(line.replace(",90,", ",x,") for line in good))
    (folder / "far.csv").write_text("\n".join(line.replace("47.0,", "48.0,") for line in good))
    track: dict[str, Any] = {
        "metadata": {"id": "x"},
        "stops": {"unit": "miles", "values": [0, 6000]},
        "speed limits": {"units": {"position": "m", "velocity": "km/h"}, "values": [[0, 100]]},
        "gradients": {"units": {"position": "m", "slope": "permil"}, "values": [[0, 1], [500, 2], [400, 3]]},
    }
    (folder / "unit.json").write_text(json.dumps(track))
    track["stops"]["unit"] = "m"
    (folder / "down.json").write_text(json.dumps(track))
    (folder / "junk.mcap").write_bytes(os.urandom(500))
    return folder


@pytest.mark.parametrize(("arguments", "message"), BAD, ids=lambda x: x if isinstance(x, str) else None)
def test_bad_input_is_one_line_and_exit_code_2(bad_folder: Path, arguments: list[str], message: str) -> None:
    """Each kind of bad file or option is named in one line, and nothing is written."""
    assert re.search(message, refusal(*arguments, cwd=bad_folder))
    assert not list(bad_folder.glob("**/*.rrd"))


# --- the parts of a replay ---------------------------------------------------------------------------------------


def test_estimate_of_an_optimal_run_finds_its_energy() -> None:
    """Inverse dynamics of a solved run sampled each second: the energy comes back within 0.5 %."""
    section = build_section(load_route("zurich-luzern"), load_vehicle("re460-ic"), end_m=29_000.0)
    solution = solve_front(section).trajectory(1_250.0)
    run = solution.trajectory
    t = np.arange(0.0, run.time_s, 1.0)
    s = np.interp(t, run.t_s, run.s_m)
    v = np.interp(t, run.t_s, run.v_mps)
    estimate = estimate_run(section, t, s, v)
    assert estimate.balance.input == pytest.approx(solution.balance.input, rel=5e-3)
    assert estimate.beyond_ratio < 0.01


@pytest.mark.slow
def test_halving_the_plants_step_changes_its_energy_little() -> None:
    """The train model's integration has converged: 0.1 s against 0.05 s within 0.2 %."""
    route, vehicle = load_route("zurich-luzern"), load_vehicle("re460-ic")
    energies = []
    for step_s in (0.1, 0.05):
        plant = HurriedPlant(route, vehicle, vehicle.loss_model(vehicle.default_level), step_s)
        driver = HurriedDriver(route, vehicle, 12_000.0, 0, wander_mps=0.0)
        state = HurriedState(time_s=0.0, s_m=0.0, speed_mps=0.0)
        while state.s_m < 8_000.0:
            state = plant.step(state, driver.wanted_force_n(state.s_m, state.speed_mps, step_s))
        energies.append(state.energy_input_j)
    assert energies[0] == pytest.approx(energies[1], rel=2e-3)


def test_plant_runs_down_to_a_standstill_by_resistance_alone() -> None:
    """Coasting on the level: the way to standstill against ∫ m·v/R(v) dv, by quadrature."""
    vehicle = load_vehicle("re460-ic")
    plant = HurriedPlant(load_route("flat-6km"), vehicle, vehicle.loss_model(vehicle.default_level))
    state = HurriedState(time_s=0.0, s_m=0.0, speed_mps=8.0)
    while state.speed_mps > 0:
        state = plant.step(state, 0.0)
    v = np.linspace(0.0, 8.0, 20_001)
    way = np.trapezoid(vehicle.inertial_mass_kg * v / vehicle.resistance.force_n(v), v)
    assert state.s_m == pytest.approx(way, rel=2e-3)


@pytest.mark.nightly
def test_make_trip_makes_the_bundled_recording_again(tmp_path: Path) -> None:
    """The command in recordings/README.md gives the bundled recording, field by field."""
    done = in_a_process("tests.support.make_trip", "again.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    ours, bundled = read_recording(tmp_path / "again.mcap"), read_recording(bundled_recording())
    for topic in (JOURNEY, POSITION, DELAY, LOCATION):
        a = [m.message for m in ours.of(topic)]
        b = [m.message for m in bundled.of(topic)]
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            for field in x.DESCRIPTOR.fields:
                left, right = getattr(x, field.name), getattr(y, field.name)
                assert left == (pytest.approx(right, abs=1e-3) if isinstance(right, float) else right)
