"""A Kalman filter along the track for the position, speed and acceleration, and for the slow errors of the sensors.

State x = (s, v, a, b, c, g): position, speed and acceleration on the scale of the measured speeds, and three errors.
The errors b of the measured position and c of the measured speed wander (first-order Gauss–Markov with time constant τ
and standard deviations σ_b and σ_c). So does, far more slowly, the scale g: the true distance per metre of distance
computed from the measured speeds.

    s' = g·v, v' = a, a' = white noise of density q
    b(t + dt) = e^(−dt/τ)·b + noise of variance σ_b²·(1 − e^(−2·dt/τ)), c and g − 1 likewise

Sensors measure s + b and v + c, each with independent white noise (Bar-Shalom, Li & Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sections 6.2.3, 8.3 and 10.3). The matrices are written out in floats,
because calling a matrix library takes longer than the computation itself.
"""

from __future__ import annotations

import math
from itertools import combinations_with_replacement
from typing import Final, NamedTuple

from das.domain.vehicle import Vehicle
from das.estimate.estimate import OVERSPEED_RATIO, SPEED_LATE_S, PositionFix, Quality, deviations

SPEED_SCALE_SD: Final = 0.04
"""Standard deviation of the scale of all measured speeds, which no sender states and only positions reveal: wheel wear
2.3 % (8 % between new and worn); a wrongly set diameter and slip together 3 %."""
HARD_MPS2: Final = 1.0
"""Braking (m/s²) that nearly every train can reach, whatever its traction."""
EFFORT_LASTS_S: Final = 60.0
"""Time (s) for which a driver holds an effort; the jerk density is 2·σ² divided by it, σ being half the largest
acceleration or deceleration."""
MANOEUVRE_SDS: Final = 3.0
"""Deviation of a speed (standard deviations) beyond which the effort, and so the acceleration, may have changed."""
WANDER_S = 30.0
"""Time constant (s) with which the errors of a receiver's position and speed wander (assumption)."""
SCALE_WANDER_S = 3600.0
"""Time constant (s) with which the scale of the speeds wanders: slip varies, the wheel diameter not (assumption)."""


class Track(NamedTuple):
    """The mean of the state (s and b in m, v and c in m/s, a in m/s², g) and its covariance (upper triangle)."""

    s: float
    v: float
    a: float
    b: float
    c: float
    g: float
    ss: float
    sv: float
    sa: float
    sb: float
    sc: float
    sg: float
    vv: float
    va: float
    vb: float
    vc: float
    vg: float
    aa: float
    ab: float
    ac: float
    ag: float
    bb: float
    bc: float
    bg: float
    cc: float
    cg: float
    gg: float

    @property
    def speed_mps(self) -> float:
        """The speed of the train over ground."""
        return self.g * self.v

    @property
    def speed_variance(self) -> float:
        """The variance (m²/s²) of the speed over ground."""
        g, v = self.g, self.v
        return g * g * self.vv + 2.0 * g * v * self.vg + v * v * self.gg


_UPPER: Final = tuple((n, i, j) for n, (i, j) in enumerate(combinations_with_replacement(range(6), 2), start=6))
"""Fields of a `Track` that hold the covariance, each with its row and column; they follow the six means."""
_MOVING: Final = (
    *("v", "a", "c", "sv", "sa", "sc", "vv", "va", "vb", "vc", "vg", "aa", "ab", "ac", "ag", "bc", "cc", "cg"),
)
"""Fields of a `Track` that are 0 while the train stands: speed, acceleration and the error of the speed."""


def begin(
    s_m: float,
    position_sd_m: float,
    v_mps: float,
    speed_sd_mps: float,
    acceleration_sd_mps2: float,
    scale_sd: float = 0.0,
) -> Track:
    """The state after a first fix: its position error is attributed to b, and none of its speed error to c."""
    var = position_sd_m**2
    x = Track(*[0.0] * len(Track._fields))
    errors = {"ss": var, "sb": -var, "bb": var, "vv": speed_sd_mps**2, "aa": acceleration_sd_mps2**2, "gg": scale_sd**2}
    return x._replace(s=s_m, v=v_mps, g=1.0, **errors)


def predict(
    x: Track, dt: float, jerk_psd_m2ps5: float, wander_sd_m: float, speed_wander_sd_mps: float, scale_sd: float
) -> Track:
    """The state `dt` seconds (>= 0) later, with P ← F·P·Fᵀ + Q; a train stops at v = 0 and never rolls back."""
    q, h, keep, hold = jerk_psd_m2ps5, 0.5 * dt * dt, math.exp(-dt / WANDER_S), math.exp(-dt / SCALE_WANDER_S)
    fresh = 1.0 - keep * keep
    way_m, v, a = x.v * dt + x.a * h, x.v + x.a * dt, x.a
    if v < 0:
        way_m, v, a = 0.5 * x.v * x.v / -x.a, 0.0, 0.0
    # The row of F that gives s; then the entries of F·P above the diagonal, which the product with Fᵀ needs again.
    g_v, g_a = x.g * dt, x.g * h
    sv, sa = x.sv + g_v * x.vv + g_a * x.va + way_m * x.vg, x.sa + g_v * x.va + g_a * x.aa + way_m * x.ag
    sg = x.sg + g_v * x.vg + g_a * x.ag + way_m * x.gg
    va = x.va + dt * x.aa
    return Track(
        s=x.s + x.g * way_m,
        v=v,
        a=a,
        b=keep * x.b,
        c=keep * x.c,
        g=1.0 + hold * (x.g - 1.0),
        ss=x.ss + g_v * (x.sv + sv) + g_a * (x.sa + sa) + way_m * (x.sg + sg) + q * x.g**2 * dt**5 / 20.0,
        sv=sv + dt * sa + q * x.g * dt**4 / 8.0,
        sa=sa + q * x.g * dt**3 / 6.0,
        sb=keep * (x.sb + g_v * x.vb + g_a * x.ab + way_m * x.bg),
        sc=keep * (x.sc + g_v * x.vc + g_a * x.ac + way_m * x.cg),
        sg=hold * sg,
        vv=x.vv + dt * x.va + dt * va + q * dt**3 / 3.0,
        va=va + q * h,
        vb=keep * (x.vb + dt * x.ab),
        vc=keep * (x.vc + dt * x.ac),
        vg=hold * (x.vg + dt * x.ag),
        aa=x.aa + q * dt,
        ab=keep * x.ab,
        ac=keep * x.ac,
        ag=hold * x.ag,
        bb=keep * keep * x.bb + wander_sd_m**2 * fresh,
        bc=keep * keep * x.bc,
        bg=keep * hold * x.bg,
        cc=keep * keep * x.cc + speed_wander_sd_mps**2 * fresh,
        cg=keep * hold * x.cg,
        gg=hold * hold * x.gg + scale_sd**2 * (1.0 - hold * hold),
    )


def position_variance(x: Track) -> float:
    """The variance of s + b (m²), without the fresh noise of a fix."""
    return x.ss + 2.0 * x.sb + x.bb


def speed_variance(x: Track) -> float:
    """The variance of v + c (m²/s²), without the fresh noise of a speed."""
    return x.vv + 2.0 * x.vc + x.cc


def with_position(x: Track, s_m: float, variance_m2: float) -> Track:
    """The state corrected by a measured position with fresh noise of this variance (> 0)."""
    column = (x.ss + x.sb, x.sv + x.vb, x.sa + x.ab, x.sb + x.bb, x.sc + x.bc, x.sg + x.bg)
    return _corrected(x, column, s_m - x.s - x.b, position_variance(x) + variance_m2)


def with_speed(x: Track, speed_mps: float, variance_m2ps2: float) -> Track:
    """The state corrected by a measured speed with fresh noise of this variance (> 0)."""
    column = (x.sv + x.sc, x.vv + x.vc, x.va + x.ac, x.vb + x.bc, x.vc + x.cc, x.vg + x.cg)
    return _corrected(x, column, speed_mps - x.v - x.c, speed_variance(x) + variance_m2ps2)


def _corrected(x: Track, column: tuple[float, ...], innovation: float, variance: float) -> Track:
    """The state x ← x + k·y/S and P ← P − k·kᵀ/S, with the column k = P·Hᵀ, the innovation y and its variance S."""
    gain = [entry / variance for entry in column]
    mean = [x[i] + gain[i] * innovation for i in range(len(gain))]
    covariance = [x[n] - gain[i] * column[j] for n, i, j in _UPPER]
    found = Track(*mean, *covariance)
    return found if found.v > 0 else found._replace(v=0.0)


class TrainMotion:
    """Predicts the state of one train up to a fix, and corrects it by the measurements of the fix."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.fastest_mps = OVERSPEED_RATIO * vehicle.max_speed_mps
        """The largest speed (m/s) that is credible for the train."""
        start_mps2 = float(vehicle.traction_effort_n(0.0)) / vehicle.inertial_mass_kg
        self._acceleration_sd_mps2 = 0.5 * max(min(start_mps2, vehicle.max_acceleration_mps2), HARD_MPS2)
        self.jerk_psd_m2ps5 = 2.0 * self._acceleration_sd_mps2**2 / EFFORT_LASTS_S
        """The density of the train's jerk (m²/s⁵)."""
        self._wander_sd_m: float | None = None

    def begin(self, fix: PositionFix) -> Track:
        """The state from this fix alone; without a measured speed, any speed of the train is possible."""
        position_sd_m, speed_sd_mps = deviations(fix)
        speed_mps = max(fix.speed_mps, 0.0)
        if math.isnan(fix.speed_mps):
            speed_mps, speed_sd_mps = 0.0, 0.5 * self.fastest_mps
        self._wander_sd_m = position_sd_m
        return begin(fix.s_m, position_sd_m, speed_mps, speed_sd_mps, self._acceleration_sd_mps2, SPEED_SCALE_SD)

    def expected(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """The state expected when a fix comes, `span_s` after the last one.

        The driver is expected to hold the effort; if the measured speed contradicts that, the effort is unknown.
        """
        # A receiver that filters its speeds sends them late; a stated deviation includes this error.
        speed_wander_sd_mps = 0.0 if fix.speed_uncertainty_mps > 0 else abs(SPEED_LATE_S * x.a)
        y = self._predicted(x, fix, span_s, speed_wander_sd_mps)
        speed_sd_mps = deviations(fix).speed_mps
        if abs(fix.speed_mps - y.v - y.c) > MANOEUVRE_SDS * math.sqrt(speed_variance(y) + speed_sd_mps**2):
            x = x._replace(aa=x.aa + self._acceleration_sd_mps2**2)
            y = self._predicted(x, fix, span_s, speed_wander_sd_mps)
        return y

    def _predicted(self, x: Track, fix: PositionFix, span_s: float, speed_wander_sd_mps: float) -> Track:
        """The state `span_s` later, with the errors of the fix's sensors wandering."""
        wander_sd_m = self._wandering_sd_m(fix)
        return predict(x, span_s, self.jerk_psd_m2ps5, wander_sd_m, speed_wander_sd_mps, SPEED_SCALE_SD)

    def stand(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """The state of a standing train at a fix: only the error of the receiver's position has wandered."""
        wander_sd_m = self._wander_sd_m = self._wandering_sd_m(fix)
        x = x._replace(**dict.fromkeys(_MOVING, 0.0))
        return predict(x, span_s, 0.0, wander_sd_m, 0.0, math.sqrt(x.gg))

    def set_off(self, x: Track, fix: PositionFix, span_s: float) -> Track:
        """The state expected at a fix of a train that has set off since the last fix."""
        x = x._replace(vv=deviations(fix).speed_mps ** 2, aa=self._acceleration_sd_mps2**2)
        return self._predicted(x, fix, span_s, 0.0)  # The train stood: c begins at 0.

    def corrected(self, y: Track, fix: PositionFix) -> Track:
        """The expected state corrected by the measurements of the fix."""
        self._wander_sd_m = self._wandering_sd_m(fix)
        sds = deviations(fix)
        if not math.isnan(fix.speed_mps):
            y = with_speed(y, fix.speed_mps, sds.speed_mps**2)
        return y if math.isnan(fix.s_m) else with_position(y, fix.s_m, sds.position_m**2)

    def _wandering_sd_m(self, fix: PositionFix) -> float:
        """The standard deviation of the part of a position's error that wanders.

        The error of a degraded fix wanders no more than that of the previous fix; the additional error is fresh noise.
        """
        position_sd_m = deviations(fix).position_m
        if fix.quality is Quality.DEGRADED and self._wander_sd_m is not None:
            return min(position_sd_m, self._wander_sd_m)
        return position_sd_m
