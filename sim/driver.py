"""A simulated driver without advice: as fast as allowed, brakes for what comes, with a human's unsteadiness."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from das.domain.route import Floats, Route
from das.domain.units import KMH
from das.domain.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class DriverStyle:
    """How a driver drives; all figures are assumptions of a plausible size."""

    below_limit_mps: float = 3.0 * KMH
    """Keeps this much below the limit."""
    braking_mps2: float = 0.45
    """Plans braking with this deceleration."""
    approach_mps2: float = 0.35
    """Plans the last braking to the stop with this deceleration."""
    full_effort_error_mps: float = 2.0
    """Uses full effort when this much too slow or too fast."""
    wander_mps: float = 2.0 * KMH
    wander_s: float = 40.0
    """The speed aimed at wanders by this (standard deviation) with this correlation time."""


class HurriedDriver:
    """Aims at a speed under the limits and the braking curves ahead, and steers force towards it."""

    def __init__(self, route: Route, vehicle: Vehicle, end_m: float, seed: int, style: DriverStyle) -> None:
        self.vehicle, self.end_m, self.style = vehicle, end_m, style
        self._random = np.random.default_rng(seed)
        self._wander = 0.0
        self._at_m, self._limit = _limits_for_head(route, vehicle, end_m)

    def wanted_force_n(self, s_m: float, speed_mps: float, step_s: float) -> float:
        """Wheel force the driver sets now (N)."""
        style = self.style
        decay = math.exp(-step_s / style.wander_s)
        self._wander = (
            decay * self._wander + style.wander_mps * math.sqrt(1 - decay**2) * self._random.standard_normal()
        )
        error = self._aim(s_m) - speed_mps
        share = min(max(error / style.full_effort_error_mps, -1.0), 1.0)
        hold = float(self.vehicle.resistance.force_n(speed_mps))
        if share >= 0:
            return hold + share * (float(self.vehicle.traction_effort_n(speed_mps)) - hold)
        return hold + share * self.vehicle.inertial_mass_kg * 2.0 * style.braking_mps2

    def _aim(self, s_m: float) -> float:
        """The speed to aim at: limit here and braking curves to what comes, less a margin; the stop exactly."""
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
    places = np.unique(np.concatenate((starts, starts + vehicle.length_m)))
    places = places[places < end_m]
    limit = route.limits_mps.minimum(places - vehicle.length_m, places + 0.5)
    return places, limit
