"""Whether the measured forces can be trusted: checks of the force sensor that do not rest on the sensor alone.

A gain of the sensor goes into mass and resistance alike, and no motion under measured forces tells it from them. What
can be told: a force that the train does not have; a train that coasts on known gradients, where the force is zero
whatever the gain is; and mass and resistance that are off by one and the same factor, as a gain makes them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from das.domain.vehicle import Vehicle
from das.estimate.belief import Belief
from das.estimate.calibration_settings import CalibrationSettings, ForceSettings
from das.estimate.ratios import Estimates, ForceDoubt, RatioLearner
from das.estimate.window import MeasuredWindow, Sample


class ForceLimits:
    """Compares measured forces with the largest ones that the train has at its speed."""

    def __init__(self, vehicle: Vehicle, settings: ForceSettings) -> None:
        self._vehicle, self._settings = vehicle, settings
        self._in_a_row = 0
        self.exceeded = False
        """Whether forces were above the train's own for long enough to be no noise; it stays so for this train."""

    def take(self, sample: Sample) -> None:
        """Take note of the forces of one moment."""
        train, ratio = self._vehicle, self._settings.too_strong_ratio
        electric_n = sample.force_n - sample.friction_n
        largest_n = train.traction_effort_n if electric_n > 0 else train.electric_brake_effort_n
        is_above = abs(electric_n) > ratio * float(largest_n(sample.speed_mps))
        is_above = is_above or -sample.friction_n > ratio * train.friction_brake_force_n
        self._in_a_row = self._in_a_row + 1 if is_above else 0
        self.exceeded |= self._in_a_row >= self._settings.too_strong_samples


class CheckedLearner:
    """Learns mass and resistance, and checks the forces behind them.

    A coasting train has 0 = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², whatever its force sensor
    says. Windows of coasting are therefore compared with what windows under forces say of the two ratios.
    """

    def __init__(self, vehicle: Vehicle, settings: CalibrationSettings) -> None:
        self._settings = settings
        self._all, self._driven = RatioLearner(vehicle, settings), RatioLearner(vehicle, settings)
        self._limits, self._c0_n, self._mean = (
            ForceLimits(vehicle, settings.force),
            vehicle.resistance.c0_n,
            MeanResistance(),
        )
        self._distances_sds: deque[float] = deque(maxlen=settings.force.coasting_windows)

    def take(self, sample: Sample) -> None:
        """Take note of the forces of one moment."""
        self._limits.take(sample)

    def learn(self, window: MeasuredWindow) -> None:
        """Learn from one window."""
        self._mean.take(window)
        self._all.learn(window)
        if not window.coasts:
            self._driven.learn(window)
        elif self._driven.estimates.samples:
            self._distances_sds.append(self._driven.distance_sds(window))

    def change_load(self) -> None:
        """Take note that passengers may have got on and off, so that the mass may be another."""
        self._all.change_load()
        self._driven.change_load()
        self._distances_sds.clear()

    @property
    def estimates(self) -> Estimates:
        """What is known by now; of no use while the forces are doubted."""
        found, doubt = self._all.estimates, self._doubt
        return found if doubt is None else replace(found, usable=False, doubt=doubt)

    @property
    def _doubt(self) -> ForceDoubt | None:
        tuning, distances = self._settings.force, self._distances_sds
        if self._limits.exceeded:
            return ForceDoubt.TOO_STRONG
        full = len(distances) == tuning.coasting_windows
        if full and abs(sum(distances)) / len(distances) > tuning.coasting_sds:
            return ForceDoubt.COASTING
        known = self._all.estimates.usable
        if known and looks_like_gain(self._all.belief, self._c0_n, self._mean.moving_n, self._settings):
            return ForceDoubt.GAIN
        return None


class MeanResistance:
    """The mean of the speed-dependent resistance c1·v + c2·v² (N) over the windows that were learned from."""

    def __init__(self) -> None:
        self._sum_n, self._count = 0.0, 0

    def take(self, window: MeasuredWindow) -> None:
        """Take note of one window."""
        self._sum_n += window.moving_n
        self._count += 1

    @property
    def moving_n(self) -> float:
        """The mean (N); 0 before the first window."""
        return self._sum_n / self._count if self._count else 0.0


def looks_like_gain(belief: Belief, c0_n: float, moving_n: float, settings: CalibrationSettings) -> bool:
    """Whether mass and resistance are off by one factor, so far as they are known: a gain would look the same.

    A gain γ gives µ = γ and κ·(µ·c0 + r) = γ·(c0 + r), with r = c1·v + c2·v² (`moving_n`). What the two sides differ
    by, over c0 + r, is compared with its standard deviation, provided that the mass is certainly not as planned.
    """
    mass, resistance = belief.theta
    all_n = c0_n + moving_n
    apart = (resistance * (mass * c0_n + moving_n)) / all_n - mass
    row = np.array([resistance * c0_n / all_n - 1.0, (mass * c0_n + moving_n) / all_n])
    model = np.diag(np.square(settings.belief.model_sd))
    covariance = belief.covariance + model
    is_off = abs(mass - 1.0) >= max(settings.force.gain_step, settings.force.gain_sds * float(covariance[0, 0]) ** 0.5)
    return bool(is_off and apart**2 <= settings.force.gain_sds**2 * float(row @ covariance @ row))
