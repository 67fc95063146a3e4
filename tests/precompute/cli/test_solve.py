"""das-precompute solve and front: what they print and write, checked independently."""

from __future__ import annotations

import csv
import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.files.load import locate_route, locate_vehicle
from tests.support.making import printed, write_loss_map
from tests.support.raw_data import Line, Train, read_loss_map, read_rows
from tests.support.verifier import verify

SOLVE = ("solve", "flat-6km", "re460-ic")
MASS_KG, FORCE_N, POWER_W, LIMIT_MPS, LENGTH_M = 440e3, 300e3, 6.1e6, 160 / 3.6, 6000.0
Solved = tuple[dict[str, Any], Path]
BALANCE = {"resistance", "component_loss", "friction_brake", "unreturned", "kinetic", "potential", "input", "comfort"}


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    """The flat section at 7 % buffer: what `--json` printed, and the folder with run.csv and run.png."""
    folder = tmp_path_factory.mktemp("solved")
    files = ("--out", "run.csv", "--plot", "run.png")
    return json.loads(printed(folder, *SOLVE, "--buffer", "7", "--json", *files)), folder


def test_solve_prints_one_json_object_and_draws_a_picture(solved: Solved) -> None:
    result = solved[0]
    numbers = ("min_time_s", "time_s", "energy_kwh", "energy_irreversible_kwh", "gap_ratio", "solve_s")
    assert all(isinstance(result[name], float) for name in numbers)
    balance = result["ledger_kwh"]
    assert set(balance) == BALANCE
    assert result["time_s"] == pytest.approx(1.07 * result["min_time_s"], abs=0.05)
    assert (result["fit"], result["feasible"]) == ("on-time", True)
    lost = balance["resistance"] + balance["component_loss"] + balance["friction_brake"]
    assert result["energy_irreversible_kwh"] == pytest.approx(lost)
    assert result["energy_stored_kwh"] == balance["kinetic"] + balance["potential"]
    assert result["energy_kwh"] == balance["input"] == pytest.approx(lost + balance["kinetic"], rel=1e-6)
    assert balance["potential"] == 0
    assert balance["comfort"] == pytest.approx(250 * result["time_s"] / 3600)
    assert 0.0 <= result["gap_ratio"] < 0.05
    assert result["gap_reason"] == ""
    assert 0 < result["solve_s"] < 30
    picture = (solved[1] / "run.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert len(picture) > 10_000


def test_the_least_time_is_that_of_full_effort_cruising_and_full_brake(solved: Solved) -> None:
    """∫m·dv/(F ∓ R) up to the limit and down, by quadrature; the rest at the limit."""
    v = np.linspace(0, LIMIT_MPS, 200_001)
    effort = np.minimum(FORCE_N, POWER_W / np.maximum(v, 1e-9))
    resistance_n = 8200 + 38.8 * v + 8.6 * v * v  # eq. 15 of the paper
    time_s, way_m = 0.0, 0.0
    for force in (effort - resistance_n, effort + resistance_n):
        time_s += np.trapezoid(MASS_KG / force, v)
        way_m += np.trapezoid(MASS_KG * v / force, v)
    assert solved[0]["min_time_s"] == pytest.approx(time_s + (LENGTH_M - way_m) / LIMIT_MPS, abs=0.2)


def test_the_csv_and_what_is_printed_are_one_run_that_the_verifier_finds_nothing_wrong_with(
    tmp_path: Path, solved: Solved
) -> None:
    """Forces, motion, limits and every energy by a program of its own, which reads the files itself."""
    hilly = ("solve", "zurich-luzern", "re460-ic", "--to", "Thalwil", "--buffer", "7", "--json")
    write_loss_map(tmp_path / "map.csv", "re460-ic")
    out = printed(tmp_path, *hilly, "--out", "run.csv")
    train, loss = Train.read(locate_vehicle("re460-ic")), read_loss_map(tmp_path / "map.csv")
    runs = (("flat-6km", (0.0, LENGTH_M), *solved), ("zurich-luzern", (0.0, 12e3), json.loads(out), tmp_path))
    for route, ends_m, claim, folder in runs:
        header = (folder / "run.csv").read_text().splitlines()[0]
        assert header == "s_m,t_s,v_mps,force_el_n,force_friction_n,grade_ratio,limit_mps"
        rows, line = read_rows(folder / "run.csv"), Line.read(locate_route(route))
        assert verify(rows, line, train, loss, ends_m=ends_m, claim=claim) == []
        lighter = replace(train, mass_kg=0.999 * train.mass_kg)
        found = verify(rows, line, lighter, loss, ends_m=ends_m, claim=claim)
        assert "forces do not balance" in [one.what for one in found]


def test_solve_for_people_says_what_it_wrote_and_how_a_baseline_drives(tmp_path: Path) -> None:
    out = printed(tmp_path, *SOLVE, "--time", "100", "--out", "run.csv")
    assert "late" in out
    assert "saved" not in out, "a single run has nothing to be compared with"
    assert "written: run.csv" in out
    assert os.listdir(tmp_path) == ["run.csv"]
    out = printed(tmp_path, *SOLVE, "--level", "l1", "--strategy", "four-mode", "--buffer", "7")
    assert "four-mode" in out
    assert re.search(r"^holds 1[34]\d\.\d km/h$", out, re.MULTILINE)
    assert re.search(r"^coasts from km 1\.\d{3} to km 5\.\d{3}$", out, re.MULTILINE)


@pytest.mark.nightly
def test_more_time_never_costs_more(tmp_path: Path, solved: Solved) -> None:
    words = ("front", *SOLVE[1:], "--buffers", "0,2,7,20", "--plot", "front.png", "--json")
    result = json.loads(printed(tmp_path, *words))
    points = result["points"]
    assert [p["buffer_percent"] for p in points] == [0, 2, 7, 20]
    assert result["front_s"] > 0
    energies = [p["energy_kwh"] for p in points]
    assert energies == sorted(energies, reverse=True)
    assert energies[0] > 1.2 * energies[-1]
    for point in points:
        assert point["time_s"] == pytest.approx(result["min_time_s"] * (1 + point["buffer_percent"] / 100), abs=0.05)
        assert set(point["ledger_kwh"]) == BALANCE
    assert points[2]["energy_kwh"] == pytest.approx(solved[0]["energy_kwh"], rel=1e-5)
    assert (tmp_path / "front.png").read_bytes().startswith(b"\x89PNG")
    unrefined = json.loads(printed(tmp_path, *words[:3], "--buffers", "7", "--refine", "off", "--json"))
    assert unrefined["points"][0]["energy_kwh"] > points[2]["energy_kwh"]


@pytest.mark.parametrize(
    "section",
    [("flat-6km",), ("zurich-luzern", "--to", "Thalwil"), ("zurich-luzern", "--reverse", "--from", "Thalwil")],
)
def test_what_is_lost_and_what_is_stored_sum_to_the_input_that_is_printed(
    tmp_path: Path, section: tuple[str, ...]
) -> None:
    """Level, uphill and downhill."""
    route, *ends = section
    out = printed(tmp_path, "front", route, "re460-ic", *ends, "--buffers", "0,7", "--refine", "off")
    rows = re.findall(r"^ +[\d.]+ +[\d.]+ +(-?[\d.]+) +([\d.]+) +([-+][\d.]+) ", out, re.MULTILINE)
    assert len(rows) == 2
    for input_kwh, lost_kwh, stored_kwh in rows:
        assert float(input_kwh) == pytest.approx(float(lost_kwh) + float(stored_kwh), abs=0.015 + 1e-9)


def test_refinement_saves_and_can_be_switched_off(tmp_path: Path, solved: Solved) -> None:
    """Off gives the run of the table; the refined one is not later and needs less."""
    found = json.loads(printed(tmp_path, *SOLVE, "--buffer", "7", "--json", "--refine", "off"))
    assert found["energy_kwh"] > solved[0]["energy_kwh"]
    assert found["time_s"] >= solved[0]["time_s"]


@pytest.mark.nightly
def test_baseline_strategies(tmp_path: Path, solved: Solved) -> None:
    """Same keys, time and files as the optimal run, and each needs more energy than the better one."""
    energies = []
    for strategy in ("four-mode", "top-speed", "fastest"):
        time_given = () if strategy == "fastest" else ("--buffer", "7")
        files = ("--out", f"{strategy}.csv", "--plot", f"{strategy}.png")
        result = json.loads(printed(tmp_path, *SOLVE, "--strategy", strategy, *time_given, "--json", *files))
        assert set(result) == set(solved[0])
        assert (result["strategy"], result["fit"], result["feasible"]) == (strategy, "on-time", True)
        assert result["min_time_s"] == pytest.approx(solved[0]["min_time_s"], abs=1e-6)
        assert (result["lambda_kw"], result["gap_ratio"]) == (None, None)
        buffer = 1.0 if strategy == "fastest" else 1.07
        assert result["time_s"] == pytest.approx(buffer * result["min_time_s"], abs=0.05)
        assert (result["cruise_speed_mps"] is None) == (strategy == "fastest")
        assert len(result["coasting_m"]) == (strategy == "four-mode")
        energies.append(result["energy_kwh"])
        with (tmp_path / f"{strategy}.csv").open() as file:
            last = list(csv.DictReader(file))[-1]
        assert float(last["t_s"]) == pytest.approx(result["time_s"], abs=1e-6)
        assert (tmp_path / f"{strategy}.png").read_bytes().startswith(b"\x89PNG")
    assert (solved[0]["strategy"], solved[0]["cruise_speed_mps"]) == ("optimal", None)
    assert solved[0]["energy_kwh"] < energies[0] < energies[1] < energies[2]


@pytest.mark.nightly
def test_exact_front_beside_the_solver(tmp_path: Path) -> None:
    words = ("front", "flat-6km", "re460-ic", "--exact", "--buffers", "0,2", "--out", "front.csv", "--json")
    result = json.loads(printed(tmp_path, *words))
    assert [point["buffer_percent"] for point in result["points"]] == [0, 2]
    for point in result["points"]:
        assert point["time_s"] <= result["min_time_s"] * (1 + point["buffer_percent"] / 100) + 1e-6
        assert point["supported_kwh"] <= point["energy_kwh"] * (1 + 1e-12)
        # The solver is not bound to the grid; at least time the grid's rounding down of full traction costs most.
        assert -0.04 < point["fast_difference_ratio"] < 0.001
    assert result["worst_gap_ratio"] < 0.001
    rows = list(csv.DictReader((tmp_path / "front.csv").open()))
    assert len(rows) == result["front_points"] > 1000
    assert float(rows[0]["time_s"]) == pytest.approx(result["min_time_s"], abs=1e-6)
    assert float(rows[0]["energy_input_j"]) / 3.6e6 == pytest.approx(result["points"][0]["energy_kwh"])
