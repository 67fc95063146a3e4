"""Polishing a schedule: its phases are moved by place and speed until nothing is gained any more."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.few_switch_follow import followed_step
from das.solver.kernels.few_switch_moves import BRAKE, HOLD, TRACTION
from das.solver.kernels.few_switch_roll_out import step_energy

UNSAID_S = 0.1
"""A move may let limits ahead ask for brakes, where no phase does, for no longer than this more (s)."""
MET_MPS = 1e-3
"""Two runs whose speeds are this near (m/s) to each other, and whose phases are the same from there on, are one."""
SLOWEST_MPS = 2.0
"""No speed to hold is made lower than this (m/s)."""
LEAST_SHARE = 0.2
"""No effort is made lower than this share of the largest."""
MOVES = 6
"""A phase begins earlier or later, leads to a lower or higher speed, or has less or more effort."""


@kernel
def cost_of_time(late, prices):
    """What arriving late (s; early < 0) costs (J).

    `prices` are those of a second late and of a second early (W), and how many early ones are worth something (s).
    """
    late_w, early_w, early_s = prices
    return late_w * late if late > 0.0 else early_w * max(late, -early_s)


@kernel
def missing_time(first, begin, kind, step, least_s, v):
    """By how much (s) the phases of a run that are no brakes are shorter than the least, all together."""
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
    """Fill in the phase of every interval, and how far behind the interval it ends (m)."""
    n = at.size
    k = 0
    for i in range(n):
        while k + 1 < begin.size and begin[k + 1] <= i:
            k += 1
        at[i] = k
        ends[i] = node[begin[k + 1] if k + 1 < begin.size else n] - node[i + 1]


@kernel
def drive_schedule(start, meets, laid_out, phases, back_share, line, envelope, p, c, base, v):
    """Follow a schedule from node `start` of the run `base` on; from node `meets` on it may meet that run again.

    `base` holds speed, time, energy and unsaid braking (s) up to every node. Fills v and returns the last three of the
    whole run, or (-1, 0, 0) after a stall.
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
    """The first node at a place (m) or beyond it: written out, for numba's `searchsorted` needs scipy at the start."""
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
    """The highest speed of the nodes first … last: written out, for numba's `max` of an array needs scipy as well."""
    found = speed[first]
    for i in range(first + 1, last + 1):
        found = max(found, speed[i])
    return found


@kernel
def moved(k, move, by, begin, phases, node, envelope, new_begin, new_phases):
    """One move of phase k: begun earlier (0) or later (1), slower (2) or faster (3), with less (4) or more effort (5).

    `by` are the distance, the speed and the share. Fills in the new places, shares and speeds; returns the first node
    that is another one and the first behind the change, or (-1, -1) where there is no such move. The end of a brake
    stays: there its speed is needed.
    """
    by_m, by_speed, by_share = by
    kind, share, target = phases
    _, new_share, new_target = new_phases
    count = begin.size
    new_begin[:] = begin
    new_share[:] = share
    new_target[:] = target
    sign = 1.0 if move % 2 else -1.0
    if move < 2:
        if k == 0 or kind[k - 1] >= BRAKE:
            return -1, -1
        last = (begin[k + 1] if k + 1 < count else node.size - 1) - 1
        index = first_from(node, node[begin[k]] + sign * by_m)
        new_begin[k] = min(max(index, begin[k - 1] + 1), last)
        if new_begin[k] == begin[k]:
            return -1, -1
        # A brake before it ends elsewhere, and what it does depends on that from its beginning on.
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

    `wanted` are the time that it is to take (s) and the prices of time (see `cost_of_time`), `steps` those of places
    (m), of speeds and of shares. Changes `begin`, shares and targets. The run begins with `speed` at node `first`. No
    phase but a brake is made shorter than `least_s`, or shorter yet.
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
                v[:] = base[0]
                time, energy, unsaid = drive_schedule(
                    start, meets, laid_out, tried, back_share, line, envelope, p, c, base, v
                )
                cost = energy + cost_of_time(time - asked, prices)
                if time < 0.0 or cost >= best or unsaid > base[3][n] + UNSAID_S:
                    continue
                lacking = missing_time(first, new_begin, kind, line.step_m, least_s, v)
                if lacking > missing:
                    continue
                begin[:] = new_begin
                share[:] = new_share
                target[:] = new_target
                best, missing = cost, lacking
                record(first, laid_out, phases, back_share, line, envelope, p, c, base)
