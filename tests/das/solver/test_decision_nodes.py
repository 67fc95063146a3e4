"""The decision nodes see the line: fixed ones where it changes, steps by speed and by how near the changes lie."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.route import Route
from das.solver import tolerances as tol
from das.solver.line_profile import decision_nodes, even_nodes, fixed_nodes
from das.solver.section import build_section
from das.solver.solve import solve_front
from tests.support.making import flat, make_route

LENGTH_M = 20_000.0


def nodes(route: Route, speed_mps: float, asked_m: float | None = None) -> np.ndarray:
    """The decision nodes of a route on which the fastest run has one speed everywhere."""
    fixed_m = fixed_nodes(route, (0.0, route.length_m), 0.0)
    even_m = even_nodes(fixed_m)
    return decision_nodes(route, fixed_m, even_m, np.full(len(even_m), speed_mps), asked_m)


def longest_step_m(route: Route, speed_mps: float, asked_m: float | None = None) -> float:
    return float(np.diff(nodes(route, speed_mps, asked_m)).max())


def changing(every_m: float) -> Route:
    """A line whose limit changes every so many metres."""
    return make_route(LENGTH_M, [(at, 30.0 + at / every_m % 2) for at in np.arange(0.0, LENGTH_M, every_m)])


@pytest.mark.parametrize("speed_mps", [0.0, 3.0, 12.0, 25.0, 40.0, 80.0])
def test_a_step_takes_the_fastest_run_about_as_long_at_every_speed(speed_mps: float) -> None:
    longest_m = longest_step_m(changing(tol.USUAL_APART_M), speed_mps)
    cap_m = np.clip(tol.STEP_S * speed_mps, tol.SHORTEST_MAX_STEP_M, tol.MAX_STEP_M)
    assert 0.6 * cap_m <= longest_m <= cap_m + 1e-6


def test_steps_are_shorter_where_changes_lie_near_each_other() -> None:
    longest_m = [longest_step_m(changing(every_m), 25.0) for every_m in (2_000.0, 1_000.0, 500.0, 250.0, 125.0)]
    assert longest_m == sorted(longest_m, reverse=True)
    assert longest_m[-1] < 0.6 * longest_m[1]


def test_a_steep_change_of_gradient_counts_as_a_change_and_a_gentle_one_does_not() -> None:
    places = np.arange(0.0, LENGTH_M, 250.0)

    def hilly(ratio: float) -> Route:
        return make_route(LENGTH_M, [(0.0, 25.0)], [(at, ratio * (i % 2)) for i, at in enumerate(places)])

    steep, gentle = (len(nodes(hilly(ratio), 25.0)) for ratio in (1.2, 0.8) * np.array(tol.STEEP_CHANGE_RATIO))
    assert steep > 1.3 * gentle


def test_every_change_of_the_line_is_a_node_whatever_is_asked_for() -> None:
    route = make_route(5_000.0, [(0.0, 30.0), (1_234.5, 20.0), (1_235.1, 25.0)], [(0.0, 0.0), (3_333.3, 5e-3)])
    for asked_m in (None, 7.0, 400.0):
        found_m = nodes(route, 20.0, asked_m)
        assert np.isin(fixed_nodes(route, (0.0, 5_000.0), 0.0), found_m).all()
        assert (np.diff(found_m) > 0).all()


def test_a_short_section_has_short_steps() -> None:
    assert longest_step_m(flat(200.0), 15.0) <= tol.SHORTEST_MAX_STEP_M + 1e-6
    assert longest_step_m(flat(2_000.0), 15.0) <= 2_000.0 / tol.STEPS_OF_A_SECTION + 1e-6


def test_a_train_that_coasts_over_changing_slopes_uses_no_force() -> None:
    """The slope under a train of 200 m changes within decision steps; held at one acceleration it would need force."""
    places = np.arange(0.0, 8_000.0, 500.0)
    gradients = [(float(at), 0.012 * (-1) ** i) for i, at in enumerate(places)]
    section = build_section(make_route(8_000.0, [(0.0, 30.0)], gradients), load_vehicle("re460-ic"), level=Level.L1)
    front = solve_front(section, threads=1)
    run = front.trajectory(1.25 * front.fastest().time_s).trajectory
    force_n = np.abs(run.force_el_n + run.force_friction_n)
    nearly_none = (force_n < 0.05 * section.train.traction_force_n) & (np.diff(run.grade_ratio, append=0.0) != 0.0)
    assert nearly_none.sum() > 20
    # Where the train switches within a step there is a little force; where it coasts there is none at all.
    assert np.median(force_n[nearly_none]) < 1.0
