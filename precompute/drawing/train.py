"""Draws a train: its forces against its resistance, its losses, and the energy that cruising needs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import shortened
from das.domain.units import KM, KN, KW, STANDARD_GRAVITY_MPS2, kmh, kwh
from das.domain.vehicle import Vehicle
from das.drawing.colors import GRID, INK, SEVERAL
from das.drawing.picture import Picture
from precompute.performance import Performance, performance_of

Floats = NDArray[np.float64]

SIZE_IN = (10.0, 9.0)
SPEEDS = 400
"""Number of speeds at which the curves are drawn."""
GRADIENTS = (0.01, 0.02)
"""Gradients on which the resistance is also drawn."""
MOST_MODES = 6
"""Most other modes that are drawn with the one of the train."""
MOST_LETTERS = 24
"""Longest name of a mode in the key of the picture."""
TRACTION, BRAKE, RESISTANCE = SEVERAL[0], SEVERAL[1], INK


def draw_train(train: Vehicle) -> Picture:
    """The picture of a train: forces and resistance, losses, energy of cruising, each over speed."""
    figure = Picture(figsize=SIZE_IN)
    forces, losses, cruising = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.0, 1.0))
    speed = np.linspace(1e-3, train.max_speed_mps, SPEEDS)
    found = performance_of(train, speed)
    _draw_forces(forces, train, speed, found)
    _draw_losses(losses, speed, found)
    _draw_cruising(cruising, train, speed, found)
    for axes in (forces, losses, cruising):
        axes.grid(color=GRID, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
    cruising.set_xlim(0.0, kmh(train.max_speed_mps))
    cruising.set_xlabel("speed, km/h")
    mode = f", mode {train.mode}" if train.mode else ""
    figure.suptitle(f"{train.name}{mode}", x=0.08, ha="left", fontsize=12, fontweight="bold", color=INK)
    figure.subplots_adjust(left=0.08, right=0.78, top=0.94, bottom=0.06, hspace=0.1)
    return figure


def _draw_forces(axes: Any, train: Vehicle, speed: Floats, found: Performance) -> None:
    """Largest traction and electric brake, with the points of their curves, and the resistance on some gradients."""
    for name in [name for name in train.modes if name != train.mode][:MOST_MODES]:
        effort = train.in_mode(name).traction_effort_n(speed) / KN
        axes.plot(kmh(speed), effort, color="#888888", linewidth=0.8, label=f"in {shortened(name, MOST_LETTERS)}")
    axes.plot(kmh(speed), found.traction_n / KN, color=TRACTION, linewidth=2.0, label="traction")
    brake = found.electric_brake_n / KN
    if brake.any():
        axes.plot(kmh(speed), -brake, color=BRAKE, linewidth=2.0, label="electric brake")
        axes.axhline(0.0, color=INK, linewidth=0.8)
    for curve, sign, color in ((train.traction.curve, 1, TRACTION), (train.electric_brake.curve, -1, BRAKE)):
        if curve is not None:
            inside = np.array(curve.speed_mps) <= train.max_speed_mps * (1 + 1e-9)
            points = np.array(curve.speed_mps)[inside], sign * np.array(curve.force_n)[inside] / KN
            axes.plot(kmh(points[0]), points[1], ".", color=color, markersize=4)
    resistance, weight = found.resistance_n / KN, train.mass_kg * STANDARD_GRAVITY_MPS2 / KN
    axes.plot(kmh(speed), resistance, color=RESISTANCE, linewidth=1.4, label="resistance, level")
    top = float((found.traction_n / KN).max())
    for gradient, style in zip(GRADIENTS, ("--", ":"), strict=True):
        steep = resistance + gradient * weight
        if steep.min() < top:
            axes.plot(kmh(speed), steep, style, color=RESISTANCE, linewidth=1.2, label=f"on {1000 * gradient:.0f} ‰")
    axes.set_ylim(-1.06 * float(brake.max()) if brake.any() else 0.0, 1.06 * max(top, float(resistance.max())))
    axes.set_ylabel("force, kN")


def _draw_losses(axes: Any, speed: Floats, found: Performance) -> None:
    """Losses of the traction chain at full traction, when cruising, and without effort."""
    for loss_w, name, color in (
        (found.full_traction_loss_w, "full traction", TRACTION),
        (found.cruising_loss_w, "cruising", RESISTANCE),
        (found.idle_loss_w, "no effort", "#888888"),
    ):
        axes.plot(kmh(speed), loss_w / KW, color=color, linewidth=1.4, label=f"loss, {name}")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("loss, kW")


def _draw_cruising(axes: Any, train: Vehicle, speed: Floats, found: Performance) -> None:
    """Energy per kilometre of cruising on the level: at the wheel, and at the current collector."""
    collector = kwh(found.cruising_j_per_m * KM)
    wheel = np.where(np.isfinite(collector), kwh(found.resistance_n * KM), np.nan)
    axes.plot(kmh(speed), collector, color=TRACTION, linewidth=2.0, label="at the collector")
    axes.plot(kmh(speed), wheel, color=RESISTANCE, linewidth=1.4, label="at the wheel")
    usual = collector[speed > 0.1 * train.max_speed_mps]
    most = np.nanmax(usual) if np.isfinite(usual).any() else 1.0
    axes.set_ylim(0.0, 1.1 * float(most))
    axes.set_ylabel("cruising, kWh/km")
