"""Trajectories over the nodes of a section, and their energy balance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossModel
from das.domain.summary import Summary
from das.domain.units import KM, STANDARD_GRAVITY_MPS2, kmh, kwh, kwh_words
from das.domain.vehicle import Resistance, Vehicle

Floats = NDArray[np.float64]

PART_WORDS: Final = {
    "resistance": "running resistance",
    "component_loss": "component losses and auxiliaries",
    "friction_brake": "friction brake",
    "unreturned": "brake resistors",
    "kinetic": "speed gained",
    "potential": "height gained",
}
"""The parts that add up to the input of an energy balance, by the names that all tables use."""


@dataclass(frozen=True, kw_only=True, repr=False)
class EnergyBalance(Summary):
    """The energy balance of a trajectory, in J.

    input = resistance + component_loss + friction_brake + unreturned + kinetic + potential. `input` is the net energy
    at the current collector without the comfort systems, whose energy is `comfort`. `unreturned` is the energy fed back
    that the line did not accept; it is dissipated in the brake resistors.
    """

    resistance: float
    component_loss: float
    friction_brake: float
    unreturned: float
    kinetic: float
    potential: float
    input: float
    comfort: float

    def facts(self) -> dict[str, str]:
        """The input and its parts, in kWh."""
        told = {"input": self.input, **{PART_WORDS[name]: energy_j for name, energy_j in self.parts.items()}}
        return {name: kwh_words(energy_j) for name, energy_j in told.items()}

    @property
    def parts(self) -> dict[str, float]:
        """The parts of the input (J) by their names in `PART_WORDS`."""
        return {name: float(getattr(self, name)) for name in PART_WORDS}

    @property
    def stored(self) -> float:
        """The increase of kinetic and potential energy from start to end (J): input − irreversible."""
        return self.kinetic + self.potential

    @property
    def irreversible(self) -> float:
        """The irreversible energy E_IC of the paper (J): neither stored in the train nor fed back."""
        return self.resistance + self.component_loss + self.friction_brake + self.unreturned

    def as_dict(self) -> dict[str, float]:
        """All terms (J), each under its name with the unit (`resistance_j`, …, `input_j`), and `irreversible_j`."""
        terms = {f"{name}_j": value for name, value in vars(self).items()}
        return {**terms, "irreversible_j": self.irreversible}

    def as_kwh(self) -> dict[str, float]:
        """All terms (kWh) by name."""
        return {name: kwh(value) for name, value in vars(self).items()}

    @property
    def residual_ratio(self) -> float:
        """The residual of the energy balance, relative to its largest term."""
        difference = self.input - sum(self.parts.values())
        scale = max(abs(self.input), self.resistance, abs(self.potential), abs(self.kinetic), 1.0)
        return abs(difference) / scale


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trajectory(Summary):
    """A trajectory: n nodes, n − 1 intervals of constant acceleration.

    Per node: `s_m` (route position), `t_s` (from 0), `v_mps`. Per interval (from its node to the next): wheel forces
    `force_el_n` (traction > 0, electric brake < 0) and `force_friction_n` (<= 0), `grade_ratio` (train-averaged),
    `grade_and_curve_n`, `tunnel_n_per_mps2`, `limit_mps` and `supply` (see `das.domain.route.Route.supply`).
    """

    s_m: Floats
    t_s: Floats
    v_mps: Floats
    force_el_n: Floats
    force_friction_n: Floats
    grade_ratio: Floats
    grade_and_curve_n: Floats
    tunnel_n_per_mps2: Floats
    limit_mps: Floats
    supply: Floats

    @cached_property
    def time_s(self) -> float:
        """Duration (s)."""
        return float(self.t_s[-1])

    def facts(self) -> dict[str, str]:
        """Start, end, duration and speeds."""
        return {
            "from": f"km {self.s_m[0] / KM:.3f}",
            "to": f"km {self.s_m[-1] / KM:.3f}",
            "time": f"{self.time_s:.0f} s",
            "top speed": f"{kmh(float(self.v_mps.max())):.0f} km/h",
            "nodes": f"{len(self.s_m)}",
        }

    def columns(self) -> dict[str, Floats]:
        """The trajectory as arrays of shape (n,), one value per node, by names with units.

        `s_m`, `t_s` and `v_mps` are values at the node; `force_el_n`, `force_friction_n`, `grade_ratio` and `limit_mps`
        apply from the node to the next. The last node has no forces (0) and repeats the gradient and limit before it.
        """
        return {
            "s_m": self.s_m,
            "t_s": self.t_s,
            "v_mps": self.v_mps,
            "force_el_n": np.append(self.force_el_n, 0.0),
            "force_friction_n": np.append(self.force_friction_n, 0.0),
            "grade_ratio": np.append(self.grade_ratio, self.grade_ratio[-1]),
            "limit_mps": np.append(self.limit_mps, self.limit_mps[-1]),
        }

    def interval_s(self) -> Floats:
        """Duration of each interval (s)."""
        return np.diff(self.t_s)

    def mean_speed_mps(self) -> Floats:
        """Mean speed of each interval over time (m/s)."""
        return 0.5 * (self.v_mps[:-1] + self.v_mps[1:])

    def passed(self, position_m: float) -> tuple[float, float]:
        """Time (s) and speed (m/s) at a position of the trajectory; the acceleration is constant between two nodes."""
        node = int(np.clip(np.searchsorted(self.s_m, position_m, side="right") - 1, 0, len(self.s_m) - 2))
        step_m, way_m = self.s_m[node + 1] - self.s_m[node], position_m - self.s_m[node]
        before, after = self.v_mps[node : node + 2]
        speed_mps = float(np.sqrt(before**2 + (after**2 - before**2) * way_m / step_m))
        return float(self.t_s[node] + 2.0 * way_m / max(before + speed_mps, 1e-9)), speed_mps

    def loss_j(self, loss: LossModel) -> Floats:
        """Component loss (J) of each interval with any loss model."""
        return loss.loss_w(self.force_el_n, self.mean_speed_mps()) * self.interval_s()

    def input_j(self, loss_j: Floats) -> Floats:
        """Energy of each interval at the current collector (J), net of the energy accepted by the line."""
        gross = self.force_el_n * np.diff(self.s_m) + loss_j
        return np.where(gross > 0, gross, np.clip(self.supply, 0.0, 1.0) * gross)

    def balance(self, vehicle: Vehicle, loss: LossModel) -> EnergyBalance:
        """Energy balance with this vehicle's masses and resistance and the given losses.

        Raises DasError if a loss map does not cover the trajectory.
        """
        return self.balance_with(vehicle, self.loss_j(loss))

    def balance_with(self, vehicle: Vehicle, loss_j: Floats) -> EnergyBalance:
        """The energy balance from the component loss of each interval (J).

        Every term is computed separately, which makes `EnergyBalance.residual_ratio` a check.
        """
        step = np.diff(self.s_m)
        v2 = self.v_mps**2
        running = mean_resistance_n(vehicle.resistance, self.v_mps, self.tunnel_n_per_mps2)
        weight = vehicle.mass_kg * STANDARD_GRAVITY_MPS2 * self.grade_ratio
        fed_back = np.maximum(-(self.force_el_n * step + loss_j), 0.0)
        return EnergyBalance(
            resistance=float((running + self.grade_and_curve_n - weight) @ step),
            component_loss=float(loss_j.sum()),
            friction_brake=float(-self.force_friction_n @ step),
            unreturned=float(fed_back @ (1.0 - np.clip(self.supply, 0.0, 1.0))),
            kinetic=float(0.5 * vehicle.inertial_mass_kg * (v2[-1] - v2[0])),
            potential=float(weight @ step),
            input=float(self.input_j(loss_j).sum()),
            comfort=vehicle.comfort_power_w * self.time_s,
        )


def mean_resistance_n(resistance: Resistance, v_mps: Floats, tunnel_n_per_mps2: Floats) -> Floats:
    """Running and tunnel resistance (N), averaged exactly over the distance of each interval of constant
    acceleration between n speeds (m/s): n − 1 values.

    v² is linear in the distance: with the speeds a and b at the ends, the mean of v² is (a² + b²)/2 and the mean of v
    is (2/3)·(a² + a·b + b²)/(a + b).
    """
    a, b = v_mps[:-1], v_mps[1:]
    quadratic = resistance.c2_n_per_mps2 + tunnel_n_per_mps2
    mean_v = (2.0 / 3.0) * (a * a + a * b + b * b) / np.maximum(a + b, 1e-12)
    return resistance.c0_n + resistance.c1_n_per_mps * mean_v + quadratic * 0.5 * (a * a + b * b)
