"""Timing two things side by side, memory, and what the machine is."""

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
    """Durations (s) of something and of its baseline, measured in turns."""

    seconds: list[float]
    baseline_seconds: list[float]

    def figure(self, subject: Subject, bound_s: float, *, amount: float | None = None) -> Figure:
        """As a figure: a duration in ms, or with an `amount` (in the unit's multiples) a rate per s.

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
    """Time both in turns, so that what else the machine does hits both alike.

    Each is called once before, uncounted; a baseline of one round is not.
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
    """Durations (s) of some calls, after one that is not counted."""
    work()
    return [seconds_of(work) for _ in range(rounds)]


def seconds_of(work: Callable[[], object]) -> float:
    """Duration of a call (s)."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def peak_bytes_of(work: Callable[[], object]) -> float | None:
    """Most memory that the process had during a call, beyond what it had before; None where the system does not say."""
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
