"""Pictures of loss maps: efficiency and loss over speed and force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.command_line.outputs import offscreen_pyplot, save_figure
from das.domain.errors import DasError
from das.domain.losses import Level, LossMap
from das.domain.units import KMH, KN, KW
from das.domain.vehicle import Vehicle
from precompute.loss_maps.figures import best_point

Floats = NDArray[np.float64]

_LOWEST_SHOWN_EFFICIENCY = 0.70
_LEVELS = 17
_BAND_KW = 50.0
_MOST_BANDS = 60
"""A picture of losses has bands of 50 kW; where these were more than 60, as many as one of efficiency."""


def draw_efficiency_map(axes: Any, loss_map: LossMap, vehicle: Vehicle, *, top_speed_mps: float | None = None) -> Any:
    """Efficiency over speed (km/h) and wheel force (kN), both quadrants, bright = efficient; returns the mappable.

    Driving: power at the wheel over power at the collector; braking: power recovered over power taken at the wheel.
    Outside the vehicle's force envelope nothing is drawn. `axes` are matplotlib's; trajectories can be drawn on top.
    """
    speed, force, inside = _grid(loss_map, vehicle, top_speed_mps)
    power = np.abs(force * speed)
    loss = loss_map.loss_w(np.where(inside, force, 0.0), speed)
    into = np.where(force < 0, power, power + loss)
    efficiency = np.maximum(into - loss, 0.0) / np.maximum(into, 1.0)
    highest = max(float(efficiency[inside].max()), _LOWEST_SHOWN_EFFICIENCY + 0.01)
    # Ever finer towards the best: that is where the runs differ.
    levels = highest - (highest - _LOWEST_SHOWN_EFFICIENCY) * np.linspace(1.0, 0.0, _LEVELS) ** 2
    shown = np.ma.masked_array(efficiency, ~inside)
    colours = {"cmap": "viridis", "norm": _norm(levels), "extend": "min"}
    return _filled(axes, (speed, force, shown), vehicle, levels=levels, **colours)


def _norm(levels: Floats) -> Any:
    """The same difference of colour from each level to the next."""
    from matplotlib.colors import BoundaryNorm

    return BoundaryNorm(levels, 256, extend="min")


def draw_loss_map(axes: Any, loss_map: LossMap, vehicle: Vehicle, *, top_speed_mps: float | None = None) -> Any:
    """Loss in kW over speed (km/h) and wheel force (kN), both quadrants; returns the mappable (see efficiency)."""
    speed, force, inside = _grid(loss_map, vehicle, top_speed_mps)
    loss = loss_map.loss_w(np.where(inside, force, 0.0), speed) / KW
    highest = max(float(loss[inside].max()), 1.0)
    round_steps = 4 * _BAND_KW < highest < _MOST_BANDS * _BAND_KW
    levels = np.arange(0.0, highest + _BAND_KW, _BAND_KW) if round_steps else np.linspace(0.0, highest, _LEVELS)
    return _filled(axes, (speed, force, np.ma.masked_array(loss, ~inside)), vehicle, levels=levels, cmap="inferno_r")


def _filled(axes: Any, field: tuple[Floats, Floats, Any], vehicle: Vehicle, **style: Any) -> Any:
    speed, force, value = field
    filled = axes.contourf(speed / KMH, force / KN, value, **style)
    filled.set_edgecolor("face")  # no hairlines between the bands
    top = speed.max()
    v = np.linspace(0.0, top, 400)
    for envelope, sign in ((vehicle.traction, 1.0), (vehicle.electric_brake, -1.0)):
        # Covers the steps that the grid leaves along the hyperbola.
        axes.plot(v / KMH, sign * envelope.force_n(v) / KN, color="0.15", linewidth=1.2)
    axes.axhline(0, color="0.15", linewidth=0.6)
    axes.set_xlim(0, top / KMH)
    axes.set_xlabel("speed, km/h")
    axes.set_ylabel("wheel force, kN")
    return filled


def _grid(loss_map: LossMap, vehicle: Vehicle, top_speed_mps: float | None) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Speeds and forces of the map's grid, and which of them the train can use."""
    top = min(vehicle.max_speed_mps if top_speed_mps is None else top_speed_mps, float(loss_map.speed_mps[-1]))
    speeds = loss_map.speed_mps[(loss_map.speed_mps > 0) & (loss_map.speed_mps <= top * (1 + 1e-9))]
    speed, force = np.meshgrid(speeds, loss_map.force_n, indexing="ij")
    inside = (force <= vehicle.traction.force_n(speed)) & (force >= -vehicle.electric_brake.force_n(speed))
    inside &= loss_map.covers(force, speed)
    if not inside.any():
        raise DasError(f"{loss_map.name}: no point of the map is within the forces of {vehicle.id}")
    return speed, force, inside


def draw_maps(path: Path, loss_map: LossMap, vehicle: Vehicle) -> None:
    """Draw efficiency and loss side by side."""
    pyplot = offscreen_pyplot()
    from matplotlib.ticker import PercentFormatter

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(13, 6), sharey=True, layout="constrained")
    efficiency = draw_efficiency_map(left, loss_map, vehicle)
    left.set_title("efficiency of the traction chain")
    figure.colorbar(efficiency, ax=left, format=PercentFormatter(1.0, decimals=1))
    for sign in (1, -1):
        best = best_point(loss_map, vehicle, sign)
        if best is not None:
            left.plot(best["speed_kmh"], best["force_kn"], "x", color="black", markersize=8)
            left.annotate(
                f"{best['efficiency_ratio']:.1%}",
                (best["speed_kmh"], best["force_kn"]),
                xytext=(6, 6),
                textcoords="offset points",
            )
    loss = draw_loss_map(right, loss_map, vehicle)
    right.set_title("loss, kW")
    right.set_ylabel("")
    figure.colorbar(loss, ax=right)
    figure.suptitle(vehicle.name if loss_map is vehicle.losses.get(Level.L3) else Path(loss_map.name).name)
    save_figure(path, figure, dpi=110)
    pyplot.close(figure)
