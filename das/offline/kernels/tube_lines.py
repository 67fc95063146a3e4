"""Moves between the lines of a tube, many pairs of lines at once in loops that the compiler vectorises.

The formulas are those of `das.offline.kernels.tube`, without branches: every pair is calculated, and what the train
cannot do is marked afterwards. With `fastmath`, divisions may become products and sums may be taken in another order,
as vector instructions require. So these costs only choose among moves; the resulting trajectory is integrated without
`fastmath`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import compiled, kernel
from das.solver.kernels.arrays import put
from das.solver.kernels.forces import on_supply
from das.solver.kernels.transitions import adhesion, losses_of_map, places_on_map
from das.solver.kernels.tuples import NO_LIMIT_N
from das.solver.tolerances import INFEASIBLE

Floats = NDArray[np.float64]

ROUNDING_RATIO, ROUNDING_N, ROUNDING_MPS2 = 1e-9, 1e-3, 1e-9
"""Forces and accelerations that exceed their bounds by no more than this are taken for rounding errors."""
_ROWS = 8
ANY_SQUARED = 1.0
"""v² (m²/s²) that stands in for a barred pair, so that nothing is divided by 0."""


class Pairs(NamedTuple):
    """Pairs of a line at a knot and one at the next knot, by their v², and the cost of a move between them.

    `energy_j` is INFEASIBLE if the train cannot make the move. `least_n` and `largest_n` are the least and the largest
    wheel force of a move. `barred` is 1 for a pair that is no move. `work` and `place` are working space.
    """

    start: Floats
    landing: Floats
    energy_j: Floats
    time_s: Floats
    least_n: Floats
    largest_n: Floats
    barred: Floats
    work: Floats
    place: NDArray[np.int32]


@kernel
def room_for(count):
    """Arrays for this number of pairs."""
    numbers = np.empty((7, count))
    return Pairs(
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6],
        np.empty((_ROWS, count)), np.empty(count, np.int32),
    )  # fmt: skip


@compiled(fastmath=True)
def to_lines(k, tube, line, p, c, pairs):
    """Fill in the costs of all pairs from knot k to the next, at constant acceleration in each interval."""
    start, landing, energy, time, least, largest, _, work, _ = pairs
    v0, v1, w0, w1, worst = work[0], work[1], work[2], work[3], work[4]
    i0, i1 = tube.knot[k], tube.knot[k + 1]
    for j in range(start.size):
        energy[j] = 0.0
        time[j] = 0.0
        worst[j] = 0.0
    for j in range(start.size):
        least[j] = INFEASIBLE
        largest[j] = -INFEASIBLE
        w0[j] = start[j]
        v0[j] = math.sqrt(start[j])
    for i in range(i0, i1):
        if i + 1 < i1:
            _after(start, landing, i, k, tube, w1)
        else:
            put(landing, w1)
        for j in range(w1.size):
            v1[j] = math.sqrt(w1[j])
        here = on_supply(p, line.supply[i])
        _one_interval(work, pairs, line.step_m[i], line.constant_n[i], line.tunnel_n_per_mps2[i], here, c)
        for j in range(w1.size):
            w0[j] = w1[j]
            v0[j] = v1[j]
    for j in range(start.size):
        energy[j] = energy[j] if worst[j] <= 0.0 else INFEASIBLE


@compiled(fastmath=True)
def _after(start, landing, i, k, tube, out):
    """The v² of all pairs after interval i between two knots: its shift from the tube's trajectory changes linearly."""
    i0, i1 = tube.knot[k], tube.knot[k + 1]
    run, first, last = tube.squared[i + 1], tube.squared[i0], tube.squared[i1]
    share, low, high = tube.share[i + 1], tube.low[i + 1], tube.high[i + 1]
    for j in range(start.size):
        here, there = start[j] - first, landing[j] - last
        out[j] = min(max(run + here + share * (there - here), low), high)


@compiled(fastmath=True)
def _one_interval(work, pairs, h, g, q, p, c):
    """Add the costs of an interval to those of all pairs."""
    v0, v1, w0, w1, worst, force, electric, dt = work
    n = v0.size
    for j in range(n):
        inverse = 1.0 / (v0[j] + v1[j])
        squares = w0[j] + w1[j]
        mean_v = (2.0 / 3.0) * (squares + v0[j] * v1[j]) * inverse
        resistance = p.c0_n + p.c1_n_per_mps * mean_v + (p.c2_n_per_mps2 + q) * 0.5 * squares
        force[j] = p.inertial_mass_kg * (w1[j] - w0[j]) / (2.0 * h) + resistance + g
        dt[j] = 2.0 * h * inverse
    _within_limits(v0, v1, w0, w1, h, p, force, electric, worst)
    energy, time, least, largest = pairs.energy_j, pairs.time_s, pairs.least_n, pairs.largest_n
    for j in range(n):
        least[j] = min(least[j], force[j])
        largest[j] = max(largest[j], force[j])
    for j in range(n):
        time[j] += dt[j]
    if c.is_map:
        # From here on the row of the force, and those of the squared speeds, hold other values.
        across, along, loss_w = w0, force, w0
        places_on_map(v0, v1, electric, c, pairs.place, across, along)
        losses_of_map(c.table_w, pairs.place, across, along, loss_w)
        for j in range(n):
            gross = electric[j] * h + loss_w[j] * dt[j]
            energy[j] += gross if gross > 0.0 else p.receptivity_ratio * gross
    else:
        for j in range(n):
            work_j = electric[j] * h
            gross = work_j + max(c.traction_ratio * work_j, -c.brake_ratio * work_j) + c.idle_w * dt[j]
            energy[j] += gross if gross > 0.0 else p.receptivity_ratio * gross


@compiled(fastmath=True)
def _within_limits(v0, v1, w0, w1, h, p, force, electric, worst):
    """The force of the motors for the wheel forces of an interval; `worst` becomes 1 if the train cannot do it."""
    slips, all_slip = p.adhesive_force_n < NO_LIMIT_N, p.braked_adhesive_force_n < NO_LIMIT_N
    slack = 1.0 + ROUNDING_RATIO
    for j in range(v0.size):
        faster = max(v0[j], v1[j])
        inverse = 1.0 / faster
        traction = min(p.traction_force_n, p.traction_power_w * inverse)
        brake = min(p.electric_force_n, p.electric_power_w * inverse)
        if slips:
            sticks = p.adhesive_force_n * adhesion(faster)
            traction, brake = min(traction, sticks), min(brake, sticks)
        both = brake + p.friction_force_n
        if all_slip:
            both = min(both, p.braked_adhesive_force_n * adhesion(faster))
        too_much = max(force[j] - traction * slack, -force[j] - both * slack) - ROUNDING_N
        worst[j] = 1.0 if too_much > 0.0 else worst[j]
        electric[j] = max(force[j], 0.0 if p.brakes_dissipate else -brake)
    for j in range(v0.size):
        rate = (w1[j] - w0[j]) / (2.0 * h)
        too_much = max(rate - p.max_acceleration_mps2, -rate - p.max_deceleration_mps2) - ROUNDING_MPS2
        worst[j] = 1.0 if too_much > 0.0 else worst[j]
