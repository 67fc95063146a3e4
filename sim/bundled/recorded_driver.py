"""The driver of the bundled recording, who can be shown the guide in a new simulation.

The way of driving is kept as it was when the recording was made; `tests/support/make_trip.py` remakes it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from das.domain.route import Floats, Route
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from sim.drivers.cab import AdviceView, Asked, CabView, asked
from sim.drivers.handling import CREEPS_MPS
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import Command
from sim.plant.plant import COAST, Efforts, lever

LOOK_S: Final = 0.2
"""The time (s) between two looks out of the window and at the speedometer."""
GLANCE_S: Final = 5.0
"""The time (s) between two glances at the display; an assumption, the mean of the default human driver."""
BELOW_LIMIT_MPS: Final = 3.0 * KMH
"""Margin (m/s) that the driver keeps below the limit; it and the values below are plausible assumptions."""
BRAKING_MPS2: Final = 0.45
"""Deceleration (m/s²) with which the driver plans braking."""
APPROACH_MPS2: Final = 0.35
"""Deceleration (m/s²) with which the driver plans the last braking to the stop."""
FULL_EFFORT_ERROR_MPS: Final = 2.0
"""Least deviation (m/s) of the speed for which the driver uses full effort."""
WANDER_MPS: Final = 2.0 * KMH
"""Standard deviation (m/s) of the error of the intended speed."""
WANDER_S: Final = 40.0
"""Correlation time (s) of that error."""


class HurriedDriver:
    """Intends a speed under the limits and the braking curves ahead, and sets the force to reach it."""

    def __init__(self, route: Route, vehicle: Vehicle, end_m: float, seed: int, wander_mps: float = WANDER_MPS) -> None:
        self.vehicle, self.end_m, self.wander_mps = vehicle, end_m, wander_mps
        self._random = np.random.default_rng(seed)
        self._wander = 0.0
        self._at_m, self._limit = _limits_for_head(route, vehicle, end_m)

    def wanted_force_n(self, s_m: float, speed_mps: float, step_s: float, top_mps: float = math.inf) -> float:
        """Wheel force (N) that the driver sets now, to keep the limits and a top speed received from the guide."""
        decay = math.exp(-step_s / WANDER_S)
        self._wander = decay * self._wander + self.wander_mps * math.sqrt(1 - decay**2) * self._random.standard_normal()
        error = min(self._aim(s_m), top_mps) - speed_mps
        share = min(max(error / FULL_EFFORT_ERROR_MPS, -1.0), 1.0)
        hold = float(self.vehicle.resistance.force_n(speed_mps))
        if share >= 0:
            return hold + share * (float(self.vehicle.traction_effort_n(speed_mps)) - hold)
        return hold + share * self.vehicle.inertial_mass_kg * 2.0 * BRAKING_MPS2

    def _aim(self, s_m: float) -> float:
        """The intended speed: limit here and braking curves to limits ahead, less a margin (none for the stop)."""
        way = np.maximum(self._at_m - s_m, 0.0)
        ahead = self._at_m > s_m
        curves = np.sqrt(self._limit[ahead] ** 2 + 2 * BRAKING_MPS2 * way[ahead])
        here = self._limit[~ahead][-1]
        limit = min(float(here), float(curves.min(initial=math.inf)))
        stop = math.sqrt(2 * APPROACH_MPS2 * max(self.end_m - s_m, 0.0))
        lower = BELOW_LIMIT_MPS + max(self._wander, -BELOW_LIMIT_MPS + 0.3)
        return min(limit - lower, stop, self.vehicle.max_speed_mps)


def _limits_for_head(route: Route, vehicle: Vehicle, end_m: float) -> tuple[Floats, Floats]:
    """Limits as the head meets them: a lower one holds until the tail has left it."""
    starts = route.limits_mps.start_m
    places = np.unique(np.concatenate((starts, starts + vehicle.train_length_m)))
    places = places[places < end_m]
    limit = route.limits_mps.minimum(places - vehicle.train_length_m, places + 0.5)
    return places, limit


class RecordedDriver:
    """Drives as in the bundled recording: without advice as fast as the limits allow, regardless of the time. With the
    guide, follows the instruction read at the last glance (`sim.drivers.cab`) with at most its effort, in the same
    manner and with the same speed errors. Limits of the line and stops are kept in any case; temporary restrictions are
    not known, because the trip has none. The motors brake first, as on the train of the recording.
    """

    def __init__(self, line: LineKnowledge, seed: int = 0) -> None:
        self.line, self.seed = line, seed
        self.own: HurriedDriver | None = None
        self.read: AdviceView | None = None
        self.glances_s = -math.inf

    def command(self, cab: CabView) -> Command:
        """The controller's setting until the next look."""
        if cab.shall_stand:
            return COAST
        if self.own is None or self.own.end_m != cab.halt_m:
            self.own = HurriedDriver(self.line.route, self.line.vehicle, cab.halt_m, self.seed)
        if cab.time_s >= self.glances_s or cab.speed_mps <= 0:
            self.read, self.glances_s = cab.shown and cab.shown.departure, cab.time_s + GLANCE_S
        efforts = Efforts.at(cab.speed_mps, self.line.train)
        top_mps, most_n = _told(self.read, cab.speed_mps, efforts)
        force_n = min(self.own.wanted_force_n(cab.s_m, cab.speed_mps, LOOK_S, top_mps), most_n)
        if cab.s_m >= cab.halt_m:  # Beyond the mark the train must stand.
            force_n = min(force_n, -self.line.train.inertial_mass_kg * BRAKING_MPS2)
        return lever(efforts.lever_ratio(force_n))


def _told(view: AdviceView | None, speed_mps: float, efforts: Efforts) -> tuple[float, float]:
    """The top speed (m/s) and the largest force (N) that the guide asks for at a speed; infinite without advice."""
    if view is None:
        return math.inf, math.inf
    to_mps, effort = view.shown_speed_mps, view.lever_ratio
    return {
        None: (math.inf, math.inf),
        Asked.ACCELERATE: (to_mps, effort * efforts.traction_n),
        Asked.HOLD: (to_mps, math.inf),
        Asked.COAST: (math.inf, 0.0),
        Asked.BRAKE: (math.inf, effort * efforts.brakes_n),
        Asked.BRAKE_BY_EYE: (max(speed_mps, CREEPS_MPS), math.inf),  # No speeding up before braking.
        Asked.KEEP_BELOW: (to_mps, 0.0),
    }[asked(view.mode, to_mps, effort, speed_mps)]
