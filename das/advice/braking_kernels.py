"""Numba kernels of braking: the effort that slows a train from its present speed to a lower one at a place.

A braking effort is the braking force as a share of what the motors can brake with at the present speed.
"""

from __future__ import annotations

import math

from das.advice.plan_kernels import interval, linear
from das.compiling import kernel
from das.solver.kernels.forces import brake_limit, electric_limit, mean_resistance, on_supply

STEPS = 4
"""The speed at the end of an interval is found by this many iterations."""
TRIES, NEAR_W = 14, 0.02
"""The search for an effort takes at most `TRIES` steps, and ends when v² is met to within `NEAR_W` (m²/s²)."""


@kernel
def full_effort(v, p):
    """The force (N) of effort 1 at a speed: that of the motors, or of all brakes if the motors do not brake."""
    electric = electric_limit(v, p)
    if electric > 0.0 and not p.brakes_dissipate:
        return electric
    return brake_limit(v, p, p.friction_force_n)


@kernel
def largest_effort(v, p):
    """The effort of all brakes of the train together at a speed."""
    full = full_effort(v, p)
    return brake_limit(v, p, p.friction_force_n) / full if full > 0.0 else 0.0


@kernel
def _braked_w(effort, w0, h, g, q, p, here):
    """v² (m²/s²) at the end of an interval in which the train brakes with an effort; < 0 if it stops before the end."""
    v0 = math.sqrt(w0)
    v1, w1 = v0, w0
    for _ in range(STEPS):
        faster = max(v0, v1)
        force = min(effort * full_effort(faster, p), brake_limit(faster, here, here.friction_force_n))
        held = (mean_resistance(v0, v1, q, here) + g) / p.inertial_mass_kg
        rate = max(min(force / p.inertial_mass_kg + held, p.max_deceleration_mps2), held)
        w1 = w0 - 2.0 * h * rate
        v1 = math.sqrt(max(w1, 0.0))
    return w1


@kernel
def left_over_w(effort, s, v, first, last, to_m, nodes, line, p):
    """v² (m²/s²) that is left at `to_m` if a train at s with speed v brakes with an effort from there on.

    `first` and `last` are the intervals of s and of `to_m`. A result below 0 means that the train stops before `to_m`;
    the further before, the lower it is.
    """
    _, g, q, u = line
    w = v * v
    at = s
    for i in range(first, last + 1):
        end = nodes[i + 1] if i < last else to_m
        h = end - at
        if h <= 0.0:
            continue
        w = _braked_w(effort, w, h, g[i], q[i], p, on_supply(p, u[i]))
        if w < 0.0:
            return w - (to_m - end)
        at = end
    return w


@kernel
def needed_effort(s, v, first, last, to_m, target, nodes, line, p):
    """The least effort that slows a train at s with speed v to `target` (m/s) at `to_m`; the largest if none does."""
    wanted = target * target
    most = largest_effort(v, p)
    low, low_w = 0.0, left_over_w(0.0, s, v, first, last, to_m, nodes, line, p) - wanted
    if low_w <= 0.0:
        return 0.0
    high, high_w = most, left_over_w(most, s, v, first, last, to_m, nodes, line, p) - wanted
    if high_w >= 0.0:
        return most
    for _ in range(TRIES):
        # Interpolated between both ends (regula falsi), but not too near to either, so that both of them move.
        share = min(max(low_w / (low_w - high_w), 0.1), 0.9)
        middle = low + (high - low) * share
        middle_w = left_over_w(middle, s, v, first, last, to_m, nodes, line, p) - wanted
        if middle_w > 0.0:
            low, low_w = middle, middle_w
        else:
            high, high_w = middle, middle_w
            if high_w > -NEAR_W:
                break
    return high


@kernel
def lowest_w(s, to_m, nodes, envelope_w):
    """The least v² (m²/s²) of an envelope from position s to `to_m`; 0 if `to_m` is not before the last node."""
    if to_m >= nodes[nodes.size - 1]:
        return 0.0
    least = linear(nodes, envelope_w, s)
    i = interval(nodes, s) + 1
    while nodes[i] < to_m:
        least = min(least, envelope_w[i])
        i += 1
    return min(least, linear(nodes, envelope_w, to_m))
