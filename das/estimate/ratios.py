"""Mass and running resistance as ratios of the planned train's, learned from windows of measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from das.domain.conditions import Conditions
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from das.estimate.belief import Belief, Floats
from das.estimate.calibration_settings import DEFAULT, CalibrationSettings, ForceSettings, ReplanSettings
from das.estimate.window import MeasuredWindow


class ForceDoubt(StrEnum):
    """Why the measured forces are not trusted, so that nothing is planned with what they say."""

    TWO_PUBLISHERS = "two-publishers"
    """Two publishers measure the forces of one train."""
    CLOCKS = "clocks"
    """Forces and positions are measured by clocks that differ, so that they do not belong together."""
    TOO_STRONG = "too-strong"
    """The forces are above those that the motors and brakes of the train have."""
    COASTING = "coasting"
    """Without any force, on known gradients, the train moves otherwise than the forces say."""
    GAIN = "gain"
    """Mass and resistance are off by the same factor, which a gain of the sensor would explain as well."""
    FAR_MASS = "far-mass"
    """The mass is far from the planned one: another train, or a sensor that is wrong. It is used, but not silently."""


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """Mass and running resistance as ratios of the planned train's, each with one standard deviation.

    The ratios are those of `das.domain.conditions.Conditions`: the resistance c0 grows with the mass, and the
    resistance ratio multiplies all of the running resistance. The wind is part of the resistance.
    """

    mass_ratio: float
    mass_sd: float
    resistance_ratio: float
    resistance_sd: float
    samples: int
    """How many windows counted."""
    usable: bool
    """Whether both ratios are known well enough and lie within their bounds, and the forces behind them are trusted."""
    doubt: ForceDoubt | None = None
    """Why the forces are not trusted."""

    def differs(self, conditions: Conditions, settings: ReplanSettings = DEFAULT.replan) -> bool:
        """Whether the train certainly differs from one under these conditions, and by enough to plan anew."""
        mass = abs(self.planned_mass_ratio - conditions.mass_ratio)
        resistance = abs(self.resistance_ratio - conditions.resistance_ratio)
        return self.usable and (
            mass >= max(settings.mass_step, settings.certain_sds * self.mass_sd)
            or resistance >= max(settings.resistance_step, settings.certain_sds * self.resistance_sd)
        )

    def remark(self, settings: ForceSettings = DEFAULT.force) -> ForceDoubt | None:
        """Return what is to be said: the doubt, or that the mass to be used is far from the planned one."""
        near = settings.near_mass_least < self.mass_ratio < settings.near_mass_most
        return ForceDoubt.FAR_MASS if self.usable and not near else self.doubt

    @property
    def planned_mass_ratio(self) -> float:
        """The mass ratio to plan with: never below 1, because the brakes of a lighter train would be better."""
        return max(self.mass_ratio, 1.0)

    def applied(self, conditions: Conditions) -> Conditions:
        """Return the conditions with mass and resistance as they are to be planned with."""
        return replace(conditions, mass_ratio=self.planned_mass_ratio, resistance_ratio=self.resistance_ratio)


class RatioLearner:
    """Learns the two ratios from windows, one after the other."""

    def __init__(self, vehicle: Vehicle, settings: CalibrationSettings) -> None:
        self._vehicle, self._settings = vehicle, settings
        self._prior = np.diag(np.square(settings.belief.prior_sd))
        self._belief = Belief(np.ones(2), self._prior)
        self._samples, self._surprises = 0, 0

    @property
    def belief(self) -> Belief:
        """The two ratios and their covariance."""
        return self._belief

    @property
    def estimates(self) -> Estimates:
        """What is known by now, whatever speaks against the forces."""
        tuning, theta = self._settings.belief, self._belief.theta
        sd = np.hypot(np.sqrt(np.diag(self._belief.covariance)), tuning.model_sd)
        inside = bool(((theta > tuning.least) & (theta < tuning.most)).all())
        return Estimates(
            mass_ratio=float(theta[0]),
            mass_sd=float(sd[0]),
            resistance_ratio=float(theta[1]),
            resistance_sd=float(sd[1]),
            samples=self._samples,
            usable=inside and bool((sd <= tuning.usable_sd).all()),
        )

    def change_load(self) -> None:
        """Take note that passengers may have got on and off, so that the mass may be another."""
        self._belief = self._with_other_load()

    def learn(self, window: MeasuredWindow) -> None:
        """Learn from one window.

        F = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², made linear at the mass ratio µ and the
        resistance ratio κ believed so far. A window that tells little, or that nobody expected, is left out.
        """
        tuning, belief = self._settings.belief, self._belief
        row, residual, variance = self._observation(window)
        if row @ self._prior @ row < tuning.informative_sds**2 * variance:
            return
        spread = float(row @ belief.covariance @ row) + variance
        if residual**2 > tuning.surprise_sds**2 * spread:
            self._surprises += 1
            if self._surprises < tuning.surprises:
                return
            # What holds the train back may be anything now; its mass changes little on the way, if at all.
            mass_variance = self._with_other_load().covariance[0, 0]
            belief = Belief(belief.theta, np.diag([mass_variance, tuning.prior_sd.resistance**2]))
        self._surprises = 0
        learned = belief.updated(row, residual, variance, tuning.forgetting)
        if (np.diag(learned.covariance) > np.square(tuning.prior_sd)).any():
            learned = belief.updated(row, residual, variance)
        self._belief = learned._replace(theta=np.clip(learned.theta, tuning.least, tuning.most))
        self._samples += 1

    def distance_sds(self, window: MeasuredWindow) -> float:
        """Return how far a window is from what the ratios say, in standard deviations of both."""
        row, residual, variance = self._observation(window)
        return residual / float(np.sqrt(row @ self._belief.covariance @ row + variance))

    def _observation(self, window: MeasuredWindow) -> tuple[Floats, float, float]:
        """Return the row, the residual (N) and the variance (N²) of a window."""
        train, (mass, resistance) = self._vehicle, self._belief.theta
        c0_n = train.resistance.c0_n
        pull_n = train.mass_kg * (window.acceleration_mps2 + window.line_mps2)
        rotating_kg = train.mass_kg * train.rotating_mass_ratio
        held_n = resistance * (mass * c0_n + window.moving_n) + window.tunnel_n
        residual_n = window.force_n - mass * pull_n - rotating_kg * window.acceleration_mps2 - held_n
        moved_variance = (mass * train.mass_kg + rotating_kg) ** 2 * window.acceleration_variance
        line_n = self._settings.window.line_sd_ratio * mass * train.mass_kg * STANDARD_GRAVITY_MPS2
        row = np.array([pull_n + resistance * c0_n, mass * c0_n + window.moving_n])
        return row, float(residual_n), float(moved_variance + line_n**2 + window.force_variance)

    def _with_other_load(self) -> Belief:
        """Return the belief with a mass that may be another, but never less known than before anything was measured."""
        covariance = self._belief.covariance.copy()
        widened = covariance[0, 0] + self._settings.load.mass_sd**2
        covariance[0, 0] = min(widened, self._settings.belief.prior_sd.mass**2)
        return Belief(self._belief.theta, covariance)
