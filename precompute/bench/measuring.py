"""Measurements for the bench: paired durations, memory, the machine, and its peak rates."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.metadata
import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from das.command_line.process import available_cores

STATUS = Path("/proc/self/status")
RESET_PEAK = Path("/proc/self/clear_refs")
CPU_INFO = Path("/proc/cpuinfo")
PACKAGES = ("numpy", "numba", "llvmlite")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One measured figure, a median over rounds, with its baseline and its bound.

    `value`, `least`, `most`, `baseline_value` and `bound_value` are in `unit`. `ratio`: how many times better than the
    baseline; `bound_ratio`: the share of the best possible rate. Where no bound is known, `bound`, `bound_value` and
    `bound_ratio` are None.
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
    bound: str | None = None
    bound_value: float | None = None
    more_is_better: bool = False

    @property
    def ratio(self) -> float:
        return self._better(self.value, self.baseline_value)

    @property
    def bound_ratio(self) -> float | None:
        return None if self.bound_value is None else self._better(self.value, self.bound_value)

    def _better(self, value: float, other: float) -> float:
        return value / other if self.more_is_better else other / value

    def as_json(self) -> dict[str, Any]:
        """Every field and both ratios."""
        return {**asdict(self), "ratio": self.ratio, "bound_ratio": self.bound_ratio}


@dataclass(frozen=True, kw_only=True)
class Times:
    """Durations (s) of a piece of work and of its baseline, measured alternately."""

    seconds: list[float]
    baseline_seconds: list[float]

    def figure(
        self,
        name: str,
        what: str,
        unit: str,
        baseline: str,
        bound: tuple[str, float] | None = None,
        amount: float | None = None,
    ) -> Figure:
        """The times as a figure: a duration in ms, or with an `amount` (in the figure's unit) a rate per s.

        `bound` is a part of the work, in words, and its least time (s); None if no bound is known.
        """
        times, typical = self.seconds, statistics.median(self.seconds)
        other = statistics.median(self.baseline_seconds)
        value, least, most, baseline_value = (_scaled(s, amount) for s in (typical, min(times), max(times), other))
        part, bound_value = (None, None) if bound is None else (bound[0], _scaled(bound[1], amount))
        return Figure(
            name=name, what=what, unit=unit, value=value, least=min(least, most), most=max(least, most),
            rounds=len(times), baseline=baseline, baseline_value=baseline_value, bound=part, bound_value=bound_value,
            more_is_better=amount is not None,
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
    """The peak memory (bytes) of a call beyond that of the process before it; None if it is not known."""
    _give_back_free_memory()
    before = _status_bytes("VmRSS")
    if before is None or not _reset_peak():
        return None
    work()
    peak = _status_bytes("VmHWM")
    return peak - before if peak is not None and peak > before else None


def _give_back_free_memory() -> None:
    """Give free memory back to the system, so that the peak of a call includes all of its memory."""
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


ROUNDS = 100
"""Rounds of about 1 ms: other work on the machine hardly interrupts all of them."""
CACHED_NUMBERS = 1024
"""Size of the array that is updated repeatedly; it fits into the first-level cache."""
REPEATS = 1000
CHAIN = 16
"""Dependent multiplications and additions on each number per pass, unrolled by the compiler."""


@dataclass(frozen=True, kw_only=True)
class Roofline:
    """The best rates of arithmetic in vectors that this number of threads can reach.

    `flops` floating-point operations per s (fused multiply-add = 2), `divisions_ps` divisions per s. Memory is left
    out: a front may reuse memory of the process that is still in a cache, so that no write rate is a bound.
    """

    threads: int
    flops: float
    divisions_ps: float

    @classmethod
    def measured(cls) -> Roofline:
        """The best rates of one thread in many rounds; measuring takes a fraction of a second."""
        numbers, passed = np.ones(CACHED_NUMBERS), REPEATS * CACHED_NUMBERS
        added_s = min(timed(lambda: multiply_add(numbers, 0.999, 0.001, REPEATS), ROUNDS))
        divided_s = min(timed(lambda: divide(numbers, 1.0, 1.0, REPEATS), ROUNDS))
        return cls(threads=1, flops=2.0 * CHAIN * passed / added_s, divisions_ps=passed / divided_s)

    def of_threads(self, threads: int) -> Roofline:
        """The rates of this number of threads: at most those of one times the number."""
        times = threads / self.threads
        return Roofline(threads=threads, flops=times * self.flops, divisions_ps=times * self.divisions_ps)

    def least_s(self, *, divisions: float = 0.0, flop: float = 0.0) -> float:
        """Least time of a computation: that of its indispensable arithmetic."""
        return divisions / self.divisions_ps + flop / self.flops


@njit(cache=True, fastmath={"contract"})
def multiply_add(x, a, b, repeats):  # type: ignore[no-untyped-def]
    """x ← a·x + b, CHAIN times a pass, `repeats` passes over x."""
    for _ in range(repeats):
        for i in range(x.size):
            v = x[i]
            for _ in range(CHAIN):
                v = a * v + b
            x[i] = v


@njit(cache=True, error_model="numpy")
def divide(x, a, b, repeats):  # type: ignore[no-untyped-def]
    """x ← a/(x + b), `repeats` passes over x."""
    for _ in range(repeats):
        for i in range(x.size):
            x[i] = a / (x[i] + b)
