"""Driving over the integration nodes towards a speed, within what train and envelope allow."""

from __future__ import annotations

import math

from das.compiling import kernel
from das.solver.kernels.fixed_point import FIXED_POINT_STEPS, FIXED_POINT_TOLERANCE, narrowed
from das.solver.kernels.forces import (
    brake_limit,
    largest_gain,
    largest_loss,
    mean_resistance,
    on_supply,
    traction_limit,
)
from das.solver.kernels.landings import landing_under

_BRAKE_STEPS = 60
_ROUNDING_W = 1e-9
"""A v² this little above the envelope's is rounding of the iterations."""


@kernel
def full_traction_speed(v0, h, g, q, p):
    """Speed after a step at full traction; the power limit holds over the whole step. 0 where the train stalls."""
    start = _full_traction_step(v0, 0.0, h, g, q, p)
    if start <= 0.0:
        return 0.0
    low, low_gap, high, high_gap, v1 = 0.0, start, 0.0, 0.0, v0
    for _ in range(FIXED_POINT_STEPS):
        new = _full_traction_step(v0, v1, h, g, q, p)
        if abs(new - v1) <= FIXED_POINT_TOLERANCE * new:
            return new
        low, low_gap, high, high_gap, v1 = narrowed(v1, new, low, low_gap, high, high_gap)
    return low


@kernel
def _full_traction_step(v0, v1, h, g, q, p):
    """Speed after a step at the full traction of a landing at v1 (0: it stops)."""
    w1 = v0 * v0 + 2.0 * h * largest_gain(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p)
    return math.sqrt(w1) if w1 > 0.0 else 0.0


@kernel
def _hardest_brake_speed(v0, h, g, q, p, friction_n):
    """Speed after a step at full electric brake plus friction_n; the power limit holds over the whole step."""
    v1 = v0
    for _ in range(_BRAKE_STEPS):
        w1 = v0 * v0 - 2.0 * h * largest_loss(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p, friction_n)
        new = math.sqrt(w1) if w1 > 0.0 else 0.0
        if abs(new - v1) <= 1e-13 * v0:
            return new
        v1 = new
    return v1


@kernel
def _attainable(a, b, h, g, q, p, friction_n):
    """Whether the train can go from speed a to b in a step within its forces, powers and accelerations."""
    rate = (b * b - a * a) / (2.0 * h)
    if rate > p.max_acceleration_mps2 or -rate > p.max_deceleration_mps2:
        return False
    force = p.inertial_mass_kg * rate + mean_resistance(a, b, q, p) + g
    faster = max(a, b)
    if force >= 0.0:
        return force <= traction_limit(faster, p)
    return -force <= brake_limit(faster, p, friction_n)


@kernel
def drive(first, last, landing, friction_n, line, envelope, p, v):
    """From v[first] towards the speed `landing` at integration node `last`, at constant acceleration.

    Every step is cut to what the train allows, with at most `friction_n` of friction brake, and to the envelope (with
    all brakes): at full traction the landing may be lower, at full electric brake or from above the envelope higher.
    Fills v[first + 1 … last]; returns False after a stall.
    """
    step, g, q, u = line
    length = 0.0
    for i in range(first, last):
        length += step[i]
    w0 = v[first] * v[first]
    w1 = landing * landing
    done = 0.0
    for i in range(first, last):
        done += step[i]
        here = on_supply(p, u[i])
        a = v[i]
        b = landing if i == last - 1 else math.sqrt(w0 + (w1 - w0) * done / length)
        b = min(b, envelope[i + 1])
        if not _attainable(a, b, step[i], g[i], q[i], here, friction_n):
            top = full_traction_speed(a, step[i], g[i], q[i], here)
            if b > top:
                b = top
            else:
                b = max(b, _hardest_brake_speed(a, step[i], g[i], q[i], here, friction_n))
                if b > envelope[i + 1]:
                    b = max(envelope[i + 1], _hardest_brake_speed(a, step[i], g[i], q[i], here, here.friction_force_n))
                    if b * b <= envelope[i + 1] ** 2 + _ROUNDING_W:
                        b = envelope[i + 1]
            if b <= 0.0 and landing > 0.0:
                return False
        v[i + 1] = b
    return True


@kernel
def hurry(first, last, line, envelope, p, v):
    """From v[first] to integration node `last` as fast as train and envelope allow; False after a stall."""
    for i in range(first, last):
        if not drive(i, i + 1, envelope[i + 1], p.friction_force_n, line, envelope, p, v):
            return False
    return True


@kernel
def coast(first, last, line, envelope, p, v):
    """From v[first] to integration node `last` without force, but never above the envelope; False after a stall."""
    for i in range(first, last):
        landing = landing_under(0.0, v[i], line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i], p)
        if landing <= 0.0 or not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return False
    return True


@kernel
def trip_time(step, v):
    """Time (s) of a run with the speeds v over steps of these lengths."""
    total = 0.0
    for i in range(step.size):
        total += 2.0 * step[i] / (v[i] + v[i + 1])
    return total
