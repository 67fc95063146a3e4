"""Least costs between cells of speeds: a shortest path that no run of a section can undercut.

The speeds at every node are divided into cells. The value of a cell is a line in w = v²/2, and a *link* is the least
that an interval can cost between two cells, the lines of both taken into account. `docs/explanation/bounds.md` proves
that the shortest path over the links is a lower bound of the energy and the priced time of every run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling.kernels import kernel
from das.solver.kernels.forces import adhesion_coefficient

Floats = NDArray[np.float64]


STEEPEST = 5.0
"""No line falls by more than this many times the mass: near a standstill, values fall without limit."""


class EvenRows(NamedTuple):
    """Energies per metre ψ (N) of a loss map from below: convex in the force, at each speed.

    `psi_n` (speeds, forces) belongs to the slownesses `tau` (falling) and to the forces force0_n + i/steps_per_n.
    `steps_per_mps` is 1 over the distance of the speeds, the first of which is one step. `standing_w` is the least loss
    of a standing train.
    """

    psi_n: Floats
    tau: Floats
    standing_w: float
    force0_n: float
    steps_per_n: float
    steps_per_mps: float


class CellTrain(NamedTuple):
    """Numbers of a train: resistance per speed (N/(m/s)), inertial mass, and powers of motors and electric brake.

    The power of the electric brake is at most `electric_w` and at least `least_electric_w`; what the adhesive weight
    `adhesive_n` (N) puts on the rail can be less.
    """

    linear: float
    mass_kg: float
    traction_w: float
    electric_w: float
    least_electric_w: float
    adhesive_n: float


class CellLine(NamedTuple):
    """What each interval (n,) asks and allows: see `das.solver.bound.cells`.

    Resistance is at least constant_n + linear·v + quadratic·(w0 + w1). The motors give between −electric_n and
    traction_n, and at most their powers at the faster end; all brakes together give at most `brake_n`. Friction brakes
    only where the electric brake gives all that it can, which is at least `least_electric_n`, or less by its power and
    by adhesion. `share` is what the line takes of what is fed back, `price_w` the price of time. No run is slower than
    `slowest_tau` (s/m).
    """

    step_m: Floats
    constant_n: Floats
    quadratic: Floats
    traction_n: Floats
    electric_n: Floats
    least_electric_n: Floats
    brake_n: Floats
    max_acceleration: Floats
    share: Floats
    price_w: Floats
    slowest_tau: Floats
    train: CellTrain


class Cells(NamedTuple):
    """Cells of speeds at the nodes (n + 1,): number j holds the speeds from j to j + 1 times `width_mps`.

    Those of node k are first[k] … first[k] + size[k] − 1, and begin at `offset[k]` of the flat arrays: `slope` and
    `value` of their lines in w, which is that at the middle of the cell, `ahead` the shortest path from the start, and
    `open` whether a better run can be in the cell. No speed is above `top_mps` (n + 1,). At both ends there is one
    cell with one speed.
    """

    first: NDArray[np.int64]
    size: NDArray[np.int64]
    offset: NDArray[np.int64]
    guess: Floats
    slope: Floats
    value: Floats
    ahead: Floats
    open: NDArray[np.bool_]
    top_mps: Floats
    width: float


@kernel
def _ends(cells, k, j):
    """Slowest and fastest speed of cell j (counted from the first) of node k."""
    if k == 0 or k == cells.size.size - 1:
        return cells.top_mps[k], cells.top_mps[k]
    low, high = (cells.first[k] + j) * cells.width, (cells.first[k] + j + 1) * cells.width
    return min(low * low, cells.top_mps[k]), min(high * high, cells.top_mps[k])


@kernel
def _least_over_forces(tau, c, a, f1, f2, rows):
    """Least c·ψ − a·f at a slowness over the forces f1 … f2."""
    x = rows.steps_per_mps / tau
    last = rows.tau.size - 1
    r = min(int(x) - 1, last - 1)
    extra, share = 0.0, 0.0
    if r < 0:
        r = 0
        share = 1.0
        extra = c * rows.standing_w * (tau - rows.tau[0])
    else:
        share = min(max((tau - rows.tau[r + 1]) / (rows.tau[r] - rows.tau[r + 1]), 0.0), 1.0)
    slow, fast = rows.psi_n[r], rows.psi_n[r + 1]
    most = slow.size - 2
    y1, y2 = (f1 - rows.force0_n) * rows.steps_per_n, (f2 - rows.force0_n) * rows.steps_per_n
    i1, i2 = min(max(int(y1), 0), most), min(max(int(y2), 0), most)
    wanted = a / (c * rows.steps_per_n)
    if share * (slow[i2 + 1] - slow[i2]) + (1.0 - share) * (fast[i2 + 1] - fast[i2]) <= wanted:
        y, i = y2, i2
    elif share * (slow[i1 + 1] - slow[i1]) + (1.0 - share) * (fast[i1 + 1] - fast[i1]) >= wanted:
        y, i = y1, i1
    else:
        low, high = i1, i2
        while high - low > 1:
            mid = (low + high) // 2
            if share * (slow[mid + 1] - slow[mid]) + (1.0 - share) * (fast[mid + 1] - fast[mid]) >= wanted:
                high = mid
            else:
                low = mid
        y, i = float(high), high
    part = y - i
    psi = share * (slow[i] + part * (slow[i + 1] - slow[i])) + (1.0 - share) * (
        fast[i] + part * (fast[i + 1] - fast[i])
    )
    return c * psi - a * (rows.force0_n + y / rows.steps_per_n) + extra


@kernel
def _weight(f1, f2, tau, a, u, rows):
    """A weight of ψ between the share u and 1 with which the larger of ψ and u·ψ is bounded well from below."""
    if _least_over_forces(tau, 1.0, 0.0, f1, f1, rows) >= 0.0:
        return 1.0
    if _least_over_forces(tau, 1.0, 0.0, f2, f2, rows) <= 0.0:
        return u
    low, high = f1, f2
    for _ in range(40):
        mid = 0.5 * (low + high)
        if _least_over_forces(tau, 1.0, 0.0, mid, mid, rows) >= 0.0:
            high = mid
        else:
            low = mid
        if high - low < 1.0:
            break
    rise = _least_over_forces(tau, 1.0, 0.0, low + 1.0, low + 1.0, rows) - _least_over_forces(
        tau, 1.0, 0.0, low, low, rows
    )
    return min(max(a / max(rise, 1e-9), max(u, 1e-6)), 1.0)


@kernel
def _link(k, low0, high0, slope0, low1, high1, slope1, line, rows):
    """Least energy and priced time of interval k from a cell to a cell, plus the line of the second, less the first's.

    Both lines are counted from the middle of their cell (in w). Infinite where no run goes from one to the other.
    """
    h, mass = line.step_m[k], line.train.mass_kg
    a0, b0, a1, b1 = 0.5 * low0 * low0, 0.5 * high0 * high0, 0.5 * low1 * low1, 0.5 * high1 * high1
    if (a1 - b0) > line.max_acceleration[k] * h:
        return np.inf
    quadratic, linear = line.quadratic[k], line.train.linear
    slowest, fastest = 0.5 * (low0 + low1), max(high0, high1)
    base_low = line.constant_n[k] + quadratic * (a0 + a1) + (linear * slowest if linear > 0.0 else linear * fastest)
    base_high = line.constant_n[k] + quadratic * (b0 + b1) + (linear * fastest if linear > 0.0 else linear * slowest)
    f1, f2 = mass * (a1 - b0) / h + base_low, mass * (b1 - a0) / h + base_high
    traction, electric = _efforts(k, max(low0, low1), line)
    if f1 > traction or f2 < -line.brake_n[k]:
        return np.inf
    f2 = min(f2, traction)
    a = max(-0.5 * (slope0 + slope1) / mass, 0.0)
    # Beyond the electric brake, friction takes what the motors do not.
    beyond = a * max(-electric - f2, 0.0)
    f1, f2 = max(f1, -electric), max(f2, -_least_electric(k, fastest, line))
    tau1 = 2.0 / (high0 + high1)
    if tau1 > line.slowest_tau[k]:
        return np.inf
    tau2 = 2.0 / (low0 + low1) if low0 + low1 > 0.0 else np.inf
    tau2 = min(tau2, line.slowest_tau[k])
    turned = (slope1 - slope0) + 2.0 * a * h * quadratic
    weight = 1.0
    if line.share[k] < 1.0:
        weight = _weight(f1, f2, tau1, a, line.share[k], rows)
    # Between the least and the largest slowness the cost is the sum of a concave and of a convex function.
    bend_tau, bend_w = h * a * max(linear, 0.0), max(turned, 0.0)
    fall_tau, fall_w = h * a * min(linear, 0.0), min(turned, 0.0)
    apart = max(abs(high1 - low0), abs(high0 - low1))
    least_apart = max(low1 - high0, low0 - high1, 0.0)
    constant = h * (beyond + a * line.constant_n[k]) + fall_w * apart * apart / 8.0
    constant += bend_w * least_apart * least_apart / 8.0
    if fall_tau < 0.0:
        constant += fall_tau * apart * apart * tau2 / 12.0
    forces, bends = (weight, a, f1, f2), (bend_tau, bend_w, fall_tau, fall_w)
    best = _least_between(tau1, tau2, h, line.price_w[k], forces, bends, rows)
    return best + constant - slope1 * 0.5 * (a1 + b1) + slope0 * 0.5 * (a0 + b0)


@kernel
def _efforts(k, faster, line):
    """Largest traction and electric brake of interval k (N) where the faster speed is at least this."""
    speed = max(faster, 1e-3)
    traction = min(line.traction_n[k], line.train.traction_w / speed)
    return traction, min(line.electric_n[k], line.train.electric_w / speed)


@kernel
def _least_electric(k, fastest, line):
    """What the electric brake gives at least in interval k (N), at a faster end of at most this speed."""
    train = line.train
    least = min(line.least_electric_n[k], train.least_electric_w / max(fastest, 1e-3))
    return min(least, train.adhesive_n * adhesion_coefficient(fastest))


@kernel
def _least_between(tau1, tau2, h, price_w, forces, bends, rows):
    """Least cost of h metres over the slownesses tau1 … tau2, from below, in parts between the speeds of the map."""
    weight, a, f1, f2 = forces
    bend_tau, bend_w, fall_tau, fall_w = bends
    best, tau = np.inf, tau1
    left = h * (_least_over_forces(tau, weight, a, f1, f2, rows) + price_w * tau)
    left += fall_tau / tau + 0.5 * fall_w / (tau * tau)
    if not tau < tau2:
        return left + bend_tau / tau + 0.5 * bend_w / (tau * tau)
    while tau < tau2:
        r = int(rows.steps_per_mps / tau * (1.0 - 1e-12)) - 1
        after = min(rows.tau[min(r, rows.tau.size - 1)], tau2) if r >= 0 else tau2
        if after <= tau:
            after = tau2
        right = h * (_least_over_forces(after, weight, a, f1, f2, rows) + price_w * after)
        right += fall_tau / after + 0.5 * fall_w / (after * after)
        best = min(best, _with_bend(tau, left, after, right, bend_tau, bend_w))
        tau, left = after, right
    return best


@kernel
def _with_bend(tau1, left, tau2, right, bend_tau, bend_w):
    """Least of a concave function with these ends and of bend_tau/τ + bend_w/(2τ²) over an interval, from below."""
    if bend_tau == 0.0 and bend_w == 0.0:
        return min(left, right)
    mid = 0.5 * (tau1 + tau2)
    value = bend_tau / mid + 0.5 * bend_w / (mid * mid)
    slope = -bend_tau / (mid * mid) - bend_w / (mid * mid * mid)
    tangent = min(left + value + slope * (tau1 - mid), right + value + slope * (tau2 - mid))
    return max(tangent, min(left, right) + bend_tau / tau2 + 0.5 * bend_w / (tau2 * tau2))


@kernel
def _reach(k, low0, high0, cells, line):
    """First and last cell (and one more) of node k + 1 that interval k can lead to from speeds low0 … high0."""
    n = cells.size.size - 1
    if k + 1 == n:
        return 0, 1
    h, mass = line.step_m[k], line.train.mass_kg
    most_w = 0.5 * cells.top_mps[k + 1] ** 2 + 0.5 * high0 * high0
    resisting = (
        line.constant_n[k] + line.quadratic[k] * most_w + max(line.train.linear, 0.0) * max(high0, cells.top_mps[k + 1])
    )
    helping = line.constant_n[k] + min(line.train.linear, 0.0) * max(high0, cells.top_mps[k + 1])
    down = 0.5 * low0 * low0 - h * (line.brake_n[k] + resisting) / mass
    up = 0.5 * high0 * high0 + h * (min(line.traction_n[k], line.train.traction_w / max(low0, 1e-3)) - helping) / mass
    low = int(math.sqrt(math.sqrt(max(2.0 * down, 0.0))) / cells.width) - 1 - cells.first[k + 1]
    high = int(math.sqrt(math.sqrt(max(2.0 * up, 0.0))) / cells.width) + 2 - cells.first[k + 1]
    return max(low, 0), min(high, cells.size[k + 1])


@kernel
def values_behind(cells, line, rows):
    """Fill slopes and values of all open cells from the end to the start; returns the value at the start."""
    n = cells.size.size - 1
    cells.value[cells.offset[n]] = 0.0
    cells.slope[cells.offset[n]] = 0.0
    cells.guess[cells.offset[n]] = 0.0
    at_edges = np.empty(cells.size.max() + 1)
    for k in range(n - 1, -1, -1):
        _slopes(k, cells, line, rows, at_edges)
        o0, o1 = cells.offset[k], cells.offset[k + 1]
        for j in range(cells.size[k]):
            cells.value[o0 + j] = np.inf
            if not cells.open[o0 + j]:
                continue
            low0, high0 = _ends(cells, k, j)
            slope0 = cells.slope[o0 + j]
            best = np.inf
            first, last = _reach(k, low0, high0, cells, line)
            for i in range(first, last):
                behind = cells.value[o1 + i]
                if behind < np.inf:
                    low1, high1 = _ends(cells, k + 1, i)
                    best = min(
                        best, behind + _link(k, low0, high0, slope0, low1, high1, cells.slope[o1 + i], line, rows)
                    )
            cells.value[o0 + j] = best
    return cells.value[0]


@kernel
def _slopes(k, cells, line, rows, at_edges):
    """Slopes of the lines of node k: those between the values at the ends of its cells, and never rising."""
    o0, count = cells.offset[k], cells.size[k]
    for j in range(count + 1):
        at_edges[j] = np.inf
        if (j < count and cells.open[o0 + j]) or (j > 0 and cells.open[o0 + j - 1]):
            speed = _ends(cells, k, j)[0] if j < count else _ends(cells, k, j - 1)[1]
            at_edges[j] = _value_at(k, speed, cells, line, rows)
    known = 0.0
    for j in range(count):
        low, high = _ends(cells, k, j)
        if high > low and at_edges[j] < np.inf and at_edges[j + 1] < np.inf:
            rise = (at_edges[j + 1] - at_edges[j]) / (0.5 * (high * high - low * low))
            slope = min(max(rise, -STEEPEST * line.train.mass_kg), 0.0)
            if known == 0.0:
                cells.slope[o0 : o0 + j] = slope
            known = slope
        cells.slope[o0 + j] = known
    # Lines that differ less from their neighbours' lose less; any lines prove a bound.
    before = cells.slope[o0]
    for j in range(1, count - 1):
        here = cells.slope[o0 + j]
        cells.slope[o0 + j] = 0.25 * (before + 2.0 * here + cells.slope[o0 + j + 1])
        before = here
    for j in range(count):
        low, high = _ends(cells, k, j)
        half = cells.slope[o0 + j] * 0.25 * (high * high - low * low)
        cells.guess[o0 + j] = min(at_edges[j] + half, at_edges[j + 1] - half) if cells.open[o0 + j] else np.inf


@kernel
def _value_at(k, speed, cells, line, rows):
    """The least cost from one speed at node k to the end."""
    o1 = cells.offset[k + 1]
    best = np.inf
    first, last = _reach(k, speed, speed, cells, line)
    for i in range(first, last):
        behind = cells.guess[o1 + i]
        if behind < np.inf:
            low1, high1 = _ends(cells, k + 1, i)
            slope = cells.slope[o1 + i]
            best = min(best, behind + _link(k, speed, speed, slope, low1, high1, slope, line, rows))
    return best


@kernel
def values_ahead(cells, line, rows):
    """Fill the shortest path from the start to every open cell, by the links of the lines that are known."""
    n = cells.size.size - 1
    cells.ahead[:] = np.inf
    cells.ahead[0] = 0.0
    for k in range(n):
        o0, o1 = cells.offset[k], cells.offset[k + 1]
        for j in range(cells.size[k]):
            here = cells.ahead[o0 + j]
            if not cells.open[o0 + j] or here == np.inf or cells.value[o0 + j] == np.inf:
                continue
            low0, high0 = _ends(cells, k, j)
            first, last = _reach(k, low0, high0, cells, line)
            for i in range(first, last):
                if cells.value[o1 + i] < np.inf:
                    low1, high1 = _ends(cells, k + 1, i)
                    cost = _link(k, low0, high0, cells.slope[o0 + j], low1, high1, cells.slope[o1 + i], line, rows)
                    cells.ahead[o1 + i] = min(cells.ahead[o1 + i], here + cost)
