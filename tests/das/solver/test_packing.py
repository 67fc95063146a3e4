"""Policies packed while they are swept: half the memory, nearly the same runs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from das.solver import solve
from das.solver.front import Front
from das.solver.kernels.policy_values import UNKNOWN_STEP
from das.solver.kernels.tuples import PackedTimes
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from das.solver.tolerances import UNREACHABLE
from tests.support.making import make_route, make_train

LADDER_W = np.geomspace(1e4, 1e7, 11)


def hilly(end_speed_mps: float = 0.0) -> Section:
    route = make_route(
        9_000.0,
        [(0.0, 35.0), (2_600.0, 22.0), (6_000.0, 40.0)],
        [(0.0, 0.0), (1_500.0, 22e-3), (4_000.0, -18e-3), (7_000.0, 4e-3)],
    )
    train = make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.5e6)
    return build_section(route, train, options=SectionOptions(end_speed_mps=end_speed_mps))


@pytest.fixture(scope="module")
def whole() -> Front:
    return solve_front(hilly(), lambda_w=LADDER_W)


def packed_by_numpy(front: Front) -> tuple[NDArray[np.uint16], NDArray[np.float32], NDArray[np.float32]]:
    """Steps, least time and step of every node and multiplier, as arrays of numpy."""
    known = front.value_j < UNREACHABLE
    times = np.where(known, np.asarray(front.time_to_go_s), np.nan).astype(np.float64)
    times = np.where(~known.any(axis=1, keepdims=True), 0.0, times)
    low = np.nanmin(times, axis=1).astype(np.float32)
    step = ((np.nanmax(times, axis=1) - low) / (UNKNOWN_STEP - 1)).astype(np.float32)
    parts = np.round((times - low[:, np.newaxis]) / np.maximum(step, np.finfo(np.float32).tiny)[:, np.newaxis])
    steps = np.where(known, np.clip(parts, 0, UNKNOWN_STEP - 1), UNKNOWN_STEP)
    return steps.astype(np.uint16), low, step


@pytest.mark.parametrize(("threads", "block_nodes"), [(1, 10_000), (1, 1), (2, 7), (3, 32)])
@pytest.mark.parametrize("end_speed_mps", [0.0, 20.0])
def test_packed_while_swept_is_packed_afterwards(threads: int, block_nodes: int, end_speed_mps: float) -> None:
    section = hilly(end_speed_mps)
    front = solve_front(section, lambda_w=LADDER_W)
    packed = solve_front(section, lambda_w=LADDER_W, threads=threads, block_nodes=block_nodes, packed=True)
    steps, low_s, step_s = packed_by_numpy(front)
    assert isinstance(packed.time_to_go_s, PackedTimes)
    assert (steps == UNKNOWN_STEP).any()
    assert np.array_equal(packed.time_to_go_s.steps, steps)
    assert np.array_equal(packed.time_to_go_s.low_s, low_s)
    assert np.array_equal(packed.time_to_go_s.step_s, step_s)
    assert packed.value_j.dtype == np.float32
    assert np.array_equal(packed.value_j, front.value_j.astype(np.float32))


@pytest.mark.parametrize("buffer_ratio", [0.005, 0.03, 0.1, 0.3])
def test_a_run_from_packed_policies_needs_the_same_energy(whole: Front, buffer_ratio: float) -> None:
    packed = solve_front(whole.section, lambda_w=LADDER_W, packed=True)
    time_s = whole.fastest().time_s * (1 + buffer_ratio)
    one, other = whole.trajectory(time_s), packed.trajectory(time_s)
    saved_by_time_j = one.lambda_w * abs(one.time_s - other.time_s)
    assert abs(other.balance.input - one.balance.input) <= 1e-5 * one.balance.input + saved_by_time_j


def test_large_policies_are_packed_by_themselves(whole: Front, monkeypatch: pytest.MonkeyPatch) -> None:
    assert whole.value_j.dtype == np.float64
    monkeypatch.setattr(solve, "PACKED_ABOVE_BYTES", whole.value_j.nbytes)
    assert solve_front(whole.section, lambda_w=LADDER_W).value_j.dtype == np.float32
    assert solve_front(whole.section, lambda_w=LADDER_W, packed=False).value_j.dtype == np.float64
