"""Figs. 5, 7, 9 and 10: optimal runs, their path through the efficiency map, and their energy.

Figs. 5, 7 and 9 have a column for each level; fig. 10 shows the old (GTO) and the new (IGBT) inverter on one trip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from das.domain.trajectory import Trajectory
from das.domain.units import KM, KMH, KN, PERCENT
from docs.studies.cases import (
    ACCELERATION,
    BUFFERS_PERCENT,
    COMPLETE,
    DECELERATION,
    L0_NOREG,
    L3,
    L3_IGBT,
    LEVELS,
    TABLE2_BUFFER_PERCENT,
    Floats,
    StudyCase,
    Variant,
    Workbench,
)
from docs.studies.drawing import (
    BUFFER_COLOURS,
    LEVEL_COLOURS,
    crossed_handles,
    draw_force,
    draw_map,
    draw_speed,
    efficiency_bar,
    new_figure,
)
from docs.studies.output import Output

LARGEST_DRAWN_PERCENT = 40.0
CURVE_POINTS = 81
"""Number of points of an energy curve: every 0.5 % if it extends to 40 %."""
HIGHEST_ENERGY_PERCENT = 125.0
"""End of the energy axis (%); a note gives values above it (L0 NOREG counts the kinetic energy)."""
HIGHEST_DRAWN_MPS = 165 * KMH
"""Speed (m/s) up to which force over speed is drawn."""
OTHER_SIDE_RATIO = 0.1
"""Share by which the force axis extends beyond zero when only driving (or braking): cruising needs some traction."""
MAX = "max"


@dataclass(frozen=True, kw_only=True, eq=False)
class EnergyCurve:
    """Energy of a level's optimal runs over the buffer, in % of the fastest run's at L3 (paper: panels c).

    `own_percent` at the level itself, the others at L3: `l3_percent` = `resistance_percent` + `loss_percent`.
    """

    buffer_percent: Floats
    own_percent: Floats
    l3_percent: Floats
    resistance_percent: Floats
    loss_percent: Floats


def energy_curve(bench: Workbench, case: StudyCase, variant: Variant) -> EnergyCurve:
    """The curve up to 40 %, or to the level's largest useful buffer if that is smaller."""
    slowest = bench.slowest(case, variant)
    largest = min(LARGEST_DRAWN_PERCENT, slowest.buffer_percent)
    runs = [(float(b), bench.run(case, variant, float(b))) for b in np.linspace(0, largest, CURVE_POINTS)]
    points = [(b, run) for b, run in runs if run is not None]
    energy_balances = [bench.balance(run, L3) for _, run in points]
    scale = PERCENT * bench.reference_j(case)
    return EnergyCurve(
        buffer_percent=np.array([b for b, _ in points]),
        own_percent=np.array([bench.percent(case, run, variant) for _, run in points]),
        l3_percent=np.array([balance.irreversible for balance in energy_balances]) / scale,
        resistance_percent=np.array([balance.resistance for balance in energy_balances]) / scale,
        loss_percent=np.array([balance.component_loss for balance in energy_balances]) / scale,
    )


def level_runs(bench: Workbench, case: StudyCase, variant: Variant) -> dict[str, Trajectory | None]:
    """A level's runs by buffer ("0" … "25", "max"); None if the buffer exceeds the level's largest useful one."""
    runs: dict[str, Trajectory | None] = {f"{b:g}": bench.run(case, variant, b) for b in BUFFERS_PERCENT}
    return {**runs, MAX: bench.slowest(case, variant).trajectory}


def runs_figure(name: str, case: StudyCase, bench: Workbench, output: Output) -> None:
    """Draw a case's runs at every level with their energies."""
    runs = {variant: level_runs(bench, case, variant) for variant in LEVELS}
    curves = {variant: energy_curve(bench, case, variant) for variant in LEVELS}
    output.picture(name, _draw(bench, case, runs, curves))


def _draw(
    bench: Workbench,
    case: StudyCase,
    runs: dict[Variant, dict[str, Trajectory | None]],
    curves: dict[Variant, EnergyCurve],
) -> Any:
    figure = new_figure(16, 10.2)
    axes = figure.subplots(3, len(LEVELS), sharey="row", height_ratios=(1.0, 1.15, 1.0))
    maps = []
    for column, variant in enumerate(LEVELS):
        speed, force, energy = axes[:, column]
        speed.set_title(variant.label, color=LEVEL_COLOURS[variant.name], fontweight="bold", fontsize=13, pad=19)
        _draw_speeds(speed, case, runs[variant])
        maps.append(_draw_forces(force, bench, case, runs[variant]))
        _draw_energy(energy, variant, curves[variant])
        slowest = bench.slowest(case, variant)
        speed.set_xlabel("distance, km")
        note = f"largest $t_+$ = {slowest.buffer_percent:.3g} % ({slowest.bound})"
        speed.text(0.5, 1.03, note, transform=speed.transAxes, ha="center", va="bottom", fontsize=9)
        for panel in (force, energy) if column else ():
            panel.set_ylabel("")
    axes[0, 0].set_ylabel("a   speed, km/h")
    axes[1, 0].set_ylabel("b   wheel force, kN")
    axes[2, 0].set_ylabel("c   energy, % of fastest at L3")
    efficiency_bar(figure, maps, axes[1, :])
    labels = [f"$t_+$ = {b:g} %" for b in BUFFERS_PERCENT] + ["largest useful $t_+$"]
    figure.legend(
        handles=crossed_handles(dict(zip(BUFFER_COLOURS, labels, strict=True))),
        loc="outside upper center",
        ncols=len(labels),
        title=f"{case.title}; runs change from bright to greyish towards the end, crosses every 200 m",
    )
    lines = [Line2D([], [], **how) for how in _ENERGY_LINES.values()]
    figure.legend(handles=lines, loc="outside lower center", ncols=4)
    return figure


def _draw_speeds(axes: Any, case: StudyCase, runs: dict[str, Trajectory | None]) -> None:
    for colour, run in zip(BUFFER_COLOURS, runs.values(), strict=True):
        if run is not None:
            draw_speed(axes, run, colour)
    axes.set_xlim(0, case.length_m / KM)
    axes.set_ylim(0, 170)


def _draw_forces(axes: Any, bench: Workbench, case: StudyCase, runs: dict[str, Trajectory | None]) -> Any:
    mappable = draw_map(axes, bench.loss_map(L3), bench.vehicle(L3), HIGHEST_DRAWN_MPS)
    for colour, run in zip(BUFFER_COLOURS, runs.values(), strict=True):
        if run is not None:
            draw_force(axes, run, colour)
    top_kn = bench.vehicle(L3).traction.max_force_n / KN
    low_kn = bench.vehicle(L3).electric_brake.max_force_n / KN
    low = 0.0 if case is ACCELERATION else -1.05 * low_kn
    high = 0.0 if case is DECELERATION else 1.05 * top_kn
    margin = OTHER_SIDE_RATIO * (high - low)
    axes.set_ylim(low - (margin if low == 0 else 0), high + (margin if high == 0 else 0))
    note_forces_off_scale(axes, [run for run in runs.values() if run is not None])
    return mappable


def note_forces_off_scale(axes: Any, runs: list[Trajectory]) -> None:
    """Add a note with the largest force if it is beyond the axis (L0 REG's runs alternate between extremes)."""
    low_kn, high_kn = axes.get_ylim()
    forces_kn = np.concatenate([run.force_el_n + run.force_friction_n for run in runs]) / KN
    if forces_kn.min() < low_kn:
        how, y, va = f"braking up to\n{-forces_kn.min():.0f} kN", 0.97, "top"
    elif forces_kn.max() > high_kn:
        how, y, va = f"driving up to\n{forces_kn.max():.0f} kN", 0.03, "bottom"
    else:
        return
    axes.text(0.97, y, f"{how}\n(off the scale)", transform=axes.transAxes, ha="right", va=va, fontsize=9)


def _draw_energy(axes: Any, variant: Variant, curve: EnergyCurve) -> None:
    x = curve.buffer_percent
    for key, how in _ENERGY_LINES.items():
        axes.plot(x, getattr(curve, key), **how)
    axes.set(xlim=(0, LARGEST_DRAWN_PERCENT), ylim=(0, HIGHEST_ENERGY_PERCENT), xlabel="buffer $t_+$, %")
    axes.grid(axis="y", color="0.9")
    if curve.own_percent.min() > HIGHEST_ENERGY_PERCENT:
        own = f"optimised for: {curve.own_percent.max():.0f} … {curve.own_percent.min():.0f} %"
        axes.text(0.97, 0.97, f"{own}\n(off the scale)", transform=axes.transAxes, ha="right", va="top", fontsize=9)
    elif variant is L0_NOREG and curve.own_percent.max() > HIGHEST_ENERGY_PERCENT:
        axes.text(
            0.97, 0.97, f"optimised for: from {curve.own_percent.max():.0f} %", transform=axes.transAxes, ha="right",
            va="top", fontsize=9,
        )  # fmt: skip


_ENERGY_LINES: dict[str, dict[str, Any]] = {
    "l3_percent": {"color": "#009e73", "linewidth": 2.0, "label": "evaluated at L3"},
    "own_percent": {"color": "black", "linestyle": ":", "linewidth": 1.6, "label": "what the level optimises"},
    "loss_percent": {"color": "#e02424", "linewidth": 1.5, "label": "component losses (L3)"},
    "resistance_percent": {"color": "#56b4e9", "linewidth": 1.5, "label": "running resistance"},
}


LABELS = {"fastest": "fastest", "l0-noreg": "L0", "l3-gto": "L3 GTO", "l3-igbt": "L3 IGBT"}


def fig10(bench: Workbench, output: Output) -> None:
    """Draw fig. 10."""
    runs = {"fastest": bench.fastest(COMPLETE)}
    for variant in (L0_NOREG, L3, L3_IGBT):
        solution = bench.front(COMPLETE, variant).trajectory(bench.time_s(COMPLETE, TABLE2_BUFFER_PERCENT))
        runs[variant.name] = solution.trajectory
    output.picture("fig10", _draw_inverters(bench, runs))


def _draw_inverters(bench: Workbench, runs: dict[str, Trajectory]) -> Any:
    figure = new_figure(14, 9)
    grid = figure.subplot_mosaic([["speed", "speed"], ["gto", "igbt"]], height_ratios=(1, 1.25))
    speed = grid["speed"]
    for name, run in runs.items():
        draw_speed(speed, run, LEVEL_COLOURS[name])
    speed.set(xlim=(0, COMPLETE.length_m / KM), ylim=(0, 170), xlabel="distance, km", ylabel="speed, km/h")
    speed.set_title(f"{COMPLETE.title}, $t_+$ = {TABLE2_BUFFER_PERCENT:g} % (fastest: 0); crosses every 200 m")
    handles = crossed_handles({LEVEL_COLOURS[name]: text for name, text in LABELS.items()})
    speed.legend(handles=handles, loc="lower center", ncols=len(LABELS))
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
