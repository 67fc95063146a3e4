"""The study of the paper: how near its figures we come, and that the pages have what the script gives."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.solver.section import build_section
from docs.studies import cases, effort, figures_energy, figures_runs, shares, table2
from docs.studies.cases import (
    ALL_VARIANTS,
    COMPLETE,
    L0_NOREG,
    L1,
    L2,
    L3,
    L3_IGBT,
    Workbench,
    lowest_running_speed_mps,
)
from docs.studies.drawing import style
from docs.studies.output import DOCS, Output
from precompute.baselines import strategies as baselines
from tests.support.kept_figures import SAME_PICTURE, picture_difference

TABLES = DOCS / "results" / "0.2" / "paper"
"""The pages that hold tables of the study."""
NEAR = 2e-3
"""The cells of these pages are as near (relative) to what the script gives: L0 REG's optimum is hardly determined."""


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("re460-ic")


@pytest.fixture(scope="module")
def bench() -> Workbench:
    return Workbench()


@pytest.fixture(scope="module")
def cells(bench: Workbench) -> list[table2.Cell]:
    return table2.cells(bench)


def ours_in(table: str) -> list[float]:
    """Our cells of a Table 2 in Markdown, row by row."""
    return [float(number) for number in re.findall(r"→ \**([\d.]+)", table)]


@pytest.mark.nightly
def test_four_modes_are_not_called_reduced_and_l3_is(bench: Workbench) -> None:
    vehicle = bench.vehicle(L3)
    runs = {"four modes": baselines.four_modes(bench.section(COMPLETE, L1), bench.time_s(COMPLETE, 7)).trajectory}
    for variant, buffer in (*product((L0_NOREG, L1, L2), (2.0, 7.0, 15.0)), (L3, 7.0), (L3, 15.0)):
        runs[f"{variant.name} {buffer}"] = bench.run(COMPLETE, variant, buffer)
    for name, run in runs.items():
        found = effort.effort(run, vehicle)
        reduced = name.startswith(L3.name)
        assert (found.acceleration.used, found.braking.used) == (reduced, reduced), name


def test_cheapest_cruising_speed_is_that_of_the_closed_form(bench: Workbench) -> None:
    data = figures_energy.cruising(bench)
    vehicle = bench.vehicle(L2)
    loss = vehicle.loss_model(Level.L2)
    # Eq. 14: d/dv [(1/η)(c1 + c2 v + c3 v²) + c0/v] = 0
    c = vehicle.resistance
    roots = np.roots([2 * c.c2_n_per_mps2, c.c1_n_per_mps, 0.0, -loss.idle_w / (1 + loss.traction_ratio)])
    least = float(roots[np.isreal(roots) & (roots.real > 0)].real[0])
    assert data.cheapest_kmh("l2") == pytest.approx(least / KMH, abs=figures_energy.STEP_KMH)
    assert data.cheapest_kmh("l0") is None
    assert data.cheapest_kmh("l1") is None
    assert abs(least / KMH - cases.CRUISING_MINIMUM_KMH) < 3.0


def test_energy_shares_close_and_follow_the_friction(vehicle: Vehicle) -> None:
    section = build_section(load_route("flat-6km"), vehicle, level=Level.L3)
    run = baselines.reduced_maximum_speed(section, 1.07 * baselines.fastest(section).time_s).trajectory
    trip = shares.DrivenTrip(vehicle=vehicle, runs=(run, run))
    electric, friction = shares.shares(trip, 0.0), shares.shares(trip, 1.0)
    assert electric.friction_brake == 0.0
    assert friction.resistance == pytest.approx(electric.resistance)
    brake_work = -2 * float(np.minimum(run.force_el_n, 0) @ np.diff(run.s_m))
    assert friction.friction_brake == pytest.approx(brake_work)
    assert friction.component_loss < electric.component_loss
    assert electric.comfort == pytest.approx(vehicle.comfort_power_w * (2 * run.time_s + shares.DWELL_S))
    assert sum(electric.percent(name) for name in cases.ENERGY_SHARES_PERCENT) == pytest.approx(100)
    ratio = shares.friction_for(trip, 15.1)
    assert shares.shares(trip, ratio).percent("friction_brake") == pytest.approx(15.1, abs=1e-6)
    assert shares.friction_for(trip, 99.0) is None


@pytest.mark.nightly
def test_largest_buffers(bench: Workbench) -> None:
    """Slow runs are dropped at L2 and L3; L0 and L1 go down to the paper's 20 km/h (sections 4.3, 4.5)."""
    for variant in (L2, L3):
        slowest = bench.slowest(COMPLETE, variant)
        assert slowest.bound == "least energy"
        later = bench.front(COMPLETE, variant).trajectory(1.1 * slowest.trajectory.time_s).trajectory
        least_j = bench.energy_j(slowest.trajectory, variant)
        assert bench.energy_j(later, variant) > least_j * (1 - 1e-3)
        assert bench.run(COMPLETE, variant, slowest.buffer_percent + 1) is None
    slowest = bench.slowest(COMPLETE, L1)
    assert slowest.bound == "not below 20 km/h"
    assert lowest_running_speed_mps(slowest.trajectory) / KMH == pytest.approx(20, abs=0.2)
    assert bench.slowest(COMPLETE, L1).buffer_percent > bench.slowest(COMPLETE, L2).buffer_percent


def test_the_page_of_table2_has_our_cells(cells: list[table2.Cell]) -> None:
    page = (TABLES / "table2.md").read_text(encoding="utf-8")
    assert ours_in(page) == pytest.approx([cell.ours for cell in cells], rel=NEAR)


EQUAL = 5e-4
"""Energies this near (relative) count as equal where only their order is asked for: print ties there as well."""


def test_table2_reaches_print_with_its_minima_on_the_diagonal_and_the_savings_of_l3(cells: list[table2.Cell]) -> None:
    printed = [cell for cell in cells if cell.deviation_ratio is not None]
    assert [c for c in printed if abs(c.deviation_ratio) > (0.04 if c.level.startswith("l3") else 0.07)] == []
    for variant in ALL_VARIANTS:
        column = {c.trajectory: c.ours for c in cells if c.level == variant.name}
        assert column[variant.name] <= min(column.values()) * (1 + EQUAL), variant.name
        assert column["fastest"] == max(column.values())
    gain = table2.gains(cells, L3)
    assert 0.01 <= gain["saves_against_second_best_ratio"] <= 0.025
    assert 0.04 <= gain["saves_against_rms_ratio"] <= 0.065
    assert table2.gains(cells, L3_IGBT)["saves_against_second_best_ratio"] >= 0.01


@pytest.mark.nightly
@pytest.mark.parametrize("wanted", cases.SAVINGS, ids=lambda s: f"{s.case}-{s.buffer_percent:g}")
def test_savings_at_the_named_buffers(bench: Workbench, wanted: cases.PrintedSaving) -> None:
    found = figures_energy.saving(bench, wanted)
    assert found.others, "no level to compare with"
    assert found.ours_percent == pytest.approx(wanted.saving_percent, abs=1.0)


def test_igbt_drives_longer_and_more_gently(bench: Workbench, tmp_path: Path) -> None:
    """Section 4.6, fig. 10, whose picture is that of the page."""
    with style():
        found = figures_runs.fig10(bench, Output(tmp_path))
    pictures = [(folder / "fig10.png").read_bytes() for folder in (TABLES, tmp_path)]
    assert picture_difference(*pictures) < SAME_PICTURE
    assert found["igbt_longer"] == {"driving": True, "braking": True}
    assert found["igbt_more_gently"] == {"driving": True, "braking": True}
    lasts_s = sum(found["use"]["fastest"][mode]["duration_s"] for mode in ("driving", "braking"))
    assert lasts_s == pytest.approx(bench.time_s(COMPLETE, 0), rel=1e-3)
