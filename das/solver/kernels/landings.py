"""Landings: the candidate speeds after a decision step, and the cost of a step."""

from __future__ import annotations

import math

from das.compiling import kernel
from das.solver.kernels.forces import (
    brake_limit,
    electric_limit,
    electric_share,
    loss_power,
    mean_resistance,
    traction_limit,
)
from das.solver.tolerances import LANDINGS_BRAKE, LANDINGS_EFFORT

SPECIAL_LANDINGS = 2
"""Number of special landings: coasting, and holding the speed."""
LANDINGS = LANDINGS_EFFORT + LANDINGS_BRAKE + SPECIAL_LANDINGS
"""Largest number of landings of a step."""

LANDING_STEPS = 4
"""Number of iterations for a landing, which are needed because the forces depend on the mean speed of the step."""


@kernel
def landing_speed(v0, h, share, g, q, p):
    """Speed after a decision step with a share of the largest traction, or of the electric brake (share < 0).

    The largest effort is taken at the mean speed. Returns 0 if the train stops.
    """
    v1 = v0
    for _ in range(LANDING_STEPS):
        mid = 0.5 * (v0 + v1)
        f = share * (traction_limit(mid, p) if share > 0.0 else electric_limit(mid, p))
        v1 = speed_under_force(f, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
    return v1


@kernel
def landing_under(f, v0, h, g, q, p):
    """Speed after a decision step under the constant wheel force f; 0 if the train stops."""
    v1 = v0
    for _ in range(LANDING_STEPS):
        v1 = speed_under_force(f, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
    return v1


@kernel
def speed_under_force(f, v0, v1, h, g, q, p):
    """Speed after a step under wheel force f, with the resistance between v0 and v1; 0 if the train stops."""
    rate = (f - mean_resistance(v0, v1, q, p) - g) / p.inertial_mass_kg
    rate = max(min(rate, p.max_acceleration_mps2), -p.max_deceleration_mps2)
    w1 = v0 * v0 + 2.0 * h * rate
    return math.sqrt(w1) if w1 > 0.0 else 0.0


@kernel
def step_cost(v0, v1, h, g, q, p, c):
    """Time (s) and energy at the collector (J) of a decision step at constant acceleration from v0 to v1."""
    mid = 0.5 * (v0 + v1)
    dt = h / mid
    f = p.inertial_mass_kg * (v1 * v1 - v0 * v0) / (2.0 * h) + mean_resistance(v0, v1, q, p) + g
    el = electric_share(f, mid, p)
    energy = el * h + loss_power(el, mid, c) * dt
    return dt, energy if energy > 0.0 else p.receptivity_ratio * energy


@kernel
def slower_landings(v0, h, g, q, p):
    """Speeds after a decision step: coasting, at full electric brake, with all brakes."""
    coast = landing_under(0.0, v0, h, g, q, p)
    electric = coast
    if not p.brakes_dissipate and p.electric_force_n > 0.0:
        electric = landing_speed(v0, h, -1.0, g, q, p)
    low = electric
    if p.friction_force_n > 0.0 or p.brakes_dissipate:
        # Both brakes together, with the electric brake at its limit at v0, which is exact for a force limit.
        low = min(landing_under(-brake_limit(v0, p, p.friction_force_n), v0, h, g, q, p), electric)
    return coast, electric, low


@kernel
def landings(v0, h, g, q, top, last, p, out):
    """Fill `out` with the candidate landing speeds from v0, hardest brake first, and return their number.

    `top` is the envelope at the landing node; at the end of a section with one end speed it is the only landing.
    """
    high = landing_speed(v0, h, 1.0, g, q, p)
    if last:
        if high < top:
            return 0
        out[0] = top
        return 1
    high = min(high, top)
    if high <= 0.0:
        return 0
    coast, electric, low = slower_landings(v0, h, g, q, p)
    low, electric, coast = min(low, high), min(electric, high), min(coast, high)
    n = 0
    if low < electric:
        for i in range(LANDINGS_BRAKE):
            out[n] = low + (electric - low) * i / LANDINGS_BRAKE
            n += 1
    for i in range(LANDINGS_EFFORT):
        out[n] = electric + (high - electric) * i / (LANDINGS_EFFORT - 1)
        n += 1
    out[n] = coast
    n += 1
    if low < v0 < high:
        out[n] = v0
        n += 1
    return n
