"""A narrow dynamic program around a trajectory: lines on both sides of it, between knots on the integration grid.

The lines of a knot are speeds squared: the trajectory's v² plus whole multiples of a spacing, cut to the bounds.
Between two knots a move leads to a *line*, its shift in v² against the trajectory changing linearly with distance, or
it follows a *special*: full traction, coasting, full electric brake, or the brake at which no power flows through the
current collector. A special lands between the lines, where values are interpolated linearly in v². Every move is
integrated in the section's own steps, so that its cost is exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver.kernels.driving import full_traction_speed
from das.solver.kernels.forces import (
    brake_limit,
    electric_limit,
    electric_share,
    largest_gain,
    loss_power,
    mean_resistance,
    on_supply,
    traction_limit,
)
from das.solver.kernels.landings import speed_under_force
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

Floats = NDArray[np.float64]

LINE, TRACTION, COAST, BRAKE, IDLE = 0, 1, 2, 3, 4
"""Kinds of moves: to a line, and the specials; `IDLE` is the brake with the current collector at zero power."""
SPECIALS = 4

ROUNDING_RATIO, ROUNDING_N, ROUNDING_MPS2 = 1e-9, 1e-3, 1e-9
"""Largest excess of a force (share, N) or acceleration (m/s²) over its bound that counts as a rounding error."""
_FORCE_STEPS = 6
_SETTLED_RATIO = 1e-12
"""Relative change below which a speed counts as converged."""


class Tube(NamedTuple):
    """A trajectory and the lines on both sides of it.

    `squared` is the trajectory's v² at every integration node, `low` and `high` are the bounds of v² there. `share` is
    the node's distance from the previous knot, as a share of that from knot to knot. `knot` holds the integration nodes
    of the knots, `spacing` the gap between lines there (in v²). On each side of the trajectory there are `lines` lines.
    """

    squared: Floats
    low: Floats
    high: Floats
    share: Floats
    knot: NDArray[np.int64]
    spacing: Floats
    lines: int


class TubeMoves(NamedTuple):
    """Moves from every line of every knot (knots − 1, lines, moves): first to each line, then the specials.

    `energy_j` (INFEASIBLE if the train cannot make the move) and `time_s` are the costs, `below` the line below the
    landing and `share` the share of the line above it.
    """

    energy_j: Floats
    time_s: Floats
    below: NDArray[np.int16]
    share: Floats


@kernel
def _interval(v0, v1, h, g, q, p, c):
    """Energy (J), time (s) and wheel force (N) of an interval at constant acceleration, v0 + v1 > 0.

    The energy is INFEASIBLE if the train cannot do this. `p` is the train on the supply of the interval.
    """
    rate = (v1 * v1 - v0 * v0) / (2.0 * h)
    force = p.inertial_mass_kg * rate + mean_resistance(v0, v1, q, p) + g
    faster = max(v0, v1)
    mid = 0.5 * (v0 + v1)
    dt = h / mid
    if rate > p.max_acceleration_mps2 + ROUNDING_MPS2 or -rate > p.max_deceleration_mps2 + ROUNDING_MPS2:
        return INFEASIBLE, dt, force
    if force >= 0.0:
        if force > traction_limit(faster, p) * (1.0 + ROUNDING_RATIO) + ROUNDING_N:
            return INFEASIBLE, dt, force
    elif -force > brake_limit(faster, p, p.friction_force_n) * (1.0 + ROUNDING_RATIO) + ROUNDING_N:
        return INFEASIBLE, dt, force
    el = electric_share(force, faster, p)
    energy = el * h + loss_power(el, mid, c) * dt
    return energy if energy > 0.0 else p.receptivity_ratio * energy, dt, force


@kernel
def _idle_force(v, p, c):
    """The brake force (N, <= 0) with which the motors cover their own losses at a speed, within the electric limit."""
    limit = electric_limit(v, p)
    f = max(-loss_power(0.0, v, c) / v, -limit)
    for _ in range(_FORCE_STEPS):
        new = max(-loss_power(f, v, c) / v, -limit)
        if abs(new - f) < ROUNDING_N:
            return new
        f = new
    return f


@kernel
def _special_speed(kind, v0, h, g, q, p, c):
    """Speed after an interval of a special move; 0 if the train stops."""
    v1 = v0
    for _ in range(_FORCE_STEPS):
        if kind == TRACTION:
            gain = largest_gain(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p)
            new = math.sqrt(max(v0 * v0 + 2.0 * h * gain, 0.0))
        else:
            force = 0.0
            if kind == BRAKE:
                force = -electric_limit(max(v0, v1), p)
            elif kind == IDLE:
                force = _idle_force(0.5 * (v0 + v1), p, c)
            new = speed_under_force(force, v0, v1, h, g, q, p)
        if new <= 0.0 or abs(new - v1) < _SETTLED_RATIO * new:
            break
        v1 = new
    else:
        if kind == TRACTION:
            return full_traction_speed(v0, h, g, q, p)
    return new


@kernel
def _drive(kind, k, start, landing, tube, line, p, c, v):
    """Drive a move from knot k at v² `start` to the next knot: to v² `landing` (a line), or where the special leads.

    Fills `v` with the speeds at the nodes of the move. Returns energy (J), time (s), v² at the end, and the least and
    the largest wheel force (N).
    """
    i0, i1 = tube.knot[k], tube.knot[k + 1]
    away, beyond = start - tube.squared[i0], landing - tube.squared[i1]
    energy, time, least_n, largest_n = 0.0, 0.0, INFEASIBLE, -INFEASIBLE
    v[i0] = math.sqrt(start)
    for i in range(i0, i1):
        h, g, q = line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i]
        here = on_supply(p, line.supply[i])
        if kind == LINE:
            w1 = tube.squared[i + 1] + away + tube.share[i + 1] * (beyond - away)
        else:
            w1 = _special_speed(kind, v[i], h, g, q, here, c) ** 2
        at_line = kind == LINE and i + 1 == i1
        v[i + 1] = math.sqrt(landing if at_line else min(max(w1, tube.low[i + 1]), tube.high[i + 1]))
        e, dt, force = _interval(v[i], v[i + 1], h, g, q, here, c)
        energy, time = min(energy + e, INFEASIBLE), time + dt
        least_n, largest_n = min(least_n, force), max(largest_n, force)
    return energy, time, landing if kind == LINE else v[i1] * v[i1], least_n, largest_n


@kernel
def _is_beside(kind, k, start, least_n, largest_n, tube, line, p, c):
    """Whether a special move may land in the tube, whose outermost lines need these forces (N)."""
    if kind == COAST:
        return least_n < 0.0 < largest_n
    here = on_supply(p, line.supply[tube.knot[k]])
    v = math.sqrt(start)
    if kind == TRACTION:
        return largest_n > 0.9 * traction_limit(v, here)
    if least_n > 0.0:
        return False
    if kind == BRAKE:
        return -least_n > 0.9 * electric_limit(v, here)
    if here.receptivity_ratio >= 1.0:
        # If the line takes all that is fed back, the energy has no kink at zero power of the collector.
        return False
    return largest_n > 2.0 * _idle_force(v, here, c)


@kernel
def _line_of(tube, k, j):
    """The v² of line j of a knot; the trajectory itself is line number `lines`."""
    i = tube.knot[k]
    w = tube.squared[i] + (j - tube.lines) * tube.spacing[k]
    return min(max(w, tube.low[i]), tube.high[i])


@kernel
def _between_lines(tube, k, w):
    """The line below a v² at a knot, and the share of the line above it; (-1, 0) outside the tube."""
    spacing = tube.spacing[k]
    last = 2 * tube.lines
    x = (w - tube.squared[tube.knot[k]]) / spacing + tube.lines if spacing > 0.0 else 1.0 * tube.lines
    if x < 0.0 or x > last:
        return -1, 0.0
    j = min(int(x), last - 1)
    low, high = _line_of(tube, k, j), _line_of(tube, k, j + 1)
    share = (w - low) / (high - low) if high - low > 1e-9 * (high + 1e-9) else 0.0
    return j, min(max(share, 0.0), 1.0)


@kernel
def _between(values, j, share):
    """A value between two lines; a line with a share of 0 is not read, because it may be unreachable."""
    below = values[j] if share < 1.0 else 0.0
    above = values[j + 1] if share > 0.0 else 0.0
    return (1.0 - share) * below + share * above


@kernel
def all_moves(tube, line, p, c):
    """All moves from the lines of every knot but the last: to every line of the next knot, and the specials."""
    size = 2 * tube.lines + 1
    moves = _room_for((tube.knot.size - 1, size, size + SPECIALS))
    v = np.empty(tube.squared.size)
    for k in range(tube.knot.size - 1):
        for j in range(size):
            _moves_from(k, _line_of(tube, k, j), tube, line, p, c, v, _row(moves, k, j))
    return moves


@kernel
def _room_for(shape):
    return TubeMoves(np.empty(shape), np.empty(shape), np.empty(shape, np.int16), np.empty(shape))


@kernel
def _row(moves, k, j):
    energy, time, below, share = moves
    return TubeMoves(energy[k, j], time[k, j], below[k, j], share[k, j])


@kernel
def _target(move, k, tube):
    """The kind of a move by its number, and the v² at the next knot if it leads to a line."""
    size = 2 * tube.lines + 1
    return max(move - size + 1, LINE), _line_of(tube, k + 1, min(move, size - 1))


@kernel
def _moves_from(k, start, tube, line, p, c, v, row):
    """Fill `row` with all moves from knot k at v² `start`; the last knot is reached only at the trajectory's own speed.

    `v` (nodes) is working memory.
    """
    energy, time, below, share = row
    size, last = 2 * tube.lines + 1, tube.knot.size - 2
    least_n, largest_n = INFEASIBLE, -INFEASIBLE
    for i in range(energy.size):
        energy[i] = INFEASIBLE
        kind, landing = _target(i, k, tube)
        if kind == LINE:
            barred = (k == last and i != tube.lines) or start + landing <= 0.0
        else:
            barred = k == last or not _is_beside(kind, k, start, least_n, largest_n, tube, line, p, c)
        if barred or (k > 0 and start <= 0.0):
            continue
        e, t, w, least, largest = _drive(kind, k, start, landing, tube, line, p, c, v)
        if kind == LINE:
            least_n, largest_n = min(least_n, least), max(largest_n, largest)
            lower, above = min(i, size - 2), 1.0 if i == size - 1 else 0.0
        else:
            lower, above = _between_lines(tube, k + 1, w)
        if lower >= 0:
            energy[i], time[i], below[i], share[i] = e, t, lower, above


@kernel
def _best_move(price, row, ahead):
    """The least energy + price·time (J) of the moves in `row` with the values `ahead` at the next knot, and its number.

    The cost is INFEASIBLE, and the number 0, if there is none.
    """
    energy, time, below, share = row
    best, number = INFEASIBLE, 0
    for i in range(energy.size):
        if energy[i] < INFEASIBLE:
            cost = energy[i] + price * time[i] + _between(ahead, below[i], share[i])
            if cost < best:
                best, number = cost, i
    return best, number


@kernel
def tube_sweep(price, moves, value):
    """Least energy + price·time (J) to the end from every line of every knot; the last row holds the end values."""
    for k in range(value.shape[0] - 2, -1, -1):
        for j in range(value.shape[1]):
            best, _ = _best_move(price, _row(moves, k, j), value[k + 1])
            value[k, j] = best if best < UNREACHABLE else INFEASIBLE


@kernel
def tube_roll_out(price, tube, line, p, c, value, v):
    """The trajectory of a price of time through the tube: at every knot the best move from the train's own speed.

    Fills `v` with the speeds at the integration nodes; returns energy (J) and time (s), or (0, −1) if no move is
    possible from a knot.
    """
    row = _room_for((2 * tube.lines + 1 + SPECIALS,))
    w, energy, time = tube.squared[0], 0.0, 0.0
    for k in range(tube.knot.size - 1):
        _moves_from(k, w, tube, line, p, c, v, row)
        best, move = _best_move(price, row, value[k + 1])
        if best > UNREACHABLE:
            return 0.0, -1.0
        kind, landing = _target(move, k, tube)
        e, t, w, _, _ = _drive(kind, k, w, landing, tube, line, p, c, v)
        energy += e
        time += t
    return energy, time
