"""A Kalman filter along the track for the position, the speed, the acceleration and the wandering error of a receiver.

State x = (s, v, a, b). Between fixes the acceleration is a random walk driven by white jerk of density q, and the
receiver's error b wanders (first-order Gauss–Markov with time constant τ and standard deviation σ_b):

    s' = v, v' = a, a' = white noise of density q, b(t + dt) = e^(−dt/τ)·b + noise of variance σ_b²·(1 − e^(−2·dt/τ))

Sensors measure s + b and v, each with fresh noise of its own (Bar-Shalom, Li & Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sections 6.2.3 and 8.3). The matrices are written out in floats, because
calling a matrix library takes longer than all of the computation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from das.domain.vehicle import Vehicle
from das.estimate.fix import PositionFix, Quality, deviations
from das.estimate.settings import LocalisationSettings

WANDER_S = 30.0
"""Time constant (s) with which the error of a receiver's position wanders (assumption)."""


class Track(NamedTuple):
    """The mean of the state (s in m, v in m/s, a in m/s², b in m) and the upper half of its covariance."""

    s: float
    v: float
    a: float
    b: float
    ss: float
    sv: float
    sa: float
    sb: float
    vv: float
    va: float
    vb: float
    aa: float
    ab: float
    bb: float


def begin(s_m: float, position_sd_m: float, v_mps: float, speed_sd_mps: float, acceleration_sd_mps2: float) -> Track:
    """Return the state after a first fix; all of its position error may be a wandering one."""
    var = position_sd_m**2
    return Track(
        s_m, v_mps, 0.0, 0.0, var, 0.0, 0.0, -var, speed_sd_mps**2, 0.0, 0.0, acceleration_sd_mps2**2, 0.0, var
    )


def predict(x: Track, dt: float, jerk_psd_m2ps5: float, wander_sd_m: float) -> Track:
    """Return the state `dt` seconds (>= 0) later, with P ← F·P·Fᵀ + Q; a train stops at v = 0 and never rolls back."""
    h, q, keep = 0.5 * dt * dt, jerk_psd_m2ps5, math.exp(-dt / WANDER_S)
    s, v, a = x.s + x.v * dt + x.a * h, x.v + x.a * dt, x.a
    if v < 0:
        s, v, a = x.s + 0.5 * x.v * x.v / -x.a, 0.0, 0.0
    # The entries of F·P above the diagonal, which the product with Fᵀ needs again.
    sv, sa = x.sv + dt * x.vv + h * x.va, x.sa + dt * x.va + h * x.aa
    va = x.va + dt * x.aa
    return Track(
        s,
        v,
        a,
        keep * x.b,
        x.ss + dt * x.sv + h * x.sa + dt * sv + h * sa + q * dt**5 / 20.0,
        sv + dt * sa + q * dt**4 / 8.0,
        sa + q * dt**3 / 6.0,
        keep * (x.sb + dt * x.vb + h * x.ab),
        x.vv + dt * x.va + dt * va + q * dt**3 / 3.0,
        va + q * h,
        keep * (x.vb + dt * x.ab),
        x.aa + q * dt,
        keep * x.ab,
        keep * keep * x.bb + wander_sd_m**2 * (1.0 - keep * keep),
    )


def stand(x: Track, dt: float, wander_sd_m: float) -> Track:
    """Return the state of a standing train `dt` seconds later: only the receiver's error has wandered."""
    still = x._replace(v=0.0, a=0.0, sv=0.0, sa=0.0, vv=0.0, va=0.0, vb=0.0, aa=0.0, ab=0.0)
    return predict(still, dt, 0.0, wander_sd_m)


def set_off(x: Track, speed_sd_mps: float, acceleration_sd_mps2: float) -> Track:
    """Return the state of a train that stood and may be moving now: its speed and acceleration are unknown."""
    return x._replace(vv=speed_sd_mps**2, aa=acceleration_sd_mps2**2)


def unknown_acceleration(x: Track, acceleration_sd_mps2: float) -> Track:
    """Return the state after the driver may have changed the effort: the acceleration is less certain."""
    return x._replace(aa=x.aa + acceleration_sd_mps2**2)


def position_variance(x: Track) -> float:
    """Return the variance of s + b (m²), without the fresh noise of a fix."""
    return x.ss + 2.0 * x.sb + x.bb


def with_position(x: Track, s_m: float, variance_m2: float) -> Track:
    """Return the state corrected by a measured position with fresh noise of this variance (> 0)."""
    column = (x.ss + x.sb, x.sv + x.vb, x.sa + x.ab, x.sb + x.bb)
    return _corrected(x, column, s_m - x.s - x.b, position_variance(x) + variance_m2)


def with_speed(x: Track, speed_mps: float, variance_m2ps2: float) -> Track:
    """Return the state corrected by a measured speed with fresh noise of this variance (> 0)."""
    return _corrected(x, (x.sv, x.vv, x.va, x.vb), speed_mps - x.v, x.vv + variance_m2ps2)


def _corrected(x: Track, column: tuple[float, float, float, float], innovation: float, variance: float) -> Track:
    """Return x ← x + c·y/S and P ← P − c·cᵀ/S, with the column c = P·Hᵀ, the innovation y and its variance S."""
    s, v, a, b = column
    gain_s, gain_v, gain_a, gain_b = s / variance, v / variance, a / variance, b / variance
    speed = x.v + gain_v * innovation
    return Track(
        x.s + gain_s * innovation,
        speed if speed > 0 else 0.0,
        x.a + gain_a * innovation,
        x.b + gain_b * innovation,
        x.ss - gain_s * s,
        x.sv - gain_s * v,
        x.sa - gain_s * a,
        x.sb - gain_s * b,
        x.vv - gain_v * v,
        x.va - gain_v * a,
        x.vb - gain_v * b,
        x.aa - gain_a * a,
        x.ab - gain_a * b,
        x.bb - gain_b * b,
    )


class TrainMotion:
    """Predicts the state of one train up to a fix, and corrects it by the measurements of the fix."""

    def __init__(self, vehicle: Vehicle, settings: LocalisationSettings) -> None:
        self.fastest_mps = settings.possible.overspeed_ratio * vehicle.max_speed_mps
        """The largest speed (m/s) that is credible for the train."""
        tuning = settings.motion
        start_mps2 = float(vehicle.traction_effort_n(0.0)) / vehicle.inertial_mass_kg
        self._acceleration_sd_mps2 = 0.5 * max(min(start_mps2, vehicle.max_acceleration_mps2), tuning.hard_mps2)
        self._jerk_psd = 2.0 * self._acceleration_sd_mps2**2 / tuning.effort_lasts_s
        self._manoeuvre_sds, self._sensors = tuning.manoeuvre_sds, settings.sensors
        self._wander_sd_m: float | None = None
        self._blind_m = 0.0

    def begin(self, fix: PositionFix) -> Track:
        """Return the state from this fix alone; without a measured speed, any speed of the train is possible."""
        position_sd_m, speed_sd_mps = deviations(fix, self._sensors)
        speed_mps = max(fix.speed_mps, 0.0)
        if math.isnan(fix.speed_mps):
            speed_mps, speed_sd_mps = 0.0, 0.5 * self.fastest_mps
        self._wander_sd_m, self._blind_m = position_sd_m, 0.0
        return begin(fix.s_m, position_sd_m, speed_mps, speed_sd_mps, self._acceleration_sd_mps2)

    def carried_on(self, x: Track, span_s: float) -> Track:
        """Return the state `span_s` (>= 0) after the last fix, without another fix."""
        return predict(x, span_s, self._jerk_psd, 0.0)

    def expected(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state expected when a fix comes, `span_s` after the last one.

        The driver is expected to hold the effort; where the measured speed contradicts that, the effort is unknown.
        """
        wander_sd_m, speed_sd_mps = self._wandering_sd_m(fix), deviations(fix, self._sensors).speed_mps
        y = predict(x, span_s, self._jerk_psd, wander_sd_m)
        if abs(fix.speed_mps - y.v) > self._manoeuvre_sds * math.sqrt(y.vv + speed_sd_mps**2):
            x = unknown_acceleration(x, self._acceleration_sd_mps2)
            y = predict(x, span_s, self._jerk_psd, wander_sd_m)
        return y

    def stand(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state of a standing train at a fix: it stays where it was, and the fix does not move it."""
        wander_sd_m = self._wander_sd_m = self._wandering_sd_m(fix)
        return stand(x, span_s, wander_sd_m)

    def set_off(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the state expected at a fix of a train that has set off since the last fix."""
        x = set_off(x, deviations(fix, self._sensors).speed_mps, self._acceleration_sd_mps2)
        return predict(x, span_s, self._jerk_psd, self._wandering_sd_m(fix))

    def corrected(self, y: Track, fix: PositionFix, span_s: float) -> Track:
        """Return the expected state corrected by the measurements of the fix.

        Without a measured position the way follows from the speeds, and the error of the odometer is added.
        """
        self._wander_sd_m = self._wandering_sd_m(fix)
        sds = deviations(fix, self._sensors)
        if not math.isnan(fix.speed_mps):
            y = with_speed(y, fix.speed_mps, sds.speed_mps**2)
        if not math.isnan(fix.s_m):
            self._blind_m = 0.0
            return with_position(y, fix.s_m, sds.position_m**2)
        before_m, self._blind_m = self._blind_m, self._blind_m + y.v * span_s
        return y._replace(ss=y.ss + self._sensors.odometer_ratio**2 * (self._blind_m**2 - before_m**2))

    def _wandering_sd_m(self, fix: PositionFix) -> float:
        """Return the standard deviation of the part of a position's error that wanders.

        The error of a degraded fix wanders no more than that of the fix before: what makes it worse is fresh noise.
        """
        position_sd_m = deviations(fix, self._sensors).position_m
        if fix.quality is Quality.DEGRADED and self._wander_sd_m is not None:
            return min(position_sd_m, self._wander_sd_m)
        return position_sd_m
