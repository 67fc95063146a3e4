"""Landings of all speeds of a decision node and their costs, in loops over the speeds that the compiler vectorises.

The formulas are those of `das.solver.kernels.landings` and `das.solver.kernels.policy_values`, without branches: every
speed is calculated, and what is out of reach is marked afterwards. Each function fills the arrays that it is given.
With `fastmath` divisions may become products and sums may be taken in another order, as vectors need it.
"""

from __future__ import annotations

import math

import numpy as np

from das.compiling import compiled
from das.solver.kernels.forces import ADHESION_EXTRA, ADHESION_LEAST, ADHESION_OFFSET, ADHESION_SPEED
from das.solver.kernels.landings import LANDING_STEPS
from das.solver.kernels.tuples import NO_LIMIT_N
from das.solver.tolerances import INFEASIBLE, SMALLEST_SHARE

_ELECTRIC_BRAKE = -1
_ROUNDING = 1e-9
"""A place on the grid that is below a line by no more than this counts as on the line."""


@compiled(fastmath=True)
def _speed_after(f, v0, v1, total, step, g, q, p):
    """Speed after a step under wheel force f; the resistance is that of a landing at v1. 0 if it stops."""
    squares = v0 * v0 + v1 * v1
    mean_v = (2.0 / 3.0) * (squares + v0 * v1) / total
    resistance = p.c0_n + p.c1_n_per_mps * mean_v + (p.c2_n_per_mps2 + q) * 0.5 * squares
    rate = (f - resistance - g) / p.inertial_mass_kg
    rate = max(min(rate, p.max_acceleration_mps2), -p.max_deceleration_mps2)
    return math.sqrt(max(v0 * v0 + 2.0 * step * rate, 0.0))


@compiled(fastmath=True)
def adhesion(v):
    return ADHESION_LEAST + ADHESION_EXTRA / (ADHESION_SPEED * v + ADHESION_OFFSET)


@compiled(fastmath=True)
def full_effort_landings(direction, speeds, step, g, q, p, out):
    """Speeds after a step at full traction (direction 1) or electric brake (−1) of the mean speed; 0 if it stops."""
    force, power = p.traction_force_n, p.traction_power_w
    if direction == _ELECTRIC_BRAKE:
        force, power = p.electric_force_n, p.electric_power_w
    slips = p.adhesive_force_n < NO_LIMIT_N
    n = speeds.size
    for j in range(n):
        out[j] = speeds[j]
    for _ in range(LANDING_STEPS):
        for j in range(n):
            v0, v1 = speeds[j], out[j]
            total = v0 + v1
            limit = min(force, 2.0 * power / total)
            if slips:
                limit = min(limit, p.adhesive_force_n * adhesion(0.5 * total))
            new = _speed_after(direction * limit, v0, v1, total, step, g, q, p)
            out[j] = new if v1 > 0.0 else 0.0


@compiled(fastmath=True)
def landings_under(forces, speeds, step, g, q, p, out):
    """Speeds after a step under a constant wheel force for each speed; 0 if it stops."""
    n = speeds.size
    for j in range(n):
        out[j] = speeds[j]
    for _ in range(LANDING_STEPS):
        for j in range(n):
            v0, v1 = speeds[j], out[j]
            new = _speed_after(forces[j], v0, v1, v0 + v1, step, g, q, p)
            out[j] = new if v1 > 0.0 else 0.0


@compiled(fastmath=True)
def full_brake_forces(speeds, p, out):
    """The force (N, < 0) of all brakes at each speed, within adhesion."""
    slips, all_slip = p.adhesive_force_n < NO_LIMIT_N, p.braked_adhesive_force_n < NO_LIMIT_N
    for j in range(speeds.size):
        v = speeds[j]
        electric = min(p.electric_force_n, p.electric_power_w / v)
        if slips:
            electric = min(electric, p.adhesive_force_n * adhesion(v))
        both = electric + p.friction_force_n
        if all_slip:
            both = min(both, p.braked_adhesive_force_n * adhesion(v))
        out[j] = -both


@compiled(fastmath=True)
def places_on_map(speeds, landings, forces, c, place, across, along):
    """Where on a loss map the mean speeds and forces lie: the first point of their cell, and the shares within it."""
    rows, columns = float(c.table_w.shape[0]), float(c.table_w.shape[1])
    for j in range(speeds.size):
        x = 0.5 * (speeds[j] + landings[j]) * c.steps_per_mps
        y = (forces[j] - c.force0_n) * c.steps_per_n
        i = min(max(math.floor(x), 0.0), rows - 2.0)
        k = min(max(math.floor(y), 0.0), columns - 2.0)
        place[j] = np.int32(i * columns + k)
        across[j] = x - i
        along[j] = y - k


@compiled(fastmath=True)
def losses_of_map(table, place, across, along, loss_w):
    """Losses (W) at places on a loss map, bilinear within a cell."""
    points, columns = table.reshape(-1), table.shape[1]
    for j in range(place.size):
        i = place[j]
        b = along[j]
        low = points[i] + b * (points[i + 1] - points[i])
        i += columns
        high = points[i] + b * (points[i + 1] - points[i])
        loss_w[j] = low + across[j] * (high - low)


@compiled(fastmath=True)
def _electric_force(v0, v1, inverse, step, g, q, p):
    """The force (N) that motors give or take between two speeds; `inverse` is 1/(v0 + v1)."""
    squares = v0 * v0 + v1 * v1
    mean_v = (2.0 / 3.0) * (squares + v0 * v1) * inverse
    resistance = p.c0_n + p.c1_n_per_mps * mean_v + (p.c2_n_per_mps2 + q) * 0.5 * squares
    force = p.inertial_mass_kg * (v1 * v1 - v0 * v0) / (2.0 * step) + resistance + g
    limit = min(p.electric_force_n, 2.0 * p.electric_power_w * inverse)
    if p.adhesive_force_n < NO_LIMIT_N:
        limit = min(limit, p.adhesive_force_n * adhesion(0.5 / inverse))
    if p.brakes_dissipate:
        limit = 0.0
    return max(force, -limit)


@compiled(fastmath=True)
def costs(speeds, landings, step, g, q, p, c, time_s, energy_j):
    """Time (s) and energy (J) from each speed to each landing (landings, speeds) at constant acceleration."""
    n = speeds.size
    loss_w, across, along, place = np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.int32)
    for i in range(landings.shape[0]):
        dt, energy = time_s[i], energy_j[i]
        for j in range(n):
            v0, v1 = speeds[j], landings[i, j]
            inverse = 1.0 / (v0 + v1)
            dt[j] = 2.0 * step * inverse
            energy[j] = _electric_force(v0, v1, inverse, step, g, q, p)
        if c.is_map:
            places_on_map(speeds, landings[i], energy, c, place, across, along)
            losses_of_map(c.table_w, place, across, along, loss_w)
            for j in range(n):
                gross = energy[j] * step + loss_w[j] * dt[j]
                energy[j] = gross if gross > 0.0 else p.receptivity_ratio * gross
        else:
            for j in range(n):
                work = energy[j] * step
                gross = work + max(c.traction_ratio * work, -c.brake_ratio * work) + c.idle_w * dt[j]
                energy[j] = gross if gross > 0.0 else p.receptivity_ratio * gross


@compiled(fastmath=True)
def locations(landings, floor, top, steps, line, share, energy_j):
    """Grid line below each landing and the share of the line above it, as `locate`; outside, the energy is INFEASIBLE.

    `line` holds whole numbers as floats.
    """
    span = top - floor
    scale, spacing = steps / span, span / steps
    least = 1.0 - _ROUNDING if floor <= 0.0 else -0.5
    for i in range(landings.shape[0]):
        for j in range(landings.shape[1]):
            v = landings[i, j]
            x = (v - floor) * scale
            lower = min(max(math.floor(x), 0.0), steps - 1.0)
            u = max(x - lower, 0.0)
            beyond = u * spacing
            s = u * (2.0 * v - beyond) / (2.0 * (v - beyond) + spacing)
            s = 0.0 if s < SMALLEST_SHARE else s
            s = 1.0 if s > 1.0 - SMALLEST_SHARE else s
            line[i, j] = lower
            share[i, j] = s
            energy_j[i, j] = INFEASIBLE if x < least else energy_j[i, j]
