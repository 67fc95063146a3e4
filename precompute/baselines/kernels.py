"""Numba kernels of the baseline strategies, on the integration grid of a section.

Symbols and preconditions are those of `das.solver.kernels`. `base` is the run that holds one cruising speed: full
traction up to min(envelope, cruising speed), then holding, then braking along the envelope; `floor` is what
climbing_floor returns. A *coasting arc* leaves the base run at a node and comes back to it where the two speeds cross.
"""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.driving import drive, trip_time
from das.solver.kernels.forces import electric_limit, electric_share, loss_power, mean_resistance, on_supply
from das.solver.tolerances import CREEP_MPS

CROSSINGS = 3
"""Number of crossings of the base run at which a coasting arc may end: up to the first it lies below the base run, then
(on a descent) above it, then below it again."""

_STEPS = 60
_TOLERANCE = 1e-13
_ON_BASE_MPS = 1e-9
_EARLY_SHARE = 0.25
"""Share of its planned nodes by which an arc may end early."""
_NO_FRICTION = 1.0 - 1e-9
"""Factor on the electric brake's limit, so that rounding does not bring in the friction brake."""


@kernel
def electric_envelope(line, envelope, p):
    """Fastest speed at each node from which the motors alone brake to the envelope; above it, friction must help."""
    step, g, q, u = line
    n = step.size
    v = np.empty(n + 1)
    v[n] = envelope[n]
    for i in range(n - 1, -1, -1):
        here = on_supply(p, u[i])
        v1 = v[i + 1]
        v0 = v1
        for _ in range(_STEPS):
            brake = electric_limit(max(v0, v1), here) * _NO_FRICTION
            rate = (brake + mean_resistance(v0, v1, q[i], p) + g[i]) / p.inertial_mass_kg
            new = math.sqrt(v1 * v1 + 2.0 * step[i] * max(min(rate, p.max_deceleration_mps2), 0.0))
            new = min(new, envelope[i])
            if abs(new - v0) <= _TOLERANCE * new:
                v0 = new
                break
            v0 = new
        v[i] = v0
    return v


@kernel
def cruise_run(cruise, line, bounds, p, v):
    """The run from v[0] that holds one cruising speed; fills v, returns the trip time (s), or -1 after a stall.

    The train uses full effort up to min(envelope, cruise), and then holds that speed with traction or brakes. It uses
    full traction below that speed, or if the floor is above it. Braking follows the envelope.
    """
    floor, envelope = bounds
    for i in range(line.step_m.size):
        landing = min(envelope[i + 1], max(cruise, floor[i + 1]))
        if not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return -1.0
    return trip_time(line.step_m, v)


@kernel
def coasting_speed(v0, h, g, q, p):
    """Speed after a step without any wheel force; 0 if the train stops."""
    c2 = p.c2_n_per_mps2 + q
    slope = 2.0 * h / p.inertial_mass_kg
    w0 = v0 * v0
    # The part that does not depend on the final speed: w1·(1 + h·c2/m) = known − slope·c1·v̄.
    known = w0 - slope * (p.c0_n + 0.5 * c2 * w0 + g)
    share = 1.0 / (1.0 + 0.5 * slope * c2)
    v1 = v0
    for _ in range(_STEPS):
        mean_v = (2.0 / 3.0) * (w0 + v0 * v1 + v1 * v1) / (v0 + v1) if v0 + v1 > 0.0 else 0.0
        w1 = share * (known - slope * p.c1_n_per_mps * mean_v)
        if w1 <= 0.0:
            return 0.0
        new = math.sqrt(w1)
        if abs(new - v1) <= _TOLERANCE * new:
            return new
        v1 = new
    return v1


@kernel
def interval_cost(v0, v1, h, g, q, p, c):
    """Time (s) and energy at the collector (J) of an interval of a trajectory, as in its energy balance."""
    mid = 0.5 * (v0 + v1)
    dt = h / mid
    f = p.inertial_mass_kg * (v1 * v1 - v0 * v0) / (2.0 * h) + mean_resistance(v0, v1, q, p) + g
    el = electric_share(f, max(v0, v1), p)
    energy = el * h + loss_power(el, mid, c) * dt
    return dt, energy if energy > 0.0 else p.receptivity_ratio * energy


@kernel
def run_costs(v, line, p, c, time_s, energy_j):
    """Time and energy from the start to each node of a run; fills time_s and energy_j."""
    step, g, q, u = line
    time_s[0] = 0.0
    energy_j[0] = 0.0
    for i in range(step.size):
        dt, de = interval_cost(v[i], v[i + 1], step[i], g[i], q[i], on_supply(p, u[i]), c)
        time_s[i + 1] = time_s[i] + dt
        energy_j[i + 1] = energy_j[i] + de


@kernel
def _side(v, base_v):
    """The side of the base run: +1 above it, -1 below it, 0 on it."""
    if abs(v - base_v) <= _ON_BASE_MPS:
        return 0
    return 1 if v > base_v else -1


@kernel
def coasting_arcs(base, base_s, base_j, most_s, line, bounds, p, c, target, extra_s, extra_j, count):
    """All coasting arcs of a base run: from every node to up to CROSSINGS places where they meet it again.

    count[i] arcs start at node i; arc m ends at node target[i, m] and takes extra_s[i, m] (s) and extra_j[i, m] (J)
    more than the base run (usually more time, less energy). `base_s`, `base_j` are run_costs of the base run; an arc is
    given up once it is more than most_s (s) behind. While coasting, the envelope is kept by braking and the floor by
    full traction.
    """
    step, g, q, u = line
    floor, envelope = bounds
    n = step.size
    for i in range(n):
        count[i] = 0
        v = base[i]
        if v < CREEP_MPS:
            continue
        side = 0
        time_s = 0.0
        energy_j = 0.0
        for j in range(i, n):
            free = coasting_speed(v, step[j], g[j], q[j], p)
            ahead = min(max(free, floor[j + 1]), envelope[j + 1])
            now = _side(ahead, base[j + 1])
            if j == i:
                side = now
                if now == 0:
                    break
            if now != side:
                dt, de = interval_cost(v, base[j + 1], step[j], g[j], q[j], on_supply(p, u[j]), c)
                m = count[i]
                target[i, m] = j + 1
                extra_s[i, m] = time_s + dt - (base_s[j + 1] - base_s[i])
                extra_j[i, m] = energy_j + de - (base_j[j + 1] - base_j[i])
                count[i] += 1
                side = now
                if now == 0 or count[i] == CROSSINGS:
                    break
            if ahead < CREEP_MPS:
                break
            if ahead == free:
                mid = 0.5 * (v + ahead)
                dt = step[j] / mid
                de = loss_power(0.0, mid, c) * dt
            else:
                dt, de = interval_cost(v, ahead, step[j], g[j], q[j], on_supply(p, u[j]), c)
            time_s += dt
            energy_j += de
            v = ahead
            if time_s - (base_s[j + 1] - base_s[i]) > most_s:
                break


@kernel
def best_arcs(price, target, extra_s, extra_j, count, choice, cost, time_s):
    """The arcs along a base run that minimise extra energy + price·extra time (Bellman, from the end).

    Fills for each node: choice (the arc taken from there; -1: stay on the base run), cost (J, from there to the end)
    and time_s (extra time from there to the end).
    """
    n = count.size
    cost[n] = 0.0
    time_s[n] = 0.0
    for i in range(n - 1, -1, -1):
        cost[i] = cost[i + 1]
        time_s[i] = time_s[i + 1]
        choice[i] = -1
        for m in range(count[i]):
            k = target[i, m]
            total = extra_j[i, m] + price * extra_s[i, m] + cost[k]
            if total < cost[i]:
                cost[i] = total
                time_s[i] = extra_s[i, m] + time_s[k]
                choice[i] = m


@kernel
def four_mode_run(cruise, ends, base, line, bounds, p, v, coasting):
    """Drive a base run with coasting arcs; fills v, returns the trip time (s), or -1 after a stall.

    ends[i] > 0: an arc starts at node i (unless another is under way) and ends at the first crossing of the base run
    near node ends[i] or beyond; an earlier crossing, at which the arc only grazes the base run, is ignored. coasting[i]
    is true if interval i has no wheel force. Every interval is limited to the capability of the train.
    """
    step, g, q, _ = line
    floor, envelope = bounds
    earliest = 0
    side = 0
    for i in range(step.size):
        landing = min(envelope[i + 1], max(cruise, floor[i + 1]))
        coasting[i] = False
        if earliest == 0 and ends[i] > 0:
            earliest = ends[i] - int(_EARLY_SHARE * (ends[i] - i))
            side = 0
        if earliest > 0:
            free = coasting_speed(v[i], step[i], g[i], q[i], p)
            ahead = min(max(free, floor[i + 1]), envelope[i + 1])
            now = _side(ahead, base[i + 1])
            if i + 1 >= earliest and (now == 0 or side not in (0, now)):
                earliest = 0
            side = now
            if earliest > 0:
                landing = ahead
                coasting[i] = ahead == free
            else:
                landing = base[i + 1]
        if not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return -1.0
    return trip_time(line.step_m, v)
