"""The verifier: against closed forms, silent on what the solver plans, and finding every planted error."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.files.load import load_route, load_vehicle, locate_route, locate_vehicle
from das.domain.losses import Level
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from precompute.cli.report import solution_json
from tests.support.making import csv_rows, das_precompute
from tests.support.raw_data import (
    Effort,
    Floats,
    G,
    Line,
    Steps,
    Train,
    constant_efficiencies,
    curve_resistance,
    read_loss_map,
    read_rows,
)
from tests.support.verifier import Drive, Finding, verify

LENGTH_M = 9000.0
STRAIGHT = ["infinity", "infinity"]
TRACK: dict[str, Any] = {
    "stops": {"unit": "m", "values": [0.0, LENGTH_M]},
    "altitude": {"unit": "m", "value": 400.0},
    "speed limits": {
        "units": {"position": "m", "velocity": "km/h"},
        "values": [[0.0, 90], [1500.0, 120], [4000.0, 60], [4600.0, 110], [7000.0, 100]],
    },
    "gradients": {
        "units": {"position": "m", "slope": "permil"},
        "values": [[0.0, 0.0], [800.0, 8.5], [2000.0, -12.0], [3100.0, 3.0], [5200.0, -18.0], [6000.0, 0.0]],
    },
    "curvatures": {
        "units": {"position": "m", "radius at start": "m", "radius at end": "m"},
        "values": [
            [0.0, *STRAIGHT],
            [1000.0, "infinity", 400.0],
            [1200.0, 400.0, 400.0],
            [1500.0, *STRAIGHT],
            [4000.0, -250.0, -250.0],
            [4300.0, *STRAIGHT],
        ],
    },
    "tunnels": {
        "units": {"position": "m", "length": "m", "cross section": "m^2"},
        "values": [[2200.0, 900.0, 36.0], [6100.0, 600.0, 60.0]],
    },
}
"""Lower limits between higher ones, hills, a clothoid, a wide and a tight curve, two tunnels."""
TRAIN: dict[str, Any] = {
    "mass": {"unit": "kg", "value": 180_000},
    "rho": {"unit": "%", "value": 8.0},
    "length": {"unit": "m", "value": 150.0},
    "max traction power": {"unit": "kW", "value": 2500.0},
    "max reg braking power": {"unit": "kW", "value": 2200.0},
    "max traction force": {"unit": "kN", "value": 180.0},
    "max reg braking force": {"unit": "kN", "value": 150.0},
    "max pn braking force": {"unit": "kN", "value": 90.0},
    "max speed": {"unit": "km/h", "value": 115.0},
    "rolling resistance r0": {"unit": "kN", "value": 2.6},
    "rolling resistance r1": {"unit": "kN/(km/h)", "value": 0.02},
    "rolling resistance r2": {"unit": "kN/(km/h)^2", "value": 0.0009},
    "efficiency traction": {"unit": "%", "value": 88.0},
    "efficiency reg brake": {"unit": "%", "value": 85.0},
    "tunnel resistance": {
        "units": {"cross section": "m^2", "coefficient": "kN/(km/h)^2"},
        "values": [[24, 0.0012], [48, 0.0005]],
    },
}
Change = Callable[[dict[str, Any], dict[str, Any]], None]
Planned = tuple[Floats, dict[str, Any]]
"""Rows, and what the command says of them."""


def planned(
    folder: Path,
    change: Change | None = None,
    buffer_ratio: float = 0.05,
    *,
    end_m: float | None = None,
    end_speed_mps: float = 0.0,
) -> Planned:
    """What the solver plans for the track and train, or for changed ones."""
    track, train = copy.deepcopy(TRACK), copy.deepcopy(TRAIN)
    if change is not None:
        change(track, train)
    for name, data in (("track", track), ("train", train)):
        (folder / f"{name}.json").write_text(json.dumps(data))
    route, vehicle = load_route(str(folder / "track.json")), load_vehicle(str(folder / "train.json"))
    section = build_section(route, vehicle, end_m=end_m, options=SectionOptions(end_speed_mps=end_speed_mps))
    front = solve_front(section)
    least_s = front.fastest().time_s
    solution = front.trajectory(least_s * (1 + buffer_ratio))
    return csv_rows(solution.trajectory), solution_json(solution, least_s, 0.0)


def found(plan: Planned, line: Line | None = None, train: Train | None = None) -> list[Finding]:
    """What the verifier says of a plan for the unchanged track and train (or given ones)."""
    train = train or Train.of(TRAIN)
    rows, claim = plan
    return verify(rows, line or Line.of(TRACK), train, train.own_loss(), ends_m=(0.0, LENGTH_M), claim=claim)


def assert_found(findings: list[Finding], expected: str) -> None:
    assert any(finding.what.startswith(expected) for finding in findings), "\n".join(map(str, findings))


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Planned:
    return planned(tmp_path_factory.mktemp("good"))


# --- closed forms -----------------------------------------------------------------------------------------------


def simple(rows: list[list[float]], **train: Any) -> Drive:
    """Rows driven by 100 t without resistance or losses on a level straight line at 30 m/s (or another train)."""
    nothing = {"r0_n": 0.0, "r1_n_per_mps": 0.0, "r2_n_per_mps2": 0.0, "rotating_kg": 0.0, "mass_kg": 1e5}
    nothing |= {"length_m": 0.0, "efficiencies": (1.0, 1.0)}
    chosen = replace(Train.of(TRAIN), **(nothing | train))
    zero = Steps(np.zeros(1), np.zeros(1))
    line = Line(zero, zero, Steps(np.zeros(1), np.full(1, 30.0)), (), (0.0, 1e4), Steps(np.zeros(1), np.ones(1)))
    return Drive(np.array(rows), line, chosen, chosen.own_loss())


def test_a_constant_force_without_resistance_is_uniform_acceleration() -> None:
    """Closed form: F = m·a with 1 m/s² from 10 to 20 m/s is 150 m in 10 s, and 15 MJ."""
    drive = simple([[0, 0, 10, 1e5, 0, 0, 30], [150, 10, 20, 0, 0, 0, 30]])
    places, speeds = drive.driven
    assert speeds[-1] == pytest.approx([20.0], abs=1e-12)
    assert places[-1] == pytest.approx([150.0], abs=1e-11)
    assert drive.balance_n == pytest.approx([0.0], abs=1e-6)
    assert drive.ledger_j["input"] == pytest.approx(1.5e7, rel=1e-12)
    assert drive.ledger_j["kinetic"] == pytest.approx(1.5e7, rel=1e-12)


def test_coasting_against_the_air_follows_the_closed_form() -> None:
    """Closed form: m·dv/dt = −c·v² gives v = v0/(1 + v0·c·t/m) and s = m/c·ln(1 + v0·c·t/m)."""
    c, seconds = 50.0, 20.0
    drive = simple([[0, 0, 25, 0, 0, 0, 30], [400, seconds, 20, 0, 0, 0, 30]], r2_n_per_mps2=c)
    places, speeds = drive.driven
    grown = 1 + 25 * c * seconds / 1e5
    assert speeds[-1] == pytest.approx([25 / grown], rel=1e-7)
    assert places[-1] == pytest.approx([1e5 / c * np.log(grown)], rel=1e-7)


def test_resistance_of_an_accelerated_way_by_hand() -> None:
    """Closed form: ∫v dv/a = 150 m, ∫v² dv/a = 7000/3, ∫v³ dv/a = 37500 for a = 1 m/s², 10 to 20 m/s."""
    drive = simple(
        [[0, 0, 10, 0, 0, 0, 30], [150, 10, 20, 0, 0, 0, 30]], r0_n=1e3, r1_n_per_mps=20.0, r2_n_per_mps2=4.0
    )
    assert drive.ledger_j["resistance"] == pytest.approx(1e3 * 150 + 20 * 7000 / 3 + 4 * 37500, rel=1e-12)


def test_a_profile_under_the_train_is_its_mean_over_the_length() -> None:
    """Means and integrals against sums over 20 000 points of the train."""
    steps = Steps(np.array([0.0, 100.0, 130.0, 500.0]), np.array([2.0, -7.0, 4.0, 1.0]))
    heads = np.array([50.0, 120.0, 200.0, 650.0])
    for length in (0.0, 60.0, 400.0):
        back = (np.arange(20_000) + 0.5) / 20_000 * length
        expected = [steps.at(head - back).mean() for head in heads]
        assert steps.under(heads, length) == pytest.approx(np.array(expected), abs=1e-3)
        way = np.linspace(heads[0], heads[-1], 60_001)
        driven = steps.driven(heads, length)
        assert driven[-1] - driven[0] == pytest.approx(np.trapezoid(steps.under(way, length), way), rel=1e-4)


def test_curves_tunnels_and_grip_by_hand() -> None:
    """The formulas written out with numbers, for a few radii, cross sections and speeds."""
    assert curve_resistance(1 / 500) == pytest.approx(9.81 * 0.5 / (500 - 30))
    assert curve_resistance(1 / 300) == pytest.approx(9.81 * 0.5 / (300 - 30))
    assert curve_resistance(1 / 200) == pytest.approx(9.81 * 0.65 / (200 - 55))
    train = Train.of(TRAIN)
    profile = train.tunnel_profile(Line.of(TRACK))  # half-way between the cross sections; beyond the larger one
    assert profile.at(np.array([2000.0, 2500.0, 3200.0, 6200.0])) / 12960 == pytest.approx([0, 0.00085, 0, 0.0005])
    grip_n = 40e3 * 9.81 * (0.161 + 7.5 / 80)
    assert replace(train, adhesive_kg=40e3).motors_n(np.array([10.0]))[0] == pytest.approx([grip_n])


def test_units_of_both_formats() -> None:
    """Figures of a TOML and of a JSON file in SI, converted by hand."""
    line, train = Line.read(locate_route("zurich-luzern")), Train.read(locate_vehicle("re460-ic"))
    assert line.stops_m == (0.0, 12e3, 29e3, 57e3)
    assert (train.mass_kg, train.length_m, train.brakes) == (440e3, 200.0, "electric")
    assert train.max_speed_mps == pytest.approx(200 / 3.6)
    assert train.r2_n_per_mps2 == pytest.approx(8.6)
    assert train.traction == Effort(300e3, 6100e3)
    ours = Train.of(TRAIN)
    assert ours.r2_n_per_mps2 == pytest.approx(0.9 * 3.6**2)
    assert ours.r1_n_per_mps == pytest.approx(20 * 3.6)
    assert ours.inertia_kg == pytest.approx(194.4e3)


def test_a_loss_map_is_bilinear_and_goes_on_past_its_edge(tmp_path: Path) -> None:
    """A map of five points, interpolated and continued by hand."""
    path = tmp_path / "map.csv"
    path.write_text("speed_kmh,force_kn,loss_kw\n0,0,1\n0,10,2\n0,20,3\n36,0,5\n36,10,9\n")
    loss = read_loss_map(path)
    assert loss(np.array([5e3]), np.array([5.0])) == pytest.approx([(1.5 + 7.0) / 2 * 1e3])
    assert loss(np.array([20e3]), np.array([10.0])) == pytest.approx([13e3])


def test_a_limit_between_the_rows_is_kept_between_them() -> None:
    """Both rows are under their limits; where the lower one begins, the train is still too fast."""
    drive = simple([[0, 0, 20, -1e5, 0, 0, 30], [150, 10, 10, 0, 0, 0, 30]])
    limits = Steps(np.array([0.0, 60.0]), np.array([30.0, 16.0]))  # v(60 m) = √(400 − 120) = 16.7 m/s
    line = replace(drive.line, limits=limits)
    findings = verify(drive.rows, line, drive.train, drive.loss, ends_m=(0, 150), end_speeds_mps=(20, 10))
    excess = [finding.excess for finding in findings if finding.what.startswith("speed above the limit")]
    assert excess == pytest.approx([np.sqrt(280.0) - 16.0], abs=1e-5)


# --- what the solver plans --------------------------------------------------------------------------------------


@pytest.mark.parametrize("buffer_ratio", [0.0, 0.05, 0.3])
def test_nothing_is_wrong_with_what_the_solver_plans(tmp_path: Path, buffer_ratio: float) -> None:
    """Two programs that share no code agree: limits, forces, motion, ledger."""
    assert found(planned(tmp_path, buffer_ratio=buffer_ratio)) == []


def test_the_plan_has_something_to_find_errors_in(good: Planned) -> None:
    """It drives at its limits, in tunnels and curves, at full power and with both brakes."""
    rows, train = good[0], Train.of(TRAIN)
    assert (rows[:-1, 2] > rows[:-1, 6] - 1e-3).sum() > 20
    fastest = np.maximum(rows[:-1, 2], rows[1:, 2])
    assert (rows[:-1, 3] > 0.999 * train.traction.limit_n(fastest)).sum() > 20
    assert (rows[:-1, 4] < -1e4).sum() > 3


def test_the_commands_files_on_a_route_and_vehicle_of_ours(tmp_path: Path) -> None:
    """CSV, JSON and loss map as the commands write them; TOML as the verifier reads it."""
    for args in (
        ("loss-map", "re460-ic", "--out", "map.csv"),
        ("solve", "zurich-luzern", "re460-ic", "--from", "Zug", "--to", "Luzern", "--buffer", "7", "--out", "run.csv"),
    ):
        done = das_precompute(tmp_path, *args, *(["--json"] if args[0] == "solve" else []))
        assert done.returncode == 0, done.stderr
    line, train = Line.read(locate_route("zurich-luzern")), Train.read(locate_vehicle("re460-ic"))
    rows, loss = read_rows(tmp_path / "run.csv"), read_loss_map(tmp_path / "map.csv")
    claim = json.loads(done.stdout)
    assert verify(rows, line, train, loss, ends_m=(29e3, 57e3), claim=claim) == []
    findings = verify(rows, line, replace(train, mass_kg=0.999 * train.mass_kg), loss, ends_m=(29e3, 57e3), claim=claim)
    assert_found(findings, "forces do not balance")


def test_a_train_that_dissipates_all(tmp_path: Path) -> None:
    """Level L0 NOREG: no losses, and both brakes together as friction."""
    for name, data in (("track", TRACK), ("train", TRAIN)):
        (tmp_path / f"{name}.json").write_text(json.dumps(data))
    section = build_section(
        load_route(str(tmp_path / "track.json")), load_vehicle(str(tmp_path / "train.json")), level=Level.L0_NOREG
    )
    rows = csv_rows(solve_front(section).fastest().trajectory)
    train, lossless = replace(Train.of(TRAIN), brakes="friction"), constant_efficiencies(1.0, 1.0)
    assert verify(rows, Line.of(TRACK), train, lossless, ends_m=(0.0, LENGTH_M)) == []
    weak = replace(train, electric=replace(train.electric, power_w=0.99 * train.electric.power_w))
    assert_found(verify(rows, Line.of(TRACK), weak, lossless, ends_m=(0.0, LENGTH_M)), "friction brake above its force")


# --- planted: a plan for another track or train -----------------------------------------------------------------


def put(name: str, value: float) -> Change:
    def change(_track: dict[str, Any], train: dict[str, Any]) -> None:
        train[name]["value"] = value

    return change


def cell(key: str, row: int, column: int, value: Any) -> Change:
    def change(track: dict[str, Any], _train: dict[str, Any]) -> None:
        track[key]["values"][row][column] = value

    return change


def drop(key: str) -> Change:
    def change(track: dict[str, Any], _train: dict[str, Any]) -> None:
        del track[key]

    return change


@pytest.mark.parametrize(
    ("buffer_ratio", "change", "expected"),
    [
        pytest.param(0.0, cell("speed limits", 2, 1, 60.72), "speed above the limit", id="limit 0.2 m/s higher"),
        pytest.param(0.0, put("max speed", 115.1), "speed above the limit", id="train too fast"),
        pytest.param(0.0, put("length", 0.0), "speed above the limit", id="tail forgotten"),
        pytest.param(0.0, put("length", 149.0), "speed above the limit", id="train 1 m too short"),
        pytest.param(0.05, put("length", 140.0), "the gradient stated is not", id="gradient under a shorter train"),
        pytest.param(0.05, put("max traction power", 2525.0), "traction above force", id="power 1 % too high"),
        pytest.param(0.05, put("max traction force", 181.8), "traction above force", id="force 1 % too high"),
        pytest.param(0.0, put("max reg braking power", 2222.0), "electric brake above", id="brake power 1 % too high"),
        pytest.param(0.0, put("max reg braking force", 151.5), "electric brake above", id="brake force 1 % too high"),
        pytest.param(0.0, put("max reg braking force", 148.5), "friction brake before", id="friction brake too early"),
        pytest.param(0.0, put("max pn braking force", 90.9), "friction brake above", id="friction brake too strong"),
        pytest.param(0.05, cell("gradients", 4, 1, -17.8), "forces do not balance", id="gradient 0.2 permil off"),
        pytest.param(0.05, cell("gradients", 4, 0, 5201.0), "the gradient stated is not", id="gradient 1 m away"),
        pytest.param(0.05, drop("curvatures"), "forces do not balance", id="curves ignored"),
        pytest.param(0.05, cell("curvatures", 1, 1, 400.0), "forces do not balance", id="clothoid taken as its end"),
        pytest.param(0.05, cell("curvatures", 4, 2, -270.0), "forces do not balance", id="wrong mean curvature"),
        pytest.param(0.05, drop("tunnels"), "forces do not balance", id="tunnels ignored"),
        pytest.param(0.05, cell("tunnels", 0, 2, 37.0), "forces do not balance", id="tunnel wider by 1 m²"),
        pytest.param(0.05, put("rho", 7.8), "forces do not balance", id="rotating mass 0.2 % off"),
        pytest.param(0.05, put("mass", 179_700), "forces do not balance", id="mass 0.2 % off"),
        pytest.param(0.05, put("rolling resistance r0", 2.61), "resistance is not what is said", id="r0 0.4 % off"),
        pytest.param(0.05, put("rolling resistance r2", 9.02e-4), "resistance is not what", id="r2 0.2 % off"),
        pytest.param(0.05, put("efficiency traction", 88.1), "component_loss is not what", id="efficiency 0.1 % off"),
        pytest.param(0.05, put("efficiency reg brake", 85.2), "component_loss is not", id="brake efficiency off"),
    ],
)
def test_a_plan_for_another_problem_is_found_out(
    tmp_path: Path, buffer_ratio: float, change: Change, expected: str
) -> None:
    """The verifier notices each error planted in what the planner was told, most of them of a few thousandths."""
    assert_found(found(planned(tmp_path, change, buffer_ratio)), expected)


@pytest.mark.parametrize(
    ("true", "expected"),
    [
        ({"friction_n": 0.0, "brakes": "electric"}, "friction brake above its force"),
        ({"max_acceleration_mps2": 0.8}, "acceleration above"),
        ({"max_deceleration_mps2": 0.9}, "deceleration above"),
        ({"adhesive_kg": 60e3}, "traction above force"),
    ],
)
def test_a_plan_for_a_train_without_a_bound_is_found_out(tmp_path: Path, true: dict[str, Any], expected: str) -> None:
    """The verifier notices each bound that the planner was not told of."""
    assert_found(found(planned(tmp_path, buffer_ratio=0.0), train=replace(Train.of(TRAIN), **true)), expected)


def test_an_end_at_another_speed_or_place_is_found(tmp_path: Path) -> None:
    """The verifier notices an end 1 m short and an end that still rolls at 0.1 m/s."""
    assert_found(found(planned(tmp_path, end_speed_mps=0.1)), "not the speed at the section's end")
    assert_found(found(planned(tmp_path, end_m=LENGTH_M - 1.0)), "the section does not begin or end there")


# --- planted: rows and claims -----------------------------------------------------------------------------------


def middle(rows: Floats, where: Floats) -> int:
    """A row in the middle of those where something holds."""
    return int(np.flatnonzero(where)[np.count_nonzero(where) // 2])


def faster_on_a_plateau(rows: Floats) -> None:
    rows[middle(rows[:-1], rows[:-1, 2] > rows[:-1, 6] - 1e-6), 2] += 0.2


def stronger_at_full_power(rows: Floats) -> None:
    limit = Train.of(TRAIN).traction.limit_n(np.maximum(rows[:-1, 2], rows[1:, 2]))
    rows[middle(rows[:-1], rows[:-1, 3] > 0.9999 * limit), 3] *= 1.01


def later_by_a_second(rows: Floats) -> None:
    rows[len(rows) // 2 :, 1] += 1.0


def not_a_number(rows: Floats) -> None:
    rows[7, 3] = np.nan


def friction_while_driving(rows: Floats) -> None:
    i = middle(rows, rows[:, 3] > 5e4)
    rows[i, 3], rows[i, 4] = rows[i, 3] + 1e3, -1e3


def a_friction_brake_that_pushes(rows: Floats) -> None:
    rows[middle(rows, rows[:, 3] > 5e4), 4] = 500.0


def a_force_of_500_n_too_much(rows: Floats) -> None:
    rows[middle(rows, (rows[:, 3] > 2e4) & (rows[:, 3] < 6e4)), 3] += 500.0


def back_and_forth(rows: Floats) -> None:
    rows[[20, 21], 0] = rows[[21, 20], 0]


def another_limit(rows: Floats) -> None:
    rows[10, 6] += 0.1


def from_a_negative_time(rows: Floats) -> None:
    rows[:, 1] -= 1.0


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (faster_on_a_plateau, "speed above the limit"),
        (stronger_at_full_power, "traction above force"),
        (later_by_a_second, "not the time of an interval"),
        (not_a_number, "a value is not finite"),
        (friction_while_driving, "friction brake before the motors"),
        (a_friction_brake_that_pushes, "friction brake pushes"),
        (a_force_of_500_n_too_much, "forces do not balance"),
        (a_force_of_500_n_too_much, "the forces do not lead to the next speed"),
        (back_and_forth, "position does not rise"),
        (another_limit, "the limit stated is not"),
        (from_a_negative_time, "time does not begin at 0"),
    ],
)
def test_a_spoilt_row_is_found(good: Planned, spoil: Callable[[Floats], None], expected: str) -> None:
    """The verifier notices each kind of damage planted in a single row."""
    rows, claim = good[0].copy(), good[1]
    spoil(rows)
    assert_found(found((rows, claim)), expected)


@pytest.mark.parametrize("name", ["resistance", "component_loss", "friction_brake", "potential", "input"])
def test_an_energy_said_wrong_by_a_thousandth_is_found(good: Planned, name: str) -> None:
    """The verifier notices a wrong term of the stated ledger, and names only that term."""
    rows, claim = good[0], copy.deepcopy(good[1])
    largest = max(map(abs, claim["ledger_kwh"].values()))
    claim["ledger_kwh"][name] += 1e-3 * largest
    assert [finding.what for finding in found((rows, claim))] == [f"{name} is not what is said"]


def test_a_time_said_wrong_is_found(good: Planned) -> None:
    """The verifier notices a stated time that is 0.01 s off."""
    rows, claim = good
    assert_found(found((rows, claim | {"time_s": claim["time_s"] + 0.01})), "the time said")


def test_forces_that_lead_elsewhere_are_found_by_driving_them() -> None:
    """A coasting train that does not slow down: seen at the speed it arrives with."""
    drive = simple([[0, 0, 20, 0, 0, 0, 30], [100, 5, 20, 0, 0, 0, 30]], r0_n=1e3)
    findings = verify(drive.rows, drive.line, drive.train, drive.loss, ends_m=(0, 100), end_speeds_mps=(20, 20))
    assert_found(findings, "the forces do not lead to the next speed")
    assert_found(findings, "the ledger does not close")


def test_a_dip_between_two_rows_is_driven_through() -> None:
    """On average level, stated as held at the limit; down in the dip a constant force is too fast."""
    drive = simple([[0, 0, 20, 0, 0, 0, 20], [400, 20, 20, 0, 0, 0, 20]])
    dip = Steps(np.array([0.0, 200.0]), np.array([-0.02, 0.02]))
    line = replace(drive.line, gradients=dip, limits=Steps(np.zeros(1), np.full(1, 20.0)))
    findings = verify(drive.rows, line, drive.train, drive.loss, ends_m=(0, 400), end_speeds_mps=(20, 20))
    assert_found(findings, "driven speed above the limit")
    assert not any("balance" in finding.what for finding in findings)


def test_a_steep_slope_is_weight() -> None:
    """Closed form: at constant speed uphill the balance is m·g·slope, the potential energy m·g·height."""
    drive = simple([[0, 0, 20, 0, 0, 0.01, 30], [100, 5, 20, 0, 0, 0.01, 30]])
    uphill = replace(drive.line, gradients=Steps(np.zeros(1), np.full(1, 0.01)))
    climbing = replace(drive, line=uphill)
    assert climbing.balance_n == pytest.approx([1e5 * G * 0.01])
    assert climbing.ledger_j["potential"] == pytest.approx(1e5 * G * 1.0)
