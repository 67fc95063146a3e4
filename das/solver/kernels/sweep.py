"""The backward sweep: least cost and time-to-go of every state under every multiplier."""

from __future__ import annotations

import numpy as np

from das.compiling.kernels import compiled, kernel
from das.solver.kernels.transitions import TOGETHER
from das.solver.tolerances import INFEASIBLE, UNREACHABLE


@kernel
def _move(time_s, energy, target, weight, k, j, i):
    return target[k, j, i], float(weight[k, j, i]), energy[k, j, i], float(time_s[k, j, i])


@kernel
def _cheaper(best, choice, cost, i):
    better = cost < best
    return cost if better else best, i if better else choice


@compiled(fastmath=True)
def backward_sweep(first, last, lam, moves, value, time_to_go):
    """Bellman sweep of the multipliers lam[first … last − 1] at once: value (J) and time-to-go (s) of every state.

    value[k, j, l] = min over landings of energy + lam·dt + value at the landing (linear in v²). Row k = n of both
    outputs must hold the end values; the other rows are filled. Landings are taken `TOGETHER`, five at a time.
    """
    dt, energy, target, weight, count = moves
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
