"""Measurements for the bench: durations side by side, memory, the machine, and the best rates that it reaches."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.metadata
import os
import platform
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from das.solver.policy_store import in_parts
from precompute.workers import available_cores

STATUS = Path("/proc/self/status")
RESET_PEAK = Path("/proc/self/clear_refs")
CPU_INFO = Path("/proc/cpuinfo")
PACKAGES = ("numpy", "numba", "llvmlite")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One measured figure, a median over rounds, beside its baseline and its roofline.

    `value`, `least`, `most`, `baseline_value` and `bound_value` are in `unit`. `ratio`: how many times better than the
    baseline; `bound_ratio`: the share of what the roofline allows.
    """

    name: str
    what: str
    unit: str
    value: float
    least: float
    most: float
    rounds: int
    baseline: str
    baseline_value: float
    bound: str
    bound_value: float
    more_is_better: bool = False

    @property
    def ratio(self) -> float:
        return self._better(self.value, self.baseline_value)

    @property
    def bound_ratio(self) -> float:
        return self._better(self.value, self.bound_value)

    def _better(self, value: float, other: float) -> float:
        return value / other if self.more_is_better else other / value

    def as_json(self) -> dict[str, Any]:
        """Every field and both ratios."""
        return {**asdict(self), "ratio": self.ratio, "bound_ratio": self.bound_ratio}


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What a figure is about: its name, what is measured, in which unit, and what it is compared with, in words."""

    name: str
    what: str
    unit: str
    baseline: str
    bound: str


@dataclass(frozen=True, kw_only=True)
class Times:
    """Durations (s) of a piece of work and of its baseline, measured in turns."""

    seconds: list[float]
    baseline_seconds: list[float]

    def figure(self, subject: Subject, bound_s: float, *, amount: float | None = None) -> Figure:
        """The times as a figure: a duration in ms, or with an `amount` (in the figure's unit) a rate per s.

        `bound_s` is the least duration that the machine could reach (s).
        """
        times, typical = self.seconds, statistics.median(self.seconds)
        other = statistics.median(self.baseline_seconds)
        scaled = [_scaled(s, amount) for s in (typical, min(times), max(times), other, bound_s)]
        value, least, most, baseline_value, bound_value = scaled
        return Figure(
            **asdict(subject), value=value, least=min(least, most), most=max(least, most), rounds=len(times),
            baseline_value=baseline_value, bound_value=bound_value, more_is_better=amount is not None,
        )  # fmt: skip


def _scaled(seconds: float, amount: float | None) -> float:
    return 1e3 * seconds if amount is None else amount / seconds


def in_turns(
    work: Callable[[], object], baseline: Callable[[], object], *, rounds: int, baseline_rounds: int | None = None
) -> Times:
    """Time both alternately, so that other load of the machine affects both alike.

    Each is first called once without being counted, except a baseline of one round.
    """
    baseline_rounds = rounds if baseline_rounds is None else baseline_rounds
    work()
    if baseline_rounds > 1:
        baseline()
    own, other = [], []
    for i in range(rounds):
        own.append(seconds_of(work))
        if i < baseline_rounds:
            other.append(seconds_of(baseline))
    return Times(seconds=own, baseline_seconds=other)


def timed(work: Callable[[], object], rounds: int) -> list[float]:
    """Durations (s) of `rounds` calls of the work, after one that is not counted."""
    work()
    return [seconds_of(work) for _ in range(rounds)]


def seconds_of(work: Callable[[], object]) -> float:
    """Duration of a call (s)."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def peak_bytes_of(work: Callable[[], object]) -> float | None:
    """The most memory (bytes) that a call takes at any time, beyond what the process had; None if it is not known."""
    _give_back_free_memory()
    before = _status_bytes("VmRSS")
    if before is None or not _reset_peak():
        return None
    work()
    peak = _status_bytes("VmHWM")
    return peak - before if peak is not None and peak > before else None


def _give_back_free_memory() -> None:
    """Give free memory back to the system, so that the peak of a call shows all that it takes."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def _reset_peak() -> bool:
    try:
        RESET_PEAK.write_text("5")
    except OSError:
        return False
    return True


def _status_bytes(key: str) -> float | None:
    with contextlib.suppress(OSError):
        for line in STATUS.read_text().splitlines():
            if line.startswith(f"{key}:"):
                return 1024.0 * float(line.split()[1])
    return None


def machine() -> dict[str, Any]:
    """The machine that the figures were measured on, and the versions of what they depend on."""
    return {
        "cpu": _cpu_model(),
        "cores": available_cores(),
        "load_average": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in PACKAGES},
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _cpu_model() -> str:
    with contextlib.suppress(OSError):
        for line in CPU_INFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown"


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
"""Number of bytes to copy: more than the caches hold."""


@dataclass(frozen=True, kw_only=True)
class Roofline:
    """The best rates that `threads` threads reach in a few rounds.

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
        """Least time of a computation: the time of its arithmetic or of its memory traffic, whichever is longer."""
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
