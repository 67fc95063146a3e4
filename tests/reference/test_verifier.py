"""The verifier: against closed forms, silent on what the solver plans, and finding every planted error."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.files.load import load_route, load_vehicle, locate_route, locate_vehicle
from das.domain.levels import Level
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from precompute.cli.report import solution_json
from tests.support.benchmark import track_path
from tests.support.making import csv_rows
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
)
from tests.support.verifier import Drive, Finding, verify

LENGTH_M = 9000.0
AS_PLANNED = Conditions()
ROUTE = """
schema_version = 1
route = {id = "line", name = "line", length_km = 9.0}
stops = [{name = "A", position_km = 0.0}, {name = "B", position_km = 9.0}]
[speed_limits]
columns = ["position_m", "limit_kmh"]
rows = [[0, 90], [1500, 120], [4000, 60], [4600, 110], [7000, 100]]
[gradients]
columns = ["position_m", "gradient_permille"]
rows = [[0, 0.0], [800, 8.5], [2000, -12.0], [3100, 3.0], [5200, -18.0], [6000, 0.0]]
[curves]
columns = ["position_m", "radius_start_m", "radius_end_m"]
rows = [[0, inf, inf], [1000, inf, 400], [1200, 400, 400], [1500, inf, inf], [4000, -250, -250], [4300, inf, inf]]
[tunnels]
columns = ["position_m", "length_m", "cross_section_m2"]
rows = [[2200, 900, 36], [6100, 600, 60]]
"""
"""Lower limits between higher ones, hills, a clothoid, a wide and a tight curve, two tunnels."""
VEHICLE = """
schema_version = 1
resistance = {c0_kn = 2.6, c1_kn_per_kmh = 0.02, c2_kn_per_kmh2 = 0.0009}
traction = {max_force_kn = 180.0, max_power_kw = 2500.0}
electric_brake = {max_force_kn = 150.0, max_power_kw = 2200.0}
friction_brake = {max_force_kn = 90.0}
losses = {default = "own", own = {traction_efficiency_ratio = 0.88, brake_efficiency_ratio = 0.85}}
[tunnel_resistance]
columns = ["cross_section_m2", "coefficient_kn_per_kmh2"]
rows = [[24, 0.0012], [48, 0.0005]]
[vehicle]
id = "train"
name = "train"
source = "test"
mass_t = 180
rotating_mass_ratio = 0.08
length_m = 150.0
max_speed_kmh = 115.0
"""
Planned = tuple[Floats, dict[str, Any]]
"""Rows, and what the command says of them."""


def planned(
    folder: Path,
    old: str = "",
    new: str = "",
    buffer_ratio: float = 0.05,
    *,
    texts: tuple[str, str] = (ROUTE, VEHICLE),
    here: Conditions = AS_PLANNED,
    level: Level | None = None,
    end_m: float | None = None,
    end_speed_mps: float = 0.0,
) -> Planned:
    """What the solver plans for a route and a vehicle, in one of which a text is another."""
    changed = [text.replace(old, new) if old else text for text in texts]
    assert not old or changed != list(texts), old
    for name, text in zip(("route.toml", "train.toml"), changed, strict=True):
        (folder / name).write_text(text)
    line, train = here.line(load_route(folder / "route.toml")), here.train(load_vehicle(folder / "train.toml"))
    section = build_section(line, train, level=level, end_m=end_m, options=SectionOptions(end_speed_mps=end_speed_mps))
    front = solve_front(section)
    least_s = front.fastest().time_s
    solution = front.trajectory(least_s * (1 + buffer_ratio))
    return csv_rows(solution.trajectory), solution_json(solution, least_s, 0.0)


@pytest.fixture(scope="module")
def true(tmp_path_factory: pytest.TempPathFactory) -> tuple[Line, Train]:
    """The unchanged route and vehicle, as the verifier reads them."""
    folder = tmp_path_factory.mktemp("true")
    (folder / "route.toml").write_text(ROUTE)
    (folder / "train.toml").write_text(VEHICLE)
    return Line.read(folder / "route.toml"), Train.read(folder / "train.toml")


def found(plan: Planned, true: tuple[Line, Train]) -> list[Finding]:
    """What the verifier says of a plan for a line and a train."""
    line, train = true
    return verify(plan[0], line, train, train.own_loss(), ends_m=(0.0, LENGTH_M), claim=plan[1])


def assert_found(findings: list[Finding], expected: str) -> None:
    assert any(finding.what.startswith(expected) for finding in findings), "\n".join(map(str, findings))


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Planned:
    return planned(tmp_path_factory.mktemp("good"))


# --- closed forms -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simple(true: tuple[Line, Train]) -> Callable[..., Drive]:
    """Rows driven by 100 t without resistance or losses on a level straight line at 30 m/s (or another train)."""
    nothing = {"r0_n": 0.0, "r1_n_per_mps": 0.0, "r2_n_per_mps2": 0.0, "rotating_kg": 0.0, "mass_kg": 1e5}
    nothing |= {"length_m": 0.0, "efficiencies": (1.0, 1.0)}
    zero = Steps(np.zeros(1), np.zeros(1))
    line = Line(zero, zero, Steps(np.zeros(1), np.full(1, 30.0)), (), (0.0, 1e4), Steps(np.zeros(1), np.ones(1)))

    def made(rows: list[list[float]], **train: Any) -> Drive:
        chosen = replace(true[1], **(nothing | train))
        return Drive(np.array(rows), line, chosen, chosen.own_loss())

    return made


def test_a_constant_force_without_resistance_is_uniform_acceleration(simple: Callable[..., Drive]) -> None:
    """Closed form: F = m·a with 1 m/s² from 10 to 20 m/s is 150 m in 10 s, and 15 MJ."""
    drive = simple([[0, 0, 10, 1e5, 0, 0, 30], [150, 10, 20, 0, 0, 0, 30]])
    places, speeds = drive.driven
    assert speeds[-1] == pytest.approx([20.0], abs=1e-12)
    assert places[-1] == pytest.approx([150.0], abs=1e-11)
    assert drive.balance_n == pytest.approx([0.0], abs=1e-6)
    assert drive.balance_j["input"] == pytest.approx(1.5e7, rel=1e-12)
    assert drive.balance_j["kinetic"] == pytest.approx(1.5e7, rel=1e-12)


def test_coasting_against_the_air_follows_the_closed_form(simple: Callable[..., Drive]) -> None:
    """Closed form: m·dv/dt = −c·v² gives v = v0/(1 + v0·c·t/m) and s = m/c·ln(1 + v0·c·t/m)."""
    c, seconds = 50.0, 20.0
    drive = simple([[0, 0, 25, 0, 0, 0, 30], [400, seconds, 20, 0, 0, 0, 30]], r2_n_per_mps2=c)
    places, speeds = drive.driven
    grown = 1 + 25 * c * seconds / 1e5
    assert speeds[-1] == pytest.approx([25 / grown], rel=1e-7)
    assert places[-1] == pytest.approx([1e5 / c * np.log(grown)], rel=1e-7)


def test_resistance_of_an_accelerated_way_by_hand(simple: Callable[..., Drive]) -> None:
    """Closed form: ∫v dv/a = 150 m, ∫v² dv/a = 7000/3, ∫v³ dv/a = 37500 for a = 1 m/s², 10 to 20 m/s."""
    drive = simple(
        [[0, 0, 10, 0, 0, 0, 30], [150, 10, 20, 0, 0, 0, 30]], r0_n=1e3, r1_n_per_mps=20.0, r2_n_per_mps2=4.0
    )
    assert drive.balance_j["resistance"] == pytest.approx(1e3 * 150 + 20 * 7000 / 3 + 4 * 37500, rel=1e-12)


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


def test_curves_tunnels_and_grip_by_hand(true: tuple[Line, Train]) -> None:
    """The formulas written out with numbers, for a few radii, cross sections and speeds."""
    assert curve_resistance(1 / 500) == pytest.approx(9.81 * 0.5 / (500 - 30))
    assert curve_resistance(1 / 300) == pytest.approx(9.81 * 0.5 / (300 - 30))
    assert curve_resistance(1 / 200) == pytest.approx(9.81 * 0.65 / (200 - 55))
    line, train = true
    profile = train.tunnel_profile(line)  # half-way between the cross sections; beyond the larger one
    assert profile.at(np.array([2000.0, 2500.0, 3200.0, 6200.0])) / 12960 == pytest.approx([0, 0.00085, 0, 0.0005])
    grip_n = 40e3 * 9.81 * (0.161 + 7.5 / 80)
    assert replace(train, adhesive_kg=40e3).motors_n(np.array([10.0]))[0] == pytest.approx([grip_n])


def test_units_of_toml_files(true: tuple[Line, Train]) -> None:
    """Figures in SI, converted by hand."""
    line, train = Line.read(locate_route("zurich-luzern")), Train.read(locate_vehicle("re460-ic"))
    assert line.stops_m == (0.0, 12e3, 29e3, 57e3)
    assert (train.mass_kg, train.length_m, train.brakes) == (440e3, 200.0, "electric")
    assert train.max_speed_mps == pytest.approx(200 / 3.6)
    assert train.r2_n_per_mps2 == pytest.approx(8.6)
    assert train.traction == Effort(300e3, 6100e3)
    ours = true[1]
    assert ours.r2_n_per_mps2 == pytest.approx(0.9 * 3.6**2)
    assert ours.r1_n_per_mps == pytest.approx(20 * 3.6)
    assert ours.inertia_kg == pytest.approx(194.4e3)


def test_a_track_is_the_same_from_both_formats(shared: Path) -> None:
    one, other = Line.read(track_path("CH_StGallen_Wil")), Line.read(shared / "ttobench/tracks/CH_StGallen_Wil.json")
    at = np.linspace(0.0, one.stops_m[-1], 1000)
    assert one.stops_m == pytest.approx(other.stops_m)
    for name in ("gradients", "curves", "limits"):
        assert getattr(one, name).at(at) == pytest.approx(getattr(other, name).at(at), abs=1e-9), name


def test_a_loss_map_is_bilinear_and_goes_on_past_its_edge(tmp_path: Path) -> None:
    """A map of five points, interpolated and continued by hand."""
    path = tmp_path / "map.csv"
    path.write_text("speed_kmh,force_kn,loss_kw\n0,0,1\n0,10,2\n0,20,3\n36,0,5\n36,10,9\n")
    loss = read_loss_map(path)
    assert loss(np.array([5e3]), np.array([5.0])) == pytest.approx([(1.5 + 7.0) / 2 * 1e3])
    assert loss(np.array([20e3]), np.array([10.0])) == pytest.approx([13e3])


def test_a_limit_between_the_rows_is_kept_between_them(simple: Callable[..., Drive]) -> None:
    """Both rows are under their limits; where the lower one begins, the train is still too fast."""
    drive = simple([[0, 0, 20, -1e5, 0, 0, 30], [150, 10, 10, 0, 0, 0, 30]])
    limits = Steps(np.array([0.0, 60.0]), np.array([30.0, 16.0]))  # v(60 m) = √(400 − 120) = 16.7 m/s
    line = replace(drive.line, limits=limits)
    findings = verify(drive.rows, line, drive.train, drive.loss, ends_m=(0, 150), end_speeds_mps=(20, 10))
    excess = [finding.excess for finding in findings if finding.what.startswith("speed above the limit")]
    assert excess == pytest.approx([np.sqrt(280.0) - 16.0], abs=1e-5)


# --- what the solver plans --------------------------------------------------------------------------------------


@pytest.mark.parametrize("buffer_ratio", [0.0, 0.05, 0.3])
def test_nothing_is_wrong_with_what_the_solver_plans(
    tmp_path: Path, true: tuple[Line, Train], buffer_ratio: float
) -> None:
    """Two programs that share no code agree: limits, forces, motion, energy balance."""
    assert found(planned(tmp_path, buffer_ratio=buffer_ratio), true) == []


def test_the_plan_has_something_to_find_errors_in(good: Planned, true: tuple[Line, Train]) -> None:
    """It drives at its limits, in tunnels and curves, at full power and with both brakes."""
    rows, train = good[0], true[1]
    assert (rows[:-1, 2] > rows[:-1, 6] - 1e-3).sum() > 20
    fastest = np.maximum(rows[:-1, 2], rows[1:, 2])
    assert (rows[:-1, 3] > 0.999 * train.traction.limit_n(fastest)).sum() > 20
    assert (rows[:-1, 4] < -1e4).sum() > 3


def test_a_train_that_dissipates_all(tmp_path: Path, true: tuple[Line, Train]) -> None:
    """Level L0 NOREG: no losses, and both brakes together as friction."""
    rows, _ = planned(tmp_path, buffer_ratio=0.0, level=Level.L0_NOREG)
    line, lossless = true[0], constant_efficiencies(1.0, 1.0)
    train = replace(true[1], brakes="friction")
    assert verify(rows, line, train, lossless, ends_m=(0.0, LENGTH_M)) == []
    weak = replace(train, electric=replace(train.electric, power_w=0.99 * train.electric.power_w))
    assert_found(verify(rows, line, weak, lossless, ends_m=(0.0, LENGTH_M)), "friction brake above its force")


# --- planted: a plan for another track or train -----------------------------------------------------------------


PLANTED = {
    "limit 0.2 m/s higher": (0.0, "[4000, 60]", "[4000, 60.72]", "speed above the limit"),
    "train too fast": (0.0, "max_speed_kmh = 115.0", "max_speed_kmh = 115.1", "speed above the limit"),
    "tail forgotten": (0.0, "length_m = 150.0", "length_m = 0.0", "speed above the limit"),
    "train 1 m too short": (0.0, "length_m = 150.0", "length_m = 149.0", "speed above the limit"),
    "gradient under a shorter train": (0.05, "length_m = 150.0", "length_m = 140.0", "the gradient stated is not"),
    "power 1 % too high": (0.05, "max_power_kw = 2500.0", "max_power_kw = 2525.0", "traction above force"),
    "force 1 % too high": (0.05, "max_force_kn = 180.0", "max_force_kn = 181.8", "traction above force"),
    "brake power 1 % too high": (0.0, "max_power_kw = 2200.0", "max_power_kw = 2222.0", "electric brake above"),
    "brake force 1 % too high": (0.0, "max_force_kn = 150.0", "max_force_kn = 151.5", "electric brake above"),
    "friction brake too early": (0.0, "max_force_kn = 150.0", "max_force_kn = 148.5", "friction brake before"),
    "friction brake too strong": (0.0, "max_force_kn = 90.0", "max_force_kn = 90.9", "friction brake above"),
    "gradient 0.2 permil off": (0.05, "[5200, -18.0]", "[5200, -17.8]", "forces do not balance"),
    "gradient 1 m away": (0.05, "[5200, -18.0]", "[5201, -18.0]", "the gradient stated is not"),
    "curves ignored": (0.05, ROUTE[ROUTE.index("[curves]") : ROUTE.index("[tunnels]")], "", "forces do not balance"),
    "clothoid taken as its end": (0.05, "[1000, inf, 400]", "[1000, 400, 400]", "forces do not balance"),
    "wrong mean curvature": (0.05, "[4000, -250, -250]", "[4000, -250, -270]", "forces do not balance"),
    "tunnels ignored": (0.05, ROUTE[ROUTE.index("[tunnels]") :], "", "forces do not balance"),
    "tunnel wider by 1 m²": (0.05, "[2200, 900, 36]", "[2200, 900, 37]", "forces do not balance"),
    "rotating mass 0.2 % off": (0.05, "mass_ratio = 0.08", "mass_ratio = 0.078", "forces do not balance"),
    "mass 0.2 % off": (0.05, "mass_t = 180", "mass_t = 179.7", "forces do not balance"),
    "r0 0.4 % off": (0.05, "c0_kn = 2.6", "c0_kn = 2.61", "resistance is not what is said"),
    "r2 0.2 % off": (0.05, "kmh2 = 0.0009", "kmh2 = 0.000902", "resistance is not what"),
    "efficiency 0.1 % off": (0.05, "efficiency_ratio = 0.88", "efficiency_ratio = 0.881", "component_loss is not what"),
    "brake efficiency off": (0.05, "efficiency_ratio = 0.85", "efficiency_ratio = 0.852", "component_loss is not"),
}
"""A buffer, what the solver is told otherwise than it is, and what the verifier says."""


@pytest.mark.parametrize("error", PLANTED)
def test_a_plan_for_another_problem_is_found_out(tmp_path: Path, true: tuple[Line, Train], error: str) -> None:
    """The verifier notices each error planted in what the planner was told, most of them of a few thousandths."""
    buffer_ratio, old, new, expected = PLANTED[error]
    assert_found(found(planned(tmp_path, old, new, buffer_ratio), true), expected)


@pytest.mark.parametrize(
    ("bound", "expected"),
    [
        ({"friction_n": 0.0, "brakes": "electric"}, "friction brake above its force"),
        ({"max_acceleration_mps2": 0.8}, "acceleration above"),
        ({"max_deceleration_mps2": 0.9}, "deceleration above"),
        ({"adhesive_kg": 60e3}, "traction above force"),
    ],
)
def test_a_plan_for_a_train_without_a_bound_is_found_out(
    tmp_path: Path, true: tuple[Line, Train], bound: dict[str, Any], expected: str
) -> None:
    """The verifier notices each bound that the planner was not told of."""
    line, train = true
    assert_found(found(planned(tmp_path, buffer_ratio=0.0), (line, replace(train, **bound))), expected)


def test_an_end_at_another_speed_or_place_is_found(tmp_path: Path, true: tuple[Line, Train]) -> None:
    """The verifier notices an end 1 m short and an end that still rolls at 0.1 m/s."""
    assert_found(found(planned(tmp_path, end_speed_mps=0.1), true), "not the speed at the section's end")
    assert_found(found(planned(tmp_path, end_m=LENGTH_M - 1.0), true), "the section does not begin or end there")


# --- planted: supply, adhesion, auxiliaries and conditions -------------------------------------------------------

SUPPLY = (
    ROUTE
    + """[receptivity]
columns = ["position_m", "receptivity_ratio"]
rows = [[0, 1.0], [3000, 0.4], [6000, 0.9]]
[neutral_sections]
columns = ["position_m", "length_m"]
rows = [[1700, 250], [6800, 120]]
[no_regeneration]
columns = ["position_m", "length_m"]
rows = [[3500, 700], [8400, 200]]
""",
    VEHICLE + "auxiliary_power_kw = 60.0\n[adhesion]\nadhesive_mass_t = 50.0\n",
)
HERE = Conditions(mass_ratio=1.2, head_wind_mps=4.0, adhesion_ratio=0.9, receptivity_ratio=0.8)


@pytest.fixture(scope="module")
def supplied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Line, Train]:
    """The line and the train with supply and adhesion under the conditions above, as the verifier reads them."""
    folder = tmp_path_factory.mktemp("supplied")
    for name, text in zip(("route.toml", "train.toml"), SUPPLY, strict=True):
        (folder / name).write_text(text)
    line, train = Line.read(folder / "route.toml"), Train.read(folder / "train.toml")
    taken = replace(line.receptivity, value=0.8 * line.receptivity.value)
    loaded = replace(train.loaded(1.2 * train.mass_kg), rail_ratio=0.9, head_wind_mps=4.0)
    return replace(line, receptivity=taken), loaded


def test_nothing_is_wrong_with_a_plan_under_conditions(tmp_path: Path, supplied: tuple[Line, Train]) -> None:
    """Two programs that share no code agree on supply, adhesion, auxiliaries, load and wind."""
    plan = planned(tmp_path, texts=SUPPLY, here=HERE)
    assert found(plan, supplied) == []
    balance = plan[1]["ledger_kwh"]
    assert balance["unreturned"] > 0.05 * balance["input"]
    assert balance["friction_brake"] > 0


SUPPLIED_OTHERWISE = [
    ("[[1700, 250], [6800, 120]]", "[[6800, 120]]", {}, "traction above force"),
    ("[[3500, 700], [8400, 200]]", "[[8400, 200]]", {}, "electric brake above force"),
    ("[1700, 250]", "[1700, 240]", {}, "traction above force"),
    ("[6000, 0.9]", "[6000, 0.91]", {}, "unreturned is not what is said"),
    ("adhesive_mass_t = 50.0", "adhesive_mass_t = 50.5", {}, "traction above force"),
    ("auxiliary_power_kw = 60.0", "auxiliary_power_kw = 60.5", {}, "component_loss is not what is said"),
    ("", "", {"mass_ratio": 1.198}, "forces do not balance"),
    ("", "", {"head_wind_mps": 4.1}, "resistance is not what is said"),
    ("", "", {"adhesion_ratio": 0.91}, "traction above force"),
    ("", "", {"receptivity_ratio": 0.81}, "unreturned is not what is said"),
]
"""What the solver is told otherwise than it is, in the files or of the conditions, and what the verifier says."""


@pytest.mark.parametrize(("old", "new", "conditions", "expected"), SUPPLIED_OTHERWISE)
def test_a_plan_for_another_supply_train_or_day_is_found_out(
    tmp_path: Path, supplied: tuple[Line, Train], old: str, new: str, conditions: dict[str, float], expected: str
) -> None:
    """The verifier notices each small error in what the planner was told of supply, train, load, wind and rail."""
    plan = planned(tmp_path, old, new, 0.03, texts=SUPPLY, here=replace(HERE, **conditions))
    assert_found(found(plan, supplied), expected)


# --- planted: rows and claims -----------------------------------------------------------------------------------


def middle(rows: Floats, where: Floats) -> int:
    """A row in the middle of those where something holds."""
    return int(np.flatnonzero(where)[np.count_nonzero(where) // 2])


def change(column: int, by: float, where: Callable[[Floats], Any]) -> Callable[[Floats], None]:
    """Something added to a column in one row, or in several."""

    def spoil(rows: Floats) -> None:
        rows[where(rows), column] += by

    return spoil


def stronger_at_full_power(rows: Floats) -> None:
    limit = Effort(180e3, 2500e3).limit_n(np.maximum(rows[:-1, 2], rows[1:, 2]))
    rows[middle(rows[:-1], rows[:-1, 3] > 0.9999 * limit), 3] *= 1.01


def friction_while_driving(rows: Floats) -> None:
    i = middle(rows, rows[:, 3] > 5e4)
    rows[i, 3:5] = rows[i, 3] + 1e3, -1e3


def back_and_forth(rows: Floats) -> None:
    rows[[20, 21], 0] = rows[[21, 20], 0]


ON_A_PLATEAU = change(2, 0.2, lambda rows: middle(rows[:-1], rows[:-1, 2] > rows[:-1, 6] - 1e-6))
TOO_MUCH = change(3, 500.0, lambda rows: middle(rows, (rows[:, 3] > 2e4) & (rows[:, 3] < 6e4)))
PUSHING = change(4, 500.0, lambda rows: middle(rows, rows[:, 3] > 5e4))
SPOILT = [
    (ON_A_PLATEAU, "speed above the limit"),
    (stronger_at_full_power, "traction above force"),
    (change(1, 1.0, lambda rows: slice(len(rows) // 2, None)), "not the time of an interval"),
    (change(3, np.nan, lambda rows: 7), "a value is not finite"),
    (friction_while_driving, "friction brake before the motors"),
    (PUSHING, "friction brake pushes"),
    (TOO_MUCH, "forces do not balance"),
    (TOO_MUCH, "the forces do not lead to the next speed"),
    (back_and_forth, "position does not rise"),
    (change(6, 0.1, lambda rows: 10), "the limit stated is not"),
    (change(1, -1.0, lambda rows: slice(None)), "time does not begin at 0"),
]


@pytest.mark.parametrize(("spoil", "expected"), SPOILT)
def test_a_spoilt_row_is_found(
    good: Planned, true: tuple[Line, Train], spoil: Callable[[Floats], None], expected: str
) -> None:
    """The verifier notices each kind of damage planted in a single row."""
    rows, claim = good[0].copy(), good[1]
    spoil(rows)
    assert_found(found((rows, claim), true), expected)


@pytest.mark.parametrize("name", ["resistance", "component_loss", "friction_brake", "potential", "input"])
def test_an_energy_said_wrong_by_a_thousandth_is_found(good: Planned, true: tuple[Line, Train], name: str) -> None:
    """The verifier notices a wrong term of the stated energy balance, and names only that term."""
    rows, claim = good[0], copy.deepcopy(good[1])
    largest = max(map(abs, claim["ledger_kwh"].values()))
    claim["ledger_kwh"][name] += 1e-3 * largest
    assert [finding.what for finding in found((rows, claim), true)] == [f"{name} is not what is said"]


def test_a_time_said_wrong_is_found(good: Planned, true: tuple[Line, Train]) -> None:
    """The verifier notices a stated time that is 0.01 s off."""
    rows, claim = good
    assert_found(found((rows, claim | {"time_s": claim["time_s"] + 0.01}), true), "the time said")


def test_forces_that_lead_elsewhere_are_found_by_driving_them(simple: Callable[..., Drive]) -> None:
    """A coasting train that does not slow down: seen at the speed it arrives with."""
    drive = simple([[0, 0, 20, 0, 0, 0, 30], [100, 5, 20, 0, 0, 0, 30]], r0_n=1e3)
    findings = verify(drive.rows, drive.line, drive.train, drive.loss, ends_m=(0, 100), end_speeds_mps=(20, 20))
    assert_found(findings, "the forces do not lead to the next speed")
    assert_found(findings, "the energy balance does not close")


def test_a_dip_between_two_rows_is_driven_through(simple: Callable[..., Drive]) -> None:
    """On average level, stated as held at the limit; down in the dip a constant force is too fast."""
    drive = simple([[0, 0, 20, 0, 0, 0, 20], [400, 20, 20, 0, 0, 0, 20]])
    dip = Steps(np.array([0.0, 200.0]), np.array([-0.02, 0.02]))
    line = replace(drive.line, gradients=dip, limits=Steps(np.zeros(1), np.full(1, 20.0)))
    findings = verify(drive.rows, line, drive.train, drive.loss, ends_m=(0, 400), end_speeds_mps=(20, 20))
    assert_found(findings, "driven speed above the limit")
    assert not any("balance" in finding.what for finding in findings)


def test_a_steep_slope_is_weight(simple: Callable[..., Drive]) -> None:
    """Closed form: at constant speed uphill the balance is m·g·slope, the potential energy m·g·height."""
    drive = simple([[0, 0, 20, 0, 0, 0.01, 30], [100, 5, 20, 0, 0, 0.01, 30]])
    uphill = replace(drive.line, gradients=Steps(np.zeros(1), np.full(1, 0.01)))
    climbing = Drive(drive.rows, uphill, drive.train, drive.loss)
    assert climbing.balance_n == pytest.approx([1e5 * G * 0.01])
    assert climbing.balance_j["potential"] == pytest.approx(1e5 * G * 1.0)
