"""The train and the driver behind the bundled recording, kept as they were when it was made.

New work uses `sim.plant` and `sim.drivers`. The driver of the first minute drives on as this one did, and
`tests/support/make_trip.py` makes the bundled recording again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from das.domain.losses import LossModel
from das.domain.route import Floats, Route
from das.domain.units import KMH, STANDARD_GRAVITY_MPS2
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


@dataclass(frozen=True, kw_only=True)
class DriverStyle:
    """How a driver drives; all figures are assumptions of a plausible size."""

    below_limit_mps: float = 3.0 * KMH
    """Margin (m/s) that the driver keeps below the limit."""
    braking_mps2: float = 0.45
    """Deceleration (m/s²) with which the driver plans braking."""
    approach_mps2: float = 0.35
    """Deceleration (m/s²) with which the driver plans the last braking to the stop."""
    full_effort_error_mps: float = 2.0
    """Deviation of the speed (m/s) from which the driver uses full effort."""
    wander_mps: float = 2.0 * KMH
    wander_s: float = 40.0
    """Correlation time (s) of the wander of the speed aimed at; its standard deviation is `wander_mps`."""


class HurriedDriver:
    """Aims at a speed under the limits and the braking curves ahead, and steers force towards it."""

    def __init__(self, route: Route, vehicle: Vehicle, end_m: float, seed: int, style: DriverStyle) -> None:
        self.vehicle, self.end_m, self.style = vehicle, end_m, style
        self._random = np.random.default_rng(seed)
        self._wander = 0.0
        self._at_m, self._limit = _limits_for_head(route, vehicle, end_m)

    def wanted_force_n(self, s_m: float, speed_mps: float, step_s: float, top_mps: float = math.inf) -> float:
        """Wheel force the driver sets now (N), to keep below the limits and at a top speed that he was told."""
        style = self.style
        decay = math.exp(-step_s / style.wander_s)
        self._wander = (
            decay * self._wander + style.wander_mps * math.sqrt(1 - decay**2) * self._random.standard_normal()
        )
        error = min(self._aim(s_m), top_mps) - speed_mps
        share = min(max(error / style.full_effort_error_mps, -1.0), 1.0)
        hold = float(self.vehicle.resistance.force_n(speed_mps))
        if share >= 0:
            return hold + share * (float(self.vehicle.traction_effort_n(speed_mps)) - hold)
        return hold + share * self.vehicle.inertial_mass_kg * 2.0 * style.braking_mps2

    def _aim(self, s_m: float) -> float:
        """The speed to aim at: limit here and braking curves to limits ahead, less a margin (none for the stop)."""
        style = self.style
        way = np.maximum(self._at_m - s_m, 0.0)
        ahead = self._at_m > s_m
        curves = np.sqrt(self._limit[ahead] ** 2 + 2 * style.braking_mps2 * way[ahead])
        here = self._limit[~ahead][-1]
        limit = min(float(here), float(curves.min(initial=math.inf)))
        stop = math.sqrt(2 * style.approach_mps2 * max(self.end_m - s_m, 0.0))
        lower = style.below_limit_mps + max(self._wander, -style.below_limit_mps + 0.3)
        return min(limit - lower, stop, self.vehicle.max_speed_mps)


def _limits_for_head(route: Route, vehicle: Vehicle, end_m: float) -> tuple[Floats, Floats]:
    """Limits as the head meets them: a lower one holds until the tail has left it."""
    starts = route.limits_mps.start_m
    places = np.unique(np.concatenate((starts, starts + vehicle.train_length_m)))
    places = places[places < end_m]
    limit = route.limits_mps.minimum(places - vehicle.train_length_m, places + 0.5)
    return places, limit
