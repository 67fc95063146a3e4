"""Planes below the energy of a loss map: nowhere above it, also at the states between its points.

The energy per metre at force f and slowness τ is ψ = f + τ·P(f, 1/τ). The map P is bilinear in force and speed in each
of its cells, so ψ is bilinear in force and slowness there: its least value against a plane lies on the cell's edges.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel

TURNED_SHARES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8)
"""Shares of the price of time (and of the loss) that a plane may shift to its term of the kinetic energy."""
SECANTS = ((1, 0), (4, -1), (0, 3), (20, 0))
"""A plane's slope in the slowness is that between a row this many before a state's own and one this many after it.

There are several such pairs, because the loss of a map jumps.
"""

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
