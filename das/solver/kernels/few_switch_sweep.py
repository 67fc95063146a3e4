"""The backward sweep of few-switch trajectories: the best notch of every state, where every change of the notch has a
price."""

from __future__ import annotations

import numpy as np

from das.compiling import compiled, kernel
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

NO_NOTCH = 255
"""The choice at a state from which no notch leads to the end."""


@compiled(fastmath=True)
def few_switch_sweep(first, last, prices, moves, policy, value):
    """Bellman sweep under multipliers first … last − 1, whose `prices` are those of time (W) and of a change (J).

    Of `policy`, `choice[k, j, l]` becomes the best notch of a state, and bit m of `stay[k, j, l]` says that a train in
    notch m keeps it. `value` (speeds, notches, L) holds the end values, and in the end those of the first node.
    """
    dt, energy, target, weight = moves
    choice, stay = policy
    n, states, count = target.shape
    lo = max(first, 0)
    size = last - lo
    price, change = prices[0][lo:last].copy(), prices[1][lo:last].copy()
    ahead = value[:, :, lo:last].copy()
    here = np.empty_like(ahead)
    best, which = np.empty(size), np.empty(size, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        for j in range(states):
            best[:] = INFEASIBLE
            which[:] = NO_NOTCH
            for m in range(count):
                a = np.int64(target[k, j, m])
                row = here[j, m]
                if a < 0:
                    row[:] = INFEASIBLE
                    continue
                s, e, t = float(weight[k, j, m]), float(energy[k, j, m]), float(dt[k, j, m])
                low, high = ahead[a, m], ahead[min(a + 1, states - 1), m]
                for l in range(size):
                    cost = e + price[l] * t + (1.0 - s) * low[l] + s * high[l]
                    row[l] = cost
                    better = cost < best[l]
                    best[l] = cost if better else best[l]
                    which[l] = m if better else which[l]
            for l in range(size):
                choice[k, j, lo + l] = which[l] if best[l] < UNREACHABLE else NO_NOTCH
                stay[k, j, lo + l] = 0
            for m in range(count):
                _keep(here[j, m], best, change, 1 << m, stay[k, j, lo:last])
        ahead, here = here, ahead
    value[:, :, lo:last] = ahead


@kernel
def _keep(row, best, change, bit, stay):
    """Cut the costs of being in a notch to those of changing it; where it is kept, its bit is set in `stay`."""
    for l in range(best.size):
        limit = best[l] + change[l]
        keeps = row[l] <= limit
        stay[l] |= bit if keeps else 0
        row[l] = (row[l] if keeps else limit) if best[l] < UNREACHABLE else INFEASIBLE
