"""Numba kernels of the exact front: segments of the paper's grid, the arcs between its states, and bounds.

Speeds are whole numbers u of the coasting sub-grid (0.01 km/h); those divisible by `ratio` are on the coarse grid.
A state of an inner node is its index u − lowest. Times are integers of ns and energies of mJ: sums do not depend on
their order, so that equal runs have equal labels and dominance needs no tolerance.

Symbols as in `das.solver.kernels`; per interval k: h, g, q. `span` of a state is the range of coarse speeds it can
reach, as first and last multiple of `ratio`; `coast` the speed it coasts to (-1: none).
"""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.arrays import put
from das.solver.kernels.forces import brake_limit, mean_resistance, on_supply, traction_limit
from das.solver.kernels.landings import landing_speed, landing_under, step_cost

NS = 1e9
MJ = 1e3
NEVER = np.int64(2**62)
_ROUNDING = 1e-9


@kernel
def attainable(v0, v1, h, g, q, p):
    """Whether a segment lies within forces, powers (at the mean speed) and accelerations."""
    mid = 0.5 * (v0 + v1)
    if mid <= 0.0:
        return False
    rate = (v1 * v1 - v0 * v0) / (2.0 * h)
    if rate > p.max_acceleration_mps2 * (1.0 + _ROUNDING) or -rate > p.max_deceleration_mps2 * (1.0 + _ROUNDING):
        return False
    f = p.inertial_mass_kg * rate + mean_resistance(v0, v1, q, p) + g
    if f >= 0.0:
        return f <= traction_limit(mid, p) * (1.0 + _ROUNDING)
    return -f <= brake_limit(mid, p, p.friction_force_n) * (1.0 + _ROUNDING)


@kernel
def segment(v0, v1, h, g, q, p, c):
    """Time (ns) and energy at the collector (mJ) of a segment, rounded to whole numbers."""
    dt, energy = step_cost(v0, v1, h, g, q, p, c)
    return np.int64(round(dt * NS)), np.int64(round(energy * MJ))


@kernel
def segment_ns(v0, v1, h):
    return np.int64(round(h / (0.5 * (v0 + v1)) * NS))


@kernel
def spans(u, unit, ratio, h, g, q, lowest, highest, p, first, last, coast):
    """For every speed u[i]: the coarse speeds first[i] … last[i] (multiples of ratio) and the coasting speed.

    Only speeds from `lowest` to `highest` (in units) count; an empty range has last < first.
    """
    for i in range(u.size):
        v0 = u[i] * unit
        fastest = landing_speed(v0, h, 1.0, g, q, p)
        up = min(int(fastest / unit) // ratio + 1, highest // ratio)
        while up * ratio >= lowest and not attainable(v0, up * ratio * unit, h, g, q, p):
            if up * ratio * unit < v0 and up * ratio * unit < fastest * 0.98:
                break
            up -= 1
        low = (lowest + ratio - 1) // ratio
        # Start below the speed after the hardest braking: power is limited at the mean speed, which is not known yet.
        brake = p.electric_force_n + p.friction_force_n
        slowest = landing_under(-brake, v0, h, g, q, p)
        down = max(int(slowest / unit) // ratio - 1, low)
        while down <= up and not attainable(v0, down * ratio * unit, h, g, q, p):
            down += 1
        first[i] = down
        last[i] = max(up, down - 1)
        coast[i] = -1
        v1 = landing_under(0.0, v0, h, g, q, p)
        target = round(v1 / unit)
        if lowest <= target <= highest and attainable(v0, target * unit, h, g, q, p):
            coast[i] = target


@kernel
def earliest(u, time, first, last, coast, unit, ratio, h, lowest, result):
    """Forward: earliest arrival (ns) at the next node's states; states that cannot be reached get NEVER."""
    result[:] = NEVER
    for i in range(u.size):
        v0 = u[i] * unit
        for j in range(first[i], last[i] + 1):
            v1 = j * ratio * unit
            t = time[i] + segment_ns(v0, v1, h)
            k = j * ratio - lowest
            result[k] = min(result[k], t)
        if coast[i] >= 0:
            v1 = coast[i] * unit
            t = time[i] + segment_ns(v0, v1, h)
            k = coast[i] - lowest
            result[k] = min(result[k], t)


@kernel
def least_time_to_go(u, first, last, coast, unit, ratio, h, lowest, ahead, result):
    """Backward: least time to go (ns) of the states u, from the least times `ahead` of the next node's states."""
    for i in range(u.size):
        v0 = u[i] * unit
        best = NEVER
        for j in range(first[i], last[i] + 1):
            k = j * ratio - lowest
            if ahead[k] < NEVER:
                best = min(best, ahead[k] + segment_ns(v0, j * ratio * unit, h))
        if coast[i] >= 0 and ahead[coast[i] - lowest] < NEVER:
            t = segment_ns(v0, coast[i] * unit, h)
            best = min(best, ahead[coast[i] - lowest] + t)
        result[i] = best


@kernel
def grown(array, size):
    new = np.empty(size, array.dtype)
    put(array, new)
    return new


@kernel
def arcs(first, last, coast, ratio, lowest, row):
    """The arcs of states i: other[start[i]] … other[start[i + 1] − 1] are the rows that they lead to at the next node.

    `row[k]` is the row of the next node's state k (−1: none).
    """
    start = np.zeros(first.size + 1, np.int64)
    other = np.empty(first.size * 8 + 64, np.int32)
    n = 0
    for i in range(first.size):
        if n + last[i] - first[i] + 2 > other.size:
            other = grown(other, 2 * (n + last[i] - first[i] + 2))
        for j in range(first[i], last[i] + 1):
            if row[j * ratio - lowest] >= 0:
                other[n] = row[j * ratio - lowest]
                n += 1
        on_coarse = coast[i] % ratio == 0 and first[i] <= coast[i] // ratio <= last[i]
        if coast[i] >= 0 and not on_coarse and row[coast[i] - lowest] >= 0:
            other[n] = row[coast[i] - lowest]
            n += 1
        start[i + 1] = n
    return start, other[:n].copy()


@kernel
def dual_values(begin, stop, start, other, u, other_u, onward, unit, h, g, q, p, c, lam, beyond, value, choice):
    """value[i, l] = least energy + lam·time (J) to the far end, for states begin … stop − 1; `choice`: the best row.

    `other` are the rows of the neighbours of each state, whose values are `beyond`. `onward`: the neighbours lie ahead,
    and the far end is the end of the section; else they lie behind, and the far end is its start. A choice of −1: no
    row.
    """
    m = lam.size
    best = np.empty(m)
    for i in range(begin, stop):
        best[:] = np.inf
        for l in range(m):
            choice[i, l] = -1
        for x in range(start[i], start[i + 1]):
            r = other[x]
            v, w = u[i] * unit, other_u[r] * unit
            t, e = segment(v if onward else w, w if onward else v, h, g, q, p, c)
            time_s = t / NS
            energy_j = e / MJ
            for l in range(m):
                cost = energy_j + lam[l] * time_s + beyond[r, l]
                if cost < best[l]:
                    best[l] = cost
                    choice[i, l] = r
        for l in range(m):
            value[i, l] = best[l]


@kernel
def run_total(run, unit, step, constant, tunnel, supply, p, c):
    """Time (ns) and energy (mJ) of a run given by its speeds at the nodes."""
    time = np.int64(0)
    energy = np.int64(0)
    for k in range(step.size):
        t, e = segment(run[k] * unit, run[k + 1] * unit, step[k], constant[k], tunnel[k], on_supply(p, supply[k]), c)
        time += t
        energy += e
    return time, energy


@kernel
def lower_hull(x, y):
    """Indices of the lower convex hull of points with rising x (Andrew's monotone chain)."""
    hull = np.empty(x.size, np.int64)
    n = 0
    for i in range(x.size):
        while n > 1:
            a = hull[n - 2]
            b = hull[n - 1]
            if (y[b] - y[a]) * (x[i] - x[a]) < (y[i] - y[a]) * (x[b] - x[a]):
                break
            n -= 1
        hull[n] = i
        n += 1
    return hull[:n]
