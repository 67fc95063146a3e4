"""The fastest run over a line, and the least time from a state."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.driving import full_traction_speed, hurry, trip_time
from das.solver.kernels.forces import on_supply
from das.solver.kernels.tuples import LineArrays

_FIRST = np.int64(0)
"""The first node; for a literal 0 numba would compile the kernel that is called once more."""


@kernel
def fastest_run(line, envelope, start_speed, p):
    """Speeds of the fastest run under the envelope, with the index of the interval where it stalls, or -1."""
    step, g, q, u = line
    n = step.size
    v = np.empty(n + 1)
    v[0] = start_speed
    for i in range(n):
        v1 = min(full_traction_speed(v[i], step[i], g[i], q[i], on_supply(p, u[i])), envelope[i + 1])
        if v1 <= 0.0 and i < n - 1:
            return v, i
        v[i + 1] = v1
    return v, -1


@kernel
def fastest_roll_out(line, envelope, p, v):
    """The fastest run from v[0]; fills v, returns the trip time (s), or -1 after a stall."""
    if not hurry(_FIRST, line.step_m.size, line, envelope, p, v):
        return -1.0
    return trip_time(line.step_m, v)


@kernel
def least_time(first, way, speed, line, envelope, p, known):
    """Time (s) of the fastest run from a speed with `way` (m) left of interval `first`, or -1 after a stall.

    `known` is a fastest run (`KnownRun`): from where the two meet they are one.
    """
    steps = line.step_m.copy()
    steps[first] = way
    ahead = LineArrays(steps, line.constant_n, line.tunnel_n_per_mps2, line.supply)
    v = np.empty(steps.size + 1)
    v[first] = speed
    total = 0.0
    for i in range(first, steps.size):
        if not hurry(i, i + 1, ahead, envelope, p, v):
            return -1.0
        total += 2.0 * steps[i] / (v[i] + v[i + 1])
        if v[i + 1] == known.speed_mps[i + 1]:
            return total + known.time_to_go_s[i + 1]
    return total
