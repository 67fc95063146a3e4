"""The best that this machine can do: memory bandwidth and rate of arithmetic, measured when they are needed."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from das.solver.in_parts import in_parts

ROUNDS = 5
CACHED_NUMBERS = 1024
"""Numbers that each thread multiplies over and over: they stay in the nearest cache."""
REPEATS = 20_000
CHAIN = 16
"""Dependent multiplications and additions on each number per pass, unrolled by the compiler."""
CHAINS = 4
"""Independent chains of divisions, enough to keep the divider busy."""
DIVISIONS = 1_000_000
COPIED_BYTES = 64_000_000
"""More than the caches hold."""


@dataclass(frozen=True, kw_only=True)
class Roofline:
    """Rates of `threads` threads, the best of a few rounds.

    `flops` floating-point operations per s in vectors (fused multiply-add = 2), `divisions_ps` divisions one at a time
    per s, `vector_divisions_ps` divisions in vectors per s, `copy_bps` bytes read and written per s, `fresh_bps`
    bytes per s written to memory that the process did not have before.
    """

    threads: int
    flops: float
    divisions_ps: float
    vector_divisions_ps: float
    copy_bps: float
    fresh_bps: float

    @classmethod
    def measured(cls, threads: int) -> Roofline:
        """Measure; takes about a second."""
        with ThreadPoolExecutor(threads) as pool:
            return cls(
                threads=threads,
                flops=_flops(pool, threads),
                divisions_ps=_divisions_ps(pool, threads),
                vector_divisions_ps=_vector_divisions_ps(pool, threads),
                copy_bps=_copy_bps(pool, threads),
                fresh_bps=_fresh_bps(pool, threads),
            )

    def least_s(
        self,
        *,
        divisions: float = 0.0,
        vector_divisions: float = 0.0,
        flop: float = 0.0,
        moved_bytes: float = 0.0,
        fresh_bytes: float = 0.0,
    ) -> float:
        """Least time of a computation: the longer of its arithmetic and of its memory traffic."""
        divisions_s = divisions / self.divisions_ps + vector_divisions / self.vector_divisions_ps
        arithmetic_s = divisions_s + flop / self.flops
        return max(arithmetic_s, moved_bytes / self.copy_bps + fresh_bytes / self.fresh_bps)


@njit(cache=True, nogil=True, fastmath={"contract"})
def multiply_add(x, a, b, repeats):  # type: ignore[no-untyped-def]
    """x ← a·x + b, CHAIN times a pass, `repeats` passes over x."""
    for _ in range(repeats):
        for i in range(x.size):
            v = x[i]
            for _ in range(CHAIN):
                v = a * v + b
            x[i] = v


@njit(cache=True, nogil=True)
def divide(a, b, n):  # type: ignore[no-untyped-def]
    """Chains of w ← a/(w + b), n passes."""
    w, x, y, z = 1.0, 1.1, 1.2, 1.3
    for _ in range(n):
        w = a / (w + b)
        x = a / (x + b)
        y = a / (y + b)
        z = a / (z + b)
    return w + x + y + z


def _flops(pool: ThreadPoolExecutor, threads: int) -> float:
    numbers = np.ones((threads, CACHED_NUMBERS))

    def multiply(first: int, _last: int, repeats: int) -> None:
        multiply_add(numbers[first], 0.999, 0.001, repeats)

    in_parts(pool, threads, threads, multiply, 1)  # compiles
    seconds = _best_s(lambda: in_parts(pool, threads, threads, multiply, REPEATS))
    return 2.0 * CHAIN * REPEATS * numbers.size / seconds


def _divisions_ps(pool: ThreadPoolExecutor, threads: int) -> float:
    def divide_all(_first: int, _last: int, passes: int) -> None:
        divide(1.0, 1.0, passes)

    in_parts(pool, threads, threads, divide_all, 1)  # compiles
    seconds = _best_s(lambda: in_parts(pool, threads, threads, divide_all, DIVISIONS))
    return CHAINS * DIVISIONS * threads / seconds


@njit(cache=True, nogil=True, error_model="numpy")
def divide_all_of(x, a, b, repeats):  # type: ignore[no-untyped-def]
    """x ← a/(x + b), `repeats` passes over x."""
    for _ in range(repeats):
        for i in range(x.size):
            x[i] = a / (x[i] + b)


def _vector_divisions_ps(pool: ThreadPoolExecutor, threads: int) -> float:
    numbers = np.ones((threads, CACHED_NUMBERS))

    def divide_numbers(first: int, _last: int, repeats: int) -> None:
        divide_all_of(numbers[first], 1.0, 1.0, repeats)

    in_parts(pool, threads, threads, divide_numbers, 1)  # compiles
    seconds = _best_s(lambda: in_parts(pool, threads, threads, divide_numbers, REPEATS))
    return REPEATS * numbers.size / seconds


def _copy_bps(pool: ThreadPoolExecutor, threads: int) -> float:
    source, target = np.ones(COPIED_BYTES // 8), np.zeros(COPIED_BYTES // 8)
    seconds = _best_s(lambda: in_parts(pool, threads, len(source), _copy, source, target))
    return 2.0 * source.nbytes / seconds


def _copy(first: int, last: int, source: NDArray[np.float64], target: NDArray[np.float64]) -> None:
    target[first:last] = source[first:last]


def _fresh_bps(pool: ThreadPoolExecutor, threads: int) -> float:
    def touch() -> None:
        fresh = np.empty(COPIED_BYTES // 8)
        in_parts(pool, threads, len(fresh), lambda a, b: fresh[a:b].fill(1.0))

    return COPIED_BYTES / _best_s(touch)


def _best_s(work: Callable[[], object]) -> float:
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)
