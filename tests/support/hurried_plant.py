"""The train model behind the bundled recording, kept as it was when that was made; new work uses `sim.plant`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from das.domain.losses import LossModel
from das.domain.route import Route
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle

EFFORT_RATE_RATIO_PER_S = 0.25
"""Share of the largest force by which effort builds up per second (assumption)."""
TRAIN_SAMPLES = 11
"""Points along the train over which the gradient is averaged."""


@dataclass(frozen=True, kw_only=True)
class HurriedState:
    """Time (s), position of the head (m), speed (m/s), wheel forces (N, brakes < 0), energy at the collector (J)."""

    time_s: float
    s_m: float
    speed_mps: float
    force_el_n: float = 0.0
    force_friction_n: float = 0.0
    energy_input_j: float = 0.0


class HurriedPlant:
    """Steps a train along a route under a wanted wheel force."""

    def __init__(self, route: Route, vehicle: Vehicle, loss: LossModel, step_s: float = 0.05) -> None:
        self.route, self.vehicle, self.loss, self.step_s = route, vehicle, loss, step_s
        self._curve, self._tunnel = vehicle.line_resistance_mps2(route), vehicle.tunnel_n_per_mps2(route)
        self._offsets = np.linspace(-vehicle.train_length_m, 0.0, TRAIN_SAMPLES)

    def step(self, state: HurriedState, wanted_n: float) -> HurriedState:
        """One step of semi-implicit Euler: forces from the speed before the step, position from the mean speed."""
        vehicle, v, dt = self.vehicle, state.speed_mps, self.step_s
        total = self._built_up(state, self._within_envelope(wanted_n, v))
        electric = max(total, -float(vehicle.electric_brake_effort_n(v))) if total < 0 else total
        friction = total - electric
        resisting = float(vehicle.resistance.force_n(v)) + self._line_force(state.s_m, v)
        acceleration = (total - resisting) / vehicle.inertial_mass_kg
        if v <= 0.0 and acceleration < 0.0:
            acceleration = 0.0  # the brakes hold the train where it stands
        after = max(v + acceleration * dt, 0.0)
        mean = 0.5 * (v + after)
        power = electric * mean + (float(self.loss.loss_w(electric, mean)) if mean > 0 else 0.0)
        return replace(
            state,
            time_s=state.time_s + dt,
            s_m=state.s_m + mean * dt,
            speed_mps=after,
            force_el_n=electric,
            force_friction_n=friction,
            energy_input_j=state.energy_input_j + power * dt,
        )

    def _within_envelope(self, wanted_n: float, v: float) -> float:
        vehicle = self.vehicle
        return min(max(wanted_n, -float(vehicle.brake_effort_n(v))), float(vehicle.traction_effort_n(v)))

    def _built_up(self, state: HurriedState, wanted_n: float) -> float:
        before = state.force_el_n + state.force_friction_n
        most = EFFORT_RATE_RATIO_PER_S * self.vehicle.traction.max_force_n * self.step_s
        return before + math.copysign(min(abs(wanted_n - before), most), wanted_n - before)

    def _line_force(self, s_m: float, v: float) -> float:
        """Force of gradients, curves and tunnels on the train (N), gradient averaged over its length."""
        places = s_m + self._offsets
        grade = float(self.route.gradients_ratio.at(places).mean())
        return float(self._tunnel.at(places).mean()) * v * v + self.vehicle.mass_kg * (
            STANDARD_GRAVITY_MPS2 * grade + float(self._curve.at(places).mean())
        )
