"""Simulated sensors: positions with noise and the faults of the day, efforts with noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from das.estimate.effort import Effort
from das.estimate.fix import PositionFix, Quality
from das.estimate.localisation_settings import LEAST_SD_M, LEAST_SD_MPS
from sim.plant.plant import PlantState
from sim.world.day import Day
from sim.world.disturbances import SensorFault, SensorOutage

CORRELATION_S = 30.0
"""The error of a receiver's position wanders with this time constant (s, assumption)."""
STREAM, FORCE_STREAM = 2, 3
"""Numbers of the streams of random numbers among those of a seed. Stream 1 draws what happens; drivers make their own.
"""


class SimulatedLocalisation:
    """Positions of a day, one a tick; `measure` is to be called in the order of time."""

    def __init__(self, day: Day) -> None:
        self._sensors, self._faults = day.service.scenario.sensors, day.of(SensorOutage)
        self._service = day.service
        self._random = np.random.default_rng([day.seed, STREAM])
        self._keep = math.exp(-1.0 / CORRELATION_S)
        self._offset_m = 0.0
        self._last: PositionFix | None = None

    def measure(self, state: PlantState) -> PositionFix | None:
        """The position that localisation reports in a state; None in a dropout."""
        fix = self._fix(state)
        for fault in self._faults:
            if fault.from_s <= state.time_s < fault.from_s + fault.for_s:
                if fault.fault is SensorFault.DROPOUT:
                    return None
                fix = self._faulty(fix, fault)
        self._last = fix
        return fix

    def _fix(self, state: PlantState) -> PositionFix:
        sensors = self._sensors
        wander, noise = self._random.standard_normal(2).tolist()
        spread_m = sensors.position_noise_m * math.sqrt(1.0 - self._keep**2)
        self._offset_m = self._keep * self._offset_m + spread_m * wander
        moving = state.speed_mps > 0
        return PositionFix(
            time_ns=self._service.moment_ns(state.time_s),
            s_m=state.s_m + (self._offset_m if moving else 0.0),
            speed_mps=max(state.speed_mps + sensors.speed_noise_mps * noise, 0.0) if moving else 0.0,
            uncertainty_m=max(sensors.position_noise_m, LEAST_SD_M),
            speed_uncertainty_mps=max(sensors.speed_noise_mps, LEAST_SD_MPS),
        )

    def _faulty(self, fix: PositionFix, fault: SensorOutage) -> PositionFix:
        """The position that a faulty receiver reports: it notices its noise, but not that it jumped or is frozen."""
        if fault.fault is SensorFault.JUMP:
            return replace(fix, s_m=fix.s_m + fault.size_m)
        if fault.fault is SensorFault.NOISE:
            off_m = fault.size_m * float(self._random.standard_normal())
            spread_m = math.hypot(fix.uncertainty_m, fault.size_m)
            return replace(fix, s_m=fix.s_m + off_m, uncertainty_m=spread_m, quality=Quality.DEGRADED)
        return replace(self._last or fix, time_ns=fix.time_ns)


class TrainControl:
    """Efforts of a day as the train's own control measures them; `measure` is to be called once a tick."""

    def __init__(self, day: Day) -> None:
        self._service, self._noise_ratio = day.service, day.service.scenario.sensors.force_noise_ratio
        self._random = np.random.default_rng([day.seed, FORCE_STREAM])

    def measure(self, state: PlantState) -> Effort | None:
        """The measured forces of a state, each with its own noise; None if the scenario does not ask for them."""
        if self._noise_ratio is None:
            return None
        electric, friction = (1.0 + self._noise_ratio * self._random.standard_normal(2)).tolist()
        return Effort(
            time_ns=self._service.moment_ns(state.time_s),
            force_el_n=electric * state.force_el_n,
            force_friction_n=friction * state.force_friction_n,
        )
