"""Online calibration: mass and running resistance of the train from its motion under its measured forces.

A Kalman filter learns the ratios of both to those of the planned train from one window of samples after the other. A
wrong gain of the force sensor changes both equally, as another train would; three signs reveal the gain, each as a
doubt: a force that the train cannot have; coasting on known gradients, where the force is zero for any gain; and mass
and resistance that are off by the same factor (docs/explanation/calibration.md).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from das.domain.conditions import Conditions
from das.domain.formulary import adhesion_coefficient
from das.domain.route import NEUTRAL, Floats, Route
from das.domain.units import NS, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from das.estimate.estimate import OVERSPEED_RATIO, Effort
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.line_profile import LineProfile

SPEED_SD_MPS: Final = 0.05
"""Least noise of a measured speed (one standard deviation); a window with more scatter has less weight."""
FORCE_SD_RATIO: Final = 0.02
"""The noise of each measured force, as a share of the force (one standard deviation)."""
FRICTION_SD_RATIO: Final = 0.1
"""Systematic error (standard deviation, as a share) of the friction brake force, known only from cylinder pressures."""
POSITION_M: Final = 40.0
"""Error (m) that a position may have. A window is left out if the distances from its positions and from its speeds
differ by more, or if the train may have come as near to a neutral section."""
LINE_GRID_M: Final = 10.0
"""The step (m) with which the line is integrated along the track."""
NORMAL_MAD = 0.6745
"""The median absolute value of a normal variable, in standard deviations."""


class MeasuredWindow(NamedTuple):
    """Means over a window of samples, all with the same weights, and the variances of two of them."""

    acceleration_mps2: float
    force_n: float
    line_mps2: float
    """The force of gradients and curves divided by the mass of the train."""
    moving_n: float
    """The resistance c1·v + c2·v² of the train as planned."""
    tunnel_n: float
    """The additional resistance in tunnels, q·v²."""
    acceleration_variance: float
    force_variance: float
    coasts: bool = False
    """Whether no force was measured in the whole window."""


class LineIntegral:
    """The forces of the line on a train, integrated along the track: a difference gives the mean over any stretch."""

    def __init__(
        self, route: Route, vehicle: Vehicle, train_length_m: float, *, speed_sd_mps: float = SPEED_SD_MPS
    ) -> None:
        """Integrate the line under a train; forces within the noise of its largest one count as none."""
        self._idle_n, self._speed_sd_mps = FORCE_SD_RATIO * vehicle.traction.max_force_n, speed_sd_mps
        self._resistance = vehicle.resistance
        breaks = route.breakpoints_m()
        grid = np.arange(0.0, route.length_m + train_length_m, LINE_GRID_M)
        ends = (grid, breaks, breaks + train_length_m, [route.length_m + train_length_m])
        self._node_m = np.unique(np.concatenate(ends))
        profile = LineProfile.on(route, vehicle, self._node_m, train_length_m)

        def along(value: Floats) -> Floats:
            return np.concatenate(([0.0], np.cumsum(value * profile.step_m)))

        self._work_m2ps2 = along(profile.constant_n / vehicle.mass_kg)
        self._tunnel = along(profile.tunnel_n_per_mps2)
        self._neutral_m = along((profile.supply == NEUTRAL).astype(float))

    def window(self, t: Floats, s: Floats, v: Floats, force: Floats, friction: Floats) -> MeasuredWindow | None:
        """The means over a window, all with the weights that the slope of the speeds gives the accelerations.

        The samples, arrays of shape (samples,), are times (s), positions of the head (m), speeds (m/s), total wheel
        forces (N) and the part of the friction brake in them (N).

        The slope is Σc·v with c = (t − t̄)/Σ(t − t̄)². Summed by parts it is Σω·ā over the intervals between samples,
        with ω = Δt·Σ_later c. The result is None if the positions do not fit the speeds, or near a neutral section.
        """
        off = t - t.mean()
        scatter = float(off @ off)
        share = np.diff(t) * np.cumsum((off / scatter)[::-1])[::-1][1:]
        speed = 0.5 * (v[:-1] + v[1:])
        way = speed * np.diff(t)
        if abs(s[-1] - s[0] - way.sum()) > POSITION_M or self._in_neutral(float(s[0]), float(s[-1])):
            return None
        middle = 0.5 * (s[:-1] + s[1:])
        weight = 0.5 * (np.append(share, 0.0) + np.append(0.0, share))
        # An effort that changes between two samples may change at any moment between them.
        between = np.sum((share * np.diff(force)) ** 2) / 12.0
        noise = np.sum((weight * FORCE_SD_RATIO * force) ** 2)
        noise = noise + (FRICTION_SD_RATIO * weight @ friction) ** 2
        r = self._resistance
        return MeasuredWindow(
            acceleration_mps2=float(off @ v) / scatter,
            force_n=float(weight @ force),
            line_mps2=float(share @ self._mean(self._work_m2ps2, middle, way)),
            moving_n=float(share @ (r.c1_n_per_mps * speed + r.c2_n_per_mps2 * speed**2)),
            tunnel_n=float(share @ (self._mean(self._tunnel, middle, way) * speed**2)),
            acceleration_variance=max(_noise_mps(v), self._speed_sd_mps) ** 2 / scatter,
            force_variance=float(between + noise),
            coasts=bool((np.abs(force) <= self._idle_n).all() and (np.abs(friction) <= self._idle_n).all()),
        )

    def _mean(self, integral: Floats, middle_m: Floats, way_m: Floats) -> Floats:
        """The means of an integrated quantity over stretches, given by their middles and lengths (m)."""
        ahead, behind = (np.interp(middle_m + x * way_m, self._node_m, integral) for x in (0.5, -0.5))
        return np.asarray((ahead - behind) / way_m)

    def _in_neutral(self, from_m: float, to_m: float) -> bool:
        """Whether the track between two positions of the head (m) comes near a neutral section."""
        ends = np.interp([from_m - POSITION_M, to_m + POSITION_M], self._node_m, self._neutral_m)
        return bool(ends[1] > ends[0])


def _noise_mps(speed_mps: Floats) -> float:
    """The noise of speeds (m/s) from the median second difference, which leaves out changing forces."""
    bends = np.abs(np.diff(speed_mps, 2))
    return float(np.median(bends)) / (NORMAL_MAD * math.sqrt(6.0))


class MassAndResistance(NamedTuple):
    """One figure for the mass ratio and one for the resistance ratio."""

    mass: float
    resistance: float


WINDOW_SAMPLES: Final = 20
"""Number of samples in a window: at 1 Hz and 0.05 m/s of noise, their slope is the acceleration to 0.002 m/s²."""
SAMPLE_EVERY_NS: Final = round(0.9 / NS)
"""Least time (ns) between samples; a nearer one is left out, so that a window takes about one a second."""
LONGEST_GAP_NS: Final = round(2.5 / NS)
"""Longest gap (ns) between samples, and between the efforts around them, within a window."""
SLOWEST_MPS: Final = 5.0
"""Lowest speed (m/s) of a sample that counts: below it, brakes are released and Davis' formula does not hold."""
ADHESION_RATIO: Final = 0.9
"""Share of a dry rail's adhesion limit; force samples above it do not count, because wheels may slip."""
STANDS_FOR_S: Final = 20.0
"""Standstill (s) after which passengers may have boarded or alighted."""
REPLAN_EVERY_S: Final = 120.0
"""Least time (s) between new plans that follow from the estimates."""
CERTAIN_SDS: Final = 3.0
"""Standard deviations above which a difference is significant."""
IN_A_ROW: Final = 3
"""Consecutive windows that are evidence: surprising ones of another resistance, coasting ones of wrong forces."""
LINE_SD_RATIO: Final = 2e-4
"""Uncertainty of gradients and curves under the train, as a share of its weight (one standard deviation)."""
PRIOR_SD: Final = MassAndResistance(0.15, 0.3)
"""Standard deviations of the two ratios before anything is measured."""
CHANGE_SD: Final = MassAndResistance(0.05, 0.01)
"""Standard deviations of changes: of the mass at a stop (500 people in 440 t are 9 %), of the resistance by wind."""
MODEL_SD: Final = MassAndResistance(0.005, 0.015)
"""Standard deviations of errors that more samples do not reduce: forces between samples, and the resistance model."""
USABLE_SD: Final = MassAndResistance(0.02, 0.08)
"""Largest standard deviations with which the estimates are usable."""
STEP: Final = MassAndResistance(0.03, 0.05)
"""Differences from the plan's ratios below which replanning is not worthwhile."""
LEAST: Final = MassAndResistance(0.5, 0.4)
"""The least values of the two estimates: an empty train, and a long tail wind."""
MOST: Final = MassAndResistance(1.6, 2.5)
"""The largest values of the two estimates: an overloaded train, and a storm against the train."""
NEAR_MASS: Final = (0.7, 1.4)
"""Mass ratios outside which both explanations are reported: another train than planned, or a wrong force sensor."""


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
    """The mass is far from the planned one: another train, or a wrong sensor. The mass is used and reported."""


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
    """Number of windows on which the estimates are based."""
    usable: bool
    """Whether both ratios are known well enough and lie within their bounds, and the forces behind them are trusted."""
    doubt: ForceDoubt | None = None
    """Why the forces are not trusted; None if they are."""

    def differs(self, conditions: Conditions) -> bool:
        """Whether the train certainly differs from one under these conditions, and by enough to replan."""
        mass = abs(self.planned_mass_ratio - conditions.mass_ratio)
        resistance = abs(self.resistance_ratio - conditions.resistance_ratio)
        return self.usable and (
            mass >= max(STEP.mass, CERTAIN_SDS * self.mass_sd)
            or resistance >= max(STEP.resistance, CERTAIN_SDS * self.resistance_sd)
        )

    def remark(self) -> ForceDoubt | None:
        """The remark to report: a doubt about the forces, or a usable mass far from the planned one; else None."""
        least, most = NEAR_MASS
        return ForceDoubt.FAR_MASS if self.usable and not least < self.mass_ratio < most else self.doubt

    @property
    def planned_mass_ratio(self) -> float:
        """The mass ratio to plan with: never below 1, so that no plan counts on a lighter train's better brakes."""
        return max(self.mass_ratio, 1.0)


class Belief(NamedTuple):
    """The estimate θ (n,) of n unknowns and its covariance P (n, n)."""

    theta: Floats
    covariance: Floats

    def updated(self, row: Floats, residual: float, variance: float) -> Belief:
        """The belief after one observation y = φ·θ + noise.

        `row` is φ (n,), `residual` is y − φ·θ at the present estimate, and `variance` is that of the noise, r.

            K = Pφ/(r + φᵀPφ),  θ ← θ + K·(y − φ·θ),  P ← P − KφᵀP
        """
        toward = self.covariance @ row
        whole = float(row @ toward) + variance
        return Belief(self.theta + toward * (residual / whole), self.covariance - np.outer(toward, toward) / whole)

    def drifted(self, sd: tuple[float, ...], most_sd: tuple[float, ...]) -> Belief:
        """The belief after random changes (standard deviations); no unknown becomes less certain than most."""
        covariance = self.covariance.copy()
        np.fill_diagonal(covariance, np.minimum(np.diag(covariance) + np.square(sd), np.square(most_sd)))
        return Belief(self.theta, covariance)


class RatioLearner:
    """Learns the two ratios from one window after the other."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.belief = Belief(np.ones(2), np.diag(np.square(PRIOR_SD)))
        """The two ratios and their covariance."""
        self.samples = self._surprises = 0

    def change_load(self) -> None:
        """Make the mass less certain, because passengers may have boarded or alighted."""
        self.belief = self.belief.drifted((CHANGE_SD.mass, 0.0), PRIOR_SD)

    def learn(self, window: MeasuredWindow) -> None:
        """Learn from one window.

        F = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², made linear at the mass ratio µ and the
        resistance ratio κ believed so far. A window with little information, or far from what is expected, is left out.
        """
        row, residual, variance = self._observation(window)
        if np.square(row * PRIOR_SD).sum() < CERTAIN_SDS**2 * variance:
            return
        belief = self.belief.drifted((0.0, CHANGE_SD.resistance), PRIOR_SD)
        if residual**2 > CERTAIN_SDS**2 * (float(row @ belief.covariance @ row) + variance):
            self._surprises += 1
            if self._surprises < IN_A_ROW:
                return
            # The resistance may have any value now; the mass changes hardly under way.
            self.change_load()
            belief = Belief(belief.theta, np.diag([self.belief.covariance[0, 0], PRIOR_SD.resistance**2]))
        self._surprises = 0
        learned = belief.updated(row, residual, variance)
        self.belief = learned._replace(theta=np.clip(learned.theta, LEAST, MOST))
        self.samples += 1

    def distance_sds(self, window: MeasuredWindow) -> float:
        """The distance of a window from the prediction of the ratios, in standard deviations of both together."""
        row, residual, variance = self._observation(window)
        return residual / float(np.sqrt(row @ self.belief.covariance @ row + variance))

    def _observation(self, window: MeasuredWindow) -> tuple[Floats, float, float]:
        """The row, the residual (N) and the variance (N²) of a window."""
        train, (mass, resistance) = self._vehicle, self.belief.theta
        c0_n = train.resistance.c0_n
        pull_n = train.mass_kg * (window.acceleration_mps2 + window.line_mps2)
        rotating_kg = train.mass_kg * train.rotating_mass_ratio
        held_n = resistance * (mass * c0_n + window.moving_n) + window.tunnel_n
        residual_n = window.force_n - mass * pull_n - rotating_kg * window.acceleration_mps2 - held_n
        moved_variance = (mass * train.mass_kg + rotating_kg) ** 2 * window.acceleration_variance
        line_n = LINE_SD_RATIO * mass * train.mass_kg * STANDARD_GRAVITY_MPS2
        row = np.array([pull_n + resistance * c0_n, mass * c0_n + window.moving_n])
        return row, float(residual_n), float(moved_variance + line_n**2 + window.force_variance)


class Calibrator:
    """Estimates the mass and the running resistance of one train from measured positions and efforts.

    `vehicle` is the train as planned, with its load. Positions and efforts may have different times; a window is used
    once its forces are known up to its last position. The same measurements give the same estimates.
    """

    def __init__(self, route: Route, vehicle: Vehicle, *, point_mass: bool = False) -> None:
        self._route, self._vehicle, self._point_mass = route, vehicle, point_mass
        self._line = LineIntegral(route, vehicle, 0.0 if point_mass else vehicle.train_length_m)
        self._all, self._driven = RatioLearner(vehicle), RatioLearner(vehicle)
        self._too_strong, self._moving_n, self._windows = False, 0.0, 0
        self._distances_sds: deque[float] = deque(maxlen=IN_A_ROW)
        self._places: list[tuple[int, float, float]] = []
        self._efforts: deque[Effort] = deque()
        self._stands_since_ns: int | None = None
        self._load_changed = False

    def is_of(self, vehicle: Vehicle) -> bool:
        """Whether a train is the planned train of the calibrator."""
        return self._vehicle is vehicle

    def anew(self, vehicle: Vehicle | None = None) -> Calibrator:
        """A calibrator on the same line that has measured nothing yet; by default of the same train."""
        return Calibrator(self._route, vehicle or self._vehicle, point_mass=self._point_mass)

    @property
    def estimates(self) -> Estimates:
        """The estimates from all windows so far; not usable while the forces are doubted."""
        theta, covariance = self._all.belief
        sd = np.hypot(np.sqrt(np.diag(covariance)), MODEL_SD)
        known = bool(((theta > LEAST) & (theta < MOST) & (sd <= USABLE_SD)).all())
        doubt = self._doubt(known)
        return Estimates(
            mass_ratio=float(theta[0]),
            mass_sd=float(sd[0]),
            resistance_ratio=float(theta[1]),
            resistance_sd=float(sd[1]),
            samples=self._all.samples,
            usable=known and doubt is None,
            doubt=doubt,
        )

    def set_effort(self, effort: Effort) -> None:
        """Take over measured forces; impossible (above the weight of the train), repeated and late ones are ignored."""
        most_n = STANDARD_GRAVITY_MPS2 * self._vehicle.mass_kg
        if not (abs(effort.force_el_n) <= most_n and -most_n <= effort.force_friction_n <= 0):
            return
        since_ns = effort.time_ns - self._efforts[-1].time_ns if self._efforts else 1
        if -LONGEST_GAP_NS <= since_ns <= 0:
            return
        if not 0 < since_ns <= LONGEST_GAP_NS:
            self._places.clear()
            self._efforts.clear()
        self._efforts.append(effort)
        begin_ns = self._places[0][0] if self._places else effort.time_ns - LONGEST_GAP_NS
        while len(self._efforts) > 1 and self._efforts[1].time_ns <= begin_ns:
            self._efforts.popleft()
        self._close()

    def set_position(self, time_ns: int, s_m: float, speed_mps: float, *, usable: bool = True) -> None:
        """Take over a position of the head (m) and a speed (m/s); an unusable position discards the open window."""
        fastest_mps = OVERSPEED_RATIO * self._vehicle.max_speed_mps
        usable = usable and 0 <= s_m <= self._route.length_m and abs(speed_mps) <= fastest_mps
        if usable:
            self._watch_standing(time_ns, speed_mps)
        efforts = self._efforts
        covered = bool(efforts) and efforts[0].time_ns <= time_ns <= efforts[-1].time_ns + LONGEST_GAP_NS
        if not usable or speed_mps < SLOWEST_MPS or not covered:
            self._places.clear()
            return
        since_ns = time_ns - self._places[-1][0] if self._places else SAMPLE_EVERY_NS
        if 0 <= since_ns < SAMPLE_EVERY_NS:
            return
        if not 0 <= since_ns <= LONGEST_GAP_NS:
            self._places.clear()
        self._places.append((time_ns, s_m, speed_mps))
        self._close()

    def _close(self) -> None:
        """Learn from the open window, if it is full and forces are known up to its last position."""
        places = self._places[:WINDOW_SAMPLES]
        if len(places) < WINDOW_SAMPLES or self._efforts[-1].time_ns < places[-1][0]:
            return
        first_ns = places[0][0]
        time_ns, s_m, speed_mps = np.array([(at - first_ns, s, v) for at, s, v in places], dtype=float).T
        known = np.array([(e.time_ns - first_ns, e.force_el_n, e.force_friction_n) for e in self._efforts]).T
        electric_n, friction_n = (np.interp(time_ns, known[0], force_n) for force_n in known[1:])
        self._watch_force(speed_mps, electric_n, friction_n)
        slips = np.flatnonzero(self._may_slip(speed_mps, electric_n, friction_n))
        used = slips[-1] + 1 if slips.size else WINDOW_SAMPLES
        del self._places[:used]
        if not slips.size:
            window = self._line.window(time_ns * NS, s_m, speed_mps, electric_n + friction_n, friction_n)
            if window is not None:
                self._learn(window)

    def _learn(self, window: MeasuredWindow) -> None:
        """Learn from a window; compare a window of coasting with the result of windows under force.

        A coasting train has 0 = µ·m·(a + line) + rotating·a + κ·(µ·c0 + c1·v + c2·v²) + q·v², whatever force is
        measured.
        """
        self._windows += 1
        self._moving_n += (window.moving_n - self._moving_n) / self._windows
        self._all.learn(window)
        if not window.coasts:
            self._driven.learn(window)
        elif self._driven.samples:
            self._distances_sds.append(self._driven.distance_sds(window))

    def _watch_standing(self, time_ns: int, speed_mps: float) -> None:
        """Let the load change once at each stop that is long enough."""
        if speed_mps > STANDSTILL_MPS:
            self._stands_since_ns, self._load_changed = None, False
        elif self._stands_since_ns is None:
            self._stands_since_ns = time_ns
        elif not self._load_changed and (time_ns - self._stands_since_ns) * NS >= STANDS_FOR_S:
            self._load_changed = True
            self._all.change_load()
            self._driven.change_load()
            self._distances_sds.clear()

    def _watch_force(self, speed_mps: Floats, electric_n: Floats, friction_n: Floats) -> None:
        """Doubt the forces from now on if more of a window than noise explains is above the train's largest force."""
        train, noise = self._vehicle, 1.0 + CERTAIN_SDS * FORCE_SD_RATIO
        above = electric_n > noise * train.traction_effort_n(speed_mps)
        above |= -electric_n > noise * train.electric_brake_effort_n(speed_mps)
        above |= -friction_n > noise * train.friction_brake_force_n
        self._too_strong |= int(above.sum()) > IN_A_ROW

    def _may_slip(self, speed_mps: Floats, electric_n: Floats, friction_n: Floats) -> Floats:
        """Whether each force is near the adhesion limit of a dry rail; never true of a train without adhesion data."""
        carried_ratio, train = ADHESION_RATIO * adhesion_coefficient(speed_mps), self._vehicle
        slips = np.abs(electric_n) > carried_ratio * train.adhesive_force_n
        return np.asarray(slips | (np.abs(electric_n + friction_n) > carried_ratio * train.braked_adhesive_force_n))

    def _doubt(self, known: bool) -> ForceDoubt | None:
        """Why the forces are not trusted, if there is a reason; `known`: the ratios are known well enough to tell."""
        distances = self._distances_sds
        if self._too_strong:
            return ForceDoubt.TOO_STRONG
        if len(distances) == IN_A_ROW and abs(sum(distances)) > IN_A_ROW * CERTAIN_SDS:
            return ForceDoubt.COASTING
        if known and looks_like_gain(self._all.belief, self._vehicle.resistance.c0_n, self._moving_n):
            return ForceDoubt.GAIN
        return None


def looks_like_gain(belief: Belief, c0_n: float, moving_n: float) -> bool:
    """Whether mass and resistance are off by the same factor, within their uncertainty, as with a wrong gain.

    A gain γ gives µ = γ and κ·(µ·c0 + r) = γ·(c0 + r), with r = c1·v + c2·v² (`moving_n`). The difference of the two
    sides, divided by c0 + r, is compared with its standard deviation, if the mass certainly differs from the plan.
    """
    mass, resistance = belief.theta
    all_n = c0_n + moving_n
    apart = (resistance * (mass * c0_n + moving_n)) / all_n - mass
    row = np.array([resistance * c0_n / all_n - 1.0, (mass * c0_n + moving_n) / all_n])
    covariance = belief.covariance + np.diag(np.square(MODEL_SD))
    is_off = abs(mass - 1.0) >= max(STEP.mass, CERTAIN_SDS * float(covariance[0, 0]) ** 0.5)
    return bool(is_off and apart**2 <= CERTAIN_SDS**2 * float(row @ covariance @ row))


class Recalibration:
    """Keeps the conditions of the plan, and decides when the estimates require other conditions."""

    def __init__(self, conditions: Conditions | None = None) -> None:
        self._planned = self.conditions = conditions or Conditions()
        """The conditions that the plan is made with."""
        self._changed_ns: int | None = None

    def due(self, estimates: Estimates, now_ns: int) -> Conditions | None:
        """Other conditions to plan with from now on; None while those of the plan are near enough.

        They change at most once in `REPLAN_EVERY_S`; once the forces are doubted, the conditions of the start return.
        """
        if estimates.doubt is not None and self.conditions != self._planned:
            self.conditions = self._planned
            return self.conditions
        if not estimates.differs(self.conditions):
            return None
        if self._changed_ns is not None and abs(now_ns - self._changed_ns) * NS < REPLAN_EVERY_S:
            return None
        mass, resistance = estimates.planned_mass_ratio, estimates.resistance_ratio
        self.conditions = replace(self.conditions, mass_ratio=mass, resistance_ratio=resistance)
        self._changed_ns = now_ns
        return self.conditions
