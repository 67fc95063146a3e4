"""Schedules of few-switch trajectories: following one, and polishing its phases until nothing more is gained."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.arrays import put
from das.solver.kernels.driving import drive, step_energy
from das.solver.kernels.few_switch_policy import BRAKE, COAST, CURVE, HOLD, TRACTION, speed_under
from das.solver.kernels.forces import on_supply

UNSAID_MPS = 0.05
"""A limit ahead demands brakes if the train would otherwise be too fast by more than this (m/s)."""
CREEP_MPS, CREEP_M = 0.5, 1.0
"""A train that brakes to a stop and is slower than this (m/s) creeps on while there is more than this (m) to go."""
BELOW_MPS = 0.5
"""A train that is slower than the speed to hold by more than this (m/s) accelerates first."""


@kernel
def followed_speed(i, phase, back_share, way, line, curve, v):
    """The speed at the end of interval i that a train in a phase (kind, share, target) aims at.

    `way` is the rest of the phase (m), and `curve` are the highest speeds allowed at both ends of the interval.
    """
    kind, share, target = phase
    step, g, q, here = line
    if kind == COAST:
        return _coasting(i, line, v)
    if kind in (TRACTION, HOLD):
        if v > target:
            return min(max(_coasting(i, line, v), target), v)
        if kind == HOLD and v >= target - BELOW_MPS:
            return target
        effort = share if kind == TRACTION else back_share
        return min(speed_under(TRACTION, effort, v, step[i], g[i], q[i], here), target)
    if v < CREEP_MPS and way > CREEP_M:  # The train would stop short of its mark.
        return min(speed_under(TRACTION, back_share, v, step[i], g[i], q[i], here), max(CREEP_MPS, target))
    if v <= target:
        return min(target, max(_coasting(i, line, v), v))
    if kind == BRAKE and share > 0.0:  # Brake with one effort to the target, then hold it.
        return min(max(speed_under(BRAKE, share, v, step[i], g[i], q[i], here), target), v)
    w, left = target * target, max(1.0 - step[i] / way, 0.0)  # Brake with one deceleration to the end of the phase.
    if kind == CURVE and curve[1] >= curve[0] >= v:
        return v  # The braking curve is still ahead.
    if kind == CURVE and curve[0] > target:  # Brake with one share of the braking curve.
        left = min(max(curve[1] * curve[1] - w, 0.0) / (curve[0] * curve[0] - w), 1.0)
    return min(_coasting(i, line, v), math.sqrt(w + (v * v - w) * left))


@kernel
def _coasting(i, line, v):
    """The speed at the end of interval i of a train that coasts."""
    step, g, q, here = line
    return speed_under(COAST, 0.0, v, step[i], g[i], q[i], here)


@kernel
def followed_step(i, phase, back_share, way, line, envelope, p, v):
    """Drive interval i in a `phase` (kind, share, target); fills v[i + 1].

    Returns the time (s), or -1 after a stall, and whether limits ahead demand more braking than the phase provides.
    """
    step, g, q, u = line
    here = (step, g, q, on_supply(p, u[i]))
    landing = followed_speed(i, phase, back_share, way, here, (envelope[i], envelope[i + 1]), v[i])
    moving = drive(i, i + 1, max(landing, 0.0), p.friction_force_n, line, envelope, p, v)
    # On a hill that the schedule cannot climb the train uses all its traction.
    if not moving and not drive(i, i + 1, envelope[i + 1], p.friction_force_n, line, envelope, p, v):
        return -1.0, False
    by_effort = phase[0] < BRAKE or (phase[0] == BRAKE and phase[1] > 0.0)
    unsaid = by_effort and landing > envelope[i + 1] + UNSAID_MPS and v[i + 1] < v[i]
    return 2.0 * step[i] / (v[i] + v[i + 1]), unsaid


@kernel
def follow(first, at, ends, phases, back_share, known, met_mps, line, envelope, p, c, v):
    """Follow a schedule from v[first] to the end; fills v.

    Returns the trip time (s), the energy at the current collector (J), and the time (s) in which limits ahead demand
    brakes although the phase is not one to brake; (-1, 0, 0) after a stall.

    `at[i]` is the number of the phase in interval i, and that phase ends `ends[i]` (m) beyond the interval; `phases`
    are the phases' kinds, shares and target speeds. `known` is a trajectory that keeps to the schedule (speeds and time
    to go at every node). Its rest is used from the node where the two speeds are within `met_mps` of each other
    (negative: never).
    """
    kinds, shares, targets = phases
    total, energy, unsaid = 0.0, 0.0, 0.0
    n = line.step_m.size
    for i in range(first, n):
        k = at[i]
        phase = kinds[k], shares[k], targets[k]
        way = ends[i] + line.step_m[i]
        took, is_unsaid = followed_step(i, phase, back_share, way, line, envelope, p, v)
        if took < 0.0:
            return -1.0, 0.0, 0.0
        total += took
        energy += step_energy(i, v[i], v[i + 1], line, p, c)
        unsaid += took if is_unsaid else 0.0
        if abs(v[i + 1] - known.speed_mps[i + 1]) < met_mps and i + 1 < n:
            for m in range(i + 1, n):
                v[m + 1] = known.speed_mps[m + 1]
                energy += step_energy(m, v[m], v[m + 1], line, p, c)
            return total + known.time_to_go_s[i + 1], energy, unsaid
    return total, energy, unsaid


UNSAID_S = 0.1
"""A move may add at most this (s) to the time in which limits demand brakes although the phase is not one to brake."""
MET_MPS = 1e-3
"""Two trajectories with the same phases ahead count as one once their speeds differ by less than this (m/s)."""
SLOWEST_MPS = 2.0
"""Polishing makes no speed to hold lower than this (m/s)."""
LEAST_SHARE = 0.2
"""Polishing makes no effort lower than this share of the largest."""
MOVES = 6
"""Number of moves: a phase begins earlier or later, leads to a lower or higher speed, or has less or more effort."""


@kernel
def cost_of_time(late, prices):
    """The cost (J) of arriving late (s; early < 0).

    `prices` are the price of a second late, the worth of a second early (W), and how many early seconds count (s).
    """
    late_w, early_w, early_s = prices
    return late_w * late if late > 0.0 else early_w * max(late, -early_s)


@kernel
def missing_time(first, begin, kind, step, least_s, v):
    """The sum of the times (s) by which phases that do not brake are shorter than `least_s`."""
    missing = 0.0
    for k in range(begin.size):
        last = begin[k + 1] if k + 1 < begin.size else step.size
        if kind[k] >= BRAKE or last <= first:
            continue
        lasts = 0.0
        for i in range(max(begin[k], first), last):
            lasts += 2.0 * step[i] / (v[i] + v[i + 1])
        missing += max(least_s - lasts, 0.0)
    return missing


@kernel
def lay_out(begin, node, at, ends):
    """Fill in the phase of every interval, and how far beyond the interval it ends (m)."""
    n = at.size
    k = 0
    for i in range(n):
        while k + 1 < begin.size and begin[k + 1] <= i:
            k += 1
        at[i] = k
        ends[i] = node[begin[k + 1] if k + 1 < begin.size else n] - node[i + 1]


@kernel
def drive_schedule(start, meets, laid_out, phases, back_share, line, envelope, p, c, base, v):
    """Follow a schedule from node `start` of the trajectory `base` on; from node `meets` on it may join `base` again.

    `base` holds speed, time, energy and the time of unsaid braking (s) up to every node. Fills v; returns time, energy
    and time of unsaid braking of the whole trajectory, or (-1, 0, 0) after a stall.
    """
    at, ends = laid_out
    kind, share, target = phases
    speed, elapsed, spent, unsaid = base
    n = at.size
    v[start] = speed[start]
    time, energy, silent = elapsed[start], spent[start], unsaid[start]
    for i in range(start, n):
        k = at[i]
        way = ends[i] + line.step_m[i]
        took, is_unsaid = followed_step(i, (kind[k], share[k], target[k]), back_share, way, line, envelope, p, v)
        if took < 0.0:
            return -1.0, 0.0, 0.0
        time += took
        energy += step_energy(i, v[i], v[i + 1], line, p, c)
        silent += took if is_unsaid else 0.0
        if i + 1 >= meets and abs(v[i + 1] - speed[i + 1]) < MET_MPS:
            left = elapsed[n] - elapsed[i + 1]
            return time + left, energy + spent[n] - spent[i + 1], silent + unsaid[n] - unsaid[i + 1]
    return time, energy, silent


@kernel
def record(first, laid_out, phases, back_share, line, envelope, p, c, base):
    """Follow a schedule from v[first] to the end and fill `base`; False after a stall."""
    at, ends = laid_out
    kind, share, target = phases
    v, elapsed, spent, unsaid = base
    elapsed[first] = spent[first] = unsaid[first] = 0.0
    for i in range(first, at.size):
        k = at[i]
        way = ends[i] + line.step_m[i]
        took, is_unsaid = followed_step(i, (kind[k], share[k], target[k]), back_share, way, line, envelope, p, v)
        if took < 0.0:
            return False
        elapsed[i + 1] = elapsed[i] + took
        spent[i + 1] = spent[i] + step_energy(i, v[i], v[i + 1], line, p, c)
        unsaid[i + 1] = unsaid[i] + (took if is_unsaid else 0.0)
    return True


@kernel
def first_from(node, at):
    """The first node at a place (m) or beyond it; numba's own `searchsorted` would need scipy at the start."""
    low, high = 0, node.size
    while low < high:
        middle = (low + high) // 2
        if node[middle] < at:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def highest(speed, first, last):
    """The highest speed of the nodes first … last; numba's own `max` of an array would need scipy as well."""
    found = speed[first]
    for i in range(first + 1, last + 1):
        found = max(found, speed[i])
    return found


@kernel
def moved(k, move, by, begin, phases, node, envelope, new_begin, new_phases):
    """One move of phase k: begun earlier (0) or later (1), slower (2) or faster (3), with less (4) or more effort (5).

    `by` are the distance, the speed and the share. Fills in the new places, shares and speeds; returns the first node
    that changes and the first one after the change, or (-1, -1) if there is no such move. The end of a phase to brake
    stays, because its target speed is needed there.
    """
    by_m, by_speed, by_share = by
    kind, share, target = phases
    _, new_share, new_target = new_phases
    count = begin.size
    put(begin, new_begin)
    put(share, new_share)
    put(target, new_target)
    sign = 1.0 if move % 2 else -1.0
    if move < 2:
        if k == 0 or kind[k - 1] >= BRAKE:
            return -1, -1
        last = (begin[k + 1] if k + 1 < count else node.size - 1) - 1
        index = first_from(node, node[begin[k]] + sign * by_m)
        new_begin[k] = min(max(index, begin[k - 1] + 1), last)
        if new_begin[k] == begin[k]:
            return -1, -1
        return min(new_begin[k], begin[k]), max(new_begin[k], begin[k]) + 1
    if move >= 4:
        if share[k] == 0.0 or (kind[k] != TRACTION and kind[k] != BRAKE):
            return -1, -1
        new_share[k] = min(max(share[k] + sign * by_share, LEAST_SHARE), 1.0)
        if new_share[k] == share[k]:
            return -1, -1
        return begin[k], (begin[k + 1] if k + 1 < count else node.size - 1) + 1
    if kind[k] != TRACTION and kind[k] != HOLD:
        return -1, -1
    last = k
    while last + 1 < count and kind[last + 1] == HOLD and target[last + 1] == target[k]:
        last += 1
    end = begin[last + 1] if last + 1 < count else node.size - 1
    ceiling = highest(envelope, begin[k], end)
    new_target[k : last + 1] = min(max(target[k] + sign * by_speed, SLOWEST_MPS), ceiling)
    if new_target[k] == target[k]:
        return -1, -1
    return begin[k], end + 1


@kernel
def polish(first, begin, phases, back_share, node, line, envelope, p, c, wanted, steps, least_s, speed):
    """Move the phases (kind, share, target) of a schedule, in rounds of smaller steps, each to where it costs least.

    `wanted` are the time that the schedule is to take (s) and the prices of time (see `cost_of_time`), `steps` the step
    sizes of places (m), speeds and shares. Changes `begin`, shares and targets. The train begins with `speed` at node
    `first`. The sum of the times by which phases that do not brake are shorter than `least_s` does not grow.
    """
    kind, share, target = phases
    asked, prices = wanted
    by_m, by_speed, by_share = steps
    n = node.size - 1
    laid_out = (np.empty(n, np.int64), np.empty(n))
    base = (np.empty(n + 1), np.empty(n + 1), np.empty(n + 1), np.empty(n + 1))
    base[0][first] = speed
    lay_out(begin, node, laid_out[0], laid_out[1])
    if not record(first, laid_out, phases, back_share, line, envelope, p, c, base):
        return
    best = base[2][n] + cost_of_time(base[1][n] - asked, prices)
    new_begin, new_share, new_target, v = begin.copy(), share.copy(), target.copy(), np.empty(n + 1)
    tried = (kind, new_share, new_target)
    missing = missing_time(first, begin, kind, line.step_m, least_s, base[0])
    for r in range(by_m.size):
        by = (by_m[r], by_speed[r], by_share[r])
        for k in range(begin.size):
            for move in range(MOVES):
                start, meets = moved(k, move, by, begin, phases, node, envelope, new_begin, tried)
                if start < 0:
                    continue
                start = max(start, first)
                lay_out(new_begin, node, laid_out[0], laid_out[1])
                put(base[0], v)
                time, energy, unsaid = drive_schedule(
                    start, meets, laid_out, tried, back_share, line, envelope, p, c, base, v
                )
                cost = energy + cost_of_time(time - asked, prices)
                if time < 0.0 or cost >= best or unsaid > base[3][n] + UNSAID_S:
                    continue
                lacking = missing_time(first, new_begin, kind, line.step_m, least_s, v)
                if lacking > missing:
                    continue
                put(new_begin, begin)
                put(new_share, share)
                put(new_target, target)
                best, missing = cost, lacking
                record(first, laid_out, phases, back_share, line, envelope, p, c, base)
