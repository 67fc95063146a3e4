"""A witness of limits and brakes that reads the TOML files itself and shares nothing with the solver or the domain."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
GRAVITY_MPS2 = 9.80665
Place = tuple[float, float, float]
"""A temporary restriction: from where to where (m), and the limit (m/s)."""


def _rows(table: dict[str, object], factor: float) -> tuple[Floats, Floats]:
    rows = np.array(table["rows"], dtype=float)
    return 1000.0 * rows[:, 0], factor * rows[:, 1]


def _steps(start_m: Floats, value: Floats, s_m: Floats) -> Floats:
    return np.asarray(value[np.clip(np.searchsorted(start_m, s_m, side="right") - 1, 0, len(value) - 1)])


@dataclass(frozen=True, kw_only=True)
class RawTrain:
    """The train as its file has it, in SI units."""

    mass_kg: float
    rotating_ratio: float
    length_m: float
    top_mps: float
    resistance: tuple[float, float, float]
    brake_n: float
    brake_w: float
    friction_n: float
    most_mps2: float

    @classmethod
    def read(cls, path: Path) -> RawTrain:
        """Read a vehicle's file; a plan that may use the electric brake only is judged by that brake."""
        data = tomllib.loads(path.read_text())
        vehicle, held, brake = data["vehicle"], data["resistance"], data["electric_brake"]
        blended = data["brakes"]["policy"] != "electric"
        return cls(
            mass_kg=1000.0 * vehicle["mass_t"],
            rotating_ratio=vehicle["rotating_mass_ratio"],
            length_m=vehicle["length_m"],
            top_mps=vehicle["max_speed_kmh"] / 3.6,
            resistance=(1000.0 * held["c0_kn"], 1000.0 * held["c1_kn_per_mps"], 1000.0 * held["c2_kn_per_mps2"]),
            brake_n=1000.0 * brake["max_force_kn"],
            brake_w=1000.0 * brake["max_power_kw"],
            friction_n=1000.0 * data["friction_brake"]["max_force_kn"] if blended else 0.0,
            most_mps2=vehicle.get("max_deceleration_mps2", math.inf),
        )

    def braking_mps2(self, speed_mps: float, uphill_ratio: float) -> float:
        """What all brakes, the running resistance and the line give at a speed."""
        c0, c1, c2 = self.resistance
        brakes_n = min(self.brake_n, self.brake_w / max(speed_mps, 0.1)) + self.friction_n
        held_n = c0 + c1 * speed_mps + c2 * speed_mps**2 + self.mass_kg * GRAVITY_MPS2 * uphill_ratio
        return min((brakes_n + held_n) / (self.mass_kg * (1.0 + self.rotating_ratio)), self.most_mps2)


class RawLine:
    """A route's limits and gradients as its file has them, on a grid of 1 m."""

    def __init__(self, path: Path, train: RawTrain) -> None:
        data = tomllib.loads(path.read_text())
        self.length_m = 1000.0 * data["route"]["length_km"]
        self.stops_m = [1000.0 * stop["position_km"] for stop in data["stops"]]
        self._train, self._s_m = train, np.arange(0.0, self.length_m + 1.0)
        self._limit = _steps(*_rows(data["speed_limits"], 1 / 3.6), self._s_m)
        gradient = _steps(*_rows(data["gradients"], 1e-3), self._s_m)
        height = np.concatenate(([0.0], np.cumsum(gradient[:-1])))
        tail_m = self._s_m - train.length_m
        behind = np.where(tail_m < 0, gradient[0] * tail_m, np.interp(tail_m, self._s_m, height))
        self._uphill = (height - behind) / train.length_m

    def allowed(self, places: Sequence[Place], stop_m: float) -> Allowed:
        """Limits and brake curve before a stop, under temporary restrictions."""
        line = self._limit
        for start_m, end_m, limit_mps in places:
            # A metre that the restriction covers in part counts as covered.
            inside = (self._s_m > start_m - 1.0) & (self._s_m < end_m)
            line = np.where(inside, np.minimum(line, limit_mps), line)
        length = math.floor(self._train.length_m)
        padded = np.concatenate((np.full(length, np.inf), line))
        limit = np.lib.stride_tricks.sliding_window_view(padded, length + 1).min(axis=1)
        limit = np.minimum(limit, self._train.top_mps)
        return Allowed(limit, self._braked(limit, round(stop_m)))

    def _braked(self, limit: Floats, stop: int) -> Floats:
        """Backwards from the stop: v² grows by twice the braking of each metre, up to the limit."""
        curve, speed = np.zeros(len(limit)), 0.0
        for i in range(min(stop, len(limit) - 1) - 1, -1, -1):
            rate = self._train.braking_mps2(speed, float(self._uphill[i]))
            speed = min(math.sqrt(max(speed**2 + 2.0 * rate, 0.0)), float(limit[i]))
            curve[i] = speed
        return curve


class Allowed:
    """Limit over the train and brake curve by the position of the head (m/s on a grid of 1 m)."""

    def __init__(self, limit_mps: Floats, curve_mps: Floats) -> None:
        self._limit_mps, self._curve_mps = limit_mps, curve_mps

    def limit(self, from_m: float, to_m: float) -> float:
        """The highest limit anywhere between two positions."""
        return self._highest(self._limit_mps, from_m, to_m)

    def curve(self, from_m: float, to_m: float) -> float:
        """The highest allowed speed anywhere between two positions."""
        return self._highest(self._curve_mps, from_m, to_m)

    @staticmethod
    def _highest(values: Floats, from_m: float, to_m: float) -> float:
        last = len(values) - 1
        first, end = (min(max(math.floor(x), 0), last) for x in (from_m, to_m + 1.0))
        return float(values[first : end + 1].max())
