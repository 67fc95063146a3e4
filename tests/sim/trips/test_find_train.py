"""Finding the train of a trip: a motion by forces that are known, its mass and resistance, and what it cannot be."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_vehicle
from das.domain.route import Route
from das.domain.units import KMH, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from docs.studies.output import DOCS
from docs.studies.planted_trains import PAGE, TRAINS, planted_drives
from sim.cli.trips import trip as trip_command
from sim.options import TripOptions
from sim.trips.find_train import FoundTrain, candidates, find_train, held_speed_mps, shares
from sim.trips.record import read_trip
from sim.trips.trip import Trip, load_trip
from tests.support.dirt import Point, write
from tests.support.make_trip import made_trip
from tests.support.making import das_sim, make_route, make_train

LENGTH_M, TOP_MPS = 16_000.0, 36.0
PLANTED_ROW = re.compile(r"\| (\d) of 4 \| (\d+) to (\d+) % \| (\d+) % \| (\d+) % \| (\d) of 4 \|")
GRADES = [(0.0, 0.0), (2000.0, 0.006), (3500.0, -0.004), (6000.0, 0.003), (9000.0, -0.006), (12_000.0, 0.002)]
MASS, RESISTANCE = 1.12, 0.9


def line() -> Route:
    return make_route(LENGTH_M, [(0.0, 40.0)], GRADES)


def own_train() -> Vehicle:
    return replace(make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.6e6), max_speed_mps=40.0)


def drive(train: Vehicle, on: Route) -> list[Point]:
    """Full traction to 36 m/s, coasting to 30 m/s, full traction again, …; at the end 0.5 m/s²: Euler in 0.05 s."""
    points, s, v, full, t = [Point(float(i), 0.0, 0.0) for i in range(10)], 0.0, 0.0, True, 10.0
    step = 0.05
    for i in range(100_000):
        if i % 20 == 0:
            points.append(Point(t, s, v))
        braked = v * v / (2 * 0.5) >= LENGTH_M - s
        full = v < TOP_MPS if full else v < 30.0
        slope = STANDARD_GRAVITY_MPS2 * float(on.gradients_ratio.at(s))
        resisted = float(train.resistance.force_n(v)) + train.mass_kg * slope
        force = float(train.traction_effort_n(max(v, 0.1))) if full else 0.0
        a = -0.5 if braked else (force - resisted) / train.inertial_mass_kg
        if braked and v + a * step <= 0.0:
            break
        s, v, t = s + v * step + 0.5 * a * step**2, max(v + a * step, 0.0), t + step
    return [*points, *(Point(points[-1].t + 1 + i, LENGTH_M, 0.0) for i in range(10))]


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Trip:
    """The record of the train with another mass and resistance, with noise of 0.1 m/s and 2 m."""
    rng = np.random.default_rng(5)
    truth = Conditions(mass_ratio=MASS, resistance_ratio=RESISTANCE).train(own_train())

    def seen_of(p: Point) -> Point:
        off_m, off_mps = 2.0 * rng.standard_normal(), 0.1 * rng.standard_normal()
        return replace(p, v=max(p.v + off_mps, 0.0), s_m=p.s_m + off_m) if p.v else p

    seen = [seen_of(p) for p in drive(truth, line())]
    path = write(tmp_path_factory.mktemp("trip"), seen, on_route=True)
    return load_trip(path, read_trip(path), line(), TripOptions())


def others() -> list[tuple[str, Vehicle]]:
    """A weak train, a slow one, one of twice the mass and effort but half the specific resistance, and the true one."""
    own = own_train()
    weak = replace(own, traction=EffortEnvelope(max_force_n=5e4, max_power_w=6e5))
    heavy = replace(own, mass_kg=3e5, traction=EffortEnvelope(max_force_n=4e5, max_power_w=9e6))
    slow = replace(own, max_speed_mps=80 * KMH)
    return [("weak", weak), ("slow", slow), ("heavy", heavy), ("own", own), ("same", replace(own, id="same"))]


def test_the_train_is_found_with_its_mass_and_its_resistance(trip: Trip) -> None:
    found = find_train(trip, others())
    first = found[0]
    assert first.names == ("own", "same")  # nothing that a motion shows tells the two apart
    assert first.possible
    assert first.mass_known
    assert first.mass_ratio == pytest.approx(MASS, abs=0.03)
    assert first.resistance_ratio == pytest.approx(RESISTANCE, abs=0.06)
    assert abs(first.mass_ratio - MASS) < 3 * first.mass_sd
    assert first.fitted.mass_kg == pytest.approx(first.mass_ratio * first.vehicle.mass_kg)
    assert first.beyond_ratio < 0.01
    assert shares(found)["own"] > 0.9
    assert sum(shares(found).values()) == pytest.approx(1.0)


def test_a_train_that_is_too_weak_or_too_slow_is_none(trip: Trip) -> None:
    found = {one.names[0]: one for one in find_train(trip, others())}
    assert held_speed_mps(trip) == pytest.approx(TOP_MPS, abs=0.6)
    assert not found["weak"].possible
    assert found["weak"].beyond_ratio > 0.1
    assert "of the time the trip needs more effort than this train has" in found["weak"].why_not
    assert found["slow"].why_not == f"the trip held {held_speed_mps(trip) / KMH:.0f} km/h, this train runs 80 km/h"
    assert "weak" not in shares(found.values())


def test_a_top_speed_may_be_exceeded_by_a_little(trip: Trip) -> None:
    driven = held_speed_mps(trip)
    names = {"near": driven / 1.04, "far": driven / 1.06}
    found = find_train(trip, [(name, replace(own_train(), max_speed_mps=top)) for name, top in names.items()])
    assert {one.names[0]: one.possible for one in found} == {"near": True, "far": False}


def test_of_two_trains_that_differ_in_top_speed_that_which_is_driven_near_it_is_likelier(trip: Trip) -> None:
    """The high speed (90th percentile) is below the allowed one by a share that is exponential, 10 % in the mean."""
    place_m = np.linspace(trip.run.s_m[0], trip.run.s_m[-1], 1000)
    driven_mps = float(np.percentile(np.interp(place_m, trip.run.s_m, trip.run.speed_mps), 90.0))
    found = find_train(trip, [(f"{top:.0f}", replace(own_train(), max_speed_mps=top)) for top in (37.0, 40.0)])
    evidence = {one.names[0]: one.evidence for one in found}
    assert evidence["37"] - evidence["40"] == pytest.approx(
        10.0 * (driven_mps / 37.0 - driven_mps / 40.0) + math.log(40.0 / 37.0), abs=0.01
    )


def test_none_of_the_trains_may_be_possible(trip: Trip) -> None:
    found = find_train(trip, others()[:2])
    assert not any(one.possible for one in found)
    assert shares(found) == {}


def test_a_few_seconds_are_too_short(trip: Trip, tmp_path: Path) -> None:
    path = write(tmp_path, drive(own_train(), line())[:50], on_route=True)
    short = load_trip(path, read_trip(path), line(), TripOptions())
    with pytest.raises(DasError, match=r"too short to find its train: \d stretches of 12 s above 18 km/h, expected"):
        find_train(short, others())


def test_candidates_are_names_files_folders_or_all(tmp_path: Path) -> None:
    bundled = catalogue("vehicles")
    assert [name for name, _ in candidates("all")] == list(bundled)
    (tmp_path / "mine.toml").write_bytes(bundled["re460-ic-igbt"].read_bytes())
    (tmp_path / "a-route.toml").write_text("[route]\n")
    (tmp_path / "track.json").write_text("{}")
    found = candidates(f"re460-ic, {tmp_path},re460-ic")
    assert [name for name, _ in found] == ["re460-ic", str(tmp_path / "mine.toml")]
    assert found[0][1].mass_kg == load_vehicle("re460-ic").mass_kg


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "a name is missing, expected trains with commas between them, or all"),
        ("re460-ic,,all", "a name is missing"),
        ("nothing.toml", "nothing.toml: no such file"),
        ("nothing", "nothing: not a bundled vehicle"),
        (str(DOCS), "no vehicle file in this folder"),
    ],
)
def test_trains_that_cannot_be_used_are_refused(text: str, expected: str) -> None:
    with pytest.raises(DasError, match=expected):
        candidates(text)


def test_one_train_and_several_are_two_questions(tmp_path: Path) -> None:
    for said in ({"vehicle": "re460-ic"}, {"loss_map": tmp_path / "map.csv"}):
        with pytest.raises(DasError, match=r"--vehicles identifies the train: expected no --.* with it"):
            trip_command(tmp_path / "x.csv", TripOptions(route="flat-6km", **said), vehicles="all")  # type: ignore[arg-type]


@pytest.mark.nightly
def test_the_command_says_which_train_it_was_and_a_replay_without_one_offers_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive on the bundled flat line by the Re 460: of six trains the metro is too slow."""
    import json

    monkeypatch.setenv("COLUMNS", "140")
    made_trip(tmp_path / "made.mcap")
    assert das_sim("trip", "made.mcap", "--out", "made.csv", cwd=tmp_path).returncode == 0
    where = ("made.csv", "--route", "flat-6km", "--no-reverse")
    told = das_sim("trip", *where, "--vehicles", "all", cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert "which train it was" in told.stdout
    assert "CN_Beijing_Subway cannot have driven this record: the trip held" in told.stdout
    rows = json.loads(das_sim("trip", *where, "--vehicles", "all", "--json", cwd=tmp_path).stdout)["trains"]
    true = next(one for one in rows if "re460-ic" in one["names"])
    assert true["possible"]
    assert true["above_optimum_kwh"] is not None
    assert all((one["not_comparable"] is None) == (one["above_optimum_kwh"] is not None) for one in rows)
    refused = das_sim("replay", *where, cwd=tmp_path)
    assert refused.returncode == 2
    assert "das-sim trip made.csv --route flat-6km --vehicles all" in refused.stderr


def _named(found: Sequence[FoundTrain]) -> set[str]:
    return {name for one in found if one.possible for name in one.names}


@pytest.mark.nightly
def test_planted_trains_are_found_and_the_page_says_so() -> None:
    """A drive of each train, one of the four in its row of the page: what is found is as good as the row says."""
    page = PAGE.read_text(encoding="utf-8")
    drives = list(planted_drives(journeys=(2,)))
    assert len(drives) == len(TRAINS)
    for one in drives:
        assert one.train in _named(one.found)
        (row,) = (line for line in page.splitlines() if line.startswith(f"| {one.train} | "))
        ((first, low, high, mass, resistance, known),) = PLANTED_ROW.findall(row)
        likely = 100.0 * shares(one.found)[one.true.names[0]]
        assert float(low) - 1.0 <= likely <= float(high) + 1.0
        assert 100.0 * abs(one.off_ratios[0]) <= float(mass) + 1.0
        assert 100.0 * abs(one.off_ratios[1]) <= float(resistance) + 1.0
        assert first != "4" or one.rank == 1
        assert known == ("4" if one.true.mass_known else "0")
