"""The sweep in vectors: whatever part of the ladder is swept, and however it is cut, every multiplier has its bits."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from das.solver.front import Front
from das.solver.kernels.sweep import LANES
from das.solver.policy_store import in_parts
from das.solver.section import Section, build_section
from das.solver.solve import DecisionGrid, Transitions, solve_front
from tests.support.making import make_route, make_train

UNTOUCHED = -7.0


@pytest.fixture(scope="module")
def section() -> Section:
    route = make_route(2_500.0, [(0.0, 25.0), (1_100.0, 18.0)], [(0.0, 0.0), (600.0, 8e-3), (1_500.0, -6e-3)])
    return build_section(route, make_train(resistance=(1500.0, 20.0, 4.0)))


@pytest.fixture(scope="module")
def front(section: Section) -> Front:
    return solve_front(section, threads=1)


@pytest.mark.parametrize("size", [*range(1, 2 * LANES + 3), 3 * LANES + 1])
def test_a_part_of_the_ladder_has_the_bits_of_the_whole(section: Section, front: Front, size: int) -> None:
    part = solve_front(section, lambda_w=front.lambda_w[:size], threads=1)
    assert np.array_equal(part.value_j, front.value_j[:, :, :size])
    assert np.array_equal(np.asarray(part.time_to_go_s), np.asarray(front.time_to_go_s)[:, :, :size])


@pytest.mark.parametrize(("first", "last"), [(0, 1), (3, 4), (3, 12), (5, 40), (9, 26), (40, 64), (63, 64), (8, 8)])
def test_only_the_multipliers_asked_for_are_written(section: Section, front: Front, first: int, last: int) -> None:
    grid = DecisionGrid.of(section)
    nodes, states = len(grid.node_m) - 1, grid.speed_steps + 1
    moves = Transitions.empty(nodes, states)
    grid.fill(0, nodes, 0, moves)
    value, time_to_go = np.full(front.value_j.shape, UNTOUCHED), np.full(front.value_j.shape, UNTOUCHED, np.float32)
    value[-1], time_to_go[-1] = 0.0, 0.0
    moves.sweep(first, last, front.lambda_w, value, time_to_go)
    asked = np.zeros(len(front.lambda_w), dtype=bool)
    asked[first:last] = True
    assert np.array_equal(value[:-1, :, asked], front.value_j[:-1, :, asked])
    assert np.array_equal(time_to_go[:-1, :, asked], np.asarray(front.time_to_go_s)[:-1, :, asked])
    assert (value[:-1, :, ~asked] == UNTOUCHED).all()
    assert (time_to_go[:-1, :, ~asked] == UNTOUCHED).all()


@pytest.mark.parametrize("threads", [1, 2, 3, 5])
@pytest.mark.parametrize("size", [1, 3, 8, 13, 15, 24, 31, 64])
def test_parts_begin_at_whole_vectors_and_cover_everything(size: int, threads: int) -> None:
    parts: list[tuple[int, int]] = []
    with ThreadPoolExecutor(1) as pool:
        in_parts(pool, threads, size, lambda first, last: parts.append((first, last)), of=LANES)
    assert [i for first, last in parts for i in range(first, last)] == list(range(size))
    assert all(first % LANES == 0 for first, last in parts if last > first)
