"""Planes below the energy of a loss map: nowhere above it, and near it where they are made."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.offline.bound import MapPlanes, _power_cut, efficiency_planes, map_rows, task_of
from das.solver.section import Section, build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from tests.support.crossing import few

Floats = NDArray[np.float64]


@cache
def run_at(train: str) -> Solution:
    """A run over the bundled 6 km with a loss map."""
    section = build_section(load_route("flat-6km"), load_vehicle(train), level=Level.L3)
    front = solve_front(section)
    return front.trajectory(front.fastest().time_s * 1.08)


def energy_n(loss: LossMap, force_n: Floats, speed_mps: Floats) -> Floats:
    return np.asarray(force_n + loss.loss_w(force_n, speed_mps) / speed_mps)


@pytest.mark.parametrize("train", few(["re460-ic", "re460-ic-igbt"], ("re460-ic-igbt",), pytest.mark.slow))
def test_no_state_of_the_map_is_below_a_plane(train: str) -> None:
    run = run_at(train)
    loss, rng = run.section.loss, np.random.default_rng(1)
    assert isinstance(loss, LossMap)
    task = task_of(run, run.time_s)
    planes = MapPlanes(task, loss).of_run(run.trajectory.force_el_n, run.lambda_w)
    speed = rng.uniform(0.05, float(task.envelope_mps.max()), 4_000)
    speed[:500] = rng.uniform(0.05, 1.0, 500)
    most = run.section.vehicle.traction_effort_n(speed)
    force = rng.uniform(-1.0, 1.0, len(speed)) * most
    truth = energy_n(loss, force, speed)
    allowed = 1.0 / speed <= task.high_tau.max()
    assert allowed.any()
    # The speeds at both ends of an interval are apart by anything; both_w is least for equal ones.
    for spread in (1.0, 1.7):
        both_w = spread * speed**2
        for k in range(0, len(task.high_tau), 40):
            within = (1.0 / speed <= task.high_tau[k]) & (1.0 / speed >= task.low_tau[k])
            heights = (
                np.outer(force, planes.force[k])
                + np.outer(1.0 / speed, planes.slowness[k])
                + np.outer(both_w, planes.speed[k])
                + planes.constant[k]
            )
            assert (heights.max(axis=1)[within] <= truth[within] * (1 + 1e-9) + 1e-6).all()


def test_at_a_stand_the_whole_force_is_within_reach_however_little_the_power() -> None:
    """5 kW give 50 kN at 0.1 m/s; a plane that stopped there would be above a map that needs less beyond it."""
    run = run_at("re460-ic")
    assert isinstance(run.section.loss, LossMap)
    task = task_of(run, run.time_s)
    weak = task.section.train._replace(traction_power_w=5e3)
    section = cast("Section", SimpleNamespace(train=weak))
    rows = map_rows(replace(task, section=section), run.section.loss)
    assert rows.hull_force[0, : rows.vertices[0]].max() >= weak.traction_force_n


def test_the_rows_reach_the_highest_speed_that_is_allowed() -> None:
    """Where that is a speed of the map, the tolerance of speeds takes it beyond; no plane may stop short of it."""
    run = run_at("re460-ic")
    assert isinstance(run.section.loss, LossMap)
    task, speeds_mps = task_of(run, run.time_s), run.section.loss.speed_mps
    of_map_mps = float(speeds_mps[np.searchsorted(speeds_mps, task.envelope_mps.max()) - 1])
    task = replace(task, envelope_mps=np.minimum(task.envelope_mps, of_map_mps))
    assert map_rows(task, run.section.loss).tau.min() <= task.low_tau.min()


@pytest.mark.parametrize("train", few(["re460-ic", "re460-ic-igbt"], ("re460-ic-igbt",), pytest.mark.slow))
def test_planes_are_near_the_run(train: str) -> None:
    run = run_at(train)
    loss, path = run.section.loss, run.trajectory
    assert isinstance(loss, LossMap)
    task = task_of(run, run.time_s)
    planes = MapPlanes(task, loss).of_run(path.force_el_n, run.lambda_w)
    tau, squares = 2.0 / (path.v_mps[:-1] + path.v_mps[1:]), 0.5 * path.v_mps**2
    heights = (
        planes.force * path.force_el_n[:, None]
        + planes.slowness * tau[:, None]
        + planes.speed * (squares[:-1] + squares[1:])[:, None]
        + planes.constant
    ).max(axis=1)
    step = np.diff(path.s_m)
    assert float(heights @ step) == pytest.approx(run.balance.input, rel=0.03)
    assert 0.0 <= run.gap_ratio < 0.04


def test_the_cut_of_a_power_touches_its_force_at_the_run_and_is_nowhere_below_it() -> None:
    """The force F at a slowness τ is the root of F + G·F·(F − R) = P·τ, with G = h·τ²/2M."""
    run = run_at("re460-ic")
    task, power_w, resisting_n = task_of(run, run.time_s), 3e6, 2e4
    slope, offset = _power_cut(task, power_w, np.full(len(task.line.step_m), resisting_n))
    of_run = 2.0 / (task.speeds_mps[:-1] + task.speeds_mps[1:])
    for times in (0.7, 1.0, 1.4):
        tau = times * of_run
        bend = 0.5 * task.line.step_m * tau**2 / task.section.train.inertial_mass_kg
        rest = 1.0 - bend * resisting_n
        force_n = (np.sqrt(rest**2 + 4.0 * bend * power_w * tau) - rest) / (2.0 * bend)
        above = (slope * tau + offset) / force_n - 1.0
        assert above[force_n > resisting_n].min() > -1e-7
        assert times != 1.0 or np.median(np.abs(above)) < 1e-7


def test_planes_of_efficiencies_are_the_energy_itself() -> None:
    loss = EfficiencyLoss(traction_ratio=0.2, brake_ratio=0.3, idle_w=5e4)
    supply = np.array([1.0, 0.4, 0.0, -1.0])
    planes = efficiency_planes(loss, supply)
    for force in (-9e4, -2e3, 0.0, 5e4):
        for speed in (0.5, 10.0, 30.0):
            gross = force + float(loss.loss_w(force, speed)) / speed
            truth = np.where(gross > 0, gross, np.clip(supply, 0, 1) * gross)
            heights = planes.force * force + planes.slowness / speed + planes.constant
            np.testing.assert_allclose(heights.max(axis=1), truth, rtol=1e-12, atol=1e-9)
