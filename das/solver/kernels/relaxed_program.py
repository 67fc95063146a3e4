"""The convex relaxation of a section as arrays, and the bound of the energy that multipliers prove."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling.kernels import kernel
from das.solver.kernels.relaxed_interval import FIXED_ROWS, LOCAL, constraints

Floats = NDArray[np.float64]


class RelaxedMotion(NamedTuple):
    """What moves the train over each interval (n,): F = inertia·(w1 − w0) + constant + quadratic·(w0 + w1) + linear/τ.

    `max_acceleration` (m/s²) is 1e5 or more where there is no such limit.
    """

    step_m: Floats
    inertia: Floats
    constant: Floats
    linear: Floats
    quadratic: Floats
    max_acceleration: Floats


class RelaxedEfforts(NamedTuple):
    """Limits of the motors over each interval (n,): −electric <= f <= traction.

    A limit is a force, and a line power·τ + offset in the slowness. `adhesive_force` (one number, negative: none) times
    the coefficient of adhesion limits the traction too.
    """

    traction_force: Floats
    traction_power: Floats
    traction_offset: Floats
    electric_force: Floats
    electric_power: Floats
    electric_offset: Floats
    adhesive_force: float


class Box(NamedTuple):
    """Bounds of v²/2 at the nodes (n + 1,) and of the slowness (n,); `free` says which speeds are variables."""

    low_w: Floats
    high_w: Floats
    free: NDArray[np.bool_]
    low_tau: Floats
    high_tau: Floats


class Planes(NamedTuple):
    """Planes (n, planes) below the energy per metre: e >= force·f + slowness·τ + speed·(w0 + w1) + constant."""

    force: Floats
    slowness: Floats
    speed: Floats
    constant: Floats


class Program(NamedTuple):
    """The convex relaxation as the kernels take it; all forces are in units of one force."""

    motion: RelaxedMotion
    efforts: RelaxedEfforts
    box: Box
    planes: Planes
    allowed_s: float


class RelaxedRun(NamedTuple):
    """Values of all variables: w (n + 1,), and local (n, 3) with τ, f and e of each interval."""

    w: Floats
    local: Floats


class Multipliers(NamedTuple):
    """Multipliers of the constraints (n, rows), and that of the time in element 0 of `time` (1,)."""

    rows: Floats
    time: Floats


@kernel
def proven_bound(run, multipliers, program):
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
def local_values(k, run, z):
    z[0], z[1] = run.w[k], run.w[k + 1]
    z[2], z[3], z[4] = run.local[k, 0], run.local[k, 1], run.local[k, 2]
