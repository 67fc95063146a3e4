"""The bound of the energy that multipliers of the convex relaxation prove."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.relaxed_interval import FIXED_ROWS, LOCAL, constraints
from das.solver.kernels.relaxed_tuples import Multipliers, Program, RelaxedRun


@kernel
def proven_bound(run: RelaxedRun, multipliers: Multipliers, program: Program):
    """A lower bound of the energy of every run of the program's class, for any point and multipliers >= 0.

    The Lagrangian is convex, so it lies above its tangent at the point; the least value of the tangent over the box of
    all runs is the bound (`docs/explanation/bounds.md`). Nothing is asked of the point but w > 0 at free nodes, τ > 0.
    """
    n = program.motion.step_m.size
    rows = FIXED_ROWS + program.planes.force.shape[1]
    c, slope, z = np.empty(rows), np.empty((rows, LOCAL)), np.empty(LOCAL)
    gradient = np.zeros(n + 1)
    price = max(multipliers.time[0], 0.0)
    total = -price * program.allowed_s
    for k in range(n):
        local_values(k, run, z)
        z[4] = 0.0
        constraints(k, z, program.box.free[k], program.box.free[k + 1], program, c, slope)
        h = program.motion.step_m[k]
        pieces = 0.0
        for i in range(FIXED_ROWS, rows):
            pieces += max(multipliers.rows[k, i], 0.0)
        total += h * price * z[2]
        in_tau, in_force = h * price, 0.0
        for i in range(rows):
            y = max(multipliers.rows[k, i], 0.0)
            if i >= FIXED_ROWS:
                # The energy has the weight h in the objective: its multipliers must add up to that.
                y = y * h / pieces if pieces > 0.0 else h / (rows - FIXED_ROWS)
            total += y * c[i]
            gradient[k] += y * slope[i, 0]
            gradient[k + 1] += y * slope[i, 1]
            in_tau += y * slope[i, 2]
            in_force += y * slope[i, 3]
        total += _least(in_tau, program.box.low_tau[k] - z[2], program.box.high_tau[k] - z[2])
        total += _least(in_force, -program.efforts.electric_force[k] - z[3], program.efforts.traction_force[k] - z[3])
    for k in range(n + 1):
        if program.box.free[k]:
            total += _least(gradient[k], program.box.low_w[k] - run.w[k], program.box.high_w[k] - run.w[k])
    return total


@kernel
def _least(gradient, low, high):
    """Least value of a linear function between two ends."""
    return min(gradient * low, gradient * high)


@kernel
def local_values(k, run: RelaxedRun, z):
    z[0], z[1] = run.w[k], run.w[k + 1]
    z[2], z[3], z[4] = run.local[k, 0], run.local[k, 1], run.local[k, 2]
