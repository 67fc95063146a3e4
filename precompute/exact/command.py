"""The command `das-precompute front --exact`: solve, compare with the fast solver, print."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from das.command_line.printing import new_table, paragraph, print_table, steps_bar, tell
from das.domain.files.writing import write_whole
from das.domain.units import in_kwh, kwh
from das.solver.front import Front
from das.solver.section import Section
from precompute.exact.front import STATES, ExactFront, solve_exact

LEGEND = {
    "buffer": "time above the least possible on the grid",
    "exact": "least energy on the grid for that time",
    "supported": "least energy on the front's lower convex hull, whose runs a price of time can find",
    "solver": "least energy that the fast solver finds for that time; its speeds are not bound to the grid",
}
COLUMNS = ("time_s", "energy_input_j", "supported_j")


def exact_front(fast: Front, buffers_percent: list[float], out: Path | None, *, as_json: bool) -> None:
    """Print the exact front of a section at some buffers (%) with the fast solver's energy for the same times.

    `fast` is the solver's front of the section. `out` is the CSV file for every point of the exact front, or None.
    """
    most_percent, began = max(buffers_percent), time.perf_counter()
    with steps_bar(STATES) as show:
        exact = solve_exact(fast.section, most_percent / 100, progress=show)
    solve_s = time.perf_counter() - began
    if out is not None:
        _write(out, exact)
    points = [_point(exact, fast, buffer) for buffer in buffers_percent]
    result = {**_summary(exact), "max_buffer_percent": most_percent, "solve_s": solve_s, "points": points}
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
    """The peak memory of this process (GB); None if the system does not report it."""
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
            *(in_kwh(point[name], finer=2) for name in ("energy_kwh", "supported_kwh", "fast_energy_kwh")),
            f"{100 * point['fast_difference_ratio']:+.3f}",
        )
    print_table(table, LEGEND)
    memory = f", {result['peak_memory_gb']:.2f} GB" if result["peak_memory_gb"] is not None else ""
    paragraph(
        f"{result['front_points']} non-dominated runs on a grid of {result['step_m']:g} m × {result['speed_kmh']:g} "
        f"km/h (coasting {result['coast_kmh']:g} km/h), {result['labels']} partial runs, "
        f"{result['solve_s']:.1f} s{memory}"
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
