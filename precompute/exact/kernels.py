"""Numba kernels of the exact front: segments of the paper's grid, bounds, and Pareto merging of labels.

Speeds are whole numbers u of the coasting sub-grid (0.01 km/h); those divisible by `ratio` are on the coarse grid.
A state of an inner node is its index u − lowest. Times are integers of ns and energies of mJ: sums do not depend on
their order, so that equal runs have equal labels and dominance needs no tolerance.

Symbols as in `das.solver.kernels`; per interval k: h, g, q. `span` of a state is the range of coarse speeds it can
reach, as first and last multiple of `ratio`; `coast` the speed it coasts to (-1: none).
"""

from __future__ import annotations

import math

import numpy as np

from das.compiling.kernels import kernel
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
        # A start below the hardest braking: the power limit holds at the mean speed, which is not known yet.
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
    """Forward: earliest arrival (ns) at the next node's states; result is filled with NEVER outside."""
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
    """Backward: least time to go (ns) of the states u, from that of the next node's states."""
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
def dual_values(start, stop, u, first, last, coast, unit, ratio, h, g, q, p, c, lowest, row, ahead, lam, value, choice):
    """Backward: value[i, l] = least energy + lam·time (J) to go of states start … stop − 1; choice: the speed taken.

    `row[k]` is the row of the next node's state k in `ahead`, or -1.
    """
    m = lam.size
    best = np.empty(m)
    for i in range(start, stop):
        v0 = u[i] * unit
        best[:] = np.inf
        for l in range(m):
            choice[i, l] = -1
        for j in range(first[i], last[i] + 2):
            target = j * ratio if j <= last[i] else coast[i]
            if target < 0:
                continue
            r = row[target - lowest]
            if r < 0:
                continue
            t, e = segment(v0, target * unit, h, g, q, p, c)
            time_s = t / NS
            energy_j = e / MJ
            for l in range(m):
                cost = energy_j + lam[l] * time_s + ahead[r, l]
                if cost < best[l]:
                    best[l] = cost
                    choice[i, l] = target
        for l in range(m):
            value[i, l] = best[l]


@kernel
def _grown(array, size):
    new = np.empty(size, array.dtype)
    new[: array.size] = array
    return new


@kernel
def _merge_pair(a, a_end, b, b_end, time, energy, parent, out, new_time, new_energy, new_parent):
    """Merge two undominated lists (time rising, energy falling) into an undominated one from `out` on; its end."""
    lowest = NEVER
    while a < a_end or b < b_end:
        if b >= b_end:
            first = True
        elif a >= a_end:
            first = False
        else:
            first = time[a] < time[b] or (time[a] == time[b] and energy[a] <= energy[b])
        i = a if first else b
        if first:
            a += 1
        else:
            b += 1
        if energy[i] < lowest:
            lowest = energy[i]
            new_time[out] = time[i]
            new_energy[out] = energy[i]
            new_parent[out] = parent[i]
            out += 1
    return out


@kernel
def _merge_segments(end, count, time, energy, parent, new_time, new_energy, new_parent):
    """Merge `count` undominated lists that lie one after the other; the result is in time, energy, parent; its length.

    Neighbours are merged in rounds, so that what is dominated leaves early.
    """
    while count > 1:
        merged = 0
        begin = 0
        out = 0
        for k in range(0, count, 2):
            middle = end[k]
            last = end[k + 1] if k + 1 < count else middle
            out = _merge_pair(begin, middle, middle, last, time, energy, parent, out, new_time, new_energy, new_parent)
            begin = last
            end[merged] = out
            merged += 1
        time[:out] = new_time[:out]
        energy[:out] = new_energy[:out]
        parent[:out] = new_parent[:out]
        count = merged
    return end[0]


@kernel
def merge_labels(
    targets,
    coast_start,
    coast_source,
    u,
    offset,
    node_cost,
    time,
    energy,
    first,
    last,
    unit,
    ratio,
    h,
    g,
    q,
    p,
    c,
    lam,
    allowed,
    ahead,
    latest,
    bucket_ns,
):
    """Labels of a block of target states of the next node: everything not dominated and not excluded by the bounds.

    Sources u[i] have the labels offset[i] … offset[i + 1] − 1 (time rising, energy falling) and node_cost[i, l], the
    least energy + lam·time among them. `targets` are speeds; coast_source[coast_start[d] … coast_start[d + 1] − 1]
    are the sources that coast to target d. A label goes on where, for some l, its energy + lam·time + ahead[d, l]
    does not exceed allowed[l], and its time not latest[d]. `bucket_ns` > 0 keeps at most one label per bucket of time
    (a heuristic that makes upper bounds quickly); 0 keeps all.

    Returns times, energies, parents (label index) and the number of labels of each target.
    """
    m = lam.size
    size = 1024
    used = 0
    out_time = np.empty(size, np.int64)
    out_energy = np.empty(size, np.int64)
    out_parent = np.empty(size, np.uint32)
    counts = np.zeros(targets.size, np.int64)
    room = 4096
    cand_time = np.empty(room, np.int64)
    cand_energy = np.empty(room, np.int64)
    cand_parent = np.empty(room, np.uint32)
    new_time = np.empty(room, np.int64)
    new_energy = np.empty(room, np.int64)
    new_parent = np.empty(room, np.uint32)
    segment_end = np.empty(2 * u.size, np.int64)
    bound = np.empty(m)
    price = np.empty(m)
    source = np.empty(2 * u.size, np.int64)
    for d in range(targets.size):
        target = targets[d]
        v1 = target * unit
        n_source = 0
        if target % ratio == 0:
            j = target // ratio
            for i in range(u.size):
                if first[i] <= j <= last[i]:
                    source[n_source] = i
                    n_source += 1
        for x in range(coast_start[d], coast_start[d + 1]):
            source[n_source] = coast_source[x]
            n_source += 1
        n = 0
        segments = 0
        for x in range(n_source):
            i = source[x]
            v0 = u[i] * unit
            dt, de = segment(v0, v1, h, g, q, p, c)
            useful = 0
            for l in range(m):
                limit = allowed[l] - ahead[d, l] - de / MJ - lam[l] * (dt / NS)
                if node_cost[i, l] <= limit:
                    bound[useful] = limit
                    price[useful] = lam[l]
                    useful += 1
            if useful == 0:
                continue
            if n + offset[i + 1] - offset[i] > room:
                room = 2 * (n + offset[i + 1] - offset[i])
                cand_time = _grown(cand_time, room)
                cand_energy = _grown(cand_energy, room)
                cand_parent = _grown(cand_parent, room)
                new_time = np.empty(room, np.int64)
                new_energy = np.empty(room, np.int64)
                new_parent = np.empty(room, np.uint32)
            for a in range(offset[i], offset[i + 1]):
                t = time[a]
                if t + dt > latest[d]:
                    break
                seconds = t / NS
                joules = energy[a] / MJ
                for l in range(useful):
                    if joules + price[l] * seconds <= bound[l]:
                        cand_time[n] = t + dt
                        cand_energy[n] = energy[a] + de
                        cand_parent[n] = a
                        n += 1
                        break
            if n > (segment_end[segments - 1] if segments > 0 else 0):
                segment_end[segments] = n
                segments += 1
        if n == 0:
            continue
        n = _merge_segments(
            segment_end, segments, cand_time, cand_energy, cand_parent, new_time, new_energy, new_parent
        )
        if used + n > size:
            size = 2 * (used + n)
            out_time = _grown(out_time, size)
            out_energy = _grown(out_energy, size)
            out_parent = _grown(out_parent, size)
        begin = used
        for a in range(n):
            same = used > begin + 1 and bucket_ns > 0 and cand_time[a] // bucket_ns == out_time[used - 1] // bucket_ns
            if same:
                used -= 1
            out_time[used] = cand_time[a]
            out_energy[used] = cand_energy[a]
            out_parent[used] = cand_parent[a]
            used += 1
        counts[d] = used - begin
    return out_time[:used], out_energy[:used], out_parent[:used], counts


@kernel
def least_costs(offset, time, energy, lam, result):
    """result[i, l] = least energy + lam·time (J) among the labels of state i."""
    m = lam.size
    for i in range(offset.size - 1):
        for l in range(m):
            result[i, l] = math.inf
        for a in range(offset[i], offset[i + 1]):
            seconds = time[a] / NS
            joules = energy[a] / MJ
            for l in range(m):
                cost = joules + lam[l] * seconds
                if cost < result[i, l]:
                    result[i, l] = cost


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
