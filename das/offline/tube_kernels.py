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
_ANY_SQUARED = 1.0
"""v² (m²/s²) used for a barred pair, to avoid a division by 0."""
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


class Pairs(NamedTuple):
    """Pairs of a line at a knot and a line at the next knot, given by v², and the cost of the move between them.

    `energy_j` is INFEASIBLE if the train cannot make the move. `least_n` and `largest_n` are the least and the largest
    wheel force of a move. `barred` is 1 for a pair that is no move.
    """

    start: Floats
    landing: Floats
    energy_j: Floats
    time_s: Floats
    least_n: Floats
    largest_n: Floats
    barred: Floats


@kernel
def _room_for(count):
    rows = np.empty((7, count))
    return Pairs(rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6])


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
def _special(kind, k, start, tube, line, p, c):
    """Energy (J), time (s) and v² at the end of a special move from knot k at v² `start`, cut to the bounds."""
    energy, time = 0.0, 0.0
    v0 = math.sqrt(start)
    for i in range(tube.knot[k], tube.knot[k + 1]):
        h, g, q = line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i]
        here = on_supply(p, line.supply[i])
        v1 = _special_speed(kind, v0, h, g, q, here, c)
        v1 = math.sqrt(min(max(v1 * v1, tube.low[i + 1]), tube.high[i + 1]))
        e, dt, _ = _interval(v0, v1, h, g, q, here, c)
        if e >= INFEASIBLE:
            return INFEASIBLE, 0.0, 0.0
        energy += e
        time += dt
        v0 = v1
    return energy, time, v0 * v0


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
def fill_moves(tube, line, p, c, moves):
    """All moves from the lines of every knot but the last: to every line of the next knot, and the specials."""
    size = 2 * tube.lines + 1
    last = tube.knot.size - 2
    pairs = _room_for(size * size)
    for k in range(last + 1):
        for j in range(size):
            start = _line_of(tube, k, j)
            for i in range(size):
                pairs.start[size * j + i] = start
                pairs.landing[size * j + i] = _line_of(tube, k + 1, i)
        _pair_up(k, tube, line, p, c, pairs)
        for j in range(size):
            _fill_from(k, j, pairs, tube, line, p, c, moves)


@kernel
def _pair_up(k, tube, line, p, c, pairs):
    """Fill in the costs of all pairs; pairs off the trajectory's own ends, or at a standstill, are barred."""
    size, last = 2 * tube.lines + 1, tube.knot.size - 2
    start, landing = pairs.start, pairs.landing
    for n in range(start.size):
        barred = (k == 0 and n // size != tube.lines) or (k == last and n % size != tube.lines)
        barred = barred or (start[n] <= 0.0 and k > 0) or start[n] + landing[n] <= 0.0
        pairs.barred[n] = 1.0 if barred else 0.0
        if barred:
            start[n], landing[n] = _ANY_SQUARED, _ANY_SQUARED
    _to_lines(k, tube, line, p, c, pairs)


@kernel
def _to_lines(k, tube, line, p, c, pairs):
    """Fill in the costs of all pairs from knot k to the next, at constant acceleration in each interval."""
    i0, i1 = tube.knot[k], tube.knot[k + 1]
    for n in range(pairs.start.size):
        away, beyond = pairs.start[n] - tube.squared[i0], pairs.landing[n] - tube.squared[i1]
        energy, time, least_n, largest_n = 0.0, 0.0, INFEASIBLE, -INFEASIBLE
        v0 = math.sqrt(pairs.start[n])
        for i in range(i0, i1):
            w1 = tube.squared[i + 1] + away + tube.share[i + 1] * (beyond - away)
            w1 = pairs.landing[n] if i + 1 == i1 else min(max(w1, tube.low[i + 1]), tube.high[i + 1])
            v1 = math.sqrt(w1)
            h, g, q = line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i]
            e, dt, force = _interval(v0, v1, h, g, q, on_supply(p, line.supply[i]), c)
            energy, time = min(energy + e, INFEASIBLE), time + dt
            least_n, largest_n = min(least_n, force), max(largest_n, force)
            v0 = v1
        pairs.energy_j[n], pairs.time_s[n] = energy, time
        pairs.least_n[n], pairs.largest_n[n] = least_n, largest_n


@kernel
def _fill_from(k, j, pairs, tube, line, p, c, moves):
    """All moves from line j of knot k; those to lines are in the pairs."""
    energy, time, below, share = moves
    size, last = 2 * tube.lines + 1, tube.knot.size - 2
    energy[k, j, :] = INFEASIBLE
    time[k, j, :] = 0.0
    below[k, j, :] = 0
    share[k, j, :] = 0.0
    least_n, largest_n = INFEASIBLE, -INFEASIBLE
    for i in range(size):
        n = size * j + i
        if pairs.barred[n] > 0.0:
            continue
        least_n, largest_n = min(least_n, pairs.least_n[n]), max(largest_n, pairs.largest_n[n])
        energy[k, j, i] = pairs.energy_j[n]
        time[k, j, i] = pairs.time_s[n]
        below[k, j, i] = min(i, size - 2)
        share[k, j, i] = 1.0 if i == size - 1 else 0.0
    if k == last or least_n > largest_n:
        return
    start = _line_of(tube, k, j)
    for kind in range(1, SPECIALS + 1):
        if not _is_beside(kind, k, start, least_n, largest_n, tube, line, p, c):
            continue
        e, t, w = _special(kind, k, start, tube, line, p, c)
        lower, above = _between_lines(tube, k + 1, w) if e < INFEASIBLE else (-1, 0.0)
        if lower >= 0:
            i = size + kind - 1
            energy[k, j, i] = e
            time[k, j, i] = t
            below[k, j, i] = lower
            share[k, j, i] = above


@kernel
def tube_sweep(price, moves, value):
    """Least energy + price·time (J) to the end from every line of every knot; the last row holds the end values."""
    energy, time, below, share = moves
    count, size, landings = energy.shape
    for k in range(count - 1, -1, -1):
        ahead = value[k + 1]
        for j in range(size):
            best = INFEASIBLE
            for i in range(landings):
                e = energy[k, j, i]
                if e < INFEASIBLE:
                    best = min(best, e + price * time[k, j, i] + _between(ahead, below[k, j, i], share[k, j, i]))
            value[k, j] = best if best < UNREACHABLE else INFEASIBLE


@kernel
def tube_roll_out(price, tube, line, p, c, value, v):
    """The trajectory of a price of time through the tube: at every knot the best move from the train's own speed.

    Fills `v` with the speeds at the integration nodes; returns energy (J) and time (s), or (0, −1) if no move is
    possible from a knot.
    """
    size = 2 * tube.lines + 1
    last = tube.knot.size - 2
    pairs = _room_for(size)
    w = tube.squared[0]
    v[0] = math.sqrt(w)
    energy, time = 0.0, 0.0
    for k in range(last + 1):
        best, kind_best, e_best, t_best, w_best = INFEASIBLE, LINE, 0.0, 0.0, 0.0
        least_n, largest_n = INFEASIBLE, -INFEASIBLE
        for i in range(size):
            pairs.start[i], pairs.landing[i] = w, _line_of(tube, k + 1, i)
            barred = (k == last and i != tube.lines) or w + pairs.landing[i] <= 0.0
            pairs.barred[i] = 1.0 if barred else 0.0
            if barred:
                pairs.start[i], pairs.landing[i] = _ANY_SQUARED, _ANY_SQUARED
        _to_lines(k, tube, line, p, c, pairs)
        for i in range(size):
            if pairs.barred[i] > 0.0:
                continue
            least_n, largest_n = min(least_n, pairs.least_n[i]), max(largest_n, pairs.largest_n[i])
            cost = pairs.energy_j[i] + price * pairs.time_s[i] + value[k + 1, i]
            if cost < best:
                best, kind_best, w_best = cost, LINE, pairs.landing[i]
                e_best, t_best = pairs.energy_j[i], pairs.time_s[i]
        for kind in range(1, SPECIALS + 1):
            if k == last or not _is_beside(kind, k, w, least_n, largest_n, tube, line, p, c):
                continue
            e, t, w1 = _special(kind, k, w, tube, line, p, c)
            lower, above = _between_lines(tube, k + 1, w1) if e < INFEASIBLE else (-1, 0.0)
            if lower < 0:
                continue
            cost = e + price * t + _between(value[k + 1], lower, above)
            if cost < best:
                best, kind_best, e_best, t_best, w_best = cost, kind, e, t, w1
        if best > UNREACHABLE:
            return 0.0, -1.0
        _record(kind_best, k, w, w_best, tube, line, p, c, v)
        energy += e_best
        time += t_best
        w = w_best
    return energy, time


@kernel
def _record(kind, k, start, landing, tube, line, p, c, v):
    i0, i1 = tube.knot[k], tube.knot[k + 1]
    here, there = start - tube.squared[i0], landing - tube.squared[i1]
    v0 = math.sqrt(start)
    for i in range(i0, i1 - 1):
        if kind == LINE:
            w1 = tube.squared[i + 1] + here + tube.share[i + 1] * (there - here)
        else:
            g, q = line.constant_n[i], line.tunnel_n_per_mps2[i]
            v1 = _special_speed(kind, v0, line.step_m[i], g, q, on_supply(p, line.supply[i]), c)
            w1 = v1 * v1
        v0 = math.sqrt(min(max(w1, tube.low[i + 1]), tube.high[i + 1]))
        v[i + 1] = v0
    v[i1] = math.sqrt(landing)
