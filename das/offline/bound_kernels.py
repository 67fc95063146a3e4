"""The convex relaxation of a section: its variables and constraints, and the bound that its multipliers prove.

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
from das.solver.kernels.arrays import add, put
from das.solver.kernels.forces import ADHESION_EXTRA, ADHESION_LEAST, ADHESION_OFFSET, ADHESION_SPEED

TURNED_SHARES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8)
"""Shares of the price of time (and of the loss) that a plane may shift to its kinetic-energy term."""
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
    `standing_w` with τ, the least is taken in closed form. Only slownesses between `ends_tau` count. The search ends at
    a c of at most `enough`, which is useless.
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
def loss_planes(force_at, state, price_w, ends_tau, rows):
    """Planes below the energy of every interval, near the forces `force_at` (n, planes) and the speeds of `state`.

    A plane's slope in the force is that of the map, its slope in the slowness that of one of several secants; a share
    of the latter and of the price of time is shifted to the kinetic energy. Of all these planes, which are valid for
    slownesses between `ends_tau` (two arrays, n), the highest at the state is taken.
    """
    low_tau, high_tau = ends_tau
    size, shape = rows.tau.size, force_at.shape
    out = Planes(np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape))
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
                        out.force[k, p], out.slowness[k, p], out.speed[k, p], out.constant[k, p] = a, b, 0.5 * d, c
    return out


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
    """Bounds of v²/2 at the nodes (n + 1,) and of the slowness (n,); `free` marks the speeds that are variables.

    A free v²/2 lies between 0 and `high_w`; a fixed one is `high_w`.
    """

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
    """The convex relaxation in the form of the kernels; all forces are in units of one force."""

    motion: RelaxedMotion
    efforts: RelaxedEfforts
    box: Box
    planes: Planes
    allowed_s: float


class RelaxedRun(NamedTuple):
    """Values (or changes) of all variables: w (n + 1,), and local (n, 3) with τ, f and e of each interval."""

    w: Floats
    local: Floats


class Multipliers(NamedTuple):
    """Multipliers of the constraints (n, rows), and that of the time in element 0 of `time` (1,)."""

    rows: Floats
    time: Floats


LOCAL = 5
"""Local variables of an interval: w0, w1, τ, f, e."""
FIXED_ROWS = 10
"""Number of constraints of an interval before the constraints of its planes."""


@kernel
def constraints(k, z, free0, free1, program: Program, c, slope):
    """Fill the constraints `c` (rows,) and their slopes (rows, 5) of interval k at the local variables z.

    `free0` and `free1`: whether the speeds at the two nodes are variables; a fixed speed has no slope.
    """
    w0, w1, tau, f, e = z[0], z[1], z[2], z[3], z[4]
    h = program.motion.step_m[k]
    slope[:, :] = 0.0
    v0, v1 = math.sqrt(2.0 * w0), math.sqrt(2.0 * w1)
    total = v0 + v1
    # The slowness is at least the value for constant acceleration between the nodes.
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
        c[9] = -w1
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
    """Fill the constraints 2 to 6: the limits of the motors' traction and braking."""
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
            total += _least_between(gradient[k], -run.w[k], program.box.high_w[k] - run.w[k])
    return total


@kernel
def _least_between(gradient, low, high):
    return min(gradient * low, gradient * high)


@kernel
def local_values(k, run: RelaxedRun, z):
    z[0], z[1] = run.w[k], run.w[k + 1]
    z[2], z[3], z[4] = run.local[k, 0], run.local[k, 1], run.local[k, 2]


_TO_BOUNDARY = 0.99
"""Share of the distance to the nearest bound that a step covers."""
_LEAST_SLACK = 0.01
"""Least slack of a constraint at the first point, whether the point satisfies the constraint or not."""
_CENTRE = 0.1
"""Product of slack and multiplier of a constraint at the first point, per metre of the interval."""
_PATIENCE = 5
"""Number of consecutive steps without a higher bound after which the search ends, once it has a useful bound."""
_USEFUL = 2e-4
"""Ratio by which a useful bound may lie below the energy of the point."""
_FEASIBLE = 1e-5
"""Largest violation of a constraint with which a point counts as feasible."""


class Iterate(NamedTuple):
    """A point with the slacks and multipliers of its constraints (n, rows), and those of the trip time (1,).

    A step from one point to the next has the same form: it holds the changes.
    """

    run: RelaxedRun
    multipliers: Multipliers
    slack: Floats
    spare_s: Floats


@kernel
def best_bound(run: RelaxedRun, multipliers: Multipliers, program: Program, most_steps, enough):
    """Improve a point and its multipliers by Newton steps; returns the best bound and its price of time.

    The first point need not satisfy the constraints. The search stops when the bound is within `enough` (a ratio) of
    the energy of a point that satisfies them, when it no longer improves, or after `most_steps`.
    """
    n, m = multipliers.rows.shape
    newton = evaluate(run, multipliers.rows, program)
    now = Iterate(run, multipliers, np.empty((n, m)), np.empty(1))
    _set_slacks(now, program, newton)
    best, best_price, idle = -np.inf, multipliers.time[0], 0
    for _ in range(most_steps):
        _advance(now, program, _direction(now, program, newton))
        newton = evaluate(run, multipliers.rows, program)
        energy, size, worst = _quality(now, program, newton)
        found = proven_bound(run, multipliers, program)
        idle = 0 if found > best + 0.1 * enough * size or not found <= energy else idle + 1
        if found > best:
            best, best_price = found, multipliers.time[0]
        near = energy - best
        is_found = near <= enough * size and worst < _FEASIBLE
        if is_found or (near <= _USEFUL * size and idle >= _PATIENCE) or not math.isfinite(energy):
            break
    return best, best_price


@kernel
def _no_run(n):
    return RelaxedRun(np.zeros(n + 1), np.zeros((n, 3)))


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
    total = now.multipliers.time[0] * now.spare_s[0]
    for k in range(now.slack.shape[0]):
        for i in range(now.slack.shape[1]):
            total += now.slack[k, i] * now.multipliers.rows[k, i]
    return total


@kernel
def _direction(now, program, newton):
    """The step: the predictor aims at slack · multiplier = 0; its possible length sets the corrector's target."""
    n, m = now.slack.shape
    theta = np.empty((n, m))
    for k in range(n):
        for i in range(m):
            theta[k, i] = now.multipliers.rows[k, i] / now.slack[k, i]
    factor(theta, newton, program.box.free)
    # Solved with the row of the trip time as right-hand side, the Newton system makes that dense row cheap.
    right, column = _no_run(n), _no_run(n)
    put(program.motion.step_m, right.local[:, 0])
    solve(newton, program.box.free, right, column)
    total = _complementarity(now)
    change = Iterate(_no_run(n), Multipliers(np.zeros((n, m)), np.zeros(1)), np.zeros((n, m)), np.zeros(1))
    _newton_step(now, program, newton, column, 0.0, change)
    primal, dual = _longest_steps(now, change)
    price = now.multipliers.time[0] + dual * change.multipliers.time[0]
    after = price * (now.spare_s[0] + primal * change.spare_s[0])
    for k in range(n):
        for i in range(m):
            y = now.multipliers.rows[k, i] + dual * change.multipliers.rows[k, i]
            after += y * (now.slack[k, i] + primal * change.slack[k, i])
    centre = total / (n * m + 1) * min(max(after / total, 0.0), 1.0) ** 3
    _newton_step(now, program, newton, column, centre, change)
    return change


@kernel
def _newton_step(now, program, newton, column, centre, change):
    """The Newton step towards slack · multiplier = `centre`, corrected by the products of the step in `change`.

    `change` holds the predictor's step, or zeros; the new step replaces it.
    """
    n, m = now.slack.shape
    y, slack, price, spare_s = now.multipliers.rows, now.slack, now.multipliers.time[0], now.spare_s[0]
    moves, (turns, change_price) = change.run, change.multipliers
    weights = np.empty((n, m))
    for k in range(n):
        for i in range(m):
            miss = slack[k, i] * y[k, i] - centre + change.slack[k, i] * turns[k, i]
            weights[k, i] = y[k, i] + (y[k, i] * (newton.value[k, i] + slack[k, i]) - miss) / slack[k, i]
    over_s = _time(program, now.run.local) + spare_s - program.allowed_s
    time_miss = spare_s * price - centre + change.spare_s[0] * change_price[0]
    right = _right_side(weights, program, newton, price + (price * over_s - time_miss) / spare_s)
    solve(newton, program.box.free, right, moves)
    ratio = price / spare_s
    share = ratio * _time(program, moves.local) / (1.0 + ratio * _time(program, column.local))
    add(-share, column.w, moves.w)
    for k in range(n):
        add(-share, column.local[k], moves.local[k])
    change.spare_s[0] = -over_s - _time(program, moves.local)
    change_price[0] = (-time_miss - price * change.spare_s[0]) / spare_s
    for k in range(n):
        for i in range(m):
            moved = newton.slope[k, i, 0] * moves.w[k] + newton.slope[k, i, 1] * moves.w[k + 1]
            for j in range(3):
                moved += newton.slope[k, i, 2 + j] * moves.local[k, j]
            miss = slack[k, i] * y[k, i] - centre + change.slack[k, i] * turns[k, i]
            change.slack[k, i] = -(newton.value[k, i] + slack[k, i]) - moved
            turns[k, i] = (-miss - y[k, i] * change.slack[k, i]) / slack[k, i]


@kernel
def _right_side(weights, program, newton, price):
    """−(slope of the energy) − (slopes of the constraints)·weights, with the time's weight `price`."""
    right = _no_run(weights.shape[0])
    for k in range(weights.shape[0]):
        h = program.motion.step_m[k]
        right.local[k, 0] = -h * price
        right.local[k, 2] = -h
        for i in range(weights.shape[1]):
            y = weights[k, i]
            right.w[k] -= y * newton.slope[k, i, 0]
            right.w[k + 1] -= y * newton.slope[k, i, 1]
            for j in range(3):
                right.local[k, j] -= y * newton.slope[k, i, 2 + j]
    return right


@kernel
def _longest_steps(now, change):
    """The longest steps (at most 1) that keep slacks and multipliers positive."""
    primal, dual = 1.0, 1.0
    if change.spare_s[0] < 0.0:
        primal = min(primal, -now.spare_s[0] / change.spare_s[0])
    if change.multipliers.time[0] < 0.0:
        dual = min(dual, -now.multipliers.time[0] / change.multipliers.time[0])
    for k in range(now.slack.shape[0]):
        for i in range(now.slack.shape[1]):
            if change.slack[k, i] < 0.0:
                primal = min(primal, -now.slack[k, i] / change.slack[k, i])
            if change.multipliers.rows[k, i] < 0.0:
                dual = min(dual, -now.multipliers.rows[k, i] / change.multipliers.rows[k, i])
    return primal, dual


@kernel
def _advance(now, program, change):
    """Take the step, shortened so that speeds and slownesses stay positive."""
    primal, dual = _longest_steps(now, change)
    for k in range(now.slack.shape[0]):
        if change.run.local[k, 0] < 0.0:
            primal = min(primal, -0.9 * now.run.local[k, 0] / change.run.local[k, 0])
        if change.run.w[k] < 0.0 and program.box.free[k]:
            primal = min(primal, -0.9 * now.run.w[k] / change.run.w[k])
    primal, dual = min(1.0, _TO_BOUNDARY * primal), min(1.0, _TO_BOUNDARY * dual)
    add(primal, change.run.w, now.run.w)
    for k in range(now.slack.shape[0]):
        add(primal, change.run.local[k], now.run.local[k])
        add(primal, change.slack[k], now.slack[k])
        add(dual, change.multipliers.rows[k], now.multipliers.rows[k])
    now.spare_s[0] += primal * change.spare_s[0]
    now.multipliers.time[0] += dual * change.multipliers.time[0]


@kernel
def _quality(now, program, newton):
    """The point's energy, the sum of its absolute values over the intervals, and the largest violation of a
    constraint."""
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
def evaluate(run: RelaxedRun, rows, program: Program):
    """Constraints, slopes and curvature of every interval at a point, with room for the factors of the system."""
    n, m = rows.shape
    newton = Newton(
        np.empty((n, m)),
        np.empty((n, m, LOCAL)),
        np.empty((n, LOCAL, LOCAL)),
        np.zeros((n, 3, 3)),
        np.empty((n, 2, 3)),
        np.empty(n + 1),
        np.empty(n),
    )
    z = np.empty(LOCAL)
    for k in range(n):
        local_values(k, run, z)
        free0, free1 = program.box.free[k], program.box.free[k + 1]
        constraints(k, z, free0, free1, program, newton.value[k], newton.slope[k])
        curvature(k, z, free0, free1, rows[k], program, newton.curvature[k])
    return newton


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
def solve(newton, free, right, found):
    """Solve the factored system for one right-hand side; both it and the solution are in the form of a run."""
    (in_w, in_local), (out_w, out_local) = right, found
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
