"""The description of a loss map: coverage, fits of levels L1 and L2, best points, and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from das.command_line.files import load_vehicle
from das.command_line.printing import new_table
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError
from das.domain.files.vehicles import read_loss_map
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap, fit_mean_efficiency, operating_points
from das.domain.route import Floats
from das.domain.units import KMH, KN, KW
from das.domain.vehicle import Vehicle

if TYPE_CHECKING:
    from rich.table import Table

    from das.drawing.picture import Picture

CRUISING_MPS = np.arange(40.0, 160.5) * KMH
"""Speeds of cruising on level track at which the deviation of a fit is computed."""
LEGEND = {
    "fit": "level whose constant efficiency is fitted to the map",
    "idle": "constant loss of the fit",
    "mean/in": "mean deviation of the fit, relative to the mean input power",
    "mean/max, rms/max": "mean and root mean square deviation, relative to the largest loss",
    "cruising": "mean of (map − fit)/fit at 40 to 160 km/h on the level, |cruising| of its magnitude",
}
CSV_VEHICLE = "re460-ic"
"""The train whose forces bound a CSV map, unless another is named."""


def map_of(name: str, vehicle: str | None) -> tuple[LossMap, Vehicle]:
    """A vehicle's L3 map, or a map from a CSV file with the forces of `vehicle`; DasError if there is none."""
    if Path(name).suffix.lower() == ".csv":
        return read_loss_map(Path(name)), load_vehicle(CSV_VEHICLE if vehicle is None else vehicle)
    if vehicle is not None:
        raise DasError(f"--vehicle {vehicle}: applies to a CSV map only, and {name} is a vehicle")
    train = load_vehicle(name)
    model = train.loss_model(Level.L3)
    if not isinstance(model, LossMap):
        raise DasError(f"{train.source}: its losses at level {Level.L3} are not a map")
    return model, train


def loss_map_summary(loss_map: LossMap, vehicle: Vehicle) -> dict[str, Any]:
    """The figures that describe a map: coverage, the fits of L1 and L2 with their errors, and the best points."""
    power_w, force_n = vehicle.traction.max_power_w, vehicle.traction.max_force_n
    points = operating_points(loss_map, power_w, force_n)
    full = points.power_w >= 0.99 * power_w
    signs = (("driving", 1), ("braking", -1))
    at_full = {name: points.loss_w[full & (np.sign(points.force_n) == sign)] for name, sign in signs}
    return {
        "coverage": {
            "speed_kmh": [float(loss_map.speed_mps[0] / KMH), float(loss_map.speed_mps[-1] / KMH)],
            "force_kn": [float(loss_map.force_low_n.min() / KN), float(loss_map.force_high_n.max() / KN)],
            "points": int(np.isfinite(loss_map.loss_w_table).sum()),
            "operating_points": len(points.loss_w),
        },
        "largest_loss_kw": float(points.loss_w.max() / KW),
        "full_power_loss_kw": {name: float(x.mean() / KW) if len(x) else None for name, x in at_full.items()},
        "fits": {str(level): _fit_json(loss_map, vehicle, level is Level.L2) for level in (Level.L1, Level.L2)},
        "best": {name: best_point(loss_map, vehicle, sign) for name, sign in signs},
    }


def _fit_json(loss_map: LossMap, vehicle: Vehicle, with_idle: bool) -> dict[str, float | None]:
    fit = fit_mean_efficiency(loss_map, vehicle.traction.max_power_w, with_idle=with_idle)
    return {
        "mean_efficiency_ratio": 1.0 / (1.0 + fit.traction_ratio),
        "idle_kw": fit.idle_w / KW,
        **fit_error(loss_map, fit, vehicle.traction.max_power_w),
        "cruising_deviation_ratio": cruising_deviation_ratio(loss_map, fit, vehicle),
        "cruising_absolute_deviation_ratio": cruising_deviation_ratio(loss_map, fit, vehicle, absolute=True),
    }


def fit_error(loss_map: LossMap, fit: EfficiencyLoss, max_power_w: float) -> dict[str, float]:
    """The deviation of a fit from a map over the operating points it was fitted to (see `fit_mean_efficiency`).

    It is relative to the chain's mean input power (as for energies), and to the largest loss of the map.
    """
    points = operating_points(loss_map, max_power_w)
    residual = np.abs(points.loss_w - fit.loss_w(points.force_n, points.speed_mps))
    largest = max(float(points.loss_w.max()), 1e-9)
    return {
        "error_mean_to_input_ratio": float(residual.mean() / points.input_w().mean()),
        "error_mean_to_largest_ratio": float(residual.mean() / largest),
        "error_rms_to_largest_ratio": float(np.sqrt((residual**2).mean()) / largest),
        "error_largest_kw": float(residual.max()) / KW,
    }


def cruising_deviation_ratio(
    loss_map: LossMap, fit: EfficiencyLoss, vehicle: Vehicle, *, absolute: bool = False
) -> float | None:
    """Mean of (map − fit)/fit, or of its magnitude, when cruising on level track at 40 to 160 km/h.

    None if the map does not cover this.
    """
    speed = CRUISING_MPS[vehicle.max_speed_mps >= CRUISING_MPS]
    force = vehicle.resistance.force_n(speed)
    if not len(speed) or not loss_map.covers(force, speed).all():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        deviation = loss_map.loss_w(force, speed) / fit.loss_w(force, speed) - 1.0
    return float((np.abs(deviation) if absolute else deviation).mean())


def best_point(loss_map: LossMap, vehicle: Vehicle, sign: int) -> dict[str, float] | None:
    """The most efficient operating point of one quadrant, within the vehicle's forces."""
    envelope: EffortEnvelope = vehicle.traction if sign > 0 else vehicle.electric_brake
    points = operating_points(loss_map, envelope.max_power_w, envelope.max_force_n)
    quadrant = np.flatnonzero((np.sign(points.force_n) == sign) & (points.speed_mps <= vehicle.max_speed_mps))
    if not len(quadrant):
        return None
    best = quadrant[points.efficiency_ratio()[quadrant].argmax()]
    return {
        "efficiency_ratio": float(points.efficiency_ratio()[best]),
        "speed_kmh": float(points.speed_mps[best] / KMH),
        "force_kn": float(points.force_n[best] / KN),
        "power_share_ratio": float(points.power_w[best] / envelope.max_power_w),
    }


def facts(loss_map: LossMap, vehicle: Vehicle, summary: dict[str, Any]) -> Iterator[str]:
    """The coverage of a map, its largest losses and its best points, a line each."""
    cover = summary["coverage"]
    (slow, fast), (least, most) = cover["speed_kmh"], cover["force_kn"]
    yield loss_map.name
    yield f"covers {slow:g} … {fast:g} km/h, {least:g} … {most:g} kN"
    most_kw = vehicle.traction.max_power_w / KW
    yield f"{cover['operating_points']} operating points within {most_kw:g} kW of {vehicle.id}"
    full = [f"{name} {loss:.0f} kW" for name, loss in summary["full_power_loss_kw"].items() if loss is not None]
    yield f"largest loss {summary['largest_loss_kw']:.0f} kW; mean at full power: {', '.join(full) or 'none'}"
    for name, best in summary["best"].items():
        if best is not None:
            yield (
                f"best efficiency {name}: {best['efficiency_ratio']:.1%} at {best['speed_kmh']:.0f} km/h, "
                f"{best['force_kn']:.0f} kN ({best['power_share_ratio']:.0%} of the power)"
            )


def table(summary: dict[str, Any]) -> Table:
    """The fits of L1 and L2 with their errors."""
    errors = ("mean/in\n%", "mean/max\n%", "rms/max\n%", "cruising\n%", "|cruising|\n%")
    found = new_table("", (), ("fit", "mean\nefficiency", "idle\nkW", *errors))
    for level, fit in summary["fits"].items():
        cruising, absolute = fit["cruising_deviation_ratio"], fit["cruising_absolute_deviation_ratio"]
        found.add_row(
            level,
            f"{fit['mean_efficiency_ratio']:.4f}",
            f"{fit['idle_kw']:.1f}",
            *(f"{100 * fit[f'error_{x}_ratio']:.2f}" for x in ("mean_to_input", "mean_to_largest", "rms_to_largest")),
            f"{100 * cruising:+.2f}" if cruising is not None else "–",
            f"{100 * absolute:.2f}" if absolute is not None else "–",
        )
    return found


_LOWEST_SHOWN_EFFICIENCY = 0.70
_LEVELS = 17
_BAND_KW = 50.0
_MOST_BANDS = 60
"""Largest number of 50 kW bands in a picture of losses; instead of more, or of fewer than 4, it has `_LEVELS` bands."""


def draw_efficiency_map(axes: Any, loss_map: LossMap, vehicle: Vehicle) -> Any:
    """Efficiency over speed (km/h) and wheel force (kN), both quadrants, bright = efficient; returns the mappable.

    Driving: power at the wheel over power at the collector; braking: power recovered over power taken at the wheel.
    Outside the vehicle's force envelope nothing is drawn. `axes` are matplotlib's; trajectories can be drawn on top.
    """
    from matplotlib.colors import BoundaryNorm

    speed, force, inside = _grid(loss_map, vehicle)
    power = np.abs(force * speed)
    loss = loss_map.loss_w(np.where(inside, force, 0.0), speed)
    into = np.where(force < 0, power, power + loss)
    efficiency = np.maximum(into - loss, 0.0) / np.maximum(into, 1.0)
    highest = max(float(efficiency[inside].max()), _LOWEST_SHOWN_EFFICIENCY + 0.01)
    # The bands become finer towards the best efficiency, where runs differ.
    levels = highest - (highest - _LOWEST_SHOWN_EFFICIENCY) * np.linspace(1.0, 0.0, _LEVELS) ** 2
    shown = np.ma.masked_array(efficiency, ~inside)
    # The differences of colour between levels are equal.
    colours = {"cmap": "viridis", "norm": BoundaryNorm(levels, 256, extend="min"), "extend": "min"}
    return _filled(axes, (speed, force, shown), vehicle, levels=levels, **colours)


def draw_loss_map(axes: Any, loss_map: LossMap, vehicle: Vehicle) -> Any:
    """Loss in kW over speed (km/h) and wheel force (kN), both quadrants; returns the mappable.

    Nothing is drawn outside the vehicle's force envelope. `axes` are matplotlib's.
    """
    speed, force, inside = _grid(loss_map, vehicle)
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
        # This covers the steps that the grid leaves along the hyperbola.
        axes.plot(v / KMH, sign * envelope.force_n(v) / KN, color="0.15", linewidth=1.2)
    axes.axhline(0, color="0.15", linewidth=0.6)
    axes.set_xlim(0, top / KMH)
    axes.set_xlabel("speed, km/h")
    axes.set_ylabel("wheel force, kN")
    return filled


def _grid(loss_map: LossMap, vehicle: Vehicle) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Speeds and forces of the map's grid, and a mask of those that the train can use."""
    top = min(vehicle.max_speed_mps, float(loss_map.speed_mps[-1]))
    speeds = loss_map.speed_mps[(loss_map.speed_mps > 0) & (loss_map.speed_mps <= top * (1 + 1e-9))]
    speed, force = np.meshgrid(speeds, loss_map.force_n, indexing="ij")
    inside = (force <= vehicle.traction.force_n(speed)) & (force >= -vehicle.electric_brake.force_n(speed))
    inside &= loss_map.covers(force, speed)
    if not inside.any():
        raise DasError(f"{loss_map.name}: no point of the map is within the forces of {vehicle.id}")
    return speed, force, inside


def draw_maps(loss_map: LossMap, vehicle: Vehicle) -> Picture:
    """Efficiency and loss side by side."""
    from matplotlib.ticker import PercentFormatter

    from das.drawing.picture import Picture

    figure = Picture(figsize=(13, 6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    efficiency = draw_efficiency_map(left, loss_map, vehicle)
    left.set_title("efficiency of the traction chain")
    figure.colorbar(efficiency, ax=left, format=PercentFormatter(1.0, decimals=1))
    for sign in (1, -1):
        best = best_point(loss_map, vehicle, sign)
        if best is not None:
            left.plot(best["speed_kmh"], best["force_kn"], "x", color="black", markersize=8)
            at = best["speed_kmh"], best["force_kn"]
            left.annotate(f"{best['efficiency_ratio']:.1%}", at, xytext=(6, 6), textcoords="offset points")
    loss = draw_loss_map(right, loss_map, vehicle)
    right.set_title("loss, kW")
    right.set_ylabel("")
    figure.colorbar(loss, ax=right)
    figure.suptitle(vehicle.name if loss_map is vehicle.losses.get(Level.L3) else Path(loss_map.name).name)
    return figure
