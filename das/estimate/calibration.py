"""Online calibration: mass and running resistance of the train from how it moves under the forces it measures.

Pure and deterministic: no bus, no clock, no randomness. Per window of samples one row of a least-squares problem
(docs/explanation/calibration.md); two ratios against the planned train are estimated recursively.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.conditions import Conditions
from das.domain.formulary import adhesion_coefficient
from das.domain.route import NEUTRAL, Route
from das.domain.units import NS, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from das.estimate.localisation import OVERSPEED_RATIO, STANDSTILL_MPS
from das.solver.section import LineProfile

Floats = NDArray[np.float64]

WINDOW_SAMPLES = 20
"""Samples of a window: at 1 Hz and 0.05 m/s of noise their slope gives the acceleration to 0.002 m/s²."""
SAMPLE_EVERY_S, LONGEST_GAP_S = 0.9, 2.5
"""Samples nearer together than the first are passed over; with a gap longer than the second the window begins anew."""
SLOWEST_MPS = 5.0
"""Below it brakes are released, couplers stretch and resistance does not follow Davis."""
SPEED_SD_MPS = 0.05
"""Least noise of the speed, one standard deviation; a window whose speeds scatter more is trusted less."""
NORMAL_MAD = 0.6745
"""Median size of a normal variable in standard deviations."""
FORCE_SD_RATIO, FRICTION_SD_RATIO = 0.02, 0.1
"""Noise of each measured force, and the standing error of the friction brake's, known from cylinder pressures only."""
LINE_SD_RATIO = 2e-4
"""How well gradients and curves under the train are known in a window (0.2 permille)."""
PRIOR_SD = (0.15, 0.3)
"""Standard deviations of the two ratios before anything is measured."""
LEAST_RATIO, MOST_RATIO = (0.5, 0.4), (1.6, 2.5)
"""Bounds of the estimates: an empty and an overloaded train; a long tail wind, and a storm from ahead."""
FORGETTING = 0.98
"""What an observation counts for after another one that says the same: a memory of about 50 windows, 17 minutes."""
STANDS_FOR_S = 20.0
"""A train that stands as long may have let passengers on and off …"""
STOP_MASS_SD = 0.05
"""… whose mass is known to this ratio of the train's (500 people in a train of 440 t: 9 %)."""
INFORMATIVE_SD = 2.0
"""A window counts where the prior's spread shows in it by at least so many standard deviations of its noise."""
SURPRISE_SD = 4.0
"""A window further from what is expected is left out (slip, a fault, an unknown force) …"""
SURPRISES = 3
"""… but so many in a row mean that the world has changed: what was learned of the resistance counts no longer."""
ADHESION_RATIO = 0.9
"""Forces above this share of the dry rail's adhesion may slip."""
ODOMETRY_M = 40.0
"""Positions and speeds of a window must agree on the way by this."""
NEUTRAL_MARGIN_M = 30.0
"""A window that comes this near to a neutral section is left out."""
IMPOSSIBLE_RATIO = 1.5
"""Forces beyond the train's largest by this are faults."""
MODEL_SD = (0.005, 0.015)
"""What stays open however long is measured: forces between samples, the shape of the resistance."""
USABLE_SD = (0.02, 0.08)
"""Estimates are usable where both are known as well as this."""
MASS_STEP, RESISTANCE_STEP = 0.03, 0.05
"""Smaller differences from the plan's ratios are not worth another plan …"""
CERTAIN_SD = 3.0
"""… nor are those within so many standard deviations."""
PLAN_ANEW_EVERY_S = 120.0
GRID_M = 10.0


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Wheel forces (N; traction > 0, brakes < 0) of motors and friction brake as the train measures them."""

    time_ns: int
    force_el_n: float
    force_friction_n: float


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """Mass and running resistance against the planned train's, each with one standard deviation.

    As in `das.domain.conditions.Conditions`: another mass changes c0 with it, the resistance ratio multiplies all of
    R; wind is part of it. `samples`: windows that counted. `usable`: well enough known, and within the bounds.
    """

    mass_ratio: float
    mass_sd: float
    resistance_ratio: float
    resistance_sd: float
    samples: int
    usable: bool

    def differs(self, conditions: Conditions) -> bool:
        """Whether the train is certainly, and by enough to matter, another one than under these conditions."""
        mass = abs(self.mass_ratio - conditions.mass_ratio)
        resistance = abs(self.resistance_ratio - conditions.resistance_ratio)
        return self.usable and (
            mass >= max(MASS_STEP, CERTAIN_SD * self.mass_sd)
            or resistance >= max(RESISTANCE_STEP, CERTAIN_SD * self.resistance_sd)
        )

    def applied(self, conditions: Conditions) -> Conditions:
        """The conditions with mass and resistance as estimated."""
        return replace(conditions, mass_ratio=self.mass_ratio, resistance_ratio=self.resistance_ratio)


class Belief(NamedTuple):
    """Estimate θ (n,) and its covariance P (n, n)."""

    theta: Floats
    covariance: Floats

    def updated(self, row: Floats, residual: float, variance: float, forgetting: float = 1.0) -> Belief:
        """After one observation y = row·θ + noise of a variance; residual: y − row·θ at the estimate held.

        K = Pφ/(r + φᵀPφ), θ ← θ + K·e, P ← P − KφᵀP. Before it, directional forgetting (Kulhavý 1987):
        P ← P + (1/λ − 1)·PφφᵀP/(φᵀPφ), so that only what this observation speaks of is forgotten.
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


class _Sample(NamedTuple):
    time_s: float
    s_m: float
    speed_mps: float
    force_n: float
    friction_n: float


class _Place(NamedTuple):
    time_ns: int
    s_m: float
    speed_mps: float
    usable: bool


class Window(NamedTuple):
    """Consistent means over a window: of acceleration, wheel force, line, resistance; and variances.

    `line_mps2`: g·gradient + curves per mass; `moving_n`: c1·v + c2·v² of the planned train; `tunnel_n`: q·v².
    """

    acceleration_mps2: float
    force_n: float
    line_mps2: float
    moving_n: float
    tunnel_n: float
    acceleration_variance: float
    force_variance: float


class Calibrator:
    """Hears positions and efforts, estimates what the train weighs and what holds it back.

    `vehicle` is the train as planned, with its load. Positions and efforts may come at moments of their own.
    """

    def __init__(self, route: Route, vehicle: Vehicle, *, point_mass: bool = False) -> None:
        self._route, self._vehicle, self._point_mass = route, vehicle, point_mass
        self._line = _Line(route, vehicle, 0.0 if point_mass else vehicle.train_length_m)
        self._belief = Belief(np.ones(2), _prior())
        self._window: list[_Sample] = []
        self._places: deque[_Place] = deque(maxlen=100)
        self._before: Effort | None = None
        self._effort: Effort | None = None
        self._stands_since_s: float | None = None
        self._exchanged = False
        self._samples, self._surprises = 0, 0

    def is_of(self, vehicle: Vehicle) -> bool:
        """Whether this train is the one as planned."""
        return self._vehicle is vehicle

    def anew(self, vehicle: Vehicle) -> Calibrator:
        """One of another train on the same line, of which nothing is known yet."""
        return Calibrator(self._route, vehicle, point_mass=self._point_mass)

    @property
    def estimates(self) -> Estimates:
        """What is known by now."""
        theta = self._belief.theta
        sd = np.hypot(np.sqrt(np.diag(self._belief.covariance)), MODEL_SD)
        inside = bool(((theta > LEAST_RATIO) & (theta < MOST_RATIO)).all())
        return Estimates(
            mass_ratio=float(theta[0]),
            mass_sd=float(sd[0]),
            resistance_ratio=float(theta[1]),
            resistance_sd=float(sd[1]),
            samples=self._samples,
            usable=inside and bool((sd <= USABLE_SD).all()),
        )

    def set_effort(self, effort: Effort) -> None:
        """Take over measured forces; impossible ones and such that come again or late are ignored."""
        last = self._effort
        if not self._possible(effort):
            return
        if last is not None and effort.time_ns <= last.time_ns:
            if (last.time_ns - effort.time_ns) * NS <= LONGEST_GAP_S:
                return
            last = None  # the clock was set back
        self._before, self._effort = last, effort
        self._pair()

    def set_position(self, time_ns: int, s_m: float, speed_mps: float, *, usable: bool = True) -> None:
        """Take over a position of the head and a speed; an unusable one breaks the window off."""
        if self._places and time_ns < self._places[-1].time_ns:
            self._places.clear()
        self._places.append(_Place(time_ns, s_m, speed_mps, usable))
        self._pair()

    def _possible(self, effort: Effort) -> bool:
        """Whether a train like this one can have such forces (false for what is not a number)."""
        train = self._vehicle
        electric_n = max(train.traction.max_force_n, train.electric_brake.max_force_n)
        most_n = IMPOSSIBLE_RATIO * (electric_n + train.friction_brake_force_n)
        return abs(effort.force_el_n) <= most_n and -most_n <= effort.force_friction_n <= 0

    def _plausible(self, place: _Place) -> bool:
        """Whether a position is usable, on the line, and no faster than the train (false for what is not a number)."""
        on_line = 0 <= place.s_m <= self._line.length_m
        return place.usable and on_line and abs(place.speed_mps) <= OVERSPEED_RATIO * self._vehicle.max_speed_mps

    def _pair(self) -> None:
        """Positions up to the last effort become samples, with the force of their moment, linear between efforts."""
        effort, before = self._effort, self._before
        if effort is None:
            return
        while self._places and self._places[0].time_ns <= effort.time_ns:
            place = self._places.popleft()
            if not self._plausible(place):
                self._window.clear()
                continue
            forces = _forces_at(place.time_ns, before, effort)
            if forces is not None:
                self._take(_Sample(place.time_ns * NS, place.s_m, place.speed_mps, *forces))

    def _take(self, sample: _Sample) -> None:
        """Add a sample to the window, or begin another; a full one is evaluated."""
        self._watch_standing(sample)
        if self._window:
            since_s = sample.time_s - self._window[-1].time_s
            if 0 <= since_s < SAMPLE_EVERY_S:
                return
            if not 0 <= since_s <= LONGEST_GAP_S:
                self._window.clear()
        if sample.speed_mps < SLOWEST_MPS or self._may_slip(sample):
            self._window.clear()
            return
        self._window.append(sample)
        if len(self._window) == WINDOW_SAMPLES:
            window = self._line.window(self._window)
            self._window.clear()
            if window is not None:
                self._learn(window)

    def _watch_standing(self, sample: _Sample) -> None:
        """After a stop the mass may be another: once a stop its variance grows."""
        if sample.speed_mps > STANDSTILL_MPS:
            self._stands_since_s, self._exchanged = None, False
            return
        if self._stands_since_s is None:
            self._stands_since_s = sample.time_s
        if not self._exchanged and sample.time_s - self._stands_since_s >= STANDS_FOR_S:
            self._belief, self._exchanged = _with_other_load(self._belief), True

    def _may_slip(self, sample: _Sample) -> bool:
        """Whether a force is near what a dry rail carries (trains without adhesion data: never)."""
        carried_ratio = ADHESION_RATIO * float(adhesion_coefficient(sample.speed_mps))
        driven_n, all_n = self._vehicle.adhesive_force_n, self._vehicle.braked_adhesive_force_n
        electric_n = sample.force_n - sample.friction_n
        return abs(electric_n) > carried_ratio * driven_n or abs(sample.force_n) > carried_ratio * all_n

    def _learn(self, window: Window) -> None:
        """One observation: F = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², linear at (µ, κ)."""
        belief = self._belief
        row, residual, variance = self._observation(window)
        if row @ _prior() @ row < INFORMATIVE_SD**2 * variance:
            return
        spread = float(row @ belief.covariance @ row) + variance
        if residual**2 > SURPRISE_SD**2 * spread:
            self._surprises += 1
            if self._surprises < SURPRISES:
                return
            # What holds the train back may be anything now; its mass changes little on the way, if at all.
            mass_variance = _with_other_load(belief).covariance[0, 0]
            belief = Belief(belief.theta, np.diag([mass_variance, PRIOR_SD[1] ** 2]))
        self._surprises = 0
        learned = belief.updated(row, residual, variance, FORGETTING)
        if (np.diag(learned.covariance) > np.square(PRIOR_SD)).any():
            learned = belief.updated(row, residual, variance)
        self._belief = learned._replace(theta=np.clip(learned.theta, LEAST_RATIO, MOST_RATIO))
        self._samples += 1

    def _observation(self, window: Window) -> tuple[Floats, float, float]:
        """Row, residual (N) and variance (N²) of a window."""
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


class Recalibration:
    """Which mass and resistance the plan is made with, and when to make it anew."""

    def __init__(self, conditions: Conditions | None = None) -> None:
        self.conditions = conditions or Conditions()
        self._changed_ns: int | None = None

    def due(self, estimates: Estimates, now_ns: int) -> Conditions | None:
        """Other conditions to plan with from now on, at most every while; None: the plan's are near enough."""
        if not estimates.differs(self.conditions):
            return None
        if self._changed_ns is not None and abs(now_ns - self._changed_ns) * NS < PLAN_ANEW_EVERY_S:
            return None
        self.conditions, self._changed_ns = estimates.applied(self.conditions), now_ns
        return self.conditions


class _Line:
    """What the line asks of the train, integrated along the way, so that means over any way are differences."""

    def __init__(self, route: Route, vehicle: Vehicle, length_m: float) -> None:
        self._resistance, self.length_m = vehicle.resistance, route.length_m
        breaks = route.breakpoints_m()
        grid = np.arange(0.0, route.length_m + length_m, GRID_M)
        self._node_m = np.unique(np.concatenate((grid, breaks, breaks + length_m, [route.length_m + length_m])))
        profile = LineProfile.on(route, vehicle, self._node_m, length_m)

        def along(value: Floats) -> Floats:
            return np.concatenate(([0.0], np.cumsum(value * profile.step_m)))

        self._work_m2ps2 = along(profile.constant_n / vehicle.mass_kg)
        self._tunnel = along(profile.tunnel_n_per_mps2)
        self._neutral_m = along((profile.supply == NEUTRAL).astype(float))

    def window(self, samples: Sequence[_Sample]) -> Window | None:
        """Means over a window, all with the weights with which the slope of the speeds weighs accelerations.

        Slope Σc·v, c = (t − t̄)/Σ(t − t̄)²; summed by parts it is Σω·ā over the intervals with ω = Δt·Σ_later c.
        None where the way does not fit the speeds, or in a neutral section.
        """
        t, s, v, force, friction = np.array(samples).T
        off = t - t.mean()
        scatter = float(off @ off)
        share = np.diff(t) * np.cumsum((off / scatter)[::-1])[::-1][1:]
        speed = 0.5 * (v[:-1] + v[1:])
        way = speed * np.diff(t)
        if abs(s[-1] - s[0] - way.sum()) > ODOMETRY_M or self._in_neutral(float(s[0]), float(s[-1])):
            return None
        middle = 0.5 * (s[:-1] + s[1:])
        weight = 0.5 * (np.append(share, 0.0) + np.append(0.0, share))
        # An effort that changes between two samples may do so at any moment between them.
        between = np.sum((share * np.diff(force)) ** 2) / 12.0
        noise = np.sum((weight * FORCE_SD_RATIO * force) ** 2) + (FRICTION_SD_RATIO * weight @ friction) ** 2
        r = self._resistance
        return Window(
            acceleration_mps2=float(off @ v) / scatter,
            force_n=float(weight @ force),
            line_mps2=float(share @ self._mean(self._work_m2ps2, middle, way)),
            moving_n=float(share @ (r.c1_n_per_mps * speed + r.c2_n_per_mps2 * speed**2)),
            tunnel_n=float(share @ (self._mean(self._tunnel, middle, way) * speed**2)),
            acceleration_variance=_noise_mps(v) ** 2 / scatter,
            force_variance=float(between + noise),
        )

    def _mean(self, integral: Floats, middle_m: Floats, way_m: Floats) -> Floats:
        ahead, behind = (np.interp(middle_m + x * way_m, self._node_m, integral) for x in (0.5, -0.5))
        return np.asarray((ahead - behind) / way_m)

    def _in_neutral(self, from_m: float, to_m: float) -> bool:
        ends = np.interp([from_m - NEUTRAL_MARGIN_M, to_m + NEUTRAL_MARGIN_M], self._node_m, self._neutral_m)
        return bool(ends[1] > ends[0])


def _noise_mps(speed_mps: Floats) -> float:
    """Noise of the speeds from their second differences, by the median: few of them are of changing forces."""
    bends = np.abs(np.diff(speed_mps, 2))
    return max(float(np.median(bends)) / (NORMAL_MAD * math.sqrt(6.0)), SPEED_SD_MPS)


def _with_other_load(belief: Belief) -> Belief:
    """The same, but the mass may be another by `STOP_MASS_SD`; never less known than before anything was measured."""
    covariance = belief.covariance.copy()
    covariance[0, 0] = min(covariance[0, 0] + STOP_MASS_SD**2, PRIOR_SD[0] ** 2)
    return Belief(belief.theta, covariance)


def _prior() -> Floats:
    return np.diag(np.square(PRIOR_SD))


def _forces_at(time_ns: int, before: Effort | None, effort: Effort) -> tuple[float, float] | None:
    """Whole wheel force and friction part (N) at a moment up to the last effort; None: it is not between two."""
    if time_ns == effort.time_ns:
        share = 1.0
        before = before or effort
    elif before is None or time_ns < before.time_ns or (effort.time_ns - before.time_ns) * NS > LONGEST_GAP_S:
        return None
    else:
        share = (time_ns - before.time_ns) / (effort.time_ns - before.time_ns)
    electric_n = before.force_el_n + share * (effort.force_el_n - before.force_el_n)
    friction_n = before.force_friction_n + share * (effort.force_friction_n - before.force_friction_n)
    return electric_n + friction_n, friction_n
