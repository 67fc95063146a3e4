"""The sweep of a section: the same bits in every part and order, for a train under way, and packed."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from das.solver.front import Front
from das.solver.kernels.sweep import LANES, backward_sweep
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import BEHIND_M, DecisionGrid, empty_moves, in_parts, solve_ahead, solve_front
from tests.support.making import make_route, make_train

LADDER_W = np.geomspace(1e4, 1e8, 12)
LENGTH_M = 12_000.0
AT_M = 7_300.0
UNTOUCHED = -7.0


def hilly(end_speed_mps: float = 0.0) -> Section:
    route = make_route(
        LENGTH_M,
        [(0.0, 30.0), (3_100.0, 18.0), (5_000.0, 35.0), (10_000.0, 25.0)],
        [(0.0, 0.0), (2_000.0, 22e-3), (4_500.0, -12e-3), (8_000.0, 6e-3)],
    )
    train = make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.5e6)
    return build_section(route, train, options=SectionOptions(end_speed_mps=end_speed_mps))


SECTION = hilly()
WHOLE = solve_front(SECTION, lambda_w=LADDER_W)


def assert_same_rows(front: Front, whole: Front, first: int = 0) -> None:
    assert np.array_equal(front.value_j[first:], whole.value_j[first:])
    assert np.array_equal(np.asarray(front.time_to_go_s)[first:], np.asarray(whole.time_to_go_s)[first:])


# --- parts of the ladder ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def short() -> Front:
    """A short section with the whole ladder."""
    route = make_route(2_500.0, [(0.0, 25.0), (1_100.0, 18.0)], [(0.0, 0.0), (600.0, 8e-3), (1_500.0, -6e-3)])
    return solve_front(build_section(route, make_train(resistance=(1500.0, 20.0, 4.0))), threads=1)


@pytest.mark.parametrize("size", [*range(1, 2 * LANES + 3), 3 * LANES + 1])
def test_a_part_of_the_ladder_has_the_bits_of_the_whole(short: Front, size: int) -> None:
    part = solve_front(short.section, lambda_w=short.lambda_w[:size], threads=1)
    assert np.array_equal(part.value_j, short.value_j[:, :, :size])
    assert np.array_equal(np.asarray(part.time_to_go_s), np.asarray(short.time_to_go_s)[:, :, :size])


@pytest.mark.parametrize(("first", "last"), [(0, 1), (3, 4), (3, 12), (5, 40), (9, 26), (40, 64), (63, 64), (8, 8)])
def test_only_the_multipliers_asked_for_are_written(short: Front, first: int, last: int) -> None:
    grid = DecisionGrid.of(short.section)
    nodes = len(grid.node_m) - 1
    moves = empty_moves(nodes, short.section.speed_steps + 1)
    grid.fill(0, nodes, 0, moves)
    value, time_to_go = np.full(short.value_j.shape, UNTOUCHED), np.full(short.value_j.shape, UNTOUCHED, np.float32)
    value[-1], time_to_go[-1] = 0.0, 0.0
    backward_sweep(first, last, short.lambda_w, moves, value, time_to_go)
    asked = np.isin(np.arange(len(short.lambda_w)), range(first, last))
    assert np.array_equal(value[:-1, :, asked], short.value_j[:-1, :, asked])
    assert np.array_equal(time_to_go[:-1, :, asked], np.asarray(short.time_to_go_s)[:-1, :, asked])
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


# --- a train under way ------------------------------------------------------------------------------------------


def known_from(front: Front) -> int:
    return 0 if front.sweep is None else front.sweep.known_from


@pytest.fixture
def ahead() -> Front:
    """The front of a train at AT_M."""
    return solve_ahead(SECTION, AT_M, lambda_w=LADDER_W)


def test_only_what_is_ahead_is_solved_and_has_the_same_bits(ahead: Front) -> None:
    first = known_from(ahead)
    assert SECTION.node_m[SECTION.decision[first]] == pytest.approx(AT_M - BEHIND_M, abs=150.0)
    assert_same_rows(ahead, WHOLE, first)


AHEAD = solve_ahead(SECTION, AT_M, lambda_w=LADDER_W)


@settings(max_examples=60, deadline=None)
@given(st.floats(AT_M - BEHIND_M, LENGTH_M - 10.0), st.floats(0.0, 1.0), st.floats(0.001, 0.6))
def test_a_train_ahead_is_led_as_by_the_whole_front(s_m: float, share: float, buffer_ratio: float) -> None:
    v_mps = share * float(np.interp(s_m, SECTION.node_m, SECTION.envelope_mps))
    time_s = WHOLE.least_time_s(s_m, v_mps) * (1 + buffer_ratio)
    one, other = WHOLE.trajectory(time_s, s_m, v_mps), AHEAD.trajectory(time_s, s_m, v_mps)
    assert np.array_equal(one.trajectory.v_mps, other.trajectory.v_mps)
    assert (one.lambda_w, one.fit) == (other.lambda_w, other.fit)
    assert known_from(AHEAD) > 0


@pytest.mark.parametrize("ask", ["trajectory", "by_multiplier", "cover"])
def test_a_question_from_further_back_is_answered_by_solving_the_rest(ahead: Front, ask: str) -> None:
    if ask == "trajectory":
        time_s = 1.1 * WHOLE.least_time_s(500.0, 12.0)
        found = ahead.trajectory(time_s, 500.0, 12.0).trajectory.v_mps
        assert np.array_equal(found, WHOLE.trajectory(time_s, 500.0, 12.0).trajectory.v_mps)
    elif ask == "by_multiplier":
        for found, expected in zip(ahead.by_multiplier(500.0, 12.0), WHOLE.by_multiplier(500.0, 12.0), strict=True):
            assert np.array_equal(found, expected)
    else:
        ahead.cover(0.0)
    assert known_from(ahead) == 0
    assert_same_rows(ahead, WHOLE)


def test_several_threads_may_ask_for_the_rest_at_once(ahead: Front) -> None:
    places_m = (300.0, 700.0, 1_500.0, 400.0)
    with ThreadPoolExecutor(4) as pool:
        times = list(pool.map(lambda s_m: ahead.trajectory(900.0, s_m, 10.0).time_s, places_m))
    assert times == [WHOLE.trajectory(900.0, s_m, 10.0).time_s for s_m in places_m]
    assert_same_rows(ahead, WHOLE)


def test_a_free_end_speed_and_a_start_at_the_very_end() -> None:
    section = hilly(20.0)
    ends_j = np.linspace(5e7, 0.0, section.speed_steps + 1)
    whole = solve_front(section, lambda_w=LADDER_W, end_value_j=ends_j)
    for s_m in (-50.0, 0.0, 6_000.0, LENGTH_M, LENGTH_M + 500.0):
        front = solve_ahead(section, s_m, lambda_w=LADDER_W, end_value_j=ends_j, threads=1)
        assert_same_rows(front, whole, known_from(front))


def test_a_section_of_one_step() -> None:
    section = build_section(make_route(20.0, [(0.0, 5.0)]), make_train())
    front, whole = solve_ahead(section, 0.0, lambda_w=LADDER_W), solve_front(section, lambda_w=LADDER_W)
    assert front.trajectory(20.0).time_s == whole.trajectory(20.0).time_s
