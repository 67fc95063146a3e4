"""An interior point method for the convex relaxation of a section (Mehrotra's predictor and corrector).

The program's matrix couples only neighbouring nodes. So the variables of the intervals are eliminated, a tridiagonal
matrix of the nodes remains, and a Newton step costs as much as a few sweeps over the line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.offline.kernels.relaxed_program import (
    FIXED_ROWS,
    LOCAL,
    Multipliers,
    Program,
    RelaxedRun,
    constraints,
    curvature,
    local_values,
    proven_bound,
)
from das.solver.kernels.arrays import add, put

Floats = NDArray[np.float64]

_TO_BOUNDARY = 0.99
"""Share of the way to the nearest bound that a step takes."""
_LEAST_SLACK = 0.01
"""Least slack of a constraint at the first point, whether the point satisfies the constraint or not."""
_CENTRE = 0.1
"""Product of slack and multiplier of a constraint at the first point, per metre of the interval."""
_PATIENCE = 5
"""Steps in a row without a higher bound after which the search ends, once it has a useful one."""
_USEFUL = 2e-4
"""Ratio below the energy of the point within which a bound is useful."""
_FEASIBLE = 1e-5
"""Largest violation of a constraint with which a point counts as feasible."""


class Iterate(NamedTuple):
    """A point with the slacks and multipliers of its constraints (n, rows), and those of the trip time (1,)."""

    run: RelaxedRun
    multipliers: Multipliers
    slack: Floats
    spare_s: Floats


class Direction(NamedTuple):
    """Changes of all that an `Iterate` holds."""

    w: Floats
    local: Floats
    rows: Floats
    slack: Floats
    price: Floats
    spare_s: Floats


class TimeColumn(NamedTuple):
    """The Newton system solved with the row of the trip time as right-hand side, which makes that dense row cheap."""

    w: Floats
    local: Floats


@kernel
def best_bound(run: RelaxedRun, multipliers: Multipliers, program: Program, most_steps, enough):
    """Improve a point and its multipliers by Newton steps; returns the best bound, its price of time, and the steps.

    The first point need not satisfy the constraints. The search stops when the bound is within `enough` (a ratio) of
    the energy of a point that satisfies them, when it no longer improves, or after `most_steps`.
    """
    n, m = multipliers.rows.shape
    newton = empty_newton(n, m)
    evaluate(run, multipliers.rows, program, newton)
    now = Iterate(run, multipliers, np.empty((n, m)), np.empty(1))
    _set_slacks(now, program, newton)
    change = Direction(np.zeros(n + 1), np.zeros((n, 3)), np.zeros((n, m)), np.zeros((n, m)), np.zeros(1), np.zeros(1))
    column = TimeColumn(np.empty(n + 1), np.empty((n, 3)))
    best, best_price, idle = -np.inf, multipliers.time[0], 0
    for step in range(most_steps):
        _find_direction(now, program, newton, column, change)
        _advance(now, program, change)
        evaluate(run, multipliers.rows, program, newton)
        energy, size, worst = _quality(now, program, newton)
        found = proven_bound(run, multipliers, program)
        idle = 0 if found > best + 0.1 * enough * size or not found <= energy else idle + 1
        if found > best:
            best, best_price = found, multipliers.time[0]
        near = energy - best
        is_found = near <= enough * size and worst < _FEASIBLE
        if is_found or (near <= _USEFUL * size and idle >= _PATIENCE) or not math.isfinite(energy):
            return best, best_price, step + 1
    return best, best_price, most_steps


@kernel
def _set_slacks(now, program, newton):
    """Set the first slacks (the point's, at least `_LEAST_SLACK`) and, by `_CENTRE`, the limits' multipliers."""
    n, m = now.slack.shape
    for k in range(n):
        for i in range(m):
            now.slack[k, i] = max(-newton.value[k, i], _LEAST_SLACK)
            if 0 < i < FIXED_ROWS:
                now.multipliers.rows[k, i] = _CENTRE * program.motion.step_m[k] / now.slack[k, i]
    spare_s = program.allowed_s - _time(program, now.run.local)
    now.spare_s[0] = max(spare_s, 1e-3 * program.allowed_s)


@kernel
def _time(program, local):
    """Time (s) of the slownesses (s/m) in `local`; if `local` holds changes of them, the change of time."""
    total = 0.0
    for k in range(local.shape[0]):
        total += program.motion.step_m[k] * local[k, 0]
    return total


@kernel
def _complementarity(now):
    """Sum of all products of slack and multiplier."""
    total = now.multipliers.time[0] * now.spare_s[0]
    for k in range(now.slack.shape[0]):
        for i in range(now.slack.shape[1]):
            total += now.slack[k, i] * now.multipliers.rows[k, i]
    return total


@kernel
def _find_direction(now, program, newton, column, change):
    """Find the step: the predictor aims at slack · multiplier = 0; how far it can go sets the corrector's target."""
    n, m = now.slack.shape
    theta = np.empty((n, m))
    for k in range(n):
        for i in range(m):
            theta[k, i] = now.multipliers.rows[k, i] / now.slack[k, i]
    factor(theta, newton, program.box.free)
    in_w, in_local = np.zeros(n + 1), np.zeros((n, 3))
    put(program.motion.step_m, in_local[:, 0])
    solve(newton, program.box.free, in_w, in_local, column.w, column.local)
    total = _complementarity(now)
    change.rows[:] = 0.0
    change.slack[:] = 0.0
    change.price[0] = 0.0
    change.spare_s[0] = 0.0
    _newton_step(now, program, newton, column, 0.0, change)
    primal, dual = _longest_steps(now, change)
    after = (now.multipliers.time[0] + dual * change.price[0]) * (now.spare_s[0] + primal * change.spare_s[0])
    for k in range(n):
        for i in range(m):
            y = now.multipliers.rows[k, i] + dual * change.rows[k, i]
            after += y * (now.slack[k, i] + primal * change.slack[k, i])
    centre = total / (n * m + 1) * min(max(after / total, 0.0), 1.0) ** 3
    _newton_step(now, program, newton, column, centre, change)


@kernel
def _newton_step(now, program, newton, column, centre, change):
    """The Newton step towards slack · multiplier = `centre`, corrected by the products of the step in `change`.

    `change` holds the predictor's step, or zeros; the new step replaces it.
    """
    n, m = now.slack.shape
    y, slack, price, spare_s = now.multipliers.rows, now.slack, now.multipliers.time[0], now.spare_s[0]
    weights = np.empty((n, m))
    for k in range(n):
        for i in range(m):
            miss = slack[k, i] * y[k, i] - centre + change.slack[k, i] * change.rows[k, i]
            weights[k, i] = y[k, i] + (y[k, i] * (newton.value[k, i] + slack[k, i]) - miss) / slack[k, i]
    over_s = _time(program, now.run.local) + spare_s - program.allowed_s
    time_miss = spare_s * price - centre + change.spare_s[0] * change.price[0]
    in_w, in_local = np.empty(n + 1), np.empty((n, 3))
    _right_side(weights, program, newton, price + (price * over_s - time_miss) / spare_s, in_w, in_local)
    solve(newton, program.box.free, in_w, in_local, change.w, change.local)
    ratio = price / spare_s
    share = ratio * _time(program, change.local) / (1.0 + ratio * _time(program, column.local))
    add(-share, column.w, change.w)
    for k in range(n):
        add(-share, column.local[k], change.local[k])
    change.spare_s[0] = -over_s - _time(program, change.local)
    change.price[0] = (-time_miss - price * change.spare_s[0]) / spare_s
    for k in range(n):
        for i in range(m):
            moved = newton.slope[k, i, 0] * change.w[k] + newton.slope[k, i, 1] * change.w[k + 1]
            for j in range(3):
                moved += newton.slope[k, i, 2 + j] * change.local[k, j]
            miss = slack[k, i] * y[k, i] - centre + change.slack[k, i] * change.rows[k, i]
            change.slack[k, i] = -(newton.value[k, i] + slack[k, i]) - moved
            change.rows[k, i] = (-miss - y[k, i] * change.slack[k, i]) / slack[k, i]


@kernel
def _right_side(weights, program, newton, price, in_w, in_local):
    """−(slope of the energy) − (slopes of the constraints)·weights, with the time's weight `price`."""
    in_w[:] = 0.0
    for k in range(weights.shape[0]):
        h = program.motion.step_m[k]
        in_local[k, 0] = -h * price
        in_local[k, 1] = 0.0
        in_local[k, 2] = -h
        for i in range(weights.shape[1]):
            y = weights[k, i]
            in_w[k] -= y * newton.slope[k, i, 0]
            in_w[k + 1] -= y * newton.slope[k, i, 1]
            for j in range(3):
                in_local[k, j] -= y * newton.slope[k, i, 2 + j]


@kernel
def _longest_steps(now, change):
    """The longest steps (at most 1) that keep slacks and multipliers positive."""
    primal, dual = 1.0, 1.0
    if change.spare_s[0] < 0.0:
        primal = min(primal, -now.spare_s[0] / change.spare_s[0])
    if change.price[0] < 0.0:
        dual = min(dual, -now.multipliers.time[0] / change.price[0])
    for k in range(now.slack.shape[0]):
        for i in range(now.slack.shape[1]):
            if change.slack[k, i] < 0.0:
                primal = min(primal, -now.slack[k, i] / change.slack[k, i])
            if change.rows[k, i] < 0.0:
                dual = min(dual, -now.multipliers.rows[k, i] / change.rows[k, i])
    return primal, dual


@kernel
def _advance(now, program, change):
    """Take the step, shortened so that speeds and slownesses stay positive."""
    primal, dual = _longest_steps(now, change)
    for k in range(now.slack.shape[0]):
        if change.local[k, 0] < 0.0:
            primal = min(primal, -0.9 * now.run.local[k, 0] / change.local[k, 0])
        if change.w[k] < 0.0 and program.box.free[k]:
            primal = min(primal, -0.9 * now.run.w[k] / change.w[k])
    primal, dual = min(1.0, _TO_BOUNDARY * primal), min(1.0, _TO_BOUNDARY * dual)
    add(primal, change.w, now.run.w)
    for k in range(now.slack.shape[0]):
        add(primal, change.local[k], now.run.local[k])
        add(primal, change.slack[k], now.slack[k])
        add(dual, change.rows[k], now.multipliers.rows[k])
    now.spare_s[0] += primal * change.spare_s[0]
    now.multipliers.time[0] += dual * change.price[0]


@kernel
def _quality(now, program, newton):
    """Energy of the point, the sum of its magnitudes over the intervals, and the largest violation of a constraint."""
    energy, size, worst = 0.0, 0.0, 0.0
    for k in range(now.slack.shape[0]):
        energy += program.motion.step_m[k] * now.run.local[k, 2]
        size += program.motion.step_m[k] * abs(now.run.local[k, 2])
        for i in range(now.slack.shape[1]):
            worst = max(worst, abs(newton.value[k, i] + now.slack[k, i]))
    return energy, size, worst


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
    """Arrays for a program of n intervals with this number of constraints each."""
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
    for a in range(LOCAL):
        put(newton.curvature[k, a], matrix[a])
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
    """Cholesky factor of the part of τ, f and e, and its product with the part that couples it to the nodes."""
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
    """Solve the factored system for one right-hand side: `in_w` is its part for the nodes, `in_local` for intervals."""
    n = in_local.shape[0]
    put(in_w, out_w)
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
