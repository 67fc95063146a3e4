"""The solver beside plain versions of its steps (tests/support/plain_solver.py)."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.files.load import load_route, load_vehicle
from das.domain.losses import EfficiencyLoss
from das.solver import solve
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solution import Fit, trajectory_on
from das.solver.solve import solve_front
from tests.support.closeness import assert_close
from tests.support.making import make_route, make_train
from tests.support.plain_solver import bisected, numpy_sweep, plain_front
from tests.support.transitions import all_moves


@pytest.fixture(scope="module")
def section() -> Section:
    """Limits, hills that need a run-up, losses: some states cannot be finished from."""
    route = make_route(
        6_000.0,
        [(0.0, 30.0), (2_500.0, 22.0), (3_500.0, 40.0)],
        [(0.0, 0.0), (1_000.0, 0.012), (3_000.0, -0.01), (4_200.0, 0.12), (4_350.0, 0.0)],
    )
    train = make_train(resistance=(1500.0, 20.0, 4.0), loss=EfficiencyLoss.from_efficiencies(0.88, 0.85, 2e4))
    return build_section(route, train)


@pytest.fixture(scope="module")
def front(section: Section) -> Front:
    return solve_front(section)


@pytest.mark.parametrize(("threads", "block_nodes"), [(1, 10_000), (2, 10_000), (1, 1), (3, 7), (2, 32)])
def test_blocks_and_threads_change_no_bit(
    monkeypatch: pytest.MonkeyPatch, section: Section, front: Front, threads: int, block_nodes: int
) -> None:
    monkeypatch.setattr(solve, "BLOCK_NODES", block_nodes)
    other = solve_front(section, threads=threads)
    assert np.array_equal(other.value_j, front.value_j)
    assert np.array_equal(other.time_to_go_s, front.time_to_go_s)


def test_the_sweep_is_the_plain_recursion(section: Section, front: Front) -> None:
    value_j, time_to_go_s = numpy_sweep(all_moves(section), front.lambda_w)
    unreachable = front.value_j > 1e29
    assert unreachable.any()
    assert np.array_equal(value_j > 1e29, unreachable)
    assert np.allclose(value_j[~unreachable], front.value_j[~unreachable], rtol=1e-12, atol=1e-6)
    # Where two landings cost the same the time may differ: the value does not say which it was.
    close = np.isclose(time_to_go_s[~unreachable], front.time_to_go_s[~unreachable], rtol=1e-4)
    assert close.mean() > 0.999


@pytest.mark.parametrize("buffer_ratio", [0.02, 0.05, 0.1, 0.2, 0.4])
def test_the_search_for_a_time_finds_what_bisection_finds(section: Section, front: Front, buffer_ratio: float) -> None:
    """The same energy, but for the price of the time between the two (bisection ends at either side of a jump)."""
    time_s = front.fastest().time_s * (1 + buffer_ratio)
    solution = front.trajectory(time_s)
    speeds, found_s = bisected(front, time_s)
    plain = trajectory_on(section, section, speeds)
    assert plain.time_s == pytest.approx(found_s)
    assert found_s == pytest.approx(time_s, rel=0.02)
    assert solution.fit is Fit.ON_TIME
    input_j = plain.balance(section.vehicle, section.loss).input + solution.lambda_w * (found_s - solution.time_s)
    assert solution.balance.input == pytest.approx(input_j, rel=3e-4)


def test_the_plain_front_is_the_front() -> None:
    """Transitions of one speed after the other give the same values, to rounding, in any number of threads."""
    section = build_section(load_route("flat-6km"), load_vehicle("re460-ic"))
    plain, front = plain_front(section, 2), solve_front(section)
    reached = front.value_j < 1e16
    assert_close(np.asarray(plain.value_j)[reached], np.asarray(front.value_j)[reached], rel=1e-6, absolute=10.0)
