"""Polishing a schedule: its phases are moved by place and speed until nothing is gained any more."""

from __future__ import annotations

import numpy as np

from das.compiling.kernels import kernel
from das.solver.kernels.calm_follow import follow
from das.solver.kernels.calm_moves import BRAKE, HOLD, TRACTION
from das.solver.kernels.calm_roll_out import run_energy
from das.solver.tolerances import INFEASIBLE

LATE_RATIO = 3.0
"""A second of being late costs so many times the price of time,"""
EARLY_RATIO = 0.7
"""and one of being early is worth this share of it,"""
EARLY_S = 2.0
"""up to so many of them (s): the price is that of a run of the ladder, and may be half as high again as it should."""
UNSAID_S = 0.1
"""A move may let limits ahead ask for brakes, where no phase does, for no longer than this more (s)."""
SLOWEST_MPS = 2.0
"""No speed to hold is made lower than this (m/s)."""


@kernel
def cost_of_time(late, price):
    """What arriving late (s; early < 0) costs at a price of time (W): in J."""
    return price * (LATE_RATIO * late if late > 0.0 else EARLY_RATIO * max(late, -EARLY_S))


@kernel
def missing_time(first, begin, kind, step, least_s, v):
    """By how much (s) the phases of a run that are no brakes are shorter than the least, all together."""
    missing = 0.0
    for k in range(begin.size):
        last = begin[k + 1] if k + 1 < begin.size else step.size
        if kind[k] == BRAKE or last <= first:
            continue
        lasts = 0.0
        for i in range(max(begin[k], first), last):
            lasts += 2.0 * step[i] / (v[i] + v[i + 1])
        missing += max(least_s - lasts, 0.0)
    return missing


@kernel
def schedule_cost(first, begin, kind, share, target, back_share, node, known, line, envelope, p, c, price, asked, v):
    """What a schedule costs (J) that is to take a time, and for how long (s) no phase says its brakes, from v[first].

    Fills v.
    """
    step, g, q, u = line
    n = step.size
    at = np.empty(n, np.int64)
    ends = np.empty(n)
    k = 0
    for i in range(n):
        while k + 1 < begin.size and begin[k + 1] <= i:
            k += 1
        at[i] = k
        end = begin[k + 1] if k + 1 < begin.size else n
        ends[i] = node[end] - node[i + 1]
    time, unsaid = follow(first, at, ends, kind, share, target, back_share, known, -1.0, line, envelope, p, v)
    if time < 0.0:
        return INFEASIBLE, 0.0
    energy = run_energy((step[first:], g[first:], q[first:], u[first:]), p, c, v[first:])
    return energy + cost_of_time(time - asked, price), unsaid


@kernel
def polish(
    first, begin, kind, share, target, back_share, node, known, line, envelope, p, c, price, asked, by_m, by_speed,
    least_s, v,
):  # fmt: skip
    """Move the phases of a schedule, in rounds of smaller and smaller steps, each to where it costs least.

    Changes `begin` and `target`; returns the cost (J). The end of a brake stays: there its speed is needed. No phase
    but a brake is made shorter than `least_s`, or shorter yet.
    """
    count = begin.size
    best, said = schedule_cost(
        first, begin, kind, share, target, back_share, node, known, line, envelope, p, c, price, asked, v
    )
    missing = missing_time(first, begin, kind, line.step_m, least_s, v)
    tried = begin.copy()
    speeds = target.copy()
    for r in range(by_m.size):
        for k in range(count):
            for move in range(4):
                tried[:] = begin
                speeds[:] = target
                sign = 1.0 if move % 2 else -1.0
                if move < 2:
                    if k == 0 or kind[k - 1] == BRAKE:
                        continue
                    last = (begin[k + 1] if k + 1 < count else node.size - 1) - 1
                    index = np.searchsorted(node, node[begin[k]] + sign * by_m[r])
                    tried[k] = min(max(index, begin[k - 1] + 1), last)
                    if tried[k] == begin[k]:
                        continue
                else:
                    if kind[k] != TRACTION and kind[k] != HOLD:
                        continue
                    last = k
                    while last + 1 < count and kind[last + 1] == HOLD and target[last + 1] == target[k]:
                        last += 1
                    end = begin[last + 1] if last + 1 < count else node.size - 1
                    ceiling = envelope[begin[k] : end + 1].max()
                    speeds[k : last + 1] = min(max(target[k] + sign * by_speed[r], SLOWEST_MPS), ceiling)
                    if speeds[k] == target[k]:
                        continue
                cost, unsaid = schedule_cost(
                    first, tried, kind, share, speeds, back_share, node, known, line, envelope, p, c, price, asked, v
                )
                if cost >= best or unsaid > said + UNSAID_S:
                    continue
                lacking = missing_time(first, tried, kind, line.step_m, least_s, v)
                if lacking <= missing:
                    best, said, missing = cost, min(unsaid, said), lacking
                    begin[:] = tried
                    target[:] = speeds
    return best
