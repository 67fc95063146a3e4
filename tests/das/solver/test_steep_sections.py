"""Steep sections and weak trains: what a fine stepwise calculation finds possible is solved, within the forces."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from das.domain.effort import EffortEnvelope
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from tests.support.making import make_route, make_train


def front(line_m: float, limit_mps: float, grades: list[tuple[float, float]], c0_n: float, **train: Any) -> Front:
    weak = replace(make_train(resistance=(c0_n, 0.0, 0.0)), **train)
    return solve_front(build_section(make_route(line_m, [(0.0, limit_mps)], grades), weak))


def test_a_hill_that_the_power_climbs_at_a_walk_is_not_refused() -> None:
    """96 kW lift 300 t up 21.9 permil at about 1.4 m/s."""
    traction = EffortEnvelope(max_force_n=96e3, max_power_w=96e3)
    run = front(2_000.0, 20.0, [(0.0, 0.0219)], 3e3, mass_kg=3e5, traction=traction).fastest()
    assert run.time_s == pytest.approx(2_000.0 / (96e3 / (3e5 * 9.81 * 0.0219 + 3e3)), rel=0.01)


def test_a_weak_brake_is_used_within_its_force_where_the_slope_accelerates_more_than_the_train_may() -> None:
    """On 70 permil the full brake leaves 0.29 m/s²; the train's largest acceleration is 0.2 m/s²."""
    brake = EffortEnvelope(max_force_n=4e4, max_power_w=1e12)
    grades = [(0.0, 0.0), (50.0, -0.07), (100.0, 0.0)]
    run = front(300.0, 20.0, grades, 0.0, electric_brake=brake, max_acceleration_mps2=0.2).fastest()
    assert run.trajectory.force_el_n.min() == pytest.approx(-4e4, abs=1e-3)
    assert run.feasible


@pytest.mark.parametrize("buffer_ratio", [0.0, 0.03, 0.1])
def test_a_hill_that_slows_more_than_the_train_may_brake_is_climbed_within_the_force(buffer_ratio: float) -> None:
    traction = EffortEnvelope(max_force_n=2e4, max_power_w=1e12)
    grades = [(0.0, -0.06), (100.0, 0.07), (110.0, -0.02)]
    solved = front(300.0, 20.0, grades, 0.0, traction=traction, max_deceleration_mps2=0.3)
    run = solved.trajectory(solved.fastest().time_s * (1 + buffer_ratio))
    assert run.trajectory.force_el_n.max() == pytest.approx(2e4, abs=1e-3)


@pytest.mark.parametrize(
    ("force_n", "grade_ratio", "from_m", "hill_m"),
    [(43e3, 0.0459, 60.0, 15.0), (35e3, 0.0364, 40.0, 20.0), (54e3, 0.0578, 40.0, 15.0)],
)
def test_a_hill_climbed_with_momentum_does_not_end_every_other_run(
    force_n: float, grade_ratio: float, from_m: float, hill_m: float
) -> None:
    """Setting off on the hill is impossible, so the slowest runs stop at its top: others are found."""
    traction = EffortEnvelope(max_force_n=force_n, max_power_w=1e6)
    grades = [(0.0, 0.0), (from_m, grade_ratio), (from_m + hill_m, -0.01)]
    solved = front(150.0, 3.0, grades, 2e3, traction=traction, train_length_m=5.0)
    for buffer_ratio in (0.05, 0.2):
        run = solved.trajectory(solved.fastest().time_s * (1 + buffer_ratio))
        assert run.feasible
        assert run.fit in (Fit.ON_TIME, Fit.EARLY)
