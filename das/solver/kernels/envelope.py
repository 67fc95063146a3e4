"""The bounds of the speed: the braking envelope and the climbing floor."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.fixed_point import FIXED_POINT_STEPS, FIXED_POINT_TOLERANCE, narrowed
from das.solver.kernels.forces import largest_gain, largest_loss, mean_resistance, on_supply

SLOW_MPS = 5.0
"""Below this speed (m/s) a delay asks for no more reserve: the driver sees the mark, and brakes act already."""
ALL_OF_IT = (1e9, 0.0)
"""Brakes to their full: no smaller deceleration (m/s²) than the train's, and no delay (s)."""


@kernel
def braking_envelope(line, limit, end_speed, p, service):
    """Fastest speed at each node from which limits and the end can be kept, integrated backwards.

    `service` are the largest deceleration (m/s²) and how late the brakes act (s); `ALL_OF_IT`: the train's full brakes.
    Returns the speeds with the index of the first interval (from the end) where braking is impossible, or -1.
    The brake power limit is taken at the faster end of each step, so it holds over the whole step.
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
        for _ in range(FIXED_POINT_STEPS):
            new = min(_brake_start(v0, v1, step[i], g[i], q[i], here, service), cap)
            if abs(new - v0) <= FIXED_POINT_TOLERANCE * new:
                low = new
                break
            low, low_gap, high, high_gap, v0 = narrowed(v0, new, low, low_gap, high, high_gap)
        v[i] = low
    return v, -1


@kernel
def _brake_start(v0, v1, h, g, q, p, service):
    """Speed from which the hardest brake in service of a start at v0 lands at v1 (0: it would run away)."""
    faster = max(v0, v1)
    loss = largest_loss(faster, mean_resistance(v0, v1, q, p) + g, p, p.friction_force_n)
    w0 = v1 * v1 + 2.0 * h * _in_service(loss, faster, service)
    return math.sqrt(w0) if w0 > 0.0 else 0.0


@kernel
def _in_service(loss, v, service):
    """The deceleration to plan with where full brakes give `loss` at speed v.

    A brake that acts late by t needs the way D(v) + (v − u)·t to come down to u, where D is its way without delay. Per
    speed that is v/a + t, so the deceleration is 1/(1/a + t/v).
    """
    largest, delay = service
    rate = min(loss, largest)
    return rate / (1.0 + rate * delay / max(v, SLOW_MPS)) if rate > 0.0 else rate


@kernel
def climbing_floor(line, envelope, least, p):
    """Slowest speed at each node from which full traction still reaches the end speed and climbs every hill ahead.

    0 where the train can set off from a standstill; no crest is passed slower than `least`. Never above the envelope,
    whose last value is the end speed. Integrated backwards; the power limit is taken at the faster end of each step.
    """
    step, g, q, u = line
    n = step.size
    v = np.zeros(n + 1)
    v[n] = envelope[n]
    for i in range(n - 1, -1, -1):
        here = on_supply(p, u[i])
        v1 = max(v[i + 1], min(least, envelope[i + 1]))
        v0 = v1
        for _ in range(FIXED_POINT_STEPS):
            gain = largest_gain(max(v0, v1), mean_resistance(v0, v1, q[i], p) + g[i], here)
            w0 = v1 * v1 - 2.0 * step[i] * gain
            new = math.sqrt(w0) if w0 > 0.0 else 0.0
            if abs(new - v0) <= FIXED_POINT_TOLERANCE * max(new, 1.0):
                v0 = new
                break
            v0 = new
        v[i] = min(v0, envelope[i])
    return v
