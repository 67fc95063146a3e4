"""Where the sweep of a front writes its policies: whole, or packed block by block if they would be large."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from das.solver.kernels.policy_values import pack
from das.solver.kernels.tuples import PackedTimes


def in_parts(
    pool: ThreadPoolExecutor, threads: int, size: int, work: Callable[..., None], *args: object, of: int = 1
) -> None:
    """Call work(first, last, *args) for equal parts of range(size), each on a thread of its own.

    The parts begin at multiples of `of`.
    """
    edges = [min(of * round(size * i / (threads * of)), size) for i in range(threads)] + [size]
    for future in [pool.submit(work, first, last, *args) for first, last in pairwise(edges)]:
        future.result()


Floats = NDArray[np.float64]

Rows = tuple[Floats, NDArray[np.float32]]
"""Values (J) and times-to-go (s) of some decision nodes (nodes, speeds, L)."""


class PolicyStore(Protocol):
    """Takes the policies of a front from its end to its beginning, a block of decision nodes at a time."""

    @property
    def value_j(self) -> Floats | NDArray[np.float32]:
        """Values (J) of every state (nodes, speeds, L)."""

    @property
    def time_to_go_s(self) -> NDArray[np.float32] | PackedTimes:
        """Times-to-go (s) of every state."""

    def rows(self, start: int, end: int) -> Rows:
        """Room for the nodes start … end; the last one keeps its values, the others are to be filled."""

    def keep(self, start: int, end: int, pool: ThreadPoolExecutor, threads: int) -> None:
        """Keep the nodes start … end − 1, which are filled now."""


class WholePolicies:
    """Values in double and times-to-go in single precision, as the sweep writes them."""

    def __init__(self, shape: tuple[int, int, int], end_value_j: Floats | float) -> None:
        """Room for policies of this shape (nodes, speeds, L), with the values (J) at the end of the section."""
        self.value_j, self.time_to_go_s = np.empty(shape, np.float64), np.empty(shape, np.float32)
        self.value_j[-1], self.time_to_go_s[-1] = end_value_j, 0.0

    def rows(self, start: int, end: int) -> Rows:
        return self.value_j[start : end + 1], self.time_to_go_s[start : end + 1]

    def keep(self, start: int, end: int, pool: ThreadPoolExecutor, threads: int) -> None:
        """Nothing is left to do."""


class PackedPolicies:
    """Policies at half the size: values in single precision, times-to-go in steps of 16 bits, as in a table on disk.

    Only one block of nodes is held unpacked, as the sweep writes it.
    """

    def __init__(self, shape: tuple[int, int, int], end_value_j: Floats | float, block_nodes: int) -> None:
        """Room for policies of this shape (nodes, speeds, L), with the values (J) at the end of the section."""
        nodes, states, size = shape
        self.value_j = np.empty(shape, np.float32)
        self.time_to_go_s = PackedTimes(
            np.empty(shape, np.uint16), np.empty((nodes, size), np.float32), np.empty((nodes, size), np.float32)
        )
        block = (min(block_nodes, nodes - 1) + 1, states, size)
        self._value_j, self._time_s = np.empty(block, np.float64), np.empty(block, np.float32)
        self._value_j[0], self._time_s[0] = end_value_j, 0.0
        pack(0, 1, self._value_j[:1], self._time_s[:1], *self._places(nodes - 1, nodes))

    def rows(self, start: int, end: int) -> Rows:
        # The first node of the block filled before is the last node of this block.
        last = end - start
        self._value_j[last], self._time_s[last] = self._value_j[0], self._time_s[0]
        return self._value_j[: last + 1], self._time_s[: last + 1]

    def keep(self, start: int, end: int, pool: ThreadPoolExecutor, threads: int) -> None:
        in_parts(pool, threads, end - start, pack, self._value_j, self._time_s, *self._places(start, end))

    def _places(self, start: int, end: int) -> tuple[NDArray[np.float32], PackedTimes]:
        times, rows = self.time_to_go_s, slice(start, end)
        return self.value_j[rows], PackedTimes(times.steps[rows], times.low_s[rows], times.step_s[rows])
