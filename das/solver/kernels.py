"""Numba kernels of the solver: they fill arrays they are given or return plain tuples, and check nothing.

Symbols: s position (m), v speed (m/s), h step (m), w = v² (m²/s²), m inertial mass (kg), f wheel force (N),
g constant resisting force of an interval (gradient and curves, N), q tunnel coefficient (N/(m/s)²), u supply
(receptivity, or `NO_REGENERATION`, or `NEUTRAL`), p the train, c its losses, lam the
multiplier λ (W): the price of a second. Within a step of integration the acceleration is constant.

Preconditions of every kernel: float64 C-contiguous arrays of matching lengths, steps > 0, a TrainParams and a
LossParams as `das.solver.section` makes them.
"""

from __future__ import annotations

import math

import numpy as np

from das.domain.route import NEUTRAL
from das.solver.compiling import compiled, kernel
from das.solver.params import NO_LIMIT_N, TrainParams
from das.solver.tolerances import INFEASIBLE, LANDINGS_BRAKE, LANDINGS_EFFORT, SMALLEST_SHARE, UNREACHABLE

SPECIAL_LANDINGS = 2
"""Coasting and holding the speed."""
LANDINGS = LANDINGS_EFFORT + LANDINGS_BRAKE + SPECIAL_LANDINGS
TOGETHER = 5
"""Landings that the sweep takes at a time; its code is written for five."""
PADDED_LANDINGS = -(-LANDINGS // TOGETHER) * TOGETHER

_FIXED_POINT_STEPS = 60
_FIXED_POINT_TOLERANCE = 1e-13
_LANDING_STEPS = 4


@kernel
def mean_resistance(v0, v1, q, p):
    """Running and tunnel resistance averaged over the way at constant acceleration from v0 to v1 (exact)."""
    total = v0 + v1
    if total <= 0.0:
        return p.c0_n
    mean_v = (2.0 / 3.0) * (v0 * v0 + v0 * v1 + v1 * v1) / total
    return p.c0_n + p.c1_n_per_mps * mean_v + (p.c2_n_per_mps2 + q) * 0.5 * (v0 * v0 + v1 * v1)


@kernel
def on_supply(p, u):
    """The train on a stretch with supply u: without motors, without electric brake, or with the line's receptivity."""
    traction = 0.0 if u == NEUTRAL else p.traction_force_n
    electric = p.electric_force_n if u >= 0.0 or p.brakes_dissipate else 0.0
    return TrainParams(
        p.inertial_mass_kg,
        p.c0_n,
        p.c1_n_per_mps,
        p.c2_n_per_mps2,
        traction,
        p.traction_power_w,
        electric,
        p.electric_power_w,
        p.friction_force_n,
        p.adhesive_force_n,
        p.braked_adhesive_force_n,
        p.max_acceleration_mps2,
        p.max_deceleration_mps2,
        max(u, 0.0),
        p.brakes_dissipate,
    )


@kernel
def adhesion_coefficient(v):
    """Curtius & Kniffler; as das.domain.vehicle.adhesion_coefficient, in a kernel."""
    return 0.161 + 7.5 / (3.6 * v + 44.0)


@kernel
def _effort_limit(v, force, power, adhesive_force):
    limit = force if v * force <= power else power / v
    if adhesive_force < NO_LIMIT_N:
        return min(limit, adhesive_force * adhesion_coefficient(v))
    return limit


@kernel
def traction_limit(v, p):
    return _effort_limit(v, p.traction_force_n, p.traction_power_w, p.adhesive_force_n)


@kernel
def electric_limit(v, p):
    return _effort_limit(v, p.electric_force_n, p.electric_power_w, p.adhesive_force_n)


@kernel
def brake_limit(v, p, friction_n):
    """Electric brake and `friction_n` of friction brake together, at most what all axles can put on the rail."""
    both = electric_limit(v, p) + friction_n
    if p.braked_adhesive_force_n < NO_LIMIT_N:
        return min(both, p.braked_adhesive_force_n * adhesion_coefficient(v))
    return both


@kernel
def largest_gain(v, resisting, p):
    """Acceleration at full traction against a resisting force: the train's largest, unless full brake leaves more."""
    rate = (traction_limit(v, p) - resisting) / p.inertial_mass_kg
    if rate <= p.max_acceleration_mps2:
        return rate
    return max(p.max_acceleration_mps2, -(brake_limit(v, p, p.friction_force_n) + resisting) / p.inertial_mass_kg)


@kernel
def largest_loss(v, resisting, p, friction_n):
    """Deceleration at full brake with a resisting force: the train's largest, unless full traction leaves more."""
    rate = (brake_limit(v, p, friction_n) + resisting) / p.inertial_mass_kg
    if rate <= p.max_deceleration_mps2:
        return rate
    return max(p.max_deceleration_mps2, (resisting - traction_limit(v, p)) / p.inertial_mass_kg)


@kernel
def loss_power(f, v, c):
    """Component loss (W) at wheel force f and speed v > 0."""
    if not c.is_map:
        power = f * v
        if power >= 0.0:
            return c.traction_ratio * power + c.idle_w
        return c.idle_w - c.brake_ratio * power
    x = v * c.steps_per_mps
    y = (f - c.force0_n) * c.steps_per_n
    i = min(max(int(x), 0), c.table_w.shape[0] - 2)
    j = min(max(int(y), 0), c.table_w.shape[1] - 2)
    a = x - i
    b = y - j
    low = c.table_w[i, j] + b * (c.table_w[i, j + 1] - c.table_w[i, j])
    high = c.table_w[i + 1, j] + b * (c.table_w[i + 1, j + 1] - c.table_w[i + 1, j])
    return low + a * (high - low)


@kernel
def electric_share(f, v, p):
    """The part of wheel force f that motors give or take: all traction; braking up to the electric limit."""
    if f >= 0.0:
        return f
    if p.brakes_dissipate:
        return 0.0
    return max(f, -electric_limit(v, p))


@kernel
def braking_envelope(step, g, q, u, limit, end_speed, p):
    """Fastest speed at each node from which limits and the end can be kept, integrated backwards.

    Returns it with the index of the first interval (from the end) where braking is impossible, or -1.
    The brake power limit is taken at the faster end of each step, so it holds over the whole step.
    """
    n = step.size
    v = np.empty(n + 1)
    v[n] = min(end_speed, limit[n - 1])
    for i in range(n - 1, -1, -1):
        cap = limit[i] if i == 0 else min(limit[i], limit[i - 1])
        here = on_supply(p, u[i])
        v1 = v[i + 1]
        start = min(_hardest_brake_start(0.0, v1, step[i], g[i], q[i], here), cap)
        if start <= 0.0:
            return v, i
        low, low_gap, high, high_gap, v0 = 0.0, start, 0.0, 0.0, v1
        for _ in range(_FIXED_POINT_STEPS):
            new = min(_hardest_brake_start(v0, v1, step[i], g[i], q[i], here), cap)
            if abs(new - v0) <= _FIXED_POINT_TOLERANCE * new:
                low = new
                break
            low, low_gap, high, high_gap, v0 = _narrowed(v0, new, low, low_gap, high, high_gap)
        v[i] = low
    return v, -1


@kernel
def _hardest_brake_start(v0, v1, h, g, q, p):
    """Speed from which the hardest brake of a start at v0 lands at v1 (0: it would run away)."""
    w0 = v1 * v1 + 2.0 * h * largest_loss(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p, p.friction_force_n)
    return math.sqrt(w0) if w0 > 0.0 else 0.0


@kernel
def climbing_floor(step, g, q, u, envelope, least, p):
    """Slowest speed at each node from which full traction still reaches the end speed and climbs every hill ahead.

    0 where the train can set off from a standstill; no crest is passed slower than `least`. Never above the envelope,
    whose last value is the end speed. Integrated backwards; the power limit is taken at the faster end of each step.
    """
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


@kernel
def grid_speed(floor, top, j, steps):
    """Speed of grid line j of a decision node: evenly from the floor to the envelope."""
    return floor + (top - floor) * j / steps


@kernel
def locate(v, floor, top, steps):
    """Grid line below speed v and the share of the line above it, linear in v²; (-1, 0.0) outside the table.

    A standing train (line 0 of a floor of 0) is not in the table. A speed less than half a line below a floor
    is taken as on it: that is the rounding of the integration.
    """
    span = top - floor
    if span <= 0.0:
        return 0, 0.0
    x = (v - floor) * (steps / span)
    if floor <= 0.0:
        if x < 1.0:
            return -1, 0.0
    elif x < 0.0:
        if x < -0.5:
            return -1, 0.0
        return 0, 0.0
    lower = min(int(x), steps - 1)
    # (v² − a²)/(b² − a²) with the lines a = v − beyond and b = a + span/steps: one division, no cancellation.
    u = x - lower
    beyond = u * (span / steps)
    share = u * (2.0 * v - beyond) / (2.0 * (v - beyond) + span / steps)
    if share < SMALLEST_SHARE:
        share = 0.0
    elif share > 1.0 - SMALLEST_SHARE:
        share = 1.0
    return lower, share


@kernel
def full_traction_speed(v0, h, g, q, p):
    """Speed after a step at full traction; the power limit holds over the whole step. 0 where the train stalls."""
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
    """Speed after a step at the full traction of a landing at v1 (0: it stops)."""
    w1 = v0 * v0 + 2.0 * h * largest_gain(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p)
    return math.sqrt(w1) if w1 > 0.0 else 0.0


@kernel
def _narrowed(v, new, low, low_gap, high, high_gap):
    """The next guess of a speed that is its own `new`, where new falls as v rises, and the bounds of it.

    The power limit leaves less force, the faster the step: v would swing between too fast and too slow. So it is
    bracketed and found by false position (Illinois); `high_gap` is 0 as long as nothing was too fast.
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
def fastest_run(step, g, q, u, envelope, start_speed, p):
    """Speeds of the fastest run under the envelope, with the index of the interval where it stalls, or -1."""
    n = step.size
    v = np.empty(n + 1)
    v[0] = start_speed
    for i in range(n):
        v1 = min(full_traction_speed(v[i], step[i], g[i], q[i], on_supply(p, u[i])), envelope[i + 1])
        if v1 <= 0.0 and i < n - 1:
            return v, i
        v[i + 1] = v1
    return v, -1


@kernel
def landing_speed(v0, h, sign, g, q, p):
    """Speed after a decision step at full traction (sign 1) or electric brake (−1) of its mean speed; 0 if it stops."""
    v1 = v0
    for _ in range(_LANDING_STEPS):
        mid = 0.5 * (v0 + v1)
        f = traction_limit(mid, p) if sign > 0.0 else -electric_limit(mid, p)
        v1 = _speed_under(f, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
    return v1


@kernel
def landing_under(f, v0, h, g, q, p):
    """Speed after a decision step under the constant wheel force f; 0 if it stops."""
    v1 = v0
    for _ in range(_LANDING_STEPS):
        v1 = _speed_under(f, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
    return v1


@kernel
def _speed_under(f, v0, v1, h, g, q, p):
    """Speed after a step under wheel force f, the resistance taken as for a landing at v1; 0 if it stops."""
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
def landings(v0, h, g, q, top, last, p, out):
    """Fill `out` with the landing speeds worth trying from v0; returns how many, hardest brake first.

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
    coast = landing_under(0.0, v0, h, g, q, p)
    electric = coast
    if not p.brakes_dissipate and p.electric_force_n > 0.0:
        electric = landing_speed(v0, h, -1.0, g, q, p)
    low = electric
    if p.friction_force_n > 0.0 or p.brakes_dissipate:
        # Both brakes together; the electric part is taken at its limit at v0, exact where that is a force limit.
        low = min(landing_under(-brake_limit(v0, p, p.friction_force_n), v0, h, g, q, p), electric)
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


@kernel
def transitions(
    first, last, node, constant, tunnel, supply, floor, envelope, steps, p, c, dt, energy, target, weight, count
):
    """All transitions of the decision nodes first … last − 1.

    For node first + k, speed index j and landing i: dt[k, j, i] (s), energy (J), target (speed index below the landing
    at the next node) and weight (share of the index above, linear in v²). count[k, j] landings are filled, and the
    rest of the last `TOGETHER` with what is never chosen.
    """
    n = node.size - 1
    out = np.empty(LANDINGS)
    for k in range(first, last):
        h = node[k + 1] - node[k]
        here = on_supply(p, supply[k])
        top = envelope[k + 1]
        final = k == n - 1 and floor[k + 1] >= top
        row = k - first
        for j in range(steps + 1):
            v0 = grid_speed(floor[k], envelope[k], j, steps)
            count[row, j] = 0
            if v0 <= 0.0:
                continue
            m = landings(v0, h, constant[k], tunnel[k], top, final, here, out)
            used = 0
            for i in range(m):
                v1 = out[i]
                lower = 0
                share = 0.0
                if not final:
                    lower, share = locate(v1, floor[k + 1], top, steps)
                    if lower < 0:
                        continue
                a, b = step_cost(v0, v1, h, constant[k], tunnel[k], here, c)
                dt[row, j, used] = a
                energy[row, j, used] = b
                target[row, j, used] = lower
                weight[row, j, used] = share
                used += 1
            count[row, j] = used
            for i in range(used, -(-used // TOGETHER) * TOGETHER):
                dt[row, j, i] = 0.0
                energy[row, j, i] = INFEASIBLE
                target[row, j, i] = 0
                weight[row, j, i] = 0.0


@kernel
def _move(time_s, energy, target, weight, k, j, i):
    return target[k, j, i], float(weight[k, j, i]), energy[k, j, i], float(time_s[k, j, i])


@kernel
def _cheaper(best, choice, cost, i):
    better = cost < best
    return cost if better else best, i if better else choice


@compiled(fastmath=True)
def backward_sweep(first, last, lam, dt, energy, target, weight, count, value, time_to_go):
    """Bellman sweep of the multipliers lam[first … last − 1] at once: value (J) and time-to-go (s) of every state.

    value[k, j, l] = min over landings of energy + lam·dt + value at the landing (linear in v²). Row k = n of both
    outputs must hold the end values; the other rows are filled. Landings are taken five at a time (`TOGETHER`): one
    at a time, loading and storing the best so far takes longer than the sums.
    """
    n, states = count.shape
    lo = max(first, 0)
    m = last - lo
    price = lam[lo:last].copy()
    best = np.empty(m)
    choice = np.empty(m, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        # Rows without the first index and an offset known to be >= 0: else the loops over l are not vectorised.
        ahead, ahead_s, here, here_s = value[k + 1], time_to_go[k + 1], value[k], time_to_go[k]
        for j in range(states):
            for l in range(m):
                best[l] = INFEASIBLE
                choice[l] = -1
            for i in range(0, count[k, j], TOGETHER):
                a0, s0, e0, t0 = _move(dt, energy, target, weight, k, j, i)
                a1, s1, e1, t1 = _move(dt, energy, target, weight, k, j, i + 1)
                a2, s2, e2, t2 = _move(dt, energy, target, weight, k, j, i + 2)
                a3, s3, e3, t3 = _move(dt, energy, target, weight, k, j, i + 3)
                a4, s4, e4, t4 = _move(dt, energy, target, weight, k, j, i + 4)
                for l in range(m):
                    p = price[l]
                    b = best[l]
                    c = choice[l]
                    x = lo + l
                    b, c = _cheaper(b, c, e0 + p * t0 + (1.0 - s0) * ahead[a0, x] + s0 * ahead[a0 + 1, x], i)
                    b, c = _cheaper(b, c, e1 + p * t1 + (1.0 - s1) * ahead[a1, x] + s1 * ahead[a1 + 1, x], i + 1)
                    b, c = _cheaper(b, c, e2 + p * t2 + (1.0 - s2) * ahead[a2, x] + s2 * ahead[a2 + 1, x], i + 2)
                    b, c = _cheaper(b, c, e3 + p * t3 + (1.0 - s3) * ahead[a3, x] + s3 * ahead[a3 + 1, x], i + 3)
                    b, c = _cheaper(b, c, e4 + p * t4 + (1.0 - s4) * ahead[a4, x] + s4 * ahead[a4 + 1, x], i + 4)
                    best[l] = b
                    choice[l] = c
            for l in range(m):
                i = choice[l]
                x = lo + l
                if i < 0 or best[l] > UNREACHABLE:
                    # Between a feasible and an infeasible neighbour the interpolated cost is neither.
                    here[j, x] = INFEASIBLE
                    here_s[j, x] = INFEASIBLE
                else:
                    here[j, x] = best[l]
                    a = target[k, j, i]
                    s = weight[k, j, i]
                    here_s[j, x] = dt[k, j, i] + (1.0 - s) * ahead_s[a, x] + s * ahead_s[a + 1, x]
