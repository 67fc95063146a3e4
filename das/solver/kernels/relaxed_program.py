"""The convex relaxation of a section: its variables and constraints, and the bound that multipliers prove.

The local variables of an interval are w0, w1 (v²/2 at its two nodes, m²/s²), the slowness τ (s/m), the wheel force f of
the motors and the energy e per metre (both in units of the program's force scale). Every constraint is written as
c(w0, w1, τ, f, e) <= 0 with a convex c. `docs/explanation/bounds.md` derives them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver.kernels.forces import ADHESION_EXTRA, ADHESION_LEAST, ADHESION_OFFSET, ADHESION_SPEED

Floats = NDArray[np.float64]


class RelaxedMotion(NamedTuple):
    """The force over each interval (n,): F = inertia·(w1 − w0) + constant + quadratic·(w0 + w1) + linear/τ.

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


LOCAL = 5
"""Local variables of an interval: w0, w1, τ, f, e."""
FIXED_ROWS = 10
"""Constraints of an interval before those of the energy's pieces."""


@kernel
def constraints(k, z, free0, free1, program: Program, c, slope):
    """Fill the constraints `c` (rows,) and their slopes (rows, 5) of interval k at the local variables z.

    `free0` and `free1` say whether the speeds at the two nodes are variables; a fixed speed has no slope.
    """
    w0, w1, tau, f, e = z[0], z[1], z[2], z[3], z[4]
    h = program.motion.step_m[k]
    slope[:, :] = 0.0
    v0, v1 = math.sqrt(2.0 * w0), math.sqrt(2.0 * w1)
    total = v0 + v1
    # The slowness is at least that of constant acceleration between the nodes.
    c[0] = 2.0 / total - tau
    slope[0, 0] = -2.0 / (total * total * v0) if free0 else 0.0
    slope[0, 1] = -2.0 / (total * total * v1) if free1 else 0.0
    slope[0, 2] = -1.0
    # The motors give at least the force for inertia, resistance and line.
    inertia, quadratic, linear = program.motion.inertia[k], program.motion.quadratic[k], program.motion.linear[k]
    c[1] = inertia * (w1 - w0) + program.motion.constant[k] + quadratic * (w0 + w1) + linear / tau - f
    slope[1, 0] = quadratic - inertia if free0 else 0.0
    slope[1, 1] = quadratic + inertia if free1 else 0.0
    slope[1, 2] = -linear / (tau * tau)
    slope[1, 3] = -1.0
    _effort_limits(k, tau, f, program.efforts, c, slope)
    c[7] = -1.0
    if program.motion.max_acceleration[k] < 1e5:
        c[7] = (w1 - w0) / h - program.motion.max_acceleration[k]
        slope[7, 0] = -1.0 / h if free0 else 0.0
        slope[7, 1] = 1.0 / h if free1 else 0.0
    c[8] = -1.0
    c[9] = -1.0
    if free1:
        c[8] = w1 - program.box.high_w[k + 1]
        slope[8, 1] = 1.0
        c[9] = program.box.low_w[k + 1] - w1
        slope[9, 1] = -1.0
    planes = program.planes
    for i in range(planes.force.shape[1]):
        row = FIXED_ROWS + i
        speed = planes.speed[k, i]
        c[row] = planes.force[k, i] * f + planes.slowness[k, i] * tau + speed * (w0 + w1) + planes.constant[k, i] - e
        slope[row, 0] = speed if free0 else 0.0
        slope[row, 1] = speed if free1 else 0.0
        slope[row, 2] = planes.slowness[k, i]
        slope[row, 3] = planes.force[k, i]
        slope[row, 4] = -1.0


@kernel
def _effort_limits(k, tau, f, efforts: RelaxedEfforts, c, slope):
    """Fill the constraints 2 to 6: what the motors can give and take."""
    c[2] = f - efforts.traction_power[k] * tau - efforts.traction_offset[k]
    slope[2, 2] = -efforts.traction_power[k]
    slope[2, 3] = 1.0
    c[3] = f - efforts.traction_force[k]
    slope[3, 3] = 1.0
    c[4] = -1.0
    weight = efforts.adhesive_force
    if weight > 0.0:
        below = ADHESION_SPEED + ADHESION_OFFSET * tau
        c[4] = f - weight * (ADHESION_LEAST + ADHESION_EXTRA * tau / below)
        slope[4, 2] = -weight * ADHESION_EXTRA * ADHESION_SPEED / (below * below)
        slope[4, 3] = 1.0
    c[5] = -f - efforts.electric_force[k]
    slope[5, 3] = -1.0
    c[6] = -f - efforts.electric_power[k] * tau - efforts.electric_offset[k]
    slope[6, 2] = -efforts.electric_power[k]
    slope[6, 3] = -1.0


@kernel
def curvature(k, z, free0, free1, y, program: Program, out):
    """Fill `out` (5, 5) with the second derivatives of Σ y·c of interval k; all of them are convex."""
    w0, w1, tau = z[0], z[1], z[2]
    out[:, :] = 0.0
    v0, v1 = math.sqrt(2.0 * w0), math.sqrt(2.0 * w1)
    total = v0 + v1
    square = total * total
    if free0:
        out[0, 0] = y[0] * (4.0 / (square * total * v0 * v0) + 2.0 / (square * v0 * v0 * v0))
    if free1:
        out[1, 1] = y[0] * (4.0 / (square * total * v1 * v1) + 2.0 / (square * v1 * v1 * v1))
    if free0 and free1:
        out[0, 1] = out[1, 0] = y[0] * 4.0 / (square * total * v0 * v1)
    bend = y[1] * 2.0 * program.motion.linear[k] / (tau * tau * tau)
    weight = program.efforts.adhesive_force
    if weight > 0.0:
        below = ADHESION_SPEED + ADHESION_OFFSET * tau
        bend += y[4] * 2.0 * weight * ADHESION_EXTRA * ADHESION_SPEED * ADHESION_OFFSET / (below * below * below)
    out[2, 2] = bend


@kernel
def proven_bound(run: RelaxedRun, multipliers: Multipliers, program: Program):
    """A lower bound of the energy of every run of the program's class, for any point and multipliers >= 0.

    The Lagrangian is convex, so it lies above its tangent at the point; the least value of the tangent over the box of
    all runs is the bound (`docs/explanation/bounds.md`). The point only needs w > 0 at free nodes and τ > 0.
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
