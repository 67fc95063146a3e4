"""Numba kernels of the exact front: segments of the paper's grid, arcs between its states, bounds, and labels.

Speeds are whole numbers u of the coasting sub-grid (0.01 km/h); those divisible by `ratio` are on the coarse grid.
A state of an inner node is its index u − lowest. Times are integers of ns and energies of mJ: sums do not depend on
their order, so that equal runs have equal labels and dominance needs no tolerance.

Symbols as in `das.solver.kernels`; per interval k: h, g, q. `first` and `last` of a state are the ends of the coarse
speeds it can reach, as multiples of `ratio`; `coast` is the speed it coasts to (-1: none). Labels of a state lie one
after the other, time rising and energy falling.
"""

from __future__ import annotations

import math

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
    """Whether a segment is within the limits of force, power (at the mean speed) and acceleration."""
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
    """The coarse speeds first[i] … last[i] (multiples of ratio) that every speed u[i] can reach, and the coasting
    speed.

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


STRIDE = 16
"""Number of labels that are examined together when halves are joined."""
ROOM = 1 << 18
"""Runs for which `join_labels` has room; it returns when half is used, so that the caller can drop dominated runs."""


@kernel
def _merge_pair(a, a_end, b, b_end, time, energy, parent, out, new_time, new_energy, new_parent):
    """Merge two non-dominated lists (time rising, energy falling) into one at `out`; returns its end."""
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
    """Merge `count` non-dominated lists stored in sequence; returns length, times, energies and parents of the result.

    Neighbours are merged in rounds, so that dominated labels are dropped early. Either set of arrays may hold the
    result.
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
        time, new_time = new_time, time
        energy, new_energy = new_energy, energy
        parent, new_parent = new_parent, parent
        count = merged
    return end[0], time, energy, parent


@kernel
def _envelope(lam, height, line, until):
    """The upper envelope of the lines height[l] − lam[l]·t (lam rises): its lines by t, and the last t of each.

    Returns the number of its lines.
    """
    n = 0
    for l in range(lam.size - 1, -1, -1):
        while n > 0:
            crossing = (height[line[n - 1]] - height[l]) / (lam[line[n - 1]] - lam[l])
            if n == 1 or crossing > until[n - 2]:
                until[n - 1] = crossing
                break
            n -= 1
        line[n] = l
        until[n] = math.inf
        n += 1
    return n


@kernel
def merge_labels(
    start,
    other,
    u,
    other_u,
    onward,
    offset,
    node_cost,
    time,
    energy,
    unit,
    h,
    g,
    q,
    p,
    c,
    lam,
    allowed,
    beyond,
    latest,
    bucket_ns,
):
    """Labels of a block of states u from their neighbours' labels, without those dominated or excluded by bounds.

    other[start[d]] … other[start[d + 1] − 1] are the rows of the neighbours of state d. `onward`: the labels go towards
    the end of the section, and the neighbours lie behind; else the labels come from the end, and the neighbours lie
    ahead. A neighbour i has the labels offset[i] … offset[i + 1] − 1 (time rising, energy falling) and node_cost[i, l],
    the least energy + lam·time among them. A label is kept if, for some l, its energy + lam·time + beyond[d, l] does
    not exceed allowed[l], and if its time does not exceed latest[d]. `lam` rises. `bucket_ns` > 0 keeps at most one
    label per bucket of time (a heuristic that finds upper bounds quickly); 0 keeps all.

    Returns times, energies, parents (label index) and the number of labels of each state.
    """
    m = lam.size
    size = 1024
    used = 0
    out_time = np.empty(size, np.int64)
    out_energy = np.empty(size, np.int64)
    out_parent = np.empty(size, np.uint32)
    counts = np.zeros(u.size, np.int64)
    room = 4096
    cand_time = np.empty(room, np.int64)
    cand_energy = np.empty(room, np.int64)
    cand_parent = np.empty(room, np.uint32)
    new_time = np.empty(room, np.int64)
    new_energy = np.empty(room, np.int64)
    new_parent = np.empty(room, np.uint32)
    height = np.empty(m)
    line = np.empty(m, np.int64)
    until = np.empty(m)
    for d in range(u.size):
        for l in range(m):
            height[l] = allowed[l] - beyond[d, l]
        lines = _envelope(lam, height, line, until)
        segment_end = np.empty(start[d + 1] - start[d] + 1, np.int64)
        n = 0
        segments = 0
        for x in range(start[d], start[d + 1]):
            i = other[x]
            v, w = u[d] * unit, other_u[i] * unit
            dt, de = segment(w if onward else v, v if onward else w, h, g, q, p, c)
            useful = False
            for l in range(m):
                if node_cost[i, l] <= height[l] - de / MJ - lam[l] * (dt / NS):
                    useful = True
                    break
            if not useful:
                continue
            if n + offset[i + 1] - offset[i] > room:
                room = 2 * (n + offset[i + 1] - offset[i])
                cand_time = grown(cand_time, room)
                cand_energy = grown(cand_energy, room)
                cand_parent = grown(cand_parent, room)
                new_time = np.empty(room, np.int64)
                new_energy = np.empty(room, np.int64)
                new_parent = np.empty(room, np.uint32)
            k = 0
            for a in range(offset[i], offset[i + 1]):
                t = time[a] + dt
                if t > latest[d]:
                    break
                seconds = t / NS
                while k < lines - 1 and seconds > until[k]:
                    k += 1
                e = energy[a] + de
                if e / MJ <= height[line[k]] - lam[line[k]] * seconds:
                    cand_time[n] = t
                    cand_energy[n] = e
                    cand_parent[n] = a
                    n += 1
            if n > (segment_end[segments - 1] if segments > 0 else 0):
                segment_end[segments] = n
                segments += 1
        if n == 0:
            continue
        n, merged_time, merged_energy, merged_parent = _merge_segments(
            segment_end, segments, cand_time, cand_energy, cand_parent, new_time, new_energy, new_parent
        )
        if used + n > size:
            size = 2 * (used + n)
            out_time = grown(out_time, size)
            out_energy = grown(out_energy, size)
            out_parent = grown(out_parent, size)
        begin = used
        for a in range(n):
            same = used > begin + 1 and bucket_ns > 0 and merged_time[a] // bucket_ns == out_time[used - 1] // bucket_ns
            if same:
                used -= 1
            out_time[used] = merged_time[a]
            out_energy[used] = merged_energy[a]
            out_parent[used] = merged_parent[a]
            used += 1
        counts[d] = used - begin
    return out_time[:used].copy(), out_energy[:used].copy(), out_parent[:used].copy(), counts


@kernel
def least_costs(begin, stop, offset, time, energy, lam, result):
    """result[i, l] = least energy + lam·time (J) among the labels of states begin … stop − 1; `lam` rises.

    The least lies at a corner of the labels' lower convex hull; the rising multipliers pass the corners from late to
    early.
    """
    largest = 0
    for i in range(begin, stop):
        largest = max(largest, offset[i + 1] - offset[i])
    hull = np.empty(largest, np.int64)
    for i in range(begin, stop):
        n = 0
        for a in range(offset[i], offset[i + 1]):
            while n > 1:
                b, o = hull[n - 1], hull[n - 2]
                if (energy[b] - energy[o]) / (time[b] - time[o]) < (energy[a] - energy[b]) / (time[a] - time[b]):
                    break
                n -= 1
            hull[n] = a
            n += 1
        k = n - 1
        for l in range(lam.size):
            if n == 0:
                result[i, l] = math.inf
                continue
            cost = energy[hull[k]] / MJ + lam[l] * (time[hull[k]] / NS)
            while k > 0:
                before = energy[hull[k - 1]] / MJ + lam[l] * (time[hull[k - 1]] / NS)
                if before > cost:
                    break
                cost = before
                k -= 1
            result[i, l] = cost


@kernel
def join_labels(begin, stop, a_offset, a_time, a_energy, b_offset, b_time, b_energy, latest, known, origin, width):
    """Runs that consist of a label from the start and one from the end that meet in a state begin … stop − 1.

    known[x] is the least energy of a known run that takes at most origin + x·width. A run is left out if a known run
    takes less energy and no more time, or if it takes longer than `latest`.

    Returns times, energies, the two labels of each run, and the state from which the next call continues.
    """
    size = ROOM
    time = np.empty(size, np.int64)
    energy = np.empty(size, np.int64)
    first = np.empty(size, np.uint32)
    second = np.empty(size, np.uint32)
    used = 0
    i = begin
    while i < stop and used < ROOM // 2:
        for a in range(a_offset[i], a_offset[i + 1]):
            for block in range(b_offset[i], b_offset[i + 1], STRIDE):
                end = min(block + STRIDE, b_offset[i + 1])
                t = a_time[a] + b_time[block]
                if t > latest:
                    break
                if a_energy[a] + b_energy[end - 1] > known[(t - origin) // width]:
                    continue
                if used + STRIDE > size:
                    size *= 2
                    time, energy = grown(time, size), grown(energy, size)
                    first, second = grown(first, size), grown(second, size)
                for b in range(block, end):
                    t = a_time[a] + b_time[b]
                    e = a_energy[a] + b_energy[b]
                    if t <= latest and e <= known[(t - origin) // width]:
                        time[used] = t
                        energy[used] = e
                        first[used] = a
                        second[used] = b
                        used += 1
        i += 1
    return time[:used].copy(), energy[:used].copy(), first[:used].copy(), second[:used].copy(), i
