"""Driving over the integration nodes within the limits of train and envelope, and the speed bounds at the nodes."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.forces import (
    brake_limit,
    electric_share,
    largest_gain,
    largest_loss,
    loss_power,
    mean_resistance,
    on_supply,
    traction_limit,
)
from das.solver.kernels.landings import landing_under
from das.solver.kernels.tuples import ServiceParams

SLOW_MPS = 5.0
"""Speed (m/s) below which the reserve for brake delay falls with speed: the driver sees the mark and already brakes."""
FULL_BRAKES = ServiceParams(1e9, 0.0, 1.0, 1e9)
"""Parameters of full braking: no limit below the train's own, and no delay."""
_ROUNDING_W = 1e-9
"""Largest excess of v² (m²/s²) over the envelope that counts as rounding of the iterations."""
_FIXED_POINT_STEPS = 60
"""Largest number of iterations in the search for the fixed point of a step's speed."""
_FIXED_POINT_TOLERANCE = 1e-13
"""Relative change of the speed at which an iterative search ends."""


@kernel
def _narrowed(v, new, low, low_gap, high, high_gap):
    """New bounds and the next estimate of the fixed point v; `new`, the function value at v, decreases with v.

    A faster step leaves less force under the power limit, so plain iteration would oscillate. Therefore v is bracketed
    and found by false position (Illinois). `high_gap` is 0 until an estimate has been too fast.
    """
    gap = new - v
    if gap > 0.0:
        low, low_gap, high_gap = v, gap, 0.5 * high_gap
    else:
        high, high_gap, low_gap = v, gap, 0.5 * low_gap
    if high_gap == 0.0:
        return low, low_gap, high, high_gap, new
    return low, low_gap, high, high_gap, low + (high - low) * low_gap / (low_gap - high_gap)


@kernel
def full_traction_speed(v0, h, g, q, p):
    """Speed after a step at full traction; the power limit holds over the whole step. 0 if the train stalls."""
    start = _full_traction_step(v0, 0.0, h, g, q, p)
    if start <= 0.0:
        return 0.0
    low, low_gap, high, high_gap, v1 = 0.0, start, 0.0, 0.0, v0
    for _ in range(_FIXED_POINT_STEPS):
        new = _full_traction_step(v0, v1, h, g, q, p)
        if abs(new - v1) <= _FIXED_POINT_TOLERANCE * new:
            return new
        low, low_gap, high, high_gap, v1 = _narrowed(v1, new, low, low_gap, high, high_gap)
    return low


@kernel
def _full_traction_step(v0, v1, h, g, q, p):
    """Speed after a step at the full traction that is available if the step ends at v1; 0 if the train stops."""
    w1 = v0 * v0 + 2.0 * h * largest_gain(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p)
    return math.sqrt(w1) if w1 > 0.0 else 0.0


@kernel
def _hardest_brake_speed(v0, h, g, q, p, friction_n):
    """Speed after a step at full electric brake plus friction_n; the power limit holds over the whole step."""
    v1 = v0
    for _ in range(_FIXED_POINT_STEPS):
        w1 = v0 * v0 - 2.0 * h * largest_loss(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p, friction_n)
        new = math.sqrt(w1) if w1 > 0.0 else 0.0
        if abs(new - v1) <= _FIXED_POINT_TOLERANCE * v0:
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
    """Drive from v[first] towards the speed `landing` at integration node `last`, at constant acceleration.

    Every step stays within the train's efforts, with at most `friction_n` of friction brake unless only more keeps the
    train within the envelope. The train may therefore end slower than `landing` (weak traction, low envelope) or faster
    (weak brakes). Fills v[first + 1 … last]; returns False after a stall.
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
    """Drive from v[first] to integration node `last` as fast as train and envelope allow; False after a stall."""
    for i in range(first, last):
        if not drive(i, i + 1, envelope[i + 1], p.friction_force_n, line, envelope, p, v):
            return False
    return True


@kernel
def coast(first, last, line, envelope, p, v):
    """Coast from v[first] to integration node `last`, never above the envelope; False after a stall."""
    for i in range(first, last):
        landing = landing_under(0.0, v[i], line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i], p)
        if landing <= 0.0 or not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return False
    return True


@kernel
def trip_time(step, v):
    """Running time (s) over steps of the given lengths (m), with the speeds v (m/s) at the nodes."""
    total = 0.0
    for i in range(step.size):
        total += 2.0 * step[i] / (v[i] + v[i + 1])
    return total


@kernel
def step_energy(i, v0, v1, line, p, c):
    """Energy at the current collector (J) of interval i, at constant acceleration."""
    step, g, q, u = line
    here = on_supply(p, u[i])
    mid = 0.5 * (v0 + v1)
    force = p.inertial_mass_kg * (v1 * v1 - v0 * v0) / (2.0 * step[i]) + mean_resistance(v0, v1, q[i], p) + g[i]
    el = electric_share(force, max(v0, v1), here)
    energy = el * step[i] + loss_power(el, mid, c) * step[i] / mid
    return energy if energy > 0.0 else here.receptivity_ratio * energy


@kernel
def run_energy(line, p, c, v):
    """Energy at the current collector (J) of a run, at constant acceleration between its nodes."""
    total = 0.0
    for i in range(line.step_m.size):
        total += step_energy(i, v[i], v[i + 1], line, p, c)
    return total


@kernel
def braking_envelope(line, limit, end_speed, p, service):
    """Highest speed at each node from which the limits and the end speed can be kept, integrated backwards.

    `service` is the deceleration and delay of the brakes, or `FULL_BRAKES`. Returns the speeds with the index of the
    first interval (from the end) where braking is impossible, or -1. The brake power limit is taken at the faster end
    of each step, so it holds over the whole step.
    """
    step, g, q, u = line
    n = step.size
    v = np.empty(n + 1)
    v[n] = min(end_speed, limit[n - 1])
    for i in range(n - 1, -1, -1):
        cap = limit[i] if i == 0 else min(limit[i], limit[i - 1])
        here = on_supply(p, u[i])
        v1 = v[i + 1]
        start = min(_brake_start(0.0, v1, step[i], g[i], q[i], here, service), cap)
        if start <= 0.0:
            return v, i
        low, low_gap, high, high_gap, v0 = 0.0, start, 0.0, 0.0, v1
        for _ in range(_FIXED_POINT_STEPS):
            new = min(_brake_start(v0, v1, step[i], g[i], q[i], here, service), cap)
            if abs(new - v0) <= _FIXED_POINT_TOLERANCE * new:
                low = new
                break
            low, low_gap, high, high_gap, v0 = _narrowed(v0, new, low, low_gap, high, high_gap)
        v[i] = low
    return v, -1


@kernel
def _brake_start(v0, v1, h, g, q, p, service):
    """Speed before a step of full service braking to v1, by the forces at its estimate v0; 0 if the train runs away."""
    faster = max(v0, v1)
    w0 = v1 * v1 + 2.0 * h * _in_service(faster, mean_resistance(v0, v1, q, p) + g, p, service)
    return math.sqrt(w0) if w0 > 0.0 else 0.0


@kernel
def _in_service(v, resisting, p, service):
    """The planned deceleration at speed v against a resisting force (N, < 0 on a descent), limited to the usable share
    of the brake force.

    A brake with a delay of t needs the distance D(v) + (v − u)·t to slow down to u, where D is the distance without
    delay. Per unit of speed this is v/a + t, so the deceleration is 1/(1/a + t/v). On a descent that accelerates the
    train by b, it brakes from v + b·t after the delay, so the deceleration is 1/(1/a + (1 + b/a)·t/v).
    """
    share_n = service.force_share * brake_limit(v, p, service.friction_force_n)
    rate = min(largest_loss(v, resisting, p, p.friction_force_n), (share_n + resisting) / p.inertial_mass_kg)
    rate = min(rate, service.deceleration_mps2)
    gain = max(-resisting, 0.0) / p.inertial_mass_kg
    return rate / (1.0 + (rate + gain) * service.delay_s / max(v, SLOW_MPS)) if rate > 0.0 else rate


@kernel
def climbing_floor(line, envelope, least, p):
    """Lowest speed at each node from which full traction still reaches the end speed and climbs every hill ahead.

    0 where the train can start from standstill; at crests at least `least`. Never above the envelope, whose last value
    is the end speed. Integrated backwards; the power limit is taken at the faster end of each step.
    """
    step, g, q, u = line
    n = step.size
    v = np.zeros(n + 1)
    v[n] = envelope[n]
    for i in range(n - 1, -1, -1):
        here = on_supply(p, u[i])
        v1 = max(v[i + 1], min(least, envelope[i + 1]))
        v0 = v1
        for _ in range(_FIXED_POINT_STEPS):
            gain = largest_gain(max(v0, v1), mean_resistance(v0, v1, q[i], p) + g[i], here)
            w0 = v1 * v1 - 2.0 * step[i] * gain
            new = math.sqrt(w0) if w0 > 0.0 else 0.0
            if abs(new - v0) <= _FIXED_POINT_TOLERANCE * max(new, 1.0):
                v0 = new
                break
            v0 = new
        v[i] = min(v0, envelope[i])
    return v
