"""The best landing of one decision step under a policy."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.landings import LANDINGS, landings, step_cost
from das.solver.kernels.policy_values import blended_values, needed_lines, time_at, value_at
from das.solver.kernels.speed_grid import locate
from das.solver.kernels.tuples import Policy
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

FIRST = np.int64(0)
"""The first node or grid line; for a literal 0 numba would compile the kernel that is called once more."""

_GOLDEN = 0.3819660112501051
_POLISH_STEPS = 10


@kernel
def _total_cost(v0, v1, step, price, c, row):
    if v0 + v1 <= 0.0:
        return INFEASIBLE
    dt, energy = step_cost(v0, v1, step.length_m, step.constant_n, step.tunnel_n_per_mps2, step.train, c)
    return energy + price * dt + value_at(row, v1, step.floor_mps, step.envelope_mps)


@kernel
def best_landing(v0, step, policy, policies, c, out, row):
    """Landing speed of a step from speed v0 that minimises cost under a policy plus value, and that least total.

    Tries all landings of the step, then narrows between the best one's neighbours by golden section.
    Returns (-1, INFEASIBLE) where no landing is feasible. `out` and `row` (LANDINGS and one per grid line) are
    working space.
    """
    price = policy.price_w
    h, g, q, p = step.length_m, step.constant_n, step.tunnel_n_per_mps2, step.train
    m = landings(v0, h, g, q, step.envelope_mps, step.final, p, out)
    if m == 0:
        return -1.0, INFEASIBLE
    if step.final:
        dt, energy = step_cost(v0, out[0], h, g, q, p, c)
        blended_values(policies, policy, step.node, FIRST, FIRST, row)
        return out[0], energy + price * dt + row[0]
    left = out[0]
    right = out[0]
    for i in range(m):
        left = min(left, out[i])
        right = max(right, out[i])
    first, last = needed_lines(left, right, step.floor_mps, step.envelope_mps, row.size - 1)
    blended_values(policies, policy, step.node, first, last, row)
    best = INFEASIBLE
    choice = -1.0
    for i in range(m):
        cost = _total_cost(v0, out[i], step, price, c, row)
        if cost < best:
            best = cost
            choice = out[i]
    if choice < 0.0 or best > UNREACHABLE:
        return -1.0, INFEASIBLE
    for i in range(m):
        if left < out[i] < choice:
            left = out[i]
        if choice < out[i] < right:
            right = out[i]
    x1 = left + _GOLDEN * (right - left)
    x2 = right - _GOLDEN * (right - left)
    y1 = _total_cost(v0, x1, step, price, c, row)
    y2 = _total_cost(v0, x2, step, price, c, row)
    for _ in range(_POLISH_STEPS):
        if y1 <= y2:
            right = x2
            x2 = x1
            y2 = y1
            x1 = left + _GOLDEN * (right - left)
            y1 = _total_cost(v0, x1, step, price, c, row)
        else:
            left = x1
            x1 = x2
            y1 = y2
            x2 = right - _GOLDEN * (right - left)
            y2 = _total_cost(v0, x2, step, price, c, row)
    if min(y1, y2) < best:
        if y1 <= y2:
            return x1, y1
        return x2, y2
    return choice, best


@kernel
def one_step_totals(v0, step, policies, c, total, time_s):
    """For every λ of the ladder: least total cost (J) and time (s) from speed v0 at the begin of a step."""
    out = np.empty(LANDINGS)
    time_to_go, speeds = policies.time_to_go_s, policies.value_j.shape[1]
    row = np.empty(speeds)
    for a in range(policies.lambda_w.size):
        x, cost = best_landing(v0, step, Policy(policies.lambda_w[a], a, 0.0, 0.0), policies, c, out, row)
        total[a] = cost
        if x < 0.0:
            time_s[a] = INFEASIBLE
            continue
        time_s[a] = 2.0 * step.length_m / (v0 + x)
        if not step.final:
            k = step.node
            j, s = locate(x, step.floor_mps, step.envelope_mps, speeds - 1)
            time_s[a] += (1.0 - s) * time_at(time_to_go, k, j, a) + s * time_at(time_to_go, k, j + 1, a)
