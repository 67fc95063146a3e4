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

from das.compiling import kernel
from precompute.tight_bound.link_kernels import inlined, interval, link

Floats = NDArray[np.float64]


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
