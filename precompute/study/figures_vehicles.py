"""Fig. 10: the same trip with the old (GTO) and the new (IGBT) inverter (section 4.6)."""

from __future__ import annotations

from typing import Any

import numpy as np

from das.domain.trajectory import Trajectory
from das.domain.units import KM, KN, KW
from precompute.study.cases import COMPLETE, L0_NOREG, L3, L3_IGBT, Variant
from precompute.study.drawing import LEVEL_COLOURS, draw_force, draw_map, draw_speed, efficiency_bar, new_figure
from precompute.study.effort import effort
from precompute.study.figures_levels import HIGHEST_DRAWN_MPS, effort_json, write_runs
from precompute.study.output import Output
from precompute.study.printed import TABLE2_BUFFER_PERCENT
from precompute.study.runs import Workbench

ON_N = 9e3
"""From this force on (3 % of the starting effort, as `effort.COAST_RATIO`) a train drives or brakes, else it coasts."""
LABELS = {"fastest": "fastest", "l0-noreg": "L0", "l3-gto": "L3 GTO", "l3-igbt": "L3 IGBT"}


def fig10(bench: Workbench, output: Output) -> dict[str, Any]:
    """Draw fig. 10 and compare how gently both accelerate and brake."""
    runs = {"fastest": bench.fastest(COMPLETE)}
    for variant in (L0_NOREG, L3, L3_IGBT):
        solution = bench.front(COMPLETE, variant).trajectory(bench.time_s(COMPLETE, TABLE2_BUFFER_PERCENT))
        runs[variant.name] = solution.trajectory
    buffer = f"{TABLE2_BUFFER_PERCENT:g}"
    named: dict[str, dict[str, Trajectory | None]] = {
        name: {"0" if name == "fastest" else buffer: run} for name, run in runs.items()
    }
    write_runs(output, "fig10-runs.csv", named)
    output.picture("fig10", _draw(bench, runs))
    found = {name: effort(run, bench.vehicle(L3_IGBT if name == "l3-igbt" else L3)) for name, run in runs.items()}
    use = {name: {"driving": _use(run, 1), "braking": _use(run, -1)} for name, run in runs.items()}
    gto, igbt = use["l3-gto"], use["l3-igbt"]
    return {
        "use": use,
        "igbt_more_gently": {way: igbt[way]["mean_power_kw"] < gto[way]["mean_power_kw"] for way in gto},
        "igbt_longer": {way: igbt[way]["duration_s"] > gto[way]["duration_s"] for way in gto},
        "reduced_effort": {name: effort_json(item) for name, item in found.items()},
    }


def _use(run: Trajectory, sign: int) -> dict[str, float]:
    """How long the train drives (sign 1) or brakes (−1), with which mean force and wheel power over that time."""
    force = sign * (run.force_el_n + run.force_friction_n)
    on = force > ON_N
    duration_s = run.interval_s()[on]
    work = force[on] * np.diff(run.s_m)[on]
    return {
        "duration_s": float(duration_s.sum()),
        "mean_force_kn": float(force[on] @ duration_s / duration_s.sum() / KN),
        "mean_power_kw": float(work.sum() / duration_s.sum() / KW),
    }


def _draw(bench: Workbench, runs: dict[str, Trajectory]) -> Any:
    figure = new_figure(14, 9)
    grid = figure.subplot_mosaic([["speed", "speed"], ["gto", "igbt"]], height_ratios=(1, 1.25))
    speed = grid["speed"]
    for name, run in runs.items():
        draw_speed(speed, run, LEVEL_COLOURS[name])
    speed.set(xlim=(0, COMPLETE.length_m / KM), ylim=(0, 170), xlabel="distance, km", ylabel="speed, km/h")
    speed.set_title(f"{COMPLETE.title}, $t_+$ = {TABLE2_BUFFER_PERCENT:g} % (fastest: 0); crosses every 200 m")
    speed.legend(handles=_handles(), loc="lower center", ncols=len(LABELS))
    drawn_maps = []
    maps = {
        "gto": ("L3 GTO map", L3, ("fastest", "l0-noreg", "l3-gto")),
        "igbt": ("L3 IGBT map", L3_IGBT, ("fastest", "l0-noreg", "l3-igbt")),
    }
    for key, (title, variant, drawn) in maps.items():
        drawn_maps.append(_draw_map(grid[key], bench, variant, [(name, runs[name]) for name in drawn]))
        grid[key].set_title(title)
    efficiency_bar(figure, drawn_maps, [grid["gto"], grid["igbt"]])
    return figure


def _draw_map(axes: Any, bench: Workbench, variant: Variant, runs: list[tuple[str, Trajectory]]) -> Any:
    vehicle = bench.vehicle(variant)
    drawn = draw_map(axes, bench.loss_map(variant), vehicle, HIGHEST_DRAWN_MPS)
    for name, run in runs:
        draw_force(axes, run, LEVEL_COLOURS[name])
    axes.set_ylim(-1.05 * vehicle.electric_brake.max_force_n / KN, 1.05 * vehicle.traction.max_force_n / KN)
    return drawn


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=LEVEL_COLOURS[name], linewidth=2, marker="x", markersize=5, label=label)
        for name, label in LABELS.items()
    ]
