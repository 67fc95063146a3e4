"""The files of `das-sim example`: they are read by our readers, and every command in their README runs on them."""

from __future__ import annotations

import csv
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sim
from das.bus.session import endpoint, free_ports
from das.command_line.process import EXIT_INTERRUPTED
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH
from das.solver.kernels.guide_policy import STANDS_S
from precompute.tables.plan import read_plan
from sim.bundled import example_files
from sim.options import TripOptions
from sim.trips.cleaning import FindingKind
from sim.trips.line import Line, read_kilometre_posts
from sim.trips.record import read_trip
from sim.trips.trip import load_trip
from sim.world.scenario import load_scenario
from sim.world.service import lay_out
from tests.support.example_trip import trip_files
from tests.support.made_map import EXAMPLE, map_files
from tests.support.making import das_precompute, das_sim, refusal

FILES = sorted(example_files())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example as the command writes it."""
    parent = tmp_path_factory.mktemp("example")
    done = das_sim("example", "my line", cwd=parent)
    assert done.returncode == 0, done.stderr
    assert "cd 'my line'" in done.stdout
    return parent / "my line"


def commands(folder: Path, *begin: str) -> list[str]:
    """The lines of README.txt that begin with one of some words."""
    lines = (folder / "README.txt").read_text(encoding="utf-8").splitlines()
    found = [line for line in lines if line.startswith(begin)]
    assert found
    return found


def run(folder: Path, line: str) -> str:
    """Run a line of README.txt in the folder; what it printed."""
    program, *arguments = shlex.split(line)
    if program == "das-sim":
        done = das_sim(*arguments, cwd=folder)
    else:
        assert program == "das-precompute"
        done = das_precompute(folder, *arguments)
    assert done.returncode == 0, f"{line}: {done.stderr}"
    assert "warning" not in done.stderr
    return done.stdout


# --- the files -------------------------------------------------------------------------------------------------------


def test_the_folder_holds_what_readme_lists(folder: Path) -> None:
    readme = (folder / "README.txt").read_text(encoding="utf-8")
    assert all(f"  {name}" in readme for name in FILES if name != "README.txt")
    assert {path.name for path in folder.iterdir()} >= set(FILES)


@pytest.mark.slow
def test_a_driver_who_brakes_early_for_his_stop_is_not_told_to_release_for_a_moment(folder: Path) -> None:
    """Seed 2 brakes early for Bedorf; instructions of one second at odd speeds were shown to him once.

    A driver slower than a limit before its brake is due needs no brake: that promise is not kept.
    """
    found = sim.run_day(folder / "scenario.toml", 2, driver="human", advice="guide").outcome
    assert found["shortest_instruction_s"] >= STANDS_S
    assert found["odd_speeds"] == 0
    assert found["promises_kept_ratio"] > 0.8


def test_route_vehicle_scenario_and_plan_belong_together(folder: Path) -> None:
    route, vehicle = load_route(str(folder / "route.toml")), load_vehicle(str(folder / "vehicle.toml"))
    assert [stop.name for stop in route.stops] == ["Adorf", "Bedorf", "Cedorf"]
    assert vehicle.loss_model(vehicle.default_level).loss_w(0.0, 10.0) > 0
    scenario = load_scenario(str(folder / "scenario.toml"))
    of_day, train, stops = lay_out(scenario)
    assert (of_day.id, train.id, len(stops)) == (route.id, vehicle.id, 3)
    jobs = read_plan(folder / "plan.toml").jobs
    assert {(job.route.id, job.vehicle.id) for job in jobs} == {(route.id, vehicle.id)}
    assert len(jobs) == 4  # two sections in both directions


def test_the_course_on_the_map_is_as_long_as_the_line_and_bends_as_its_curves(folder: Path) -> None:
    """The way on the map by chords, and the change of heading in each curve: its length divided by its radius."""
    route = load_route(str(folder / "route.toml"))
    line = Line.from_route(route)
    places = np.array([route.location_deg(s) for s in np.arange(0.0, 14_001.0, 25.0)])
    here, there = places[:-1], places[1:]
    north = np.radians(there[:, 0] - here[:, 0]) * 6_371_008.8
    east = np.radians(there[:, 1] - here[:, 1]) * 6_371_008.8 * np.cos(np.radians(line.latitude_deg.mean()))
    assert np.hypot(north, east) == pytest.approx(25.0, abs=0.2)
    heading = np.unwrap(np.arctan2(east, north))
    for start_m, end_m, radius_m in ((2000, 2600, 900.0), (3600, 4000, -1100.0), (8000, 9000, -1200.0)):
        turned = heading[round(end_m / 25) + 4] - heading[round(start_m / 25) - 5]
        assert turned == pytest.approx((end_m - start_m) / radius_m, abs=0.01)


def test_the_recorded_trip_is_that_of_a_train_with_a_receivers_noise(folder: Path) -> None:
    trip = load_trip(
        folder / "trip.csv",
        read_trip(folder / "trip.csv"),
        load_route(str(folder / "route.toml")),
        TripOptions(reverse=True, posts=folder / "posts.csv"),
    )
    report = trip.matched.report
    assert trip.whole
    assert trip.direction_known
    assert report.cleaning.kept == report.cleaning.read
    assert {finding.kind for finding in report.cleaning.findings} <= {FindingKind.STANDING_DRIFT, FindingKind.STEP_BACK}
    assert report.anchor == "start and end"
    assert report.scale == pytest.approx(1.0, abs=0.002)
    assert report.median_cross_track_m is not None
    assert 0.5 < report.median_cross_track_m < 5.0
    allowed = trip.route.limits_mps.at(trip.run.s_m)
    assert np.all(trip.run.speed_mps < allowed + 5.0 * KMH)


def test_the_trip_fits_the_map_of_the_route_as_well(folder: Path) -> None:
    route = load_route(str(folder / "route.toml"))
    trip = load_trip(folder / "trip.csv", read_trip(folder / "trip.csv"), route, TripOptions(reverse=True))
    assert trip.whole
    assert trip.matched.report.anchor == "route"


@pytest.mark.slow
def test_the_trip_and_its_posts_are_made_again() -> None:
    """`python -m tests.support.example_trip` writes them anew; another seed has other errors of the receiver."""
    assert trip_files() == {name: (EXAMPLE / name).read_bytes() for name in ("posts.csv", "trip.csv")}
    assert trip_files(2)["trip.csv"] != trip_files()["trip.csv"]


def test_the_map_and_the_altitudes_are_those_of_the_line() -> None:
    """`python -m tests.support.made_map` writes them anew."""
    made = map_files(load_route(str(EXAMPLE / "route.toml")))
    assert made == {name: (EXAMPLE / name).read_bytes() for name in made}


def test_the_line_is_made_once_more_from_the_map(folder: Path) -> None:
    said = [run(folder, line) for line in commands(folder, "das-precompute route")]
    assert all("adorf-cedorf" in one for one in said)
    assert [stop.name for stop in load_route(folder / "mapped.toml").stops] == ["Adorf", "Bedorf", "Cedorf"]


def test_posts_are_written_as_a_person_would(folder: Path) -> None:
    rows = list(csv.reader((folder / "posts.csv").read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["latitude", "longitude", "kilometre"]
    assert [row[2] for row in rows[1:3]] == ["14.0", "13.9"]
    assert rows[-1][2] == "0.0"
    assert read_kilometre_posts(folder / "posts.csv").chainage_m[-1] == pytest.approx(14_000.0)


# --- the command -----------------------------------------------------------------------------------------------------


def test_a_folder_with_files_in_it_is_refused_unless_they_may_be_replaced(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    (tmp_path / "full" / "route.toml").write_text("old")
    (tmp_path / "empty").mkdir()
    assert "full: there are files in it already" in refusal("example", "full", cwd=tmp_path)
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == ["notes.txt", "route.toml"]
    assert das_sim("example", "full", "--overwrite", cwd=tmp_path).returncode == 0
    assert (tmp_path / "full" / "notes.txt").read_text() == "mine"
    assert (tmp_path / "full" / "route.toml").read_text(encoding="utf-8").startswith("# A working example")
    assert das_sim("example", "empty", cwd=tmp_path).returncode == 0
    assert sorted(path.name for path in (tmp_path / "empty").iterdir()) == FILES


@pytest.mark.parametrize(
    ("where", "message"),
    [("no/where", "no such folder no"), ("file", "is a file, expected a folder"), ("file/x", "no such folder file")],
)
def test_where_nothing_can_be_written_nothing_is(tmp_path: Path, where: str, message: str) -> None:
    (tmp_path / "file").write_text("x")
    assert message in refusal("example", where, cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


# --- the commands in README.txt --------------------------------------------------------------------------------------


def test_a_section_is_solved(folder: Path) -> None:
    for line in commands(folder, "das-precompute solve"):
        assert "example-line" in run(folder, line)
    assert (folder / "run.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "run.csv").is_file()


def test_the_recorded_trip_is_looked_at(folder: Path) -> None:
    (line,) = commands(folder, "das-sim trip")
    said = run(folder, line)
    assert "Cedorf" in said
    assert "net input" in said


@pytest.mark.nightly
def test_fronts_and_journeys(folder: Path) -> None:
    for line in commands(folder, "das-precompute front", "das-precompute journey"):
        assert run(folder, line)


@pytest.mark.nightly
def test_tables_are_built_shown_and_verified_and_a_node_starts_with_them(folder: Path) -> None:
    for line in commands(folder, "das-precompute build", "das-precompute show", "das-precompute verify"):
        assert run(folder, line)
    assert len(list((folder / "tables").glob("*_*.json"))) == 4
    (line,) = commands(folder, "das-node")
    (own,) = (endpoint(port) for port in free_ports(1))
    _, *arguments = shlex.split(line)
    node = subprocess.Popen(
        [sys.executable, "-m", "das.node", *arguments, "--listen", own], cwd=folder, stderr=subprocess.PIPE, text=True
    )
    try:
        assert node.stderr is not None
        assert any(own in line for line in node.stderr)  # so it listens, or its output has ended
        node.send_signal(signal.SIGTERM)
        _, said = node.communicate(timeout=60)
    finally:
        node.kill()
    assert node.returncode in (0, EXIT_INTERRUPTED), said  # the latter where it was still starting
    assert "Traceback" not in said


@pytest.mark.nightly
def test_a_day_is_driven_and_drawn_and_many_are(folder: Path) -> None:
    for line in commands(folder, "das-sim run", "das-sim report day", "das-sim experiment run"):
        assert run(folder, line)
    assert (folder / "day.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert (folder / "runs" / "trials.csv").is_file()


@pytest.mark.nightly
def test_the_recorded_trip_is_replayed_and_drawn(folder: Path) -> None:
    for line in commands(folder, "das-sim replay", "das-sim report replay"):
        said = run(folder, line)
    assert "written: replay.html" in said
