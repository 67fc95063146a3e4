"""Kept memory: an array has its memory to itself for as long as anybody can see it, and then the next array has it."""

from __future__ import annotations

import gc

import numpy as np

from das.solver.policy_store import KeptMemory
from das.solver.section import build_section
from das.solver.solve import solve_front
from das.solver.warm_up import tiny_route, tiny_vehicle


def test_an_array_takes_over_the_memory_of_one_that_is_gone() -> None:
    kept = KeptMemory()
    first = kept.empty((100, 10), np.float32)
    place = first.ctypes.data
    del first
    assert kept.free_bytes() == 4064
    second = kept.empty((40, 10), np.float64)
    assert place % 64 == 0
    assert second.ctypes.data == place
    assert second.shape == (40, 10)
    assert second.dtype == np.float64
    assert second.flags.c_contiguous
    assert second.flags.writeable
    assert kept.free_bytes() == 0


def test_memory_is_not_given_away_while_a_view_is_left() -> None:
    """A column of a slice is enough to keep what it shows."""
    kept = KeptMemory()
    array = kept.empty((50, 20), np.float64)
    array[:] = 7.0
    column = array[10:20, 3]
    del array
    other = kept.empty((50, 20), np.float64)
    other[:] = 1.0
    assert (column == 7.0).all()
    assert kept.free_bytes() == 0
    del column
    assert kept.free_bytes() == 8064


def test_a_much_smaller_array_does_not_hold_a_large_block() -> None:
    kept = KeptMemory()
    del_me = kept.empty((1000,), np.float64)
    del del_me
    small = kept.empty((100,), np.float64)
    assert kept.free_bytes() == 8064
    assert small.size == 100


def test_no_more_than_the_limit_is_kept() -> None:
    kept = KeptMemory(kept_bytes=10_000)
    arrays = [kept.empty((1000,), np.float64), kept.empty((200,), np.float64), kept.empty((100,), np.float64)]
    del arrays
    gc.collect()
    assert kept.free_bytes() <= 10_000
    huge = kept.empty((2000,), np.float64)
    del huge
    assert kept.free_bytes() <= 10_000


def test_an_empty_array_needs_no_memory() -> None:
    assert KeptMemory().empty((0, 5), np.float64).shape == (0, 5)


def test_two_fronts_of_one_section_are_the_same_and_do_not_share_memory() -> None:
    """The second is solved in memory that a third one left, full of other values."""
    section = build_section(tiny_route(), tiny_vehicle())
    left = solve_front(section, lambda_w=np.array([5e3, 5e4, 5e5]))
    first = solve_front(section, lambda_w=np.array([1e4, 1e5, 1e6]))
    assert not np.shares_memory(left.value_j, first.value_j)
    del left
    second = solve_front(section, lambda_w=np.array([1e4, 1e5, 1e6]))
    assert second.value_j.tobytes() == first.value_j.tobytes()
    assert np.asarray(second.time_to_go_s).tobytes() == np.asarray(first.time_to_go_s).tobytes()
