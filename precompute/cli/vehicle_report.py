"""A train in words, in figures and as a picture, with warnings about unusual values."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from das.command_line.printing import new_table
from das.domain.errors import DasError, shortened
from das.domain.levels import Level
from das.domain.plausibility import warnings_of
from das.domain.route import Floats
from das.domain.units import KM, KMH, KN, KW, STANDARD_GRAVITY_MPS2, TONNE, kmh, kwh
from das.domain.vehicle import Vehicle
from das.drawing.colors import GRID, INK, QUIET, SEVERAL

if TYPE_CHECKING:
    from rich.table import Table

    from das.drawing.picture import Picture

STEPS = 10
"""Number of speeds above standstill in the table of a train."""
LEGEND = {
    "traction, brake": "largest forces of traction and of the electric brake",
    "resistance": "running resistance on the level",
    "spare": "acceleration at full traction on the level",
    "loss": "loss of the traction chain, auxiliaries included, when cruising and at full traction",
    "cruising": "energy at the current collector per kilometre at constant speed on the level",
}
RISES = 0.02
"""Largest rise of an effort curve with speed, as a share of its largest force, that causes no warning."""
COARSE_MPS = 30.0 * KMH
"""Largest distance (m/s) between points of an effort curve without a warning."""


class Performance(NamedTuple):
    """A train at n speeds on a dry level line (n,), at its default level of losses.

    Cruising needs `cruising_j_per_m` at the current collector; both it and the loss are NaN at speeds that the traction
    cannot hold. `idle_loss_w` is the loss without effort.
    """

    traction_n: Floats
    electric_brake_n: Floats
    resistance_n: Floats
    acceleration_mps2: Floats
    cruising_loss_w: Floats
    full_traction_loss_w: Floats
    idle_loss_w: Floats
    cruising_j_per_m: Floats


def performance_of(train: Vehicle, speed_mps: Floats) -> Performance:
    """The performance of a train at each speed > 0 (m/s)."""
    traction, resistance = train.traction_effort_n(speed_mps), train.resistance.force_n(speed_mps)
    loss, held = train.loss_model(train.default_level), resistance <= traction
    cruising_w = np.where(held, loss.loss_w(np.where(held, resistance, 0.0), speed_mps), np.nan)
    return Performance(
        traction_n=traction,
        electric_brake_n=train.electric_brake_effort_n(speed_mps),
        resistance_n=resistance,
        acceleration_mps2=np.minimum((traction - resistance) / train.inertial_mass_kg, train.max_acceleration_mps2),
        cruising_loss_w=cruising_w,
        full_traction_loss_w=loss.loss_w(traction, speed_mps),
        idle_loss_w=loss.loss_w(np.zeros_like(speed_mps), speed_mps),
        cruising_j_per_m=resistance + cruising_w / speed_mps,
    )


def facts(train: Vehicle) -> list[str]:
    """The kind of train and its main figures, in a few lines."""
    effort = train.traction
    shape = "force and power" if effort.curve is None else f"an effort curve of {len(effort.curve.speed_mps)} points"
    lines = [
        f"{train.name} ({train.id}): {train.mass_kg / TONNE:.4g} t, {train.train_length_m:.4g} m, "
        f"{kmh(train.max_speed_mps):.4g} km/h",
        f"traction: {shape}, at most {effort.max_force_n / KN:.4g} kN and {effort.max_power_w / KW:.5g} kW",
    ]
    lines += [f"mode: {train.mode or 'none'}; it has {', '.join(train.modes)}"] if train.modes else []
    lines += [f"loads: {', '.join(train.loads)}"] if train.loads else []
    return [*lines, f"losses: level {train.default_level}"]


def _speeds(train: Vehicle) -> Floats:
    """Standstill (as a crawl) and speeds up to the top speed (m/s)."""
    return np.maximum(np.linspace(0.0, train.max_speed_mps, STEPS + 1), 1e-3)


def as_dict(train: Vehicle) -> dict[str, Any]:
    """The train as JSON: its facts, and its figures at some speeds."""
    speeds = _speeds(train)
    return {
        "id": train.id,
        "name": train.name,
        "mass_kg": train.mass_kg,
        "length_m": train.train_length_m,
        "max_speed_mps": train.max_speed_mps,
        "max_force_n": train.traction.max_force_n,
        "max_power_w": train.traction.max_power_w,
        "mode": train.mode,
        "modes": list(train.modes),
        "loads": list(train.loads),
        "level": str(train.default_level),
        "levels": _levels(train),
        "speed_mps": speeds.round(6).tolist(),
        **{
            name: [None if np.isnan(x) else float(f"{x:.8g}") for x in values]
            for name, values in performance_of(train, speeds)._asdict().items()
        },
    }


def _levels(train: Vehicle) -> list[str]:
    found = []
    for level in sorted(Level, key=lambda one: one is not train.default_level):
        with contextlib.suppress(DasError):
            train.loss_model(level)
            found.append(str(level))
    return found


def table(train: Vehicle) -> Table:
    """Forces, acceleration, losses and the energy of cruising at some speeds."""
    speeds = _speeds(train)
    found = performance_of(train, speeds)
    heads = ("km/h", "traction\nkN", "brake\nkN", "resistance\nkN", "spare\nm/s²", "loss\ncruising kW", "loss\nfull kW")
    shown = new_table("", (), (*heads, "cruising\nkWh/km"))
    columns = [
        *(values / KN for values in (found.traction_n, found.electric_brake_n, found.resistance_n)),
        found.acceleration_mps2,
        *(values / KW for values in (found.cruising_loss_w, found.full_traction_loss_w)),
        np.where(speeds > 0.1, kwh(found.cruising_j_per_m * KM), np.nan),
    ]
    for speed, *values in zip(speeds, *columns, strict=True):
        cells = [f"{x:.3f}" if j in (3, 6) else f"{x:.1f}" for j, x in enumerate(values)]
        shown.add_row(f"{kmh(speed):.0f}", *("–" if cell == "nan" else cell for cell in cells))
    return shown


def warnings(train: Vehicle) -> list[str]:
    """A line for everything unusual in a train, in each of its modes."""
    found = [*warnings_of(train)]
    if not train.mode:
        found += [f"{train.source}: {text}" for text in _of_efforts(train)]
    for name in train.modes:
        one, place = train.in_mode(name), f"{train.source}: mode {name}: "
        found += [text.replace(": ", f": mode {name}: ", 1) for text in warnings_of(one) if text not in found]
        found += [place + text for text in _of_efforts(one)]
    return found


def _of_efforts(train: Vehicle) -> list[str]:
    """Warnings about unusual efforts of a train in one mode."""
    found = []
    for key, effort in (("traction", train.traction), ("electric_brake", train.electric_brake)):
        if effort.curve is None:
            continue
        speed, force = np.array(effort.curve.speed_mps), np.array(effort.curve.force_n)
        i = int(np.argmax(np.diff(force)))
        if key == "traction" and force[i + 1] - force[i] > RISES * force.max():
            forces = f"from {force[i] / KN:.4g} to {force[i + 1] / KN:.4g} kN"
            found.append(f"{key}.curve rises {forces} at {kmh(speed[i + 1]):.4g} km/h")
        moving = np.diff(speed) * (np.diff(force) != 0)
        i = int(np.argmax(moving))
        if moving[i] > COARSE_MPS:
            found.append(f"{key}.curve has no point between {kmh(speed[i]):.4g} and {kmh(speed[i + 1]):.4g} km/h")
    top_mps = train.max_speed_mps
    if float(train.traction_effort_n(top_mps)) < float(train.resistance.force_n(top_mps)):
        speeds = np.linspace(0.0, top_mps, 1000)
        reached = speeds[train.traction_effort_n(speeds) >= train.resistance.force_n(speeds)]
        found.append(f"on the level, its traction holds {kmh(reached.max(initial=0.0)):.0f} km/h, not max_speed")
    try:
        train.loss_model(train.default_level)
    except DasError as error:
        found.append(str(error))
    return found


SIZE_IN = (10.0, 9.0)
SPEEDS = 400
"""Number of speeds at which the curves are drawn."""
GRADIENTS = (0.01, 0.02)
"""Gradients on which the resistance is also drawn."""
MOST_MODES = 6
"""Largest number of modes that are drawn in addition to the train's own."""
MOST_LETTERS = 24
"""Longest name of a mode in the legend of the picture."""
TRACTION, BRAKE, RESISTANCE = SEVERAL[0], SEVERAL[1], INK


def draw_train(train: Vehicle) -> Picture:
    """The picture of a train: forces and resistance, losses, energy of cruising, each over speed."""
    from das.drawing.picture import Picture

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
        axes.plot(kmh(speed), effort, color=QUIET, linewidth=0.8, label=f"in {shortened(name, MOST_LETTERS)}")
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
        (found.idle_loss_w, "no effort", QUIET),
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
