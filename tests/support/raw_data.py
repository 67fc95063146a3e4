"""Tracks, trains and loss maps for the verifier, read from the raw files with separate code and units."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Loss = Callable[[Floats, Floats], Floats]
"""Loss of the traction chain (W) at wheel force (N, braking < 0) and speed (m/s)."""

G = 9.81
_KMH = 1 / 3.6
_UNITS = {
    "-": 1, "ratio": 1, "%": 1e-2, "percent": 1e-2, "permil": 1e-3, "permille": 1e-3,
    "m": 1, "km": 1e3, "m^2": 1, "m2": 1, "kg": 1, "t": 1e3,
    "m/s": 1, "mps": 1, "km/h": _KMH, "kmh": _KMH, "m/s^2": 1, "mps2": 1,
    "N": 1, "n": 1, "kN": 1e3, "kn": 1e3, "W": 1, "w": 1, "kW": 1e3, "kw": 1e3,
    "kN/(km/h)": 1e3 / _KMH, "kn_per_mps": 1e3, "kn_per_kmh": 1e3 / _KMH, "n_per_mps": 1,
    "kN/(km/h)^2": 1e3 / _KMH**2, "kn_per_mps2": 1e3, "kn_per_kmh2": 1e3 / _KMH**2, "n_per_mps2": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Steps:
    """A piecewise constant quantity along the line, with its first and last value beyond the ends."""

    start_m: Floats
    value: Floats

    def at(self, s: Floats) -> Floats:
        """The value at each place; on a boundary, the value of the stretch that begins there."""
        return self.value[np.maximum(np.searchsorted(self.start_m, s, side="right") - 1, 0)]

    def integrals(self, s: Floats) -> tuple[Floats, Floats]:
        """∫ value and ∫∫ value from the first start to each place."""
        width = np.diff(self.start_m)
        once = np.append(0.0, np.cumsum(self.value[:-1] * width))
        twice = np.append(0.0, np.cumsum(once[:-1] * width + 0.5 * self.value[:-1] * width**2))
        i = np.maximum(np.searchsorted(self.start_m, s, side="right") - 1, 0)
        x = s - self.start_m[i]
        return once[i] + self.value[i] * x, twice[i] + once[i] * x + 0.5 * self.value[i] * x * x

    def under(self, head_m: Floats, length_m: float) -> Floats:
        """Mean over a train whose head is at each place."""
        if length_m == 0:
            return self.at(head_m)
        return (self.integrals(head_m)[0] - self.integrals(head_m - length_m)[0]) / length_m

    def driven(self, head_m: Floats, length_m: float) -> Floats:
        """∫ of `under` over the position of the head, up to each place (all from the same, arbitrary place)."""
        if length_m == 0:
            return self.integrals(head_m)[0]
        return (self.integrals(head_m)[1] - self.integrals(head_m - length_m)[1]) / length_m


@dataclass(frozen=True)
class Line:
    """A track: gradients (ratio), curve resistance (m/s²), limits (m/s), tunnels (from, to, cross section), stops.

    It also contains the power supply: the accepted share of the energy fed back, the neutral sections and the zones
    without regeneration (from, to).
    """

    gradients: Steps
    curves: Steps
    limits: Steps
    tunnels: tuple[tuple[float, float, float], ...]
    stops_m: tuple[float, ...]
    receptivity: Steps
    neutral: tuple[tuple[float, float], ...] = ()
    no_regeneration: tuple[tuple[float, float], ...] = ()

    @classmethod
    def read(cls, path: Path) -> Line:
        """A TTOBench track (JSON) or a route of this project (TOML)."""
        data = _load(path)
        if path.suffix == ".json":
            return cls.of(data)

        def rows(key: str) -> list[list[float]]:
            return _columns(data[key]) if key in data else []

        return cls(
            gradients=_steps(rows("gradients")),
            curves=_bends(rows("curves")),
            limits=_steps(rows("speed_limits")),
            tunnels=tuple((start, start + length, area) for start, length, area in rows("tunnels")),
            stops_m=tuple(_named(stop, "position") for stop in data["stops"]),
            receptivity=_steps(rows("receptivity") or [[0.0, 1.0]]),
            neutral=tuple((start, start + length) for start, length in rows("neutral_sections")),
            no_regeneration=tuple((start, start + length) for start, length in rows("no_regeneration")),
        )

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Line:
        """A TTOBench track from the content of its JSON file."""
        tunnels = _rows(data["tunnels"]) if "tunnels" in data else []
        return cls(
            gradients=_steps(_rows(data["gradients"])),
            curves=_bends(_rows(data["curvatures"]) if "curvatures" in data else []),
            limits=_steps(_rows(data["speed limits"])),
            tunnels=tuple((start, start + length, area) for start, length, area in tunnels),
            stops_m=tuple(x * _UNITS[data["stops"]["unit"]] for x in data["stops"]["values"]),
            receptivity=_steps([[0.0, 1.0]]),
        )


def curve_resistance(curvature_per_m: float) -> float:
    """Resistance per mass (m/s²) of a curve: g·0.5κ/(1−30κ) from 300 m of radius on, else g·0.65κ/(1−55κ)."""
    k = curvature_per_m
    return G * (0.5 * k / (1 - 30 * k) if k * 300 <= 1 + 1e-12 else 0.65 * k / (1 - 55 * k))


@dataclass(frozen=True)
class Effort:
    """A largest force and a largest power at the wheel, or a curve of speeds and forces instead."""

    force_n: float
    power_w: float
    curve: tuple[Floats, Floats] | None = None

    def limit_n(self, v: Floats) -> Floats:
        if self.curve is not None:
            return np.interp(v, *self.curve)
        return np.minimum(self.force_n, self.power_w / np.maximum(v, 1e-9))


@dataclass(frozen=True)
class Train:
    """A train's raw values in SI; `brakes` are those that a plan may use: electric, blended or friction.

    `adhesive_kg` is the mass on driven axles (inf: adhesion is no limit), `rail_ratio` the state of the rail.
    """

    mass_kg: float
    rotating_kg: float
    length_m: float
    max_speed_mps: float
    max_acceleration_mps2: float
    max_deceleration_mps2: float
    r0_n: float
    r1_n_per_mps: float
    r2_n_per_mps2: float
    traction: Effort
    electric: Effort
    friction_n: float
    brakes: str
    tunnel_rows: tuple[tuple[float, float], ...]
    efficiencies: tuple[float, float] | None = None
    adhesive_kg: float = np.inf
    rail_ratio: float = 1.0
    head_wind_mps: float = 0.0
    auxiliary_w: float = 0.0

    @classmethod
    def read(cls, path: Path) -> Train:
        """A vehicle of this project (TOML)."""
        data = _load(path)
        main, resistance = data["vehicle"], data["resistance"]
        friction_n = _named(data["friction_brake"], "max_force") if "friction_brake" in data else 0.0
        has_electric = "electric_brake" in data
        usual = ("blended" if has_electric else "friction") if friction_n else "electric"
        tunnel = _columns(data["tunnel_resistance"]) if "tunnel_resistance" in data else []
        return cls(
            mass_kg=_named(main, "mass"),
            rotating_kg=_named(main, "mass") * _named(main, "rotating_mass", 0.0),
            length_m=_named(main, "length"),
            max_speed_mps=_named(main, "max_speed"),
            max_acceleration_mps2=_named(main, "max_acceleration", np.inf),
            max_deceleration_mps2=_named(main, "max_deceleration", np.inf),
            r0_n=_named(resistance, "c0"),
            r1_n_per_mps=_named(resistance, "c1"),
            r2_n_per_mps2=_named(resistance, "c2"),
            traction=_effort(data["traction"]),
            electric=_effort(data["electric_brake"]) if has_electric else Effort(0.0, 0.0),
            friction_n=friction_n,
            brakes=data.get("brakes", {}).get("policy", usual),
            tunnel_rows=tuple(sorted((area, coefficient) for area, coefficient in tunnel)),
            adhesive_kg=_named(data.get("adhesion", {}), "adhesive_mass", np.inf),
            auxiliary_w=_named(main, "auxiliary_power", 0.0),
            efficiencies=_efficiencies(data.get("losses", {}).get("own")),
        )

    @property
    def inertia_kg(self) -> float:
        return self.mass_kg + self.rotating_kg

    def loaded(self, mass_kg: float) -> Train:
        """The train with another mass: rotating parts keep theirs, and rolling friction is proportional to the
        weight.
        """
        return replace(self, mass_kg=mass_kg, r0_n=self.r0_n * mass_kg / self.mass_kg)

    def motors_n(self, v: Floats) -> tuple[Floats, Floats]:
        """Largest traction and electric brake: force, power, adhesion of the driven axles."""
        grip = self._grip(v, self.adhesive_kg)
        return np.minimum(self.traction.limit_n(v), grip), np.minimum(self.electric.limit_n(v), grip)

    def both_brakes_n(self, v: Floats) -> Floats:
        """Largest force of both brakes together, limited by the adhesion of all axles if given."""
        braked_kg = self.mass_kg if np.isfinite(self.adhesive_kg) else np.inf
        return np.minimum(self.motors_n(v)[1] + self.friction_n, self._grip(v, braked_kg))

    def _grip(self, v: Floats, mass_kg: float) -> Floats:
        """Curtius and Kniffler: µ = 7.5/(V + 44) + 0.161, V in km/h."""
        return mass_kg * G * self.rail_ratio * (7.5 / (v / _KMH + 44) + 0.161)

    def tunnel_profile(self, line: Line) -> Steps:
        """The v² term of the tunnels along a line (N/(m/s)²): linear between the train's cross sections."""
        starts, values = [-1e9], [0.0]
        for start, end, area in line.tunnels if self.tunnel_rows else ():
            starts += [start, end]
            values += [float(np.interp(area, *zip(*self.tunnel_rows, strict=True))), 0.0]
        return Steps(np.array(starts), np.array(values))

    def own_loss(self) -> Loss:
        """The loss of constant efficiencies: F·v/η − F·v driving, F·v − F·v·η braking."""
        if self.efficiencies is None:
            raise ValueError("this train's file states no constant efficiencies: give a loss")
        return constant_efficiencies(*self.efficiencies)


def constant_efficiencies(driving: float, braking: float, idle_w: float = 0.0) -> Loss:
    """Collector power F·v/η when driving, F·v·η when braking, and an idle loss."""

    def loss(force: Floats, speed: Floats) -> Floats:
        power = force * speed
        return np.where(power > 0, power / driving - power, power * braking - power) + idle_w

    return loss


def read_loss_map(path: Path) -> Loss:
    """A loss map (CSV): bilinear, continued linearly beyond the last known force of a speed, never below 0."""
    names = path.read_text().splitlines()[0].split(",")
    scale = [_UNITS[name.strip().split("_")[1]] for name in names]
    data = np.loadtxt(path, delimiter=",", skiprows=1) * scale
    speeds, i = np.unique(data[:, 0].round(9), return_inverse=True)
    forces, j = np.unique(data[:, 1].round(6), return_inverse=True)
    table = np.full((len(speeds), len(forces)), np.nan)
    table[i, j] = data[:, 2]
    for row in table:
        known = np.flatnonzero(np.isfinite(row))
        for edge, inner in ((known[0], known[1]), (known[-1], known[-2])):
            outside = np.arange(0, edge) if edge < inner else np.arange(edge + 1, len(row))
            slope = (row[inner] - row[edge]) / (forces[inner] - forces[edge])
            row[outside] = np.maximum(row[edge] + slope * (forces[outside] - forces[edge]), 0.0)

    def loss(force: Floats, speed: Floats) -> Floats:
        a = np.clip(np.searchsorted(speeds, speed, side="right") - 1, 0, len(speeds) - 2)
        b = np.clip(np.searchsorted(forces, force, side="right") - 1, 0, len(forces) - 2)
        x = (speed - speeds[a]) / (speeds[a + 1] - speeds[a])
        y = (force - forces[b]) / (forces[b + 1] - forces[b])
        slow = table[a, b] * (1 - y) + table[a, b + 1] * y
        fast = table[a + 1, b] * (1 - y) + table[a + 1, b + 1] * y
        return slow * (1 - x) + fast * x

    return loss


def read_rows(path: Path) -> Floats:
    """The rows of a trajectory as `das-precompute solve --out` writes it."""
    return np.loadtxt(path, delimiter=",", skiprows=1)


def _load(path: Path) -> dict[str, Any]:
    text = path.read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    return loaded


def _rows(table: Mapping[str, Any]) -> list[list[float]]:
    """A TTOBench list in SI; its units are in the order of its columns."""
    scale = [_UNITS[unit] for unit in table["units"].values()]
    return [[float(cell) * factor for cell, factor in zip(row, scale, strict=True)] for row in table["values"]]


def _columns(table: Mapping[str, Any]) -> list[list[float]]:
    """A list of this project's TOML in SI, converted by the units in its column names."""
    scale = [_unit(name) for name in table["columns"]]
    return [[float(cell) * factor for cell, factor in zip(row, scale, strict=True)] for row in table["rows"]]


def _unit(name: str) -> float:
    """Factor of the longest unit at the end of a name."""
    parts = name.split("_")
    return next(_UNITS[tail] for i in range(1, len(parts)) if (tail := "_".join(parts[i:])) in _UNITS)


def _named(table: Mapping[str, Any], quantity: str, default: float | None = None) -> float:
    """The quantity of a TOML table, with any unit at the end of its key."""
    for key, value in table.items():
        if key.startswith(quantity + "_") and key[len(quantity) + 1 :] in _UNITS:
            return float(value * _UNITS[key[len(quantity) + 1 :]])
    if default is None:
        raise KeyError(quantity)
    return default


def _efficiencies(own: Mapping[str, Any] | None) -> tuple[float, float] | None:
    """Efficiencies of traction and electric brake, if the file states them."""
    stated = own is not None and any(key.startswith("traction_efficiency") for key in own)
    return (_named(own, "traction_efficiency"), _named(own, "brake_efficiency")) if own and stated else None


def _effort(table: Mapping[str, Any]) -> Effort:
    if "curve" in table:
        speeds, forces = np.array(_columns(table["curve"])).T
        return Effort(float(forces.max()), np.inf, (speeds, forces))
    return Effort(_named(table, "max_force"), _named(table, "max_power"))


def _bends(rows: list[list[float]]) -> Steps:
    """Curve resistance from rows of position and radii at start and end; for a clothoid from its mean curvature."""
    straight = [[0.0, np.inf, np.inf]]
    return _steps([[start, curve_resistance(abs(1 / r0 + 1 / r1) / 2)] for start, r0, r1 in rows or straight])


def _steps(rows: list[list[float]]) -> Steps:
    return Steps(np.array([row[0] for row in rows]), np.array([row[1] for row in rows]))
