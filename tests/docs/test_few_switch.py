"""The study few_switch: what few changes of the controller cost, beside the optimum and four modes."""

from __future__ import annotations

from typing import Any

import pytest

from das.command_line.files import load_route, load_vehicle
from das.domain.units import kwh
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies import few_switch
from docs.studies.few_switch import few_switch_fronts, few_switch_rows
from precompute.baselines.strategies import four_modes

BUFFER_RATIO = 1.07
PRICES_S = (0.0, 0.03, 1.0)


@pytest.fixture(scope="module")
def front() -> Front:
    """The whole front of 6 km on the level."""
    return solve_front(build_section(load_route("flat-6km"), load_vehicle("re460-ic"), end_m=6000.0))


@pytest.fixture(scope="module")
def rows(front: Front) -> dict[str, dict[str, Any]]:
    """The rows of the study for a buffer of 7 %, by their names."""
    found = few_switch_rows(front, few_switch_fronts(front.section, PRICES_S), BUFFER_RATIO * front.fastest().time_s)
    return {row["run"]: row for row in found}


def test_the_optimum_and_four_modes_are_those_of_the_front_and_the_baseline(
    rows: dict[str, dict[str, Any]], front: Front
) -> None:
    time_s = BUFFER_RATIO * front.fastest().time_s
    best, run = front.trajectory(time_s), four_modes(front.section, time_s)
    assert rows["optimum"]["energy_kwh"] == pytest.approx(kwh(best.balance.input))
    assert rows["optimum"]["more_kwh"] == pytest.approx(0.0, abs=1e-4 * kwh(best.balance.input))
    assert rows["four modes"]["energy_kwh"] == pytest.approx(kwh(run.balance.input))
    assert rows["four modes"]["time_s"] == pytest.approx(run.time_s)


def test_a_dear_change_is_made_less_often_and_no_phase_is_short(rows: dict[str, dict[str, Any]]) -> None:
    """On the level with dear changes: accelerate (or hold), coast, brake; so there are two or three changes."""
    assert rows["1"]["changes"] < min(rows["0"]["changes"], rows["optimum"]["changes"])
    assert 2 <= rows["1"]["changes"] <= 3
    assert rows["0.03"]["shortest_s"] >= 10.0


def test_every_schedule_needs_more_than_the_optimum_but_not_much(rows: dict[str, dict[str, Any]]) -> None:
    for price in PRICES_S:
        row = rows[f"{price:g}"]
        assert -0.001 * row["energy_kwh"] < row["more_kwh"] < 0.03 * row["energy_kwh"]
        assert abs(row["time_s"] - rows["optimum"]["time_s"]) < 5.0


def test_the_table_of_a_buffer_has_a_row_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    few_switch.main(["flat-6km", "re460-ic", "--buffers", "5", "--prices", "0.1"])
    out = capsys.readouterr().out
    assert [line.split()[0] for line in out.splitlines()[5:8]] == ["optimum", "0.1", "four"]
    assert "price: of a change" in out


def test_the_rows_agree_with_each_other(rows: dict[str, dict[str, Any]]) -> None:
    for run in rows.values():
        assert run["changes_per_min"] == pytest.approx(60 * run["changes"] / run["time_s"])
        assert run["more_ratio"] == pytest.approx(run["more_kwh"] / (run["energy_kwh"] - run["more_kwh"]))
