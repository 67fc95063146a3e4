"""What `das-precompute front --exact` does: solve, compare with the fast solver, print."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from das.command_line.printing import new_table, paragraph, print_table, steps_bar, tell
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.units import kwh
from das.solver.front import Front
from das.solver.section import Section
from precompute.exact.front import STATES, ExactFront, Limits, passes, solve_exact

RECENT = 6
"""Latest layers of a pass that show how much slower it is than the pass before."""
MOST_GROWTH, MOST_MULTIPLE = 1.15, 12.0
"""Largest growth from layer to layer, and largest value, of the multiple of its time in the pass before with which a
layer's time is forecast."""
FACTORS = ((0.2, 1.5), (0.9, 2.0), (1.8, 6.0))
"""Range of the time of the second, third and fourth pass, each as a multiple of the time of the pass before it."""


@dataclass
class Forecast:
    """Learns how long the layers take, and forecasts the time that is left.

    `passes` is the number of all passes, at most one more than there are `FACTORS`; `clock` gives the time in s.
    """

    passes: int
    clock: Callable[[], float]
    _began_s: float = field(init=False)
    _done: list[list[float]] = field(init=False)

    def __post_init__(self) -> None:
        self._done = [[]]
        self.begin()

    def begin(self) -> None:
        """Note that the first layer begins now, after work that is not repeated."""
        self._began_s = self.clock()

    def layer_done(self, layers: int) -> None:
        """Note that one more layer out of `layers` is done."""
        if len(self._done[-1]) == layers:
            self._done.append([])
        now_s = self.clock()
        self._done[-1].append(now_s - self._began_s)
        self._began_s = now_s

    def left_s(self) -> tuple[float, float] | None:
        """The least and the most time (s) that is likely to be left; None before the first pass has ended."""
        if len(self._done) == 1:
            return None
        before, now = self._done[-2], self._done[-1]
        low_s, high_s = _rest_of_pass(before, now, FACTORS[len(self._done) - 2])
        low_whole_s, high_whole_s = sum(now) + low_s, sum(now) + high_s
        for least, most in FACTORS[len(self._done) - 1 : self.passes - 1]:
            low_whole_s, high_whole_s = least * low_whole_s, most * high_whole_s
            low_s, high_s = low_s + low_whole_s, high_s + high_whole_s
        return low_s, high_s


def _rest_of_pass(before: Sequence[float], now: Sequence[float], factors: tuple[float, float]) -> tuple[float, float]:
    """Range of the time (s) for the layers left in a pass, from the times of all layers of the pass before."""
    left = before[len(now) :]
    least, most = factors
    known = range(max(len(now) - RECENT, 1), len(now))  # the first layer may have had something to load
    if not left or not known:
        return least * sum(left), most * sum(left)
    multiple = sum(now[i] for i in known) / max(sum(before[i] for i in known), 1e-9)
    # The first layers are small and show little, so the pass is also estimated as a whole.
    high_s = sum(min(multiple * MOST_GROWTH**i, max(multiple, MOST_MULTIPLE)) * one for i, one in enumerate(left, 1))
    whole_s = most * sum(before)
    return min(multiple * sum(left), whole_s), max(multiple * sum(left), min(high_s, whole_s))


def in_words(left_s: tuple[float, float] | None) -> str:
    """A range of time (s) in everyday words; empty while nothing is known."""
    if left_s is None:
        return ""
    low, high = (_rounded(one) for one in left_s)
    unit = "s" if high < 120 else "min"
    if unit == "min":
        low, high = round(low / 60), round(high / 60)
    return f", about {high} {unit} left" if low == high else f", {low} to {high} {unit} left"


def _rounded(time_s: float) -> int:
    """A time rounded to the second up to 10 s, beyond that to 5 s."""
    return round(time_s) if time_s < 10 else 5 * round(time_s / 5)


LEGEND = {
    "buffer": "time above the least possible on the grid",
    "exact": "least energy on the grid for that time",
    "supported": "the same on the front's lower convex hull, which a price of time can find",
    "solver": "least energy that the fast solver finds for that time; it is not bound to the grid",
}
COLUMNS = ("time_s", "energy_input_j", "supported_j")


def exact_front(
    fast: Front,
    asked: tuple[float, float],
    buffers_percent: list[float],
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    """Print the exact front of a section at some buffers beside the fast solver's energy for the same times.

    `fast` is the solver's front of the section. `asked` is the largest buffer (%) and the bucket (ms, 0: exact) of
    `solve_exact`. `out` is the CSV file for every point of the exact front, or None.
    """
    max_buffer_percent, bucket_ms = asked
    beyond = [x for x in buffers_percent if x > max_buffer_percent]
    if beyond:
        raise DasError(f"--buffers {beyond[0]:g}: expected at most --max-buffer, {max_buffer_percent:g} %")
    began = time.perf_counter()
    forecast = Forecast(passes=len(passes(bucket_ms)), clock=time.perf_counter)
    with steps_bar(STATES) as show:

        def layer_done(what: str, done: int, layers: int) -> None:
            if what == STATES:
                forecast.begin()
            else:
                forecast.layer_done(layers)
            show(f"{what}{in_words(forecast.left_s())}", done, layers)

        exact = solve_exact(
            fast.section, max_buffer_percent / 100, limits=Limits(bucket_ms=bucket_ms), progress=layer_done
        )
    solve_s = time.perf_counter() - began
    if out is not None:
        _write(out, exact)
    points = [_point(exact, fast, buffer) for buffer in buffers_percent]
    result = {**_summary(exact), "max_buffer_percent": max_buffer_percent, "solve_s": solve_s, "points": points}
    if as_json:
        print(json.dumps(result))
        return
    _print(fast.section, result)
    if out is not None:
        tell(f"written: {out}")


def _summary(exact: ExactFront) -> dict[str, Any]:
    worst = int(np.argmax(exact.gap_ratio))
    above_bound = (exact.energy_j - exact.bound_j) / np.maximum(np.abs(exact.energy_j), 1.0)
    return {
        "step_m": exact.grid.step_m,
        "speed_kmh": exact.grid.speed_kmh,
        "coast_kmh": exact.grid.coast_kmh,
        "min_time_s": exact.least_time_s,
        "front_points": len(exact.time_s),
        "labels": exact.labels,
        "bucket_ms": exact.bucket_ms,
        "worst_above_bound_ratio": float(above_bound.max()),
        "mean_above_bound_ratio": float(above_bound.mean()),
        "peak_memory_gb": _peak_memory_gb(),
        "worst_gap_ratio": float(exact.gap_ratio[worst]),
        "worst_gap_time_s": float(exact.time_s[worst]),
        "mean_gap_ratio": float(exact.gap_ratio.mean()),
        "swept_runs": len(exact.swept_time_s),
        "swept_least_gap_ratio": float(exact.swept_gap_ratio.min()),
        "swept_worst_gap_ratio": float(exact.swept_gap_ratio.max()),
        "swept_mean_gap_ratio": float(exact.swept_gap_ratio.mean()),
    }


def _point(exact: ExactFront, fast: Front, buffer_percent: float) -> dict[str, float]:
    index = exact.index_at(exact.least_time_s * (1 + buffer_percent / 100))
    time_s, energy_j = float(exact.time_s[index]), float(exact.energy_j[index])
    fast_j = fast.trajectory(time_s).balance.input
    return {
        "buffer_percent": buffer_percent,
        "time_s": time_s,
        "energy_kwh": kwh(energy_j),
        "supported_kwh": kwh(float(exact.supported_j[index])),
        "fast_energy_kwh": kwh(fast_j),
        "fast_difference_ratio": fast_j / energy_j - 1,
    }


def _peak_memory_gb() -> float | None:
    """The most memory that this process has had (GB); None if the system does not say."""
    try:
        import resource
    except ImportError:
        return None
    scale = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale / 1e9


def _write(path: Path, exact: ExactFront) -> None:
    rows = zip(exact.time_s, exact.energy_j, exact.supported_j, strict=True)
    lines = [",".join(COLUMNS), *(f"{t:.9f},{e:.3f},{s:.3f}" for t, e, s in rows)]
    write_whole(path, ("\n".join(lines) + "\n").encode())


def _print(section: Section, result: dict[str, Any]) -> None:
    figures = ("buffer\n%", "time\ns", "exact\nkWh", "supported\nkWh", "solver\nkWh", "solver −\nexact %")
    table = new_table(f"{section.name}, exact front", (), figures)
    for point in result["points"]:
        table.add_row(
            f"{point['buffer_percent']:g}",
            f"{point['time_s']:.2f}",
            f"{point['energy_kwh']:.3f}",
            f"{point['supported_kwh']:.3f}",
            f"{point['fast_energy_kwh']:.3f}",
            f"{100 * point['fast_difference_ratio']:+.3f}",
        )
    print_table(table, LEGEND)
    memory = f", {result['peak_memory_gb']:.2f} GB" if result["peak_memory_gb"] is not None else ""
    paragraph(
        f"{result['front_points']} undominated runs on a grid of {result['step_m']:g} m × {result['speed_kmh']:g} km/h "
        f"(coasting {result['coast_kmh']:g} km/h), {result['labels']} partial runs, "
        f"{result['solve_s']:.1f} s{memory}"
    )
    if result["bucket_ms"]:
        paragraph(
            f"not the whole front: one partial run was kept per state and {result['bucket_ms']:g} ms; what is printed "
            f"lies at most {100 * result['worst_above_bound_ratio']:.4f} % above a lower bound, "
            f"{100 * result['mean_above_bound_ratio']:.4f} % on average"
        )
    paragraph(
        f"the supported front lies at most {100 * result['worst_gap_ratio']:.3f} % below it "
        f"(at {result['worst_gap_time_s']:.3f} s), {100 * result['mean_gap_ratio']:.4f} % on average"
    )
    paragraph(
        f"the fast solver's method on the same grid: {result['swept_runs']} runs, "
        f"{100 * result['swept_least_gap_ratio']:.4f} to {100 * result['swept_worst_gap_ratio']:.4f} % above it, "
        f"{100 * result['swept_mean_gap_ratio']:.4f} % on average"
    )
