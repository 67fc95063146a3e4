"""The lower bound is true: no run of the integrator goes below it, whatever the section, the losses and the buffer.

`DAS_PROPERTY_SECTIONS=1000 pytest tests/property/test_bounds.py` draws more sections.
"""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from das.domain.errors import InfeasibleError
from das.domain.levels import Level
from das.domain.losses import LossMap
from das.offline.bound import (
    MapPlanes,
    Task,
    behind_fastest,
    efficiency_planes,
    fastest_is_ahead,
    map_rows,
    relaxation,
    task_of,
)
from das.offline.bound_kernels import (
    FIXED_ROWS,
    LOCAL,
    Multipliers,
    Planes,
    Program,
    RelaxedRun,
    constraints,
    proven_bound,
)
from das.solver.front import Front
from das.solver.solution import Solution, trajectory_on
from das.solver.solve import solve_front
from das.solver.state import RollOut, State
from docs.studies.tight_bound import all_cells, cell_line, even_rows
from docs.studies.tight_bound_kernels import values_behind
from tests.support.cells_near import cells_near
from tests.support.random_sections import Posed, posed_sections

Floats = NDArray[np.float64]

SECTIONS = int(os.environ.get("DAS_PROPERTY_SECTIONS", "30"))
drawn = settings(
    max_examples=SECTIONS, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)
ROUNDING_RATIO = 1e-7
"""Runs keep their limits to 1e-9 or so, and forces are measured against the largest."""


def solved(posed: Posed) -> tuple[Front, list[Solution]]:
    """A coarse front of a section and its runs at the buffers, the fastest run last."""
    front = solve_front(posed.section, threads=1)
    least_s = front.fastest().time_s
    runs = [front.trajectory(least_s * (1.0 + buffer)) for buffer in posed.buffer_ratios]
    return front, [*runs, front.fastest()]


def planes_of(task: Task, solution: Solution) -> Planes:
    loss = task.section.loss
    if isinstance(loss, LossMap):
        return MapPlanes(task, loss).of_run(solution.trajectory.force_el_n, min(solution.lambda_w, 1e7))
    return efficiency_planes(loss, task.line.supply)


def as_relaxed(solution: Solution, scale_n: float) -> RelaxedRun:
    """The values that a run of the integrator has in the relaxation."""
    run = solution.trajectory
    step = np.diff(run.s_m)
    energy_n = run.input_j(run.loss_j(solution.section.loss)) / step
    local = np.stack([run.interval_s() / step, run.force_el_n / scale_n, energy_n / scale_n], axis=1)
    return RelaxedRun(0.5 * run.v_mps**2, local)


def worst_constraint(program: Program, run: RelaxedRun) -> float:
    """By how much the worst constraint is missed; powers and inertia are large at short intervals, so in ratios."""
    rows = FIXED_ROWS + program.planes.force.shape[1]
    c, slope, worst = np.empty(rows), np.empty((rows, LOCAL)), -math.inf
    for k in range(len(program.motion.step_m)):
        z = np.array([run.w[k], run.w[k + 1], *run.local[k]])
        constraints(k, z, True, True, program, c, slope)
        size = 1.0 + np.abs(np.nan_to_num(slope) * z).sum(axis=1)
        worst = max(worst, float((c / size).max()))
    return worst


@pytest.mark.slow
@drawn
@given(posed_sections())
def test_no_gap_is_negative(posed: Posed) -> None:
    """The gap of every run that keeps the limits is proven and at least 0."""
    try:
        _, runs = solved(posed)
    except InfeasibleError:
        return
    for run in runs:
        if run.feasible:
            assert run.gap_reason == ""
            assert run.gap_ratio >= 0.0, run.section.name
        else:
            assert math.isnan(run.gap_ratio)


@pytest.mark.nightly
@drawn
@given(posed_sections())
def test_every_run_keeps_the_relaxation_of_every_other(posed: Posed) -> None:
    """The proof's premise: cuts made at one run hold for all runs in its time, and the box contains them."""
    try:
        _, runs = solved(posed)
    except InfeasibleError:
        return
    slowest = max(runs, key=lambda run: run.time_s)
    for made_at in runs:
        task = task_of(made_at, slowest.time_s)
        task = behind_fastest(task) if fastest_is_ahead(task) else task
        program, scale_n = relaxation(task, planes_of(task, made_at))
        for run in runs:
            if run.feasible and run.trajectory.v_mps[-1] == made_at.trajectory.v_mps[-1]:
                relaxed = as_relaxed(run, scale_n)
                assert worst_constraint(program, relaxed) <= ROUNDING_RATIO, run.section.name
                assert (relaxed.w <= program.box.high_w * (1 + 1e-9)).all()
                tau, force = relaxed.local[:, 0], relaxed.local[:, 1]
                assert (tau >= program.box.low_tau * (1 - 1e-9)).all()
                assert (tau <= program.box.high_tau * (1 + 1e-9)).all()
                assert (force <= program.efforts.traction_force * (1 + 1e-6)).all()
                assert (force >= -program.efforts.electric_force * (1 + 1e-6)).all()


@pytest.mark.slow
@drawn
@given(posed_sections(), st.integers(0, 2**32 - 1))
def test_any_multipliers_prove_a_bound(posed: Posed, seed: int) -> None:
    """Whatever the point and the multipliers, the bound is below the energy of every run in time."""
    try:
        _, runs = solved(posed)
    except InfeasibleError:
        return
    rng = np.random.default_rng(seed)
    given_run = runs[0]
    task = task_of(given_run, given_run.time_s)
    task = behind_fastest(task) if fastest_is_ahead(task) else task
    program, scale_n = relaxation(task, planes_of(task, given_run))
    n, rows = len(program.motion.step_m), FIXED_ROWS + program.planes.force.shape[1]
    for _ in range(20):
        w = np.where(program.box.free, rng.uniform(0.01, 1.0, n + 1) * program.box.high_w, program.box.high_w)
        tau = program.box.low_tau * rng.uniform(0.5, 3.0, n)
        point = RelaxedRun(w, np.stack([tau, rng.normal(size=n), rng.normal(size=n)], axis=1))
        multipliers = Multipliers(rng.exponential(size=(n, rows)) ** 3, rng.exponential(size=1))
        bound_j = proven_bound(point, multipliers, program) * scale_n
        for run in runs:
            if run.feasible and run.time_s <= task.allowed_s:
                assert bound_j <= run.balance.input + 1e-6 * abs(bound_j)


@pytest.mark.nightly
@drawn
@given(posed_sections(), st.floats(0.05, 0.95))
def test_other_runs_in_time_are_above_the_bound(posed: Posed, share: float) -> None:
    """An independent witness: blends of other runs that take no longer need at least as much energy."""
    try:
        _, runs = solved(posed)
    except InfeasibleError:
        return
    slow, quick = max(runs[:-1], key=lambda run: run.time_s), runs[-1]
    state = State.at(posed.section)
    ends = [RollOut(run.trajectory.v_mps, run.time_s) for run in (quick, slow)]
    try:
        blended = state.blend(share, *ends)
    except InfeasibleError:
        return
    path = trajectory_on(posed.section, state, blended.speeds_mps)
    energy_j = float(path.input_j(path.loss_j(posed.section.loss)).sum())
    for run in runs:
        certificate = run.certificate
        same_end = blended.speeds_mps[-1] == run.trajectory.v_mps[-1]
        if not certificate.reason and same_end and blended.time_s <= certificate.allowed_s:
            assert energy_j >= certificate.bound_j - 1e-6 * abs(energy_j)


@pytest.mark.slow
@settings(drawn, max_examples=max(SECTIONS // 3, 1))
@given(posed_sections(levels=(Level.L3,)), st.floats(0.1, 10.0))
def test_no_run_undercuts_the_cells_of_speeds(posed: Posed, factor: float) -> None:
    """The shortest path over cells is below energy + price·time of every run, at any price and any width."""
    loss = posed.section.loss
    try:
        _, runs = solved(posed)
    except InfeasibleError:
        return
    slowest = max(runs, key=lambda run: run.time_s)
    task = task_of(slowest, slowest.time_s)
    task = behind_fastest(task) if fastest_is_ahead(task) else task
    lambda_w = factor * min(slowest.lambda_w, 1e7)
    rows, line = even_rows(map_rows(task, loss), loss), cell_line(task, lambda_w)
    same_end = [run for run in runs if run.feasible and run.trajectory.v_mps[-1] == slowest.trajectory.v_mps[-1]]
    wide = [values_behind(all_cells(task, width), line, rows) for width in (0.25, 0.08)]
    for run in same_end:
        least_j = run.balance.input + lambda_w * run.time_s
        near_j = values_behind(cells_near(run.trajectory.v_mps, all_cells(task, 0.004)), line, rows)
        assert max(*wide, near_j) <= least_j + 1e-7 * abs(least_j), run.section.name
