"""An independent calculation of limits and braking: it reads the TOML files itself and shares no code with `das`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
GRAVITY_MPS2 = 9.80665
Place = tuple[float, float, float]
"""A temporary restriction: start and end (m), and limit (m/s)."""
REACTION_S = 3.0
"""Time (s) until the driver begins to brake after a message that comes too late."""
ELECTRIC_BUILD_UP_S, FRICTION_BUILD_UP_S = 1.2, 4.5
"""Time (s) until a brake acts fully: the electric brake, and an air brake in position P (UIC 540: 3 to 5 s)."""
STEP_S, HELD_STEP_S = 0.1, 0.25


def _rows(table: dict[str, object], factor: float) -> tuple[Floats, Floats]:
    rows = np.array(table["rows"], dtype=float)
    return 1000.0 * rows[:, 0], factor * rows[:, 1]


def _steps(start_m: Floats, value: Floats, s_m: Floats) -> Floats:
    return np.asarray(value[np.clip(np.searchsorted(start_m, s_m, side="right") - 1, 0, len(value) - 1)])


@dataclass(frozen=True, kw_only=True)
class RawTrain:
    """The values of a train from its file, in SI units."""

    mass_kg: float
    rotating_ratio: float
    length_m: float
    top_mps: float
    resistance: tuple[float, float, float]
    traction_n: float
    traction_w: float
    effort: tuple[list[float], list[float]]
    """An effort curve instead of force and power: speeds (m/s) and forces (N), of equal length; may be empty."""
    brake_n: float
    brake_w: float
    friction_n: float
    """The force (N) of the friction brake that the brake policy allows in a plan."""
    service_friction_n: float
    """The force (N) of the friction brake that the driver can use."""
    most_mps2: float

    @classmethod
    def read(cls, path: Path) -> RawTrain:
        """Read a vehicle's file; plans that may use only the electric brake are judged by that brake."""
        data = tomllib.loads(path.read_text())
        vehicle, held, brake = data["vehicle"], data["resistance"], data["electric_brake"]
        rows = data["traction"].get("curve", {"rows": []})["rows"]
        blended, friction_n = data["brakes"]["policy"] != "electric", 1000.0 * data["friction_brake"]["max_force_kn"]
        return cls(
            mass_kg=1000.0 * vehicle["mass_t"],
            rotating_ratio=vehicle["rotating_mass_ratio"],
            length_m=vehicle["length_m"],
            top_mps=vehicle["max_speed_kmh"] / 3.6,
            resistance=(1000.0 * held["c0_kn"], 1000.0 * held["c1_kn_per_mps"], 1000.0 * held["c2_kn_per_mps2"]),
            traction_n=1000.0 * data["traction"].get("max_force_kn", math.nan),
            traction_w=1000.0 * data["traction"].get("max_power_kw", math.nan),
            effort=([kmh / 3.6 for kmh, _ in rows], [1000.0 * kn for _, kn in rows]),
            brake_n=1000.0 * brake["max_force_kn"],
            brake_w=1000.0 * brake["max_power_kw"],
            friction_n=friction_n if blended else 0.0,
            service_friction_n=friction_n,
            most_mps2=vehicle.get("max_deceleration_mps2", math.inf),
        )

    @property
    def inertial_kg(self) -> float:
        """The inertial mass (kg): that of the train with its rotating parts."""
        return self.mass_kg * (1.0 + self.rotating_ratio)

    def pulling_n(self, speed_mps: float) -> float:
        """The largest traction (N) at a speed."""
        if self.effort[0]:
            return float(np.interp(speed_mps, *self.effort))
        return min(self.traction_n, self.traction_w / max(speed_mps, 0.1))

    def electric_n(self, speed_mps: float) -> float:
        """The largest force (N) of the electric brake at a speed."""
        return min(self.brake_n, self.brake_w / max(speed_mps, 0.1))

    def brakes_n(self, speed_mps: float) -> float:
        """The largest force (N), at a speed, of all brakes that the policy allows in a plan."""
        return self.electric_n(speed_mps) + self.friction_n

    def held_n(self, speed_mps: float, uphill_ratio: float) -> float:
        """The force (N) of running resistance and gradient against the train."""
        c0, c1, c2 = self.resistance
        return c0 + c1 * speed_mps + c2 * speed_mps**2 + self.mass_kg * GRAVITY_MPS2 * uphill_ratio

    def braking_mps2(self, speed_mps: float, uphill_ratio: float, built_up: tuple[float, float] = (1.0, 1.0)) -> float:
        """The deceleration (m/s²) by all brakes, running resistance and gradient.

        `built_up` contains the shares of the electric and the friction brake that act already.
        """
        brakes_n = built_up[0] * self.electric_n(speed_mps) + built_up[1] * self.friction_n
        return min((brakes_n + self.held_n(speed_mps, uphill_ratio)) / self.inertial_kg, self.most_mps2)


class RawLine:
    """The limits and gradients of a route from its file, on a grid of 1 m."""

    def __init__(self, path: Path, train: RawTrain) -> None:
        data = tomllib.loads(path.read_text())
        self.length_m = 1000.0 * data["route"]["length_km"]
        self.train, self._s_m = train, np.arange(0.0, self.length_m + 1.0)
        self._limit = _steps(*_rows(data["speed_limits"], 1 / 3.6), self._s_m)
        gradient = _steps(*_rows(data["gradients"], 1e-3), self._s_m)
        height = np.concatenate(([0.0], np.cumsum(gradient[:-1])))
        tail_m = self._s_m - train.length_m
        behind = np.where(tail_m < 0, gradient[0] * tail_m, np.interp(tail_m, self._s_m, height))
        self._uphill = ((height - behind) / train.length_m).tolist()

    def uphill_ratio(self, s_m: float) -> float:
        """The gradient over the train with its head at a position."""
        return self._uphill[min(max(int(s_m), 0), len(self._uphill) - 1)]

    def held_n(self, s_m: float, speed_mps: float) -> float:
        """The force (N) of running resistance and gradient against the train at a position and speed."""
        return self.train.held_n(speed_mps, self.uphill_ratio(s_m))

    def allowed(self, places: Sequence[Place], stop_m: float) -> Allowed:
        """The limits, and the braking curve before a stop, under temporary restrictions."""
        line = self._limit
        for start_m, end_m, limit_mps in places:
            # A metre that the restriction covers only in part counts as covered.
            inside = (self._s_m > start_m - 1.0) & (self._s_m < end_m)
            line = np.where(inside, np.minimum(line, limit_mps), line)
        length = math.floor(self.train.length_m)
        padded = np.concatenate((np.full(length, np.inf), line))
        limit = np.lib.stride_tricks.sliding_window_view(padded, length + 1).min(axis=1)
        limit = np.minimum(limit, self.train.top_mps)
        return Allowed(limit, self._braked(limit, round(stop_m)))

    def unavoidable(self, s_m: float, speed_mps: float, gain_mps2: float) -> tuple[list[float], float]:
        """The motion of a train that receives a message too late: it continues for the reaction time and then brakes
        fully.

        `gain_mps2` is its acceleration at that time. Returns its speed at each metre of the line (0 beyond its stop),
        and the position where it stops (m).
        """
        fastest, at_m, v, now_s = [0.0] * len(self._s_m), s_m, speed_mps, 0.0
        passed = min(max(int(at_m), 0), len(fastest) - 1)
        while v > 0.0 and now_s < 600.0:
            index = min(max(int(at_m), 0), len(fastest) - 1)
            for i in range(passed, index + 1):
                fastest[i] = max(fastest[i], v)
            passed = index
            after_s = now_s - REACTION_S
            if after_s < 0.0:
                rate = max(gain_mps2, 0.0)
            else:
                built_up = min(after_s / ELECTRIC_BUILD_UP_S, 1.0), min(after_s / FRICTION_BUILD_UP_S, 1.0)
                rate = -self.train.braking_mps2(v, self.uphill_ratio(at_m), built_up)
            before, v, now_s = v, max(v + rate * STEP_S, 0.0), now_s + STEP_S
            at_m += 0.5 * (before + v) * STEP_S
        return fastest, at_m

    def driven(
        self, s_m: float, speed_mps: float, force_n: Callable[[float, float], float], over_s: float
    ) -> list[tuple[float, float]]:
        """Positions (m) and speeds (m/s), every `HELD_STEP_S`, under a force that depends on position and speed."""
        train, at_m, v, found = self.train, s_m, speed_mps, []
        for _ in range(round(over_s / HELD_STEP_S)):
            asked = min(max(force_n(at_m, v), -train.brakes_n(v)), train.pulling_n(v))
            rate = max((asked - self.held_n(at_m, v)) / train.inertial_kg, -train.most_mps2)
            before, v = v, max(v + rate * HELD_STEP_S, 0.0)
            at_m += 0.5 * (before + v) * HELD_STEP_S
            found.append((at_m, v))
        return found

    def _braked(self, limit: Floats, stop: int) -> Floats:
        """The braking curve, back from the stop: v² grows by twice the deceleration each metre, up to the limit."""
        curve, speed = np.zeros(len(limit)), 0.0
        for i in range(min(stop, len(limit) - 1) - 1, -1, -1):
            rate = self.train.braking_mps2(speed, self._uphill[i])
            speed = min(math.sqrt(max(speed**2 + 2.0 * rate, 0.0)), float(limit[i]))
            curve[i] = speed
        return curve


class Allowed:
    """The limit over the train and the braking curve by the position of the head (m/s on a grid of 1 m)."""

    def __init__(self, limit_mps: Floats, curve_mps: Floats) -> None:
        self._limit_mps, self.curve_mps = limit_mps.tolist(), curve_mps.tolist()

    def limit(self, from_m: float, to_m: float) -> float:
        """The highest limit anywhere between two positions."""
        return highest(self._limit_mps, from_m, to_m)

    def curve(self, from_m: float, to_m: float) -> float:
        """The highest allowed speed anywhere between two positions."""
        return highest(self.curve_mps, from_m, to_m)


def highest(values: list[float], from_m: float, to_m: float) -> float:
    """The highest of the values on a grid of 1 m between two positions (m)."""
    last = len(values) - 1
    first, end = min(max(int(from_m), 0), last), min(max(int(to_m + 1.0), 0), last)
    return max(values[first : end + 1])
