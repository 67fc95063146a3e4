"""The backward sweep: least cost and time-to-go of every state under every multiplier.

The innermost loop runs over the multipliers, which lets the compiler evaluate a landing for several of them in one
instruction. It evaluates two landings at a time, which halves the reads and writes of the best cost so far.
"""

from __future__ import annotations

import numpy as np

from das.compiling import compiled
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

LANES = 8
"""Number of multipliers in the widest vector of a processor; each thread gets a multiple of it."""


@compiled(fastmath={"contract", "nnan", "ninf", "nsz"})
def backward_sweep(first, last, lam, moves, value, time_to_go):
    """Bellman sweep of the multipliers lam[first … last − 1] together: value (J) and time-to-go (s) of every state.

    value[k, j, l] = min over landings of energy + lam·dt + value at the landing (linear in v²). Row k = n of both
    outputs must contain the end values; the other rows are filled. A product and a sum may be fused, but their order is
    fixed: results are identical, bit for bit, however the ladder is divided.
    """
    dt, energy, target, weight, filled = moves
    n, states = filled.shape
    size = last - first
    price = lam[first:last].copy()
    best, choice = np.empty(size), np.empty(size, np.int64)
    ahead = np.empty((states + 1, size))  # the last row twice: the line above the uppermost has weight 0
    for k in range(n - 1, -1, -1):
        for j in range(states + 1):
            for l in range(size):
                ahead[j, l] = value[k + 1, min(j, states - 1), first + l]
        for j in range(states):
            best[:] = INFEASIBLE
            choice[:] = -1
            for a in range(0, filled[k, j], 2):
                b = min(a + 1, filled[k, j] - 1)
                energy_a, dt_a, low_a = energy[k, j, a], float(dt[k, j, a]), target[k, j, a]
                energy_b, dt_b, low_b = energy[k, j, b], float(dt[k, j, b]), target[k, j, b]
                above_a, above_b = float(weight[k, j, a]), float(weight[k, j, b])
                below_a, below_b = 1.0 - above_a, 1.0 - above_b
                for l in range(size):
                    cost_a = energy_a + price[l] * dt_a + below_a * ahead[low_a, l] + above_a * ahead[low_a + 1, l]
                    cost_b = energy_b + price[l] * dt_b + below_b * ahead[low_b, l] + above_b * ahead[low_b + 1, l]
                    landing, cost = (b, cost_b) if cost_b < cost_a else (a, cost_a)
                    choice[l] = landing if cost < best[l] else choice[l]
                    best[l] = cost if cost < best[l] else best[l]
            for l in range(size):
                i = choice[l]
                # Between a feasible and an infeasible neighbour, the interpolated cost is meaningless.
                if i < 0 or best[l] > UNREACHABLE:
                    value[k, j, first + l] = time_to_go[k, j, first + l] = INFEASIBLE
                    continue
                low, above = target[k, j, i], weight[k, j, i]
                after_s = (1.0 - above) * time_to_go[k + 1, low, first + l]
                after_s += above * time_to_go[k + 1, min(low + 1, states - 1), first + l]
                value[k, j, first + l] = best[l]
                time_to_go[k, j, first + l] = dt[k, j, i] + after_s
