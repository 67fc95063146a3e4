"""A second witness for trajectories: shares no code with the solver, integrates in time with small steps."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

G = 9.81


def read_value(data: dict[str, Any], key: str, default: float = 0.0) -> float:
    """A TTOBench quantity in SI, by this file's own table of units."""
    scale = {"kg": 1, "kN": 1e3, "kW": 1e3, "km/h": 1 / 3.6, "%": 0.01, "m": 1, "m/s^2": 1,
             "kN/(km/h)": 3.6e3, "kN/(km/h)^2": 3.6**2 * 1e3}  # fmt: skip
    return data[key]["value"] * scale[data[key]["unit"]] if key in data else default


@dataclass
class Line:
    """Gradient, curve resistance and limit of a TTOBench track as functions of position (point mass)."""

    gradients: list[list[float]]
    limits: list[list[float]]
    curves: list[list[float]]

    @classmethod
    def read(cls, path: Path) -> Line:
        data = json.loads(path.read_text())
        curves = data.get("curvatures", {"values": [[0, "infinity", "infinity"]]})["values"]
        return cls(data["gradients"]["values"], data["speed limits"]["values"], curves)

    @staticmethod
    def _row(rows: list[list[Any]], s: float) -> list[Any]:
        return next(row for row in reversed(rows) if row[0] <= s + 1e-9)

    def resistance_per_mass(self, s: float) -> float:
        """Gradient and curve resistance, N/kg."""
        _, start, end = self._row(self.curves, s)
        k = abs(1 / float(start) + 1 / float(end)) / 2
        curve = 0.5 * k / (1 - 30 * k) if k <= 1 / 300 else 0.65 * k / (1 - 55 * k)
        return G * (self._row(self.gradients, s)[1] / 1e3 + curve)

    def limit_mps(self, s: float) -> float:
        return self._row(self.limits, s)[1] / 3.6


def integrate(
    rows: np.ndarray, line: Line, train: dict[str, Any], loss: Any, substeps: int = 8
) -> tuple[float, float, float]:
    """Drive a trajectory's forces (s, t, v, F_el, F_fr, …) from node to node by small steps in time.

    Each interval starts at the node's own speed. Returns trip time, energy at the collector (J) and the largest
    difference between the speed arrived with and the next node's.
    """
    mass = read_value(train, "mass")
    inertial = mass * (1 + read_value(train, "rho"))
    r0, r1, r2 = (read_value(train, f"rolling resistance r{i}") for i in range(3))
    time_s, energy, worst = 0.0, 0.0, 0.0
    for here, there in itertools.pairwise(rows):
        s, v, electric = here[0], here[2], here[3]
        ahead, total = there[0], here[3] + here[4]
        drag = mass * line.resistance_per_mass(0.5 * (here[0] + there[0]))
        dt = (there[1] - here[1]) / substeps
        while s < ahead - 1e-9:
            a = (total - r0 - r1 * v - r2 * v * v - drag) / inertial
            mid = max(v + 0.5 * a * dt, 1e-9)
            a = (total - r0 - r1 * mid - r2 * mid * mid - drag) / inertial
            step = min(dt, (ahead - s) / max(mid, 1e-9))
            s += mid * step
            v = max(v + a * step, 0.0)
            time_s += step
            energy += (electric * mid + loss(electric, mid)) * step
            if step < 1e-7:
                break
        worst = max(worst, abs(v - there[2]))
    return time_s, energy, worst
