"""The transitions one speed after the other: a baseline of the bench, and a witness of the solver's in tests."""

from __future__ import annotations

import numpy as np

from das.compiling.kernels import kernel
from das.solver.kernels.forces import on_supply
from das.solver.kernels.landings import LANDINGS, landings, step_cost
from das.solver.kernels.speed_grid import grid_speed, locate


@kernel
def plain_transitions(first, last, line, bounds, steps, p, c, moves):
    """All transitions of the decision nodes first … last − 1, as `das.solver.kernels.transitions.transitions`."""
    floor, envelope = bounds
    dt, energy, target, weight, count = moves
    n = line.step_m.size
    out = np.empty(LANDINGS)
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        here = on_supply(p, line.supply[k])
        top = envelope[k + 1]
        final = k == n - 1 and floor[k + 1] >= top
        row = k - first
        for j in range(steps + 1):
            v0 = grid_speed(floor[k], envelope[k], j, steps)
            count[row, j] = 0
            if v0 <= 0.0:
                continue
            m = landings(v0, h, g, q, top, final, here, out)
            used = 0
            for i in range(m):
                v1 = out[i]
                lower = 0
                share = 0.0
                if not final:
                    lower, share = locate(v1, floor[k + 1], top, steps)
                    if lower < 0:
                        continue
                a, b = step_cost(v0, v1, h, g, q, here, c)
                dt[row, j, used] = a
                energy[row, j, used] = b
                target[row, j, used] = lower
                weight[row, j, used] = share
                used += 1
            count[row, j] = used
