"""Mass and running resistance as ratios of the planned train's, learned from windows of measurements.

The measured forces are checked, because a wrong gain of the force sensor changes mass and resistance alike, and no
motion under measured forces shows the difference. Three things give a wrong sensor away: a force that the train cannot
have; a coasting train on known gradients, where the force is zero whatever the gain is; and mass and resistance that
are off by one and the same factor, as a gain would make them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from das.domain.conditions import Conditions
from das.domain.route import Floats
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from das.estimate.window import MeasuredWindow, Sample


class MassAndResistance(NamedTuple):
    """One figure for the mass ratio and one for the resistance ratio."""

    mass: float
    resistance: float


LINE_SD_RATIO: Final = 2e-4
"""Uncertainty of gradients and curves under the train, as a share of its weight (one standard deviation)."""
TOO_STRONG_RATIO: Final = 1.06
"""Multiple of the train's largest force at its speed above which noise of 2 % does not explain a measured force."""
TOO_STRONG_SAMPLES: Final = 5
"""Samples in a row with forces that are too strong after which the sensor is taken to measure too much."""
COASTING_WINDOWS: Final = 4
"""Windows of coasting that are compared with the estimate from windows with traction or braking."""
COASTING_SDS: Final = 3.0
"""Mean difference of the coasting windows from that estimate (standard deviations) above which coasting contradicts the
measured forces."""
GAIN_STEP: Final = 0.03
"""Distance of the mass ratio from 1 below which the plan would not change, so that no wrong gain of the sensor is
looked for."""
GAIN_SDS: Final = 3.0
"""Difference between mass and resistance ratio (standard deviations) below which a wrong gain of the force sensor may
explain both."""
NEAR_MASS_LEAST: Final = 0.7
"""Mass ratio below which both explanations are reported: another train than planned, or a wrong force sensor."""
NEAR_MASS_MOST: Final = 1.4
"""Mass ratio above which both explanations are reported: another train than planned, or a wrong force sensor."""
PRIOR_SD: Final = MassAndResistance(0.15, 0.3)
"""Standard deviations of the two ratios before anything is measured."""
LEAST: Final = MassAndResistance(0.5, 0.4)
"""The least values of the two estimates: an empty train, and a long tail wind."""
MOST: Final = MassAndResistance(1.6, 2.5)
"""The largest values of the two estimates: an overloaded train, and a storm from ahead."""
FORGETTING: Final = 0.98
"""Factor on the weight of an observation at every later one about the same ratio: the memory is about 50 windows, 17
minutes."""
INFORMATIVE_SDS: Final = 2.0
"""Least standard deviations of its noise by which the prior spread of the ratios (`PRIOR_SD`) would show in a window
that counts."""
SURPRISE_SDS: Final = 4.0
"""Distance from the expectation (standard deviations) above which a window is left out: wheels slipped, a sensor
failed, or a force is unknown."""
SURPRISES: Final = 3
"""Surprising windows in a row that mean changed conditions: the resistance is learned again."""
MODEL_SD: Final = MassAndResistance(0.005, 0.015)
"""The uncertainty that no amount of measuring removes (one standard deviation): forces between samples are unknown,
and so is the exact shape of the resistance."""
USABLE_SD: Final = MassAndResistance(0.02, 0.08)
"""Largest standard deviations with which the estimates are usable."""
LOAD_MASS_SD: Final = 0.05
"""Standard deviation of the mass after a stop that long, as a share of the train's: 500 people in a train of 440 t are
9 %."""
MASS_STEP: Final = 0.03
"""Difference from the plan's mass ratio below which another plan is not worth while."""
RESISTANCE_STEP: Final = 0.05
"""Difference from the plan's resistance ratio below which another plan is not worth while."""
CERTAIN_SDS: Final = 3.0
"""Standard deviations below which a difference is too uncertain for another plan."""


class Belief(NamedTuple):
    """The estimate θ (n,) of n unknowns and its covariance P (n, n)."""

    theta: Floats
    covariance: Floats

    def updated(self, row: Floats, residual: float, variance: float, forgetting: float = 1.0) -> Belief:
        """Return the belief after one observation y = φ·θ + noise.

        `row` is φ (n,), `residual` is y − φ·θ at the present estimate, and `variance` is that of the noise, r.

            K = Pφ/(r + φᵀPφ),  θ ← θ + K·(y − φ·θ),  P ← P − KφᵀP

        Before that comes directional forgetting (Kulhavý 1987), P ← P + (1/λ − 1)·PφφᵀP/(φᵀPφ), which forgets only
        in the direction of this observation; λ is `forgetting`, and 1 forgets nothing.
        """
        toward = self.covariance @ row
        spread = float(row @ toward)
        if not spread > 0:
            return self
        widened = spread / forgetting
        theta = self.theta + toward * (residual * widened / (spread * (variance + widened)))
        # Along Pφ the variance of φᵀθ goes from spread to widened, and from there to widened·r/(widened + r).
        kept = widened * variance / ((widened + variance) * spread)
        return Belief(theta, self.covariance - np.outer(toward, toward) * ((1.0 - kept) / spread))


class ForceDoubt(StrEnum):
    """Why the measured forces are not trusted, so that no plan uses estimates from them; FAR_MASS is only reported."""

    TWO_PUBLISHERS = "two-publishers"
    """Two publishers measure the forces of one train."""
    CLOCKS = "clocks"
    """Forces and positions are measured by clocks that differ, so that they do not belong together."""
    TOO_STRONG = "too-strong"
    """The forces are above those that the motors and brakes of the train can exert."""
    COASTING = "coasting"
    """While coasting on known gradients, the train moves differently from what the measured forces imply."""
    GAIN = "gain"
    """Mass and resistance are off by the same factor, which a wrong gain of the sensor would explain as well."""
    FAR_MASS = "far-mass"
    """The mass is far from the planned one: another train, or a wrong sensor. It is used, and reported."""


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
    """Windows on which the estimates rest."""
    usable: bool
    """Whether both ratios are known well enough and lie within their bounds, and the forces behind them are trusted."""
    doubt: ForceDoubt | None = None
    """Why the forces are not trusted; None if they are."""

    def differs(self, conditions: Conditions) -> bool:
        """Whether the train certainly differs from one under these conditions, and by enough to replan."""
        mass = abs(self.planned_mass_ratio - conditions.mass_ratio)
        resistance = abs(self.resistance_ratio - conditions.resistance_ratio)
        return self.usable and (
            mass >= max(MASS_STEP, CERTAIN_SDS * self.mass_sd)
            or resistance >= max(RESISTANCE_STEP, CERTAIN_SDS * self.resistance_sd)
        )

    def remark(self) -> ForceDoubt | None:
        """Return what to report: a doubt about the forces, or a usable mass far from the planned one; else None."""
        near = NEAR_MASS_LEAST < self.mass_ratio < NEAR_MASS_MOST
        return ForceDoubt.FAR_MASS if self.usable and not near else self.doubt

    @property
    def planned_mass_ratio(self) -> float:
        """The mass ratio to plan with: never below 1, so that no plan counts on a lighter train's better brakes."""
        return max(self.mass_ratio, 1.0)

    def applied(self, conditions: Conditions) -> Conditions:
        """Return these conditions with the mass and the resistance to plan with."""
        return replace(conditions, mass_ratio=self.planned_mass_ratio, resistance_ratio=self.resistance_ratio)


class RatioLearner:
    """Learns the two ratios from one window after the other."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._prior = np.diag(np.square(PRIOR_SD))
        self._belief = Belief(np.ones(2), self._prior)
        self._samples, self._surprises = 0, 0

    @property
    def belief(self) -> Belief:
        """The two ratios and their covariance."""
        return self._belief

    @property
    def estimates(self) -> Estimates:
        """The estimates from all windows so far, without any check of the forces."""
        theta = self._belief.theta
        sd = np.hypot(np.sqrt(np.diag(self._belief.covariance)), MODEL_SD)
        inside = bool(((theta > LEAST) & (theta < MOST)).all())
        return Estimates(
            mass_ratio=float(theta[0]),
            mass_sd=float(sd[0]),
            resistance_ratio=float(theta[1]),
            resistance_sd=float(sd[1]),
            samples=self._samples,
            usable=inside and bool((sd <= USABLE_SD).all()),
        )

    def change_load(self) -> None:
        """Make the mass less certain: passengers may have got on and off."""
        self._belief = self._with_other_load()

    def learn(self, window: MeasuredWindow) -> None:
        """Learn from one window.

        F = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², made linear at the mass ratio µ and the
        resistance ratio κ believed so far. A window with little information, or far from what is expected, is left out.
        """
        belief = self._belief
        row, residual, variance = self._observation(window)
        if row @ self._prior @ row < INFORMATIVE_SDS**2 * variance:
            return
        spread = float(row @ belief.covariance @ row) + variance
        if residual**2 > SURPRISE_SDS**2 * spread:
            self._surprises += 1
            if self._surprises < SURPRISES:
                return
            # The resistance may be anything now; the mass changes little on the way, if at all.
            mass_variance = self._with_other_load().covariance[0, 0]
            belief = Belief(belief.theta, np.diag([mass_variance, PRIOR_SD.resistance**2]))
        self._surprises = 0
        learned = belief.updated(row, residual, variance, FORGETTING)
        if (np.diag(learned.covariance) > np.square(PRIOR_SD)).any():
            learned = belief.updated(row, residual, variance)
        self._belief = learned._replace(theta=np.clip(learned.theta, LEAST, MOST))
        self._samples += 1

    def distance_sds(self, window: MeasuredWindow) -> float:
        """Return how far a window is from what the ratios predict, in standard deviations of both together."""
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
        line_n = LINE_SD_RATIO * mass * train.mass_kg * STANDARD_GRAVITY_MPS2
        row = np.array([pull_n + resistance * c0_n, mass * c0_n + window.moving_n])
        return row, float(residual_n), float(moved_variance + line_n**2 + window.force_variance)

    def _with_other_load(self) -> Belief:
        """Return the belief with a less certain mass, but never less certain than before anything was measured."""
        covariance = self._belief.covariance.copy()
        widened = covariance[0, 0] + LOAD_MASS_SD**2
        covariance[0, 0] = min(widened, PRIOR_SD.mass**2)
        return Belief(self._belief.theta, covariance)


class ForceLimits:
    """Compares measured forces with the largest ones that the train has at its speed."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._in_a_row = 0
        self.exceeded = False
        """Whether forces were above the train's own for longer than noise explains; once True, it stays True."""

    def take(self, sample: Sample) -> None:
        """Check the forces of one sample."""
        train = self._vehicle
        electric_n = sample.force_n - sample.friction_n
        largest_n = train.traction_effort_n if electric_n > 0 else train.electric_brake_effort_n
        is_above = abs(electric_n) > TOO_STRONG_RATIO * float(largest_n(sample.speed_mps))
        is_above = is_above or -sample.friction_n > TOO_STRONG_RATIO * train.friction_brake_force_n
        self._in_a_row = self._in_a_row + 1 if is_above else 0
        self.exceeded |= self._in_a_row >= TOO_STRONG_SAMPLES


class CheckedLearner:
    """Learns mass and resistance, and checks the forces behind them.

    A coasting train has 0 = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², whatever its force sensor
    measures. Windows of coasting are therefore compared with the two ratios learned from windows under force.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._all, self._driven = RatioLearner(vehicle), RatioLearner(vehicle)
        self._limits, self._mean = ForceLimits(vehicle), MeanResistance()
        self._c0_n = vehicle.resistance.c0_n
        self._distances_sds: deque[float] = deque(maxlen=COASTING_WINDOWS)

    def take(self, sample: Sample) -> None:
        """Check the forces of one sample."""
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
        """Make the mass less certain: passengers may have got on and off."""
        self._all.change_load()
        self._driven.change_load()
        self._distances_sds.clear()

    @property
    def estimates(self) -> Estimates:
        """The estimates from all windows so far; not usable while the forces are doubted."""
        found, doubt = self._all.estimates, self._doubt
        return found if doubt is None else replace(found, usable=False, doubt=doubt)

    @property
    def _doubt(self) -> ForceDoubt | None:
        distances = self._distances_sds
        if self._limits.exceeded:
            return ForceDoubt.TOO_STRONG
        full = len(distances) == COASTING_WINDOWS
        if full and abs(sum(distances)) / len(distances) > COASTING_SDS:
            return ForceDoubt.COASTING
        known = self._all.estimates.usable
        if known and looks_like_gain(self._all.belief, self._c0_n, self._mean.moving_n):
            return ForceDoubt.GAIN
        return None


class MeanResistance:
    """The mean of the speed-dependent resistance c1·v + c2·v² (N) over all windows."""

    def __init__(self) -> None:
        self._sum_n, self._count = 0.0, 0

    def take(self, window: MeasuredWindow) -> None:
        """Add one window to the mean."""
        self._sum_n += window.moving_n
        self._count += 1

    @property
    def moving_n(self) -> float:
        """The mean (N); 0 before the first window."""
        return self._sum_n / self._count if self._count else 0.0


def looks_like_gain(belief: Belief, c0_n: float, moving_n: float) -> bool:
    """Whether mass and resistance are off by the same factor, as far as they are known: a wrong gain looks like that.

    A gain γ gives µ = γ and κ·(µ·c0 + r) = γ·(c0 + r), with r = c1·v + c2·v² (`moving_n`). The difference of the two
    sides, divided by c0 + r, is compared with its standard deviation, if the mass certainly differs from the plan.
    """
    mass, resistance = belief.theta
    all_n = c0_n + moving_n
    apart = (resistance * (mass * c0_n + moving_n)) / all_n - mass
    row = np.array([resistance * c0_n / all_n - 1.0, (mass * c0_n + moving_n) / all_n])
    model = np.diag(np.square(MODEL_SD))
    covariance = belief.covariance + model
    is_off = abs(mass - 1.0) >= max(GAIN_STEP, GAIN_SDS * float(covariance[0, 0]) ** 0.5)
    return bool(is_off and apart**2 <= GAIN_SDS**2 * float(row @ covariance @ row))
