"""Numba kernels that answer from the policies of a section in some ten microseconds, without rolling anything out.

Symbols as in `kernels` and `rollout_kernels`. Times are those of the decision grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from das.solver.compiling import kernel
from das.solver.kernels import LANDINGS, brake_limit, locate, mean_resistance, on_supply, traction_limit
from das.solver.params import TrainParams
from das.solver.rollout_kernels import best_landing, time_at
from das.solver.tolerances import INFEASIBLE, MIN_STEP_M, TIME_TOLERANCE_S

ON_TIME, LATE, EARLY, STUCK = 0, 1, 2, 3
"""How the answer relates to the time left; STUCK: the policies know no way on."""
_MOST_NARROWINGS = 6


class FirstStep(NamedTuple):
    """The way from a state to the decision node k ahead: its length, mean forces, the bounds of speed at its end."""

    k: int
    v0: float
    h: float
    g: float
    q: float
    floor: float
    top: float
    final: bool
    train: TrainParams


@kernel
def first_step(s, v0, node, decision, step, g, q, u, floor, envelope, p):
    """The first step from position s and speed v0; a node nearer than MIN_STEP_M counts as passed."""
    i = np.searchsorted(node, s + MIN_STEP_M, side="right")
    k = np.searchsorted(decision, i)
    last = decision[k]
    part = node[i] - s
    h, gh, qh = part, g[i - 1] * part, q[i - 1] * part
    for j in range(i, last):
        h += step[j]
        gh += g[j] * step[j]
        qh += q[j] * step[j]
    final = k == decision.size - 1 and floor[last] >= envelope[last]
    return FirstStep(k, v0, h, gh / h, qh / h, floor[last], envelope[last], final, on_supply(p, u[i - 1]))


@kernel
def _slope(value, time_to_go, k, j, a, offset, gap):
    """Time-to-go (s) on a grid line: the derivative in λ of the cubic through both values and both slopes."""
    ta = time_at(time_to_go, k, j, a)
    if gap <= 0.0:
        return ta
    tb = time_at(time_to_go, k, j, a + 1)
    u = offset / gap
    secant = (float(value[k, j, a + 1]) - float(value[k, j, a])) / gap
    return 6.0 * u * (1.0 - u) * secant + (1.0 - u) * (1.0 - 3.0 * u) * ta + u * (3.0 * u - 2.0) * tb


@kernel
def _follow(x, price, a, offset, gap, value, time_to_go, c, out, row):
    """Best landing of the first step x under a policy, least total cost (J) and time (s)."""
    v1, cost = best_landing(
        x.k,
        x.v0,
        x.h,
        x.g,
        x.q,
        x.floor,
        x.top,
        x.final,
        price,
        a,
        offset,
        gap,
        value,
        time_to_go,
        x.train,
        c,
        out,
        row,
    )
    if v1 < 0.0 or x.v0 + v1 <= 0.0:
        return -1.0, INFEASIBLE, INFEASIBLE
    time = 2.0 * x.h / (x.v0 + v1)
    if not x.final:
        j, s = locate(v1, x.floor, x.top, value.shape[1] - 1)
        time += (1.0 - s) * _slope(value, time_to_go, x.k, j, a, offset, gap)
        if s > 0.0:
            time += s * _slope(value, time_to_go, x.k, j + 1, a, offset, gap)
    return v1, cost, time


@kernel
def _guess(x, time_left, lam, value, time_to_go, c, out, row):
    """Ladder index whose time is about `time_left`: all multipliers land as the middle one does."""
    low, high = 0, lam.size - 1
    v1, _, _ = _follow(x, lam[high // 2], high // 2, 0.0, 0.0, value, time_to_go, c, out, row)
    if v1 < 0.0 or x.final:
        return high
    ahead = time_left - 2.0 * x.h / (x.v0 + v1)
    j, _ = locate(v1, x.floor, x.top, value.shape[1] - 1)
    while high > low:
        a = (low + high) // 2
        if time_at(time_to_go, x.k, j, a) > ahead:
            low = a + 1
        else:
            high = a
    return low


@kernel
def _neighbours(x, time_left, lam, value, time_to_go, c, out, row):
    """Neighbours of the ladder whose times enclose `time_left`: slow index, its time, quick index, its time.

    One index twice where the time is beyond an end of the ladder.
    """
    a = _guess(x, time_left, lam, value, time_to_go, c, out, row)
    _, _, time = _follow(x, lam[a], a, 0.0, 0.0, value, time_to_go, c, out, row)
    step = 1 if time > time_left else -1
    while 0 <= a + step < lam.size:
        _, _, other = _follow(x, lam[a + step], a + step, 0.0, 0.0, value, time_to_go, c, out, row)
        if step > 0 and other <= time_left:
            return a, time, a + 1, other
        if step < 0 and other > time_left:
            return a - 1, other, a, time
        a, time = a + step, other
    return a, time, a, time


@kernel
def _narrow(x, time_left, left, slow, right, quick, lam, value, time_to_go, c, out, row):
    """λ, landing, cost and time of the policy between two neighbours whose time is `time_left` (false position)."""
    gap = lam[right] - lam[left]
    low, high, above, below = 0.0, gap, slow - time_left, quick - time_left
    kept = 0
    price, v1, cost, time = lam[left], -1.0, INFEASIBLE, INFEASIBLE
    for _ in range(_MOST_NARROWINGS):
        offset = low + (high - low) * min(max(above / (above - below), 0.02), 0.98)
        price = lam[left] + offset
        v1, cost, time = _follow(x, price, left, offset, gap, value, time_to_go, c, out, row)
        if abs(time - time_left) <= TIME_TOLERANCE_S:
            break
        # The end kept twice in a row counts half, so that both ends move (Illinois).
        if time > time_left:
            low, above = offset, time - time_left
            below *= 0.5 if kept > 0 else 1.0
            kept = 1
        else:
            high, below = offset, time - time_left
            above *= 0.5 if kept < 0 else 1.0
            kept = -1
    return price, v1, cost, time


@kernel
def _mean_force(x, v1):
    """Mean wheel force (N) of the first step with landing v1, within what the train can do now."""
    p = x.train
    force = p.inertial_mass_kg * (v1 * v1 - x.v0 * x.v0) / (2.0 * x.h) + mean_resistance(x.v0, v1, x.q, p) + x.g
    return max(min(force, traction_limit(x.v0, p)), -brake_limit(x.v0, p, p.friction_force_n))


@kernel
def look_up(s, v0, time_left, node, decision, step, g, q, u, floor, envelope, lam, value, time_to_go, p, c):
    """The optimal continuation from position s and speed v0 when `time_left` seconds are left.

    Returns (fit, λ, decision node ahead, landing speed there, mean wheel force up to it (N), energy-to-go (J),
    time-to-go (s)). On time, the energy is that of the supported front: max over λ of (least total cost − λ·time).
    """
    x = first_step(s, v0, node, decision, step, g, q, u, floor, envelope, p)
    out = np.empty(LANDINGS)
    row = np.empty(value.shape[1])
    left, slow, right, quick = _neighbours(x, time_left, lam, value, time_to_go, c, out, row)
    fit = ON_TIME
    if left < right:
        price, v1, cost, time = _narrow(x, time_left, left, slow, right, quick, lam, value, time_to_go, c, out, row)
    else:
        price = lam[left]
        v1, cost, time = _follow(x, price, left, 0.0, 0.0, value, time_to_go, c, out, row)
        if v1 < 0.0:
            return STUCK, price, x.k, v0, 0.0, INFEASIBLE, INFEASIBLE
        if abs(time - time_left) > TIME_TOLERANCE_S:
            fit = LATE if time > time_left else EARLY
    energy = cost - price * (time_left if fit == ON_TIME else time)
    return fit, price, x.k, v1, _mean_force(x, v1), energy, time
