"""The bound by cells of speeds: below a brute dynamic program, near it, and below every run that is known."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.losses import LossMap
from das.domain.vehicle import BrakePolicy
from das.offline.bound import Task, certificate, map_rows, task_of
from das.solver.line_profile import LineProfile
from das.solver.section import build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from docs.studies import tight_bound as cells_module
from docs.studies.tight_bound import (
    Incumbent,
    all_cells,
    cell_line,
    close,
    even_rows,
    split,
    tightened,
    tightened_j,
)
from docs.studies.tight_bound_kernels import values_ahead, values_behind
from tests.support.cells_near import cells_near
from tests.support.making import make_route

Floats = NDArray[np.float64]
LAMBDA_W = 2e6


@cache
def run() -> Solution:
    """A run over 500 m with the map of the GTO converters, whose loss jumps at some speeds."""
    section = build_section(make_route(500.0, [(0.0, 25.0)]), load_vehicle("re460-ic"), level=Level.L3)
    front = solve_front(section)
    return front.trajectory(front.fastest().time_s * 1.1)


def loss() -> LossMap:
    found = run().section.loss
    assert isinstance(found, LossMap)
    return found


@cache
def coarse() -> Task:
    """Eight intervals of 25 m from 12.4 to 12.4 m/s, around the speed of a jump (45 km/h)."""
    section, count = run().section, 8
    node_m = 25.0 * np.arange(count + 1)
    flat = np.zeros(count)
    line = LineProfile(
        node_m=node_m,
        step_m=np.diff(node_m),
        grade_ratio=flat,
        constant_n=np.array([0.0, 3e4, 3e4, 0.0, -4e4, -4e4, 0.0, 0.0]),
        tunnel_n_per_mps2=flat,
        limit_mps=np.full(count, 14.0),
        supply=np.ones(count),
    )
    envelope = np.full(count + 1, 14.0)
    envelope[[0, -1]] = 12.4
    return Task(section=section, line=line, envelope_mps=envelope, speeds_mps=np.full(count + 1, 12.4), allowed_s=20.0)


def brute_j(task: Task, share: float) -> float:
    """The least energy and priced time (J) of runs on a fine grid of speeds; a share of what is fed back is taken."""
    train = task.section.train
    grid = np.linspace(8.0, 14.0, 601)
    value = np.where(np.abs(grid - 12.4) < 1e-9, 0.0, np.inf)
    for k in range(len(task.line.step_m) - 1, -1, -1):
        v0, v1 = np.meshgrid(grid, grid, indexing="ij")
        h, mean = task.line.step_m[k], 0.5 * (v0 + v1)
        way_mean = (2.0 / 3.0) * (v0**2 + v0 * v1 + v1**2) / (v0 + v1)
        force = train.inertial_mass_kg * (v1**2 - v0**2) / (2.0 * h) + train.c0_n + train.c1_n_per_mps * way_mean
        force += train.c2_n_per_mps2 * 0.5 * (v0**2 + v1**2) + task.line.constant_n[k]
        possible = np.abs(force) <= train.traction_force_n
        energy = h * force + loss().loss_w(np.where(possible, force, 0.0), mean) * h / mean
        energy = np.where(energy > 0.0, energy, share * energy) + LAMBDA_W * h / mean
        value = np.where(possible, energy + value, np.inf).min(axis=1)
    return float(value[np.argmin(np.abs(grid - 12.4))])


@pytest.mark.parametrize("share", [1.0, 0.4, 0.0])
def test_the_shortest_path_is_below_a_brute_dynamic_program_and_near_it(share: float) -> None:
    task = coarse()
    task = replace(task, line=replace(task.line, supply=np.full(8, share)))
    rows, line = even_rows(map_rows(task, loss()), loss()), cell_line(task, LAMBDA_W)
    brute = brute_j(task, share)
    paths = [values_behind(all_cells(task, width), line, rows) for width in (0.04, 0.01, 0.0025)]
    assert all(path <= brute for path in paths)
    assert paths[0] < paths[1] < paths[2]
    assert paths[2] == pytest.approx(brute, rel=5e-3)


@pytest.mark.nightly
def test_cells_that_a_better_run_goes_through_stay_open() -> None:
    """The cells of the given run are open after each pass, and most others are closed."""
    task = task_of(run(), run().time_s)
    rows, lambda_w = even_rows(map_rows(task, loss()), loss()), run().lambda_w
    line, cells = cell_line(task, lambda_w), all_cells(task, 0.05)
    most_j = run().balance.input + lambda_w * run().time_s
    for parts in (2, 2):
        cells = split(cells, parts)
        assert values_behind(cells, line, rows) <= most_j
        values_ahead(cells, line, rows)
        close(cells, most_j)
        speeds_mps = np.minimum(task.speeds_mps, cells.top_mps - 1e-12)[1:-1]
        index = np.floor(np.sqrt(speeds_mps) / cells.width).astype(int)
        assert cells.open[cells.offset[1:-1] + index - cells.first[1:-1]].all()
    assert 0 < cells.open.mean() < 0.6


@pytest.mark.parametrize("electric_n", [3e5, 1e5])
def test_cells_around_a_run_prove_nearly_all_of_its_cost(electric_n: float) -> None:
    """Open only beside a run, narrow cells prove its cost to 0.2 %, also where friction brakes after the motors.

    A bound that let friction brake instead of the motors would be lower: at a low speed that costs less.
    """
    train = load_vehicle("re460-ic")
    if electric_n < train.electric_brake.max_force_n:
        weaker = replace(train.electric_brake, max_force_n=electric_n)
        train = replace(train, electric_brake=weaker, friction_brake_force_n=2e5, brake_policy=BrakePolicy.BLENDED)
    section = build_section(make_route(500.0, [(0.0, 25.0)]), train, level=Level.L3)
    front = solve_front(section)
    found = front.trajectory(front.fastest().time_s * 1.1)
    assert (found.trajectory.force_friction_n.min() < -1e4) == (electric_n < 3e5)
    task, map_of_it = task_of(found, found.time_s), section.loss
    assert isinstance(map_of_it, LossMap)
    rows, line = even_rows(map_rows(task, map_of_it), map_of_it), cell_line(task, found.lambda_w)
    cells = cells_near(found.trajectory.v_mps, all_cells(task, 5e-4))
    cost_j = found.balance.input + found.lambda_w * found.time_s
    left = (cost_j - values_behind(cells, line, rows)) / cost_j
    assert 0.0 <= left <= 2e-3


def tight_j(budget_s: float) -> float:
    """The bound by cells of the run (J), with a clock that adds a second at each look."""
    ticks = iter(range(10_000))
    incumbent, task = Incumbent(run().balance.input, run().lambda_w), task_of(run(), run().time_s)
    return tightened_j(task, loss(), incumbent, budget_s, clock=lambda: float(next(ticks)))


@pytest.mark.slow
def test_the_bound_gets_tighter_and_stays_below_the_run() -> None:
    """Of the quick bound's gap of 1.0 % less than a half is left, after three passes."""
    quick, energy_j = certificate(run()), run().balance.input
    found_j = tight_j(10.0)
    assert quick.bound_j < found_j <= energy_j
    assert energy_j - found_j < 0.5 * (energy_j - quick.bound_j)


@pytest.mark.slow
def test_a_search_without_time_leaves_the_quick_bound() -> None:
    assert tightened(run(), 1e-9).certificate == certificate(run())


def test_a_pass_that_would_not_end_in_time_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a clock that adds a second at each look there is one pass for 1 s, and several for 100 s."""
    monkeypatch.setattr(cells_module, "FIRST_WIDTH", 0.1)
    monkeypatch.setattr(cells_module, "NARROWEST_WIDTH", 0.02)
    once_j, often_j = tight_j(1.0), tight_j(100.0)
    assert -math.inf < once_j < often_j <= run().balance.input


def test_constant_efficiencies_need_no_tight_bound() -> None:
    section = build_section(make_route(500.0, [(0.0, 25.0)]), load_vehicle("re460-ic"), level=Level.L2)
    front = solve_front(section)
    found = front.trajectory(front.fastest().time_s * 1.1)
    assert tightened(found) is found
