"""The backward sweep of calm runs: the best notch of every state, where every change of the notch has a price."""

from __future__ import annotations

import numpy as np

from das.compiling.kernels import compiled
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

NO_NOTCH = 255
"""The choice at a state from which no notch leads to the end."""


@compiled(fastmath=True)
def calm_sweep(first, last, price_w, change_j, moves, choice, stay, value):
    """Bellman sweep under the multipliers price_w[first … last − 1], with `change_j` (L,) for a change of the notch.

    `choice[k, j, l]` becomes the best notch of a state, and bit m of `stay[k, j, l]` says that a train in notch m
    keeps it. `value` (speeds, notches, L) holds the end values, and in the end those of the first node.
    """
    dt, energy, target, weight = moves
    n, states, count = target.shape
    lo = max(first, 0)
    size = last - lo
    price = price_w[lo:last].copy()
    change = change_j[lo:last].copy()
    ahead = value[:, :, lo:last].copy()
    here = np.empty_like(ahead)
    best = np.empty(size)
    which = np.empty(size, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        for j in range(states):
            for l in range(size):
                best[l] = INFEASIBLE
                which[l] = NO_NOTCH
            for m in range(count):
                a = max(np.int64(target[k, j, m]), 0)
                row = here[j, m]
                if target[k, j, m] < 0:
                    for l in range(size):
                        row[l] = INFEASIBLE
                    continue
                s = float(weight[k, j, m])
                e, t = float(energy[k, j, m]), float(dt[k, j, m])
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
                row = here[j, m]
                bit = 1 << m
                for l in range(size):
                    limit = best[l] + change[l]
                    keeps = row[l] <= limit
                    stay[k, j, lo + l] |= bit if keeps else 0
                    row[l] = row[l] if keeps else limit
            for m in range(count):
                row = here[j, m]
                for l in range(size):
                    row[l] = row[l] if best[l] < UNREACHABLE else INFEASIBLE
        ahead, here = here, ahead
    for j in range(states):
        for m in range(count):
            for l in range(size):
                value[j, m, lo + l] = ahead[j, m, l]
