"""The verifier on power supply, adhesion, auxiliaries, load and wind: silent on plans, finding planted errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from das.domain.conditions import Conditions
from das.domain.files.native import read_route, read_vehicle
from das.solver.section import build_section
from das.solver.solve import solve_front
from precompute.cli.report import solution_json
from tests.support.making import csv_rows
from tests.support.raw_data import Floats, Line, Train, constant_efficiencies
from tests.support.verifier import Finding, verify

LENGTH_M = 12_000.0
ROUTE = """
schema_version = 1
[route]
id = "supply"
name = "supply"
length_km = 12.0
[[stops]]
name = "A"
position_km = 0.0
[[stops]]
name = "B"
position_km = 12.0
[speed_limits]
columns = ["position_km", "limit_kmh"]
rows = [[0.0, 120], [4.0, 60], [5.0, 130], [10.2, 70]]
[gradients]
columns = ["position_km", "gradient_permille"]
rows = [[0.0, 0], [1.0, 6], [3.0, -15], [6.0, 4], [8.0, -12], [9.5, 0]]
[receptivity]
columns = ["position_km", "receptivity_ratio"]
rows = [[0.0, 1.0], [3.0, 0.4], [7.0, 0.9]]
[neutral_sections]
columns = ["position_km", "length_m"]
rows = [[1.2, 250], [7.1, 120]]
[no_regeneration]
columns = ["position_km", "length_m"]
rows = [[3.5, 700], [11.4, 200]]
"""
VEHICLE = """
schema_version = 1
[vehicle]
id = "train"
name = "train"
source = "test"
mass_t = 320.0
rotating_mass_ratio = 0.05
length_m = 120.0
max_speed_kmh = 125.0
auxiliary_power_kw = 60.0
[resistance]
c0_kn = 4.0
c1_kn_per_mps = 0.03
c2_kn_per_mps2 = 0.008
[traction]
max_force_kn = 260.0
max_power_kw = 4200.0
[electric_brake]
max_force_kn = 180.0
max_power_kw = 4000.0
[friction_brake]
max_force_kn = 300.0
[adhesion]
adhesive_mass_t = 80.0
[losses]
default = "own"
[losses.own]
traction_efficiency_ratio = 0.87
brake_efficiency_ratio = 0.84
idle_kw = 20.0
"""
LOSS = constant_efficiencies(0.87, 0.84, 20e3)
HERE = Conditions(mass_ratio=1.2, head_wind_mps=4.0, adhesion_ratio=0.9, receptivity_ratio=0.8)


def planned(folder: Path, route: str = ROUTE, vehicle: str = VEHICLE, here: Conditions = HERE) -> tuple[Floats, Any]:
    (folder / "route.toml").write_text(route)
    (folder / "train.toml").write_text(vehicle)
    line, train = here.line(read_route(folder / "route.toml")), here.train(read_vehicle(folder / "train.toml"))
    front = solve_front(build_section(line, train))
    least_s = front.fastest().time_s
    solution = front.trajectory(least_s * 1.03)
    return csv_rows(solution.trajectory), solution_json(solution, least_s, 0.0)


def found(folder: Path, plan: tuple[Floats, Any]) -> list[Finding]:
    """What the verifier says of a plan for the unchanged route and train, under the conditions above."""
    (folder / "route.toml").write_text(ROUTE)
    (folder / "train.toml").write_text(VEHICLE)
    line, train = Line.read(folder / "route.toml"), Train.read(folder / "train.toml")
    taken = replace(line.receptivity, value=0.8 * line.receptivity.value)
    loaded = replace(train.loaded(1.2 * train.mass_kg), rail_ratio=0.9, head_wind_mps=4.0)
    return verify(plan[0], replace(line, receptivity=taken), loaded, LOSS, ends_m=(0.0, LENGTH_M), claim=plan[1])


def test_nothing_is_wrong_with_what_the_solver_plans(tmp_path: Path) -> None:
    """Two programs that share no code agree on supply, adhesion, auxiliaries, load and wind."""
    plan = planned(tmp_path)
    assert found(tmp_path, plan) == []
    ledger = plan[1]["ledger_kwh"]
    assert ledger["unreturned"] > 0.05 * ledger["input"]
    assert ledger["friction_brake"] > 0


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[[1.2, 250], [7.1, 120]]", "[[7.1, 120]]", "traction above force"),
        ("[[3.5, 700], [11.4, 200]]", "[[11.4, 200]]", "electric brake above force"),
        ("[7.1, 120]", "[7.1, 110]", "traction above force"),
        ("[3.0, 0.4]", "[3.0, 0.41]", "unreturned is not what is said"),
        ("adhesive_mass_t = 80.0", "adhesive_mass_t = 80.8", "traction above force"),
        ("auxiliary_power_kw = 60.0", "auxiliary_power_kw = 60.5", "component_loss is not what is said"),
    ],
)
def test_a_plan_for_another_supply_or_train_is_found_out(tmp_path: Path, old: str, new: str, expected: str) -> None:
    """The verifier notices each small error in what the planner was told of supply and train."""
    route, vehicle = ROUTE.replace(old, new), VEHICLE.replace(old, new)
    findings = found(tmp_path, planned(tmp_path, route, vehicle))
    assert any(finding.what.startswith(expected) for finding in findings), findings


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"mass_ratio": 1.198}, "forces do not balance"),
        ({"head_wind_mps": 4.1}, "resistance is not what is said"),
        ({"adhesion_ratio": 0.91}, "traction above force"),
        ({"receptivity_ratio": 0.81}, "unreturned is not what is said"),
    ],
)
def test_a_plan_for_other_conditions_is_found_out(tmp_path: Path, changed: dict[str, float], expected: str) -> None:
    """The verifier notices each small error in what the planner was told of load, wind, rail and line."""
    findings = found(tmp_path, planned(tmp_path, here=replace(HERE, **changed)))
    assert any(finding.what.startswith(expected) for finding in findings), findings
