"""Least costs between cells of speeds, and a shortest path that costs no more than any run of a section.

The speeds at every node are divided into cells. The value of a cell is a line in w = v²/2, and a *link* is the least
cost of an interval between two cells, plus the second cell's line, minus the first's. `docs/explanation/bounds.md`
proves that the shortest path over the links is a lower bound of the energy and the priced time of every run.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import compiled, kernel
from das.solver.kernels.forces import adhesion_coefficient
from das.solver.kernels.tuples import CURVE_STEPS_PER_MPS

Floats = NDArray[np.float64]

inlined = compiled(forceinline=True)


class EvenRows(NamedTuple):
    """Lower bounds of a loss map's energy per metre ψ (N), convex in the force at each speed.

    `psi_n` (1 + speeds, forces) belongs to the slownesses `tau` (falling), the first of which no run reaches, and to
    the forces force0_n + i/steps_per_n. `steps_per_mps` is 1 over the spacing of the speeds, which begin one spacing
    above 0.
    """

    psi_n: Floats
    tau: Floats
    force0_n: float
    steps_per_n: float
    steps_per_mps: float


class CellTrain(NamedTuple):
    """Numbers of a train: resistance per speed (N/(m/s)), inertial mass, and powers of motors and electric brake.

    The power of the electric brake is at most `electric_w` and at least `least_electric_w`; adhesion under
    the weight `adhesive_n` (N) can limit it further. `curves_n` (3, n), if `has_curves`, bound the efforts at
    the samples of speed: the largest traction and electric brake from a speed on, the least electric brake up to it.
    """

    linear: float
    mass_kg: float
    traction_w: float
    electric_w: float
    least_electric_w: float
    adhesive_n: float
    has_curves: bool
    curves_n: Floats


class CellEfforts(NamedTuple):
    """Limits of forces (N), of all intervals or of one. The motors' force is between −electric_n and traction_n, and at
    most their powers at the faster end; the force of all brakes is at most `brake_n`. The friction brake acts only if
    the electric brake is at its limit: at least `least_electric_n`, unless its power or adhesion allows less.
    """

    traction_n: Floats
    electric_n: Floats
    least_electric_n: Floats
    brake_n: Floats


class CellLine(NamedTuple):
    """Resistance, limits and prices of each interval (n,), made by `docs.studies.tight_bound`.

    Resistance is at least constant_n + linear·v + quadratic·(w0 + w1). `share` is the part of the energy fed back
    that the line takes, `price_w` the price of time. No run is slower than `slowest_tau` (s/m), and none is faster than
    `top_mps` at the nodes (n + 1,).
    """

    step_m: Floats
    constant_n: Floats
    quadratic: Floats
    efforts: CellEfforts
    max_acceleration: Floats
    share: Floats
    price_w: Floats
    slowest_tau: Floats
    top_mps: Floats
    train: CellTrain


class CellInterval(NamedTuple):
    """One interval: its entries in `CellLine`, and the train."""

    step_m: float
    constant_n: float
    quadratic: float
    efforts: CellEfforts
    max_acceleration: float
    share: float
    price_w: float
    slowest_tau: float
    top_mps: float
    train: CellTrain


@inlined
def _least_over_forces(tau, c, a, f1, f2, rows):
    """Least c·ψ − a·f at a slowness over the forces f1 … f2."""
    r = min(int(rows.steps_per_mps / tau), rows.tau.size - 2)
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
    return c * psi - a * (rows.force0_n + y / rows.steps_per_n)


@kernel
def _weight(f1, f2, tau, a, u, rows):
    """A weight of ψ between the share u and 1 that gives a high lower bound of the larger of ψ and u·ψ."""
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


@inlined
def interval(k, line):
    """Interval k of a line as numbers: with them, links take a third of the time that they take with arrays."""
    return CellInterval(
        line.step_m[k],
        line.constant_n[k],
        line.quadratic[k],
        CellEfforts(
            line.efforts.traction_n[k],
            line.efforts.electric_n[k],
            line.efforts.least_electric_n[k],
            line.efforts.brake_n[k],
        ),
        line.max_acceleration[k],
        line.share[k],
        line.price_w[k],
        line.slowest_tau[k],
        line.top_mps[k + 1],
        line.train,
    )


@inlined
def link(here, start, end, rows):
    """Least energy and priced time of an interval between two cells, plus the second cell's line, minus the first's.

    A cell is given by its slowest and fastest speed and the slope of its line, which is counted from the middle of the
    cell (in w). The result is infinite if no run goes from one cell to the other.
    """
    low0, high0, slope0 = start
    low1, high1, slope1 = end
    h, mass = here.step_m, here.train.mass_kg
    a0, b0, a1, b1 = 0.5 * low0 * low0, 0.5 * high0 * high0, 0.5 * low1 * low1, 0.5 * high1 * high1
    if (a1 - b0) > here.max_acceleration * h:
        return np.inf
    quadratic, linear = here.quadratic, here.train.linear
    slowest, fastest = 0.5 * (low0 + low1), max(high0, high1)
    base_low = here.constant_n + quadratic * (a0 + a1) + (linear * slowest if linear > 0.0 else linear * fastest)
    base_high = here.constant_n + quadratic * (b0 + b1) + (linear * fastest if linear > 0.0 else linear * slowest)
    f1, f2 = mass * (a1 - b0) / h + base_low, mass * (b1 - a0) / h + base_high
    traction, electric = _efforts(here, max(low0, low1))
    if f1 > traction or f2 < -here.efforts.brake_n:
        return np.inf
    tau1 = 2.0 / (high0 + high1)
    if tau1 > here.slowest_tau:
        return np.inf
    forces = f1, min(f2, traction), electric, _least_electric(here, fastest)
    rho = slope1 - slope0
    split = -0.5 * (slope0 + slope1) / mass, rho, 0.0
    best = _split_link(here, (low0, high0, low1, high1), forces, split, rows)
    if rho < 0.0 and high1 >= here.top_mps:
        split = -slope0 / mass, 0.0, rho * b1
        best = max(best, _split_link(here, (low0, high0, low1, high1), forces, split, rows))
    return best - slope1 * 0.5 * (a1 + b1) + slope0 * 0.5 * (a0 + b0)


@inlined
def _split_link(here, speeds, forces, split, rows):
    """Least cost of a link, with the lines' difference split into a·(force), ρ·(mean of w0 and w1) and a constant."""
    low0, high0, low1, high1 = speeds
    f1, f2, electric, least_electric = forces
    a, rho, constant = split
    h, linear = here.step_m, here.train.linear
    a = max(a, 0.0)
    # If the electric brake is not enough, the friction brake does the rest.
    beyond = a * max(-electric - f2, 0.0)
    f1, f2 = max(f1, -electric), max(f2, -least_electric)
    tau1 = 2.0 / (high0 + high1)
    tau2 = 2.0 / (low0 + low1) if low0 + low1 > 0.0 else np.inf
    tau2 = min(tau2, here.slowest_tau)
    turned = rho + 2.0 * a * h * here.quadratic
    weight = 1.0
    if here.share < 1.0:
        weight = _weight(f1, f2, tau1, a, here.share, rows)
    # Between the least and the largest slowness the cost is the sum of a concave and of a convex function.
    bend_tau, bend_w = h * a * max(linear, 0.0), max(turned, 0.0)
    fall_tau, fall_w = h * a * min(linear, 0.0), min(turned, 0.0)
    apart = max(abs(high1 - low0), abs(high0 - low1))
    least_apart = max(low1 - high0, low0 - high1, 0.0)
    constant += h * (beyond + a * here.constant_n) + fall_w * apart * apart / 8.0
    constant += bend_w * least_apart * least_apart / 8.0
    if fall_tau < 0.0:
        constant += fall_tau * apart * apart * tau2 / 12.0
    bends = (bend_tau, bend_w, fall_tau, fall_w)
    return constant + _least_between(tau1, tau2, h, here.price_w, (weight, a, f1, f2), bends, rows)


@inlined
def _efforts(here, faster):
    """Largest traction and electric brake (N) of an interval whose faster end has at least the speed `faster`."""
    speed = max(faster, 1e-3)
    traction = min(here.efforts.traction_n, here.train.traction_w / speed)
    electric = min(here.efforts.electric_n, here.train.electric_w / speed)
    if here.train.has_curves:
        i = _sample(faster, here.train)
        return min(traction, here.train.curves_n[0, i]), min(electric, here.train.curves_n[1, i])
    return traction, electric


@inlined
def _sample(speed, train):
    """The last sample of the effort curves that is not faster than a speed."""
    return min(int(speed * CURVE_STEPS_PER_MPS), train.curves_n.shape[1] - 1)


@inlined
def _least_electric(here, fastest):
    """Least force (N) of the full electric brake in an interval whose faster end has at most the speed `fastest`."""
    train = here.train
    least = min(here.efforts.least_electric_n, train.least_electric_w / max(fastest, 1e-3))
    if train.has_curves and least > 0.0:
        least = min(least, train.curves_n[2, min(_sample(fastest, train) + 1, train.curves_n.shape[1] - 1)])
    return min(least, train.adhesive_n * adhesion_coefficient(fastest))


@inlined
def _least_between(tau1, tau2, h, price_w, forces, bends, rows):
    """Lower bound of the cost of h metres at slownesses tau1 … tau2, in parts between the speeds of the map."""
    weight, a, f1, f2 = forces
    bend_tau, bend_w, fall_tau, fall_w = bends
    best, tau = np.inf, tau1
    left = h * (_least_over_forces(tau, weight, a, f1, f2, rows) + price_w * tau)
    left += fall_tau / tau + 0.5 * fall_w / (tau * tau)
    if not tau < tau2:
        return left + bend_tau / tau + 0.5 * bend_w / (tau * tau)
    while tau < tau2:
        r = int(rows.steps_per_mps / tau * (1.0 - 1e-12))
        after = min(rows.tau[min(r, rows.tau.size - 1)], tau2)
        if after <= tau:
            after = tau2
        right = h * (_least_over_forces(after, weight, a, f1, f2, rows) + price_w * after)
        right += fall_tau / after + 0.5 * fall_w / (after * after)
        best = min(best, _with_bend(tau, left, after, right, bend_tau, bend_w))
        tau, left = after, right
    return best


@inlined
def _with_bend(tau1, left, tau2, right, bend_tau, bend_w):
    """Lower bound over tau1 … tau2 of bend_tau/τ + bend_w/(2τ²) plus a concave function with these end values."""
    if bend_tau == 0.0 and bend_w == 0.0:
        return min(left, right)
    mid = 0.5 * (tau1 + tau2)
    value = bend_tau / mid + 0.5 * bend_w / (mid * mid)
    slope = -bend_tau / (mid * mid) - bend_w / (mid * mid * mid)
    tangent = min(left + value + slope * (tau1 - mid), right + value + slope * (tau2 - mid))
    return max(tangent, min(left, right) + bend_tau / tau2 + 0.5 * bend_w / (tau2 * tau2))


STEEPEST = 5.0
"""Steepest fall of a line, in multiples of the mass: near a standstill, values fall without limit."""


class Cells(NamedTuple):
    """Cells of speeds at the nodes (n + 1,): in cell j, the square root of the speed is j to j + 1 times `width`.

    Node k has the cells first[k] … first[k] + size[k] − 1, which begin at `offset[k]` of the flat arrays: `slope` of a
    cell's line in w, `value` at the middle of the cell, `guess` the value expected from the costs at the cell's ends,
    `ahead` the shortest path from the start, and `open` whether a better run can be in the cell. No speed is above
    `top_mps` (n + 1,). At both ends there is one cell with one speed.
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


@inlined
def _ends(cells, k, j):
    """Slowest and fastest speed of cell j (counted from the first) of node k."""
    if k == 0 or k == cells.size.size - 1:
        return cells.top_mps[k], cells.top_mps[k]
    low, high = (cells.first[k] + j) * cells.width, (cells.first[k] + j + 1) * cells.width
    return min(low * low, cells.top_mps[k]), min(high * high, cells.top_mps[k])


@inlined
def _all_ends(cells, k, ends):
    """Fill the slowest and the fastest speeds (2, cells) of the cells of node k."""
    for j in range(cells.size[k]):
        ends[0, j], ends[1, j] = _ends(cells, k, j)


@inlined
def _reach(k, low0, high0, cells, line):
    """The first cell of node k + 1 that interval k reaches from speeds low0 … high0, and the one after the last."""
    n = cells.size.size - 1
    if k + 1 == n:
        return 0, 1
    h, mass = line.step_m[k], line.train.mass_kg
    most_w = 0.5 * cells.top_mps[k + 1] ** 2 + 0.5 * high0 * high0
    resisting = (
        line.constant_n[k] + line.quadratic[k] * most_w + max(line.train.linear, 0.0) * max(high0, cells.top_mps[k + 1])
    )
    helping = line.constant_n[k] + min(line.train.linear, 0.0) * max(high0, cells.top_mps[k + 1])
    down = 0.5 * low0 * low0 - h * (line.efforts.brake_n[k] + resisting) / mass
    up = (
        0.5 * high0 * high0
        + h * (min(line.efforts.traction_n[k], line.train.traction_w / max(low0, 1e-3)) - helping) / mass
    )
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
    at_edges, ends = np.empty(cells.size.max() + 1), np.empty((2, cells.size.max()))
    for k in range(n - 1, -1, -1):
        here = interval(k, line)
        _all_ends(cells, k + 1, ends)
        _slopes(k, here, ends, cells, line, rows, at_edges)
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
                    there = ends[0, i], ends[1, i], cells.slope[o1 + i]
                    best = min(best, behind + link(here, (low0, high0, slope0), there, rows))
            cells.value[o0 + j] = best
    return cells.value[0]


@kernel
def _slopes(k, here, ends, cells, line, rows, at_edges):
    """Slopes of the lines of node k: each from the values at the ends of its cell, and never above 0."""
    o0, count = cells.offset[k], cells.size[k]
    for j in range(count + 1):
        at_edges[j] = np.inf
        if (j < count and cells.open[o0 + j]) or (j > 0 and cells.open[o0 + j - 1]):
            speed = _ends(cells, k, j)[0] if j < count else _ends(cells, k, j - 1)[1]
            at_edges[j] = _value_at(k, speed, here, ends, cells, line, rows)
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
    # Smoother slopes prove a higher bound; any slopes prove one.
    before = cells.slope[o0]
    for j in range(1, count - 1):
        own = cells.slope[o0 + j]
        cells.slope[o0 + j] = 0.25 * (before + 2.0 * own + cells.slope[o0 + j + 1])
        before = own
    for j in range(count):
        low, high = _ends(cells, k, j)
        half = cells.slope[o0 + j] * 0.25 * (high * high - low * low)
        cells.guess[o0 + j] = min(at_edges[j] + half, at_edges[j + 1] - half) if cells.open[o0 + j] else np.inf


@kernel
def _value_at(k, speed, here, ends, cells, line, rows):
    """The least cost from one speed at node k to the end."""
    o1 = cells.offset[k + 1]
    best = np.inf
    first, last = _reach(k, speed, speed, cells, line)
    for i in range(first, last):
        behind = cells.guess[o1 + i]
        if behind < np.inf:
            slope = cells.slope[o1 + i]
            best = min(best, behind + link(here, (speed, speed, slope), (ends[0, i], ends[1, i], slope), rows))
    return best


@kernel
def values_ahead(cells, line, rows):
    """Fill in the shortest path from the start to every open cell, over links with the known lines."""
    n = cells.size.size - 1
    cells.ahead[:] = np.inf
    cells.ahead[0] = 0.0
    ends = np.empty((2, cells.size.max()))
    for k in range(n):
        here = interval(k, line)
        _all_ends(cells, k + 1, ends)
        o0, o1 = cells.offset[k], cells.offset[k + 1]
        for j in range(cells.size[k]):
            reached = cells.ahead[o0 + j]
            if not cells.open[o0 + j] or reached == np.inf or cells.value[o0 + j] == np.inf:
                continue
            low0, high0 = _ends(cells, k, j)
            first, last = _reach(k, low0, high0, cells, line)
            for i in range(first, last):
                if cells.value[o1 + i] < np.inf:
                    there = ends[0, i], ends[1, i], cells.slope[o1 + i]
                    cost = link(here, (low0, high0, cells.slope[o0 + j]), there, rows)
                    cells.ahead[o1 + i] = min(cells.ahead[o1 + i], reached + cost)
