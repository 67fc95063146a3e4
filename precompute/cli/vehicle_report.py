"""A train in words, figures and warnings."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from das.command_line.printing import new_table
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.plausibility import warnings_of
from das.domain.units import KM, KMH, KN, KW, TONNE, kmh, kwh
from das.domain.vehicle import Vehicle
from precompute.performance import performance_of

if TYPE_CHECKING:
    from rich.table import Table

Floats = NDArray[np.float64]

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
"""Share of its largest force by which a curve that rises with speed causes a warning."""
COARSE_MPS = 30.0 * KMH
"""Distance (m/s) of points of an effort curve above which there is a warning."""


def facts(train: Vehicle) -> list[str]:
    """What kind of train it is, in a few lines."""
    effort = train.traction
    shape = "force and power" if effort.curve is None else f"an effort curve of {len(effort.curve.speed_mps)} points"
    lines = [
        f"{train.name} ({train.id}): {train.mass_kg / TONNE:.4g} t, {train.train_length_m:.4g} m, "
        f"{kmh(train.max_speed_mps):.4g} km/h",
        f"traction: {shape}, at most {effort.max_force_n / KN:.4g} kN and {effort.max_power_w / KW:.5g} kW",
    ]
    if train.modes:
        lines.append(f"mode: {train.mode or 'none'}; it has {', '.join(train.modes)}")
    if train.loads:
        lines.append(f"loads: {', '.join(train.loads)}")
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
    """The loss levels that a train has data for, its default first."""
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
    """What is unusual in the efforts of a train in one mode."""
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
