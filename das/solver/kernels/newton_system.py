"""The Newton system of the interior point method: intervals are eliminated, a tridiagonal matrix of the nodes stays."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver.kernels.relaxed_interval import LOCAL, constraints, curvature
from das.solver.kernels.relaxed_program import local_values
from das.solver.kernels.relaxed_tuples import Program, RelaxedRun

Floats = NDArray[np.float64]

_REGULAR = 1e-13
"""Least pivot, as a share of the matrix's own diagonal."""
_LEAST_PIVOT = 1e-300


class Newton(NamedTuple):
    """Constraints (n, rows) at the present point with slopes and curvature, and the factors of the system.

    `cholesky` (n, 3, 3) is the factor of the part of τ, f and e, `cross` (n, 2, 3) its product with the part that
    couples them to the nodes, `diagonal` (n + 1,) and `off` (n,) the factored matrix of the nodes.
    """

    value: Floats
    slope: Floats
    curvature: Floats
    cholesky: Floats
    cross: Floats
    diagonal: Floats
    off: Floats


@kernel
def empty_newton(n, rows):
    """Room for a program of n intervals with this number of constraints each."""
    return Newton(
        np.empty((n, rows)),
        np.empty((n, rows, LOCAL)),
        np.empty((n, LOCAL, LOCAL)),
        np.zeros((n, 3, 3)),
        np.empty((n, 2, 3)),
        np.empty(n + 1),
        np.empty(n),
    )


@kernel
def evaluate(run: RelaxedRun, rows, program: Program, newton):
    """Constraints, slopes and curvature of every interval at a point."""
    z = np.empty(LOCAL)
    for k in range(program.motion.step_m.size):
        local_values(k, run, z)
        free0, free1 = program.box.free[k], program.box.free[k + 1]
        constraints(k, z, free0, free1, program, newton.value[k], newton.slope[k])
        curvature(k, z, free0, free1, rows[k], program, newton.curvature[k])


@kernel
def factor(theta, newton, free):
    """Eliminate τ, f and e of every interval and factor the rest; `theta` (n, rows) is multiplier over slack."""
    n = theta.shape[0]
    newton.diagonal[:] = 0.0
    matrix = np.empty((LOCAL, LOCAL))
    for k in range(n):
        _assemble(k, theta, newton, matrix)
        _eliminate(matrix, newton.cholesky[k], newton.cross[k])
        cross = newton.cross[k]
        s00, s01, s11 = matrix[0, 0], matrix[0, 1], matrix[1, 1]
        for j in range(3):
            s00 -= cross[0, j] ** 2
            s01 -= cross[0, j] * cross[1, j]
            s11 -= cross[1, j] ** 2
        newton.diagonal[k] += s00
        newton.diagonal[k + 1] += s11
        newton.off[k] = s01 if free[k] and free[k + 1] else 0.0
    for k in range(n + 1):
        if not free[k]:
            newton.diagonal[k] = 1.0
    for k in range(n):
        newton.diagonal[k] = max(newton.diagonal[k], _LEAST_PIVOT)
        rest = newton.diagonal[k + 1] - newton.off[k] ** 2 / newton.diagonal[k]
        newton.diagonal[k + 1] = max(rest, _REGULAR * abs(newton.diagonal[k + 1]))


@kernel
def _assemble(k, theta, newton, matrix):
    """The matrix (5, 5) of interval k: curvature + slopes·theta·slopes."""
    matrix[:, :] = newton.curvature[k]
    for i in range(theta.shape[1]):
        for a in range(LOCAL):
            left = theta[k, i] * newton.slope[k, i, a]
            if left != 0.0:
                for b in range(a + 1):
                    matrix[a, b] += left * newton.slope[k, i, b]
    for a in range(LOCAL):
        for b in range(a):
            matrix[b, a] = matrix[a, b]


@kernel
def _eliminate(matrix, low, cross):
    """Cholesky factor of the part of τ, f and e, and its product with what couples it to the nodes."""
    for a in range(3):
        for b in range(a + 1):
            value = matrix[2 + a, 2 + b]
            for j in range(b):
                value -= low[a, j] * low[b, j]
            if a == b:
                own = matrix[2 + a, 2 + a]
                low[a, a] = math.sqrt(max(value + _REGULAR * own, _REGULAR * own + _LEAST_PIVOT))
            else:
                low[a, b] = value / low[b, b]
    for a in range(2):
        for b in range(3):
            value = matrix[a, 2 + b]
            for j in range(b):
                value -= low[b, j] * cross[a, j]
            cross[a, b] = value / low[b, b]


@kernel
def solve(newton, free, in_w, in_local, out_w, out_local):
    """Solve the factored system for one right-hand side, its part of the nodes and that of the intervals."""
    n = in_local.shape[0]
    out_w[:] = in_w
    for k in range(n):
        low, cross = newton.cholesky[k], newton.cross[k]
        for a in range(3):
            value = in_local[k, a]
            for j in range(a):
                value -= low[a, j] * out_local[k, j]
            out_local[k, a] = value / low[a, a]
        for j in range(3):
            out_w[k] -= cross[0, j] * out_local[k, j]
            out_w[k + 1] -= cross[1, j] * out_local[k, j]
    _solve_nodes(newton, free, out_w)
    for k in range(n):
        low, cross = newton.cholesky[k], newton.cross[k]
        for j in range(3):
            out_local[k, j] -= cross[0, j] * out_w[k] + cross[1, j] * out_w[k + 1]
        for a in range(2, -1, -1):
            value = out_local[k, a]
            for j in range(a + 1, 3):
                value -= low[j, a] * out_local[k, j]
            out_local[k, a] = value / low[a, a]


@kernel
def _solve_nodes(newton, free, w):
    """The tridiagonal system of the nodes, in place; a fixed speed does not change."""
    n = w.size - 1
    for k in range(n + 1):
        if not free[k]:
            w[k] = 0.0
    for k in range(n):
        w[k + 1] -= newton.off[k] / newton.diagonal[k] * w[k]
    w[n] /= newton.diagonal[n]
    for k in range(n - 1, -1, -1):
        w[k] = (w[k] - newton.off[k] * w[k + 1]) / newton.diagonal[k]
