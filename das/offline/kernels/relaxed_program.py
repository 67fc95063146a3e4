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

TURNED_SHARES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8)
"""Shares of the price of time (and of the loss) that a plane may shift to its term of the kinetic energy."""
SECANTS = ((1, 0), (4, -1), (0, 3), (20, 0))
"""Pairs of rows, before and after the state's own row, between which a plane's slope in the slowness is taken. There
are several pairs, because the loss of a map jumps."""

Floats = NDArray[np.float64]


class MapRows(NamedTuple):
    """A loss map as energies per metre ψ (N) in rows of one slowness each (falling), by their lower convex hulls.

    `hull_force` and `hull_psi` (rows, forces) hold `vertices` points of each row. `standing_w` is the least loss of a
    standing train.
    """

    tau: Floats
    standing_w: float
    hull_force: Floats
    hull_psi: Floats
    vertices: NDArray[np.int64]


class MeanSpeeds(NamedTuple):
    """Slowness (s/m) of each interval, and the sum of v²/2 at its two nodes (m²/s²)."""

    tau: Floats
    both_w: Floats


@kernel
def row_hulls(force_n, psi_n, first, last, hull_force, hull_psi, count):
    """Lower convex hulls of ψ over the forces first[i] … last[i] of each row (speed) i; `count` vertices each."""
    for i in range(psi_n.shape[0]):
        size = 0
        for j in range(first[i], last[i] + 1):
            f, p = force_n[j], psi_n[i, j]
            while size >= 2:
                f0, p0, f1, p1 = (
                    hull_force[i, size - 2],
                    hull_psi[i, size - 2],
                    hull_force[i, size - 1],
                    hull_psi[i, size - 1],
                )
                if (p1 - p0) * (f - f1) < (p - p1) * (f1 - f0):
                    break
                size -= 1
            hull_force[i, size], hull_psi[i, size] = f, p
            size += 1
        count[i] = size


@kernel
def _least(a, hull_force, hull_psi, size):
    """Least ψ − a·f of a row, from the vertices of its hull."""
    low, high = 0, size - 1
    while low < high:
        mid = (low + high) // 2
        if hull_psi[mid + 1] - hull_psi[mid] < a * (hull_force[mid + 1] - hull_force[mid]):
            low = mid + 1
        else:
            high = mid
    return hull_psi[low] - a * hull_force[low]


@kernel
def _slope_at(f, hull_force, hull_psi, size):
    """Slope of a row's hull at a force."""
    if size < 2:
        return 1.0
    low, high = 0, size - 2
    while low < high:
        mid = (low + high) // 2
        if hull_force[mid + 1] <= f:
            low = mid + 1
        else:
            high = mid
    return (hull_psi[low + 1] - hull_psi[low]) / (hull_force[low + 1] - hull_force[low])


@kernel
def plane_constant(a_b_d, least_n, rows, ends_tau, enough):
    """The largest c for which a·f + b·τ + d/(2τ²) + c, d <= 0, is nowhere above ψ (N).

    `least_n[i]` is the least ψ − a·f of row i. Between two rows, and beyond the slowest one, where ψ rises by at least
    `standing_w` with τ, the least is taken in closed form. Only slownesses between `ends_tau` count. A c of at most
    `enough` is of no use, and the search ends there.
    """
    _, b, d = a_b_d
    low_tau, high_tau = ends_tau
    c = np.inf
    for i in range(rows.tau.size):
        if i == 0:
            slow, fast, slope = max(high_tau, rows.tau[0]), rows.tau[0], rows.standing_w
        else:
            slow, fast = rows.tau[i - 1], rows.tau[i]
            slope = (least_n[i - 1] - least_n[i]) / (slow - fast)
        if slow < low_tau:
            break
        if fast > high_tau:
            continue
        quickest, slowest = max(fast, low_tau), min(slow, high_tau)
        tau = slowest
        if slope > b:
            tau = min(max((-d / (slope - b)) ** (1.0 / 3.0), quickest), slowest)
        c = min(c, least_n[i] + slope * (tau - fast) - b * tau - 0.5 * d / (tau * tau))
        if c <= enough:
            break
    return c


@kernel
def loss_planes(force_at, state, price_w, ends_tau, rows, out):
    """Fill planes (a, b, d/2, c) of every interval near the forces `force_at` (n, planes) at the speeds of `state`.

    A plane's slope in the force is that of the map, its slope in the slowness one of several secants, and a share of it
    and of the price of time is shifted to the kinetic energy. Of all these planes, which hold for slownesses between
    `ends_tau` (two arrays, n), the one highest at the state is taken.
    """
    low_tau, high_tau = ends_tau
    size = rows.tau.size
    least_n = np.empty(size)
    for k in range(force_at.shape[0]):
        tau, both_w = state.tau[k], state.both_w[k]
        i = 1
        while i < size - 1 and rows.tau[i] > tau:
            i += 1
        for p in range(force_at.shape[1]):
            f, best = force_at[k, p], -np.inf
            a = _slope_at(f, rows.hull_force[i], rows.hull_psi[i], rows.vertices[i])
            for r in range(size):
                least_n[r] = _least(a, rows.hull_force[r], rows.hull_psi[r], rows.vertices[r])
            for before, after in SECANTS:
                near, far = max(i - before, 0), min(i + after, size - 1)
                slope = 0.0
                if near < far:
                    slope = (least_n[near] - least_n[far]) / (rows.tau[near] - rows.tau[far])
                for share in TURNED_SHARES:
                    turned = share * max(price_w + slope, 0.0)
                    d, b = -turned * tau**3, slope - turned
                    rest = a * f + b * tau + 0.5 * d * both_w
                    c = plane_constant((a, b, d), least_n, rows, (low_tau[k], high_tau[k]), best - rest)
                    if rest + c > best:
                        best = rest + c
                        out[k, p, 0], out[k, p, 1], out[k, p, 2], out[k, p, 3] = a, b, 0.5 * d, c


class RelaxedMotion(NamedTuple):
    """The force over each interval (n,): F = inertia·(w1 − w0) + constant + quadratic·(w0 + w1) + linear/τ.

    `max_acceleration` (m/s²) is 1e5 or more if there is no such limit.
    """

    step_m: Floats
    inertia: Floats
    constant: Floats
    linear: Floats
    quadratic: Floats
    max_acceleration: Floats


class RelaxedEfforts(NamedTuple):
    """Limits of the motors over each interval (n,): −electric <= f <= traction.

    Each limit is a force, and also a line power·τ + offset in the slowness. `adhesive_force` (one number, negative:
    none) times the coefficient of adhesion limits the traction too.
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
"""Number of constraints of an interval before those of its planes."""


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
        total += _least_between(in_tau, program.box.low_tau[k] - z[2], program.box.high_tau[k] - z[2])
        total += _least_between(
            in_force, -program.efforts.electric_force[k] - z[3], program.efforts.traction_force[k] - z[3]
        )
    for k in range(n + 1):
        if program.box.free[k]:
            total += _least_between(gradient[k], program.box.low_w[k] - run.w[k], program.box.high_w[k] - run.w[k])
    return total


@kernel
def _least_between(gradient, low, high):
    """Least value of a linear function between two ends."""
    return min(gradient * low, gradient * high)


@kernel
def local_values(k, run: RelaxedRun, z):
    z[0], z[1] = run.w[k], run.w[k + 1]
    z[2], z[3], z[4] = run.local[k, 0], run.local[k, 1], run.local[k, 2]
