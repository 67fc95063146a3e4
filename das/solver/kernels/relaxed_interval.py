"""One interval of the convex relaxation: its constraints, their slopes, and the curvature of its Lagrangian.

The local variables of an interval are w0, w1 (v²/2 at its two nodes, m²/s²), the slowness τ (s/m), the wheel force f of
the motors and the energy e per metre (both in units of the program's force scale). Every constraint is written as
c(w0, w1, τ, f, e) <= 0 with a convex c. `docs/explanation/bounds.md` derives them.
"""

from __future__ import annotations

import math

from das.compiling import kernel
from das.solver.kernels.relaxed_tuples import Program, RelaxedEfforts

LOCAL = 5
"""Local variables of an interval: w0, w1, τ, f, e."""
FIXED_ROWS = 10
"""Constraints of an interval before those of the energy's pieces."""

_ADHESION_SPEED = 3.6
_ADHESION_OFFSET = 44.0
_ADHESION_LEAST = 0.161
_ADHESION_EXTRA = 7.5
"""Curtius & Kniffler, as `das.solver.kernels.forces.adhesion_coefficient`."""


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
    # The motors give at least what inertia, resistance and line ask for.
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
        below = _ADHESION_SPEED + _ADHESION_OFFSET * tau
        c[4] = f - weight * (_ADHESION_LEAST + _ADHESION_EXTRA * tau / below)
        slope[4, 2] = -weight * _ADHESION_EXTRA * _ADHESION_SPEED / (below * below)
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
        below = _ADHESION_SPEED + _ADHESION_OFFSET * tau
        bend += y[4] * 2.0 * weight * _ADHESION_EXTRA * _ADHESION_SPEED * _ADHESION_OFFSET / (below * below * below)
    out[2, 2] = bend
