"""All moves between the speeds of neighbouring decision nodes."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import compiled, kernel
from das.solver.kernels.arrays import put
from das.solver.kernels.forces import (
    ADHESION_EXTRA,
    ADHESION_LEAST,
    ADHESION_OFFSET,
    ADHESION_SPEED,
    on_supply,
    without_curves,
)
from das.solver.kernels.landings import LANDING_STEPS, LANDINGS, landing_speed, slower_landings, step_cost
from das.solver.kernels.policy_values import grid_speed
from das.solver.kernels.tuples import NO_LIMIT_N
from das.solver.tolerances import INFEASIBLE, LANDINGS_BRAKE, LANDINGS_EFFORT, SMALLEST_SHARE

_ROUNDING = 1e-9
"""Distance by which a point that counts as on a line may lie below it."""


@compiled(fastmath=True)
def _speed_after(f, v0, v1, total, step, g, q, p):
    """Speed after a step under wheel force f, with the resistance between v0 and v1; 0 if the train stops."""
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
    """Speeds after a step under full traction (direction 1) or electric brake (−1) at the mean speed; 0: a stop."""
    force, power = p.traction_force_n, p.traction_power_w
    if direction == -1:
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
    """Speeds after a step under a constant wheel force for each speed; 0 if the train stops."""
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
    """Places of the mean speeds and forces on a loss map: the first point of their cell, and the shares within it."""
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
    """The force (N) of the motors between two speeds; `inverse` is 1/(v0 + v1)."""
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
    """Grid line below each landing and the share of the line above, as in `locate`; energy INFEASIBLE off the grid.

    `line` contains whole numbers as floats.
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


_COAST = LANDINGS_BRAKE + LANDINGS_EFFORT
_HOLD = _COAST + 1
_STANDING_MPS = 1e-3
"""Speed (m/s) used in the computation for a standing train; its moves are removed afterwards."""


@kernel
def transitions(first, last, line, bounds, steps, p, c, moves):
    """Compute all transitions of the decision nodes first … last − 1.

    `line` and `bounds` contain all decision nodes; `steps` is the number of steps of the speed grid. Row k of `moves`
    is filled for node first + k. `filled` receives the number of landings of each state.
    """
    floor, envelope = bounds
    n = line.step_m.size
    speeds = np.empty(steps + 1)
    landing = np.empty((LANDINGS, steps + 1))
    found = np.empty((4, LANDINGS, steps + 1))
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        curved = on_supply(p, line.supply[k])
        here = without_curves(curved)
        top = envelope[k + 1]
        for j in range(steps + 1):
            speeds[j] = max(grid_speed(floor[k], envelope[k], j, steps), _STANDING_MPS)
        ends = k == n - 1 and floor[k + 1] >= top  # There is one landing; found[0, 0] keeps that of full traction.
        rows, took, spent = 1 if ends else LANDINGS, found[2 if ends else 0], found[1]
        if p.has_curves:
            _extremes_on_curves(speeds, h, g, q, curved, found[0])
        else:
            _extremes(speeds, h, g, q, here, found[0])
        if ends:
            landing[0, :] = top
        else:
            _spread(speeds, top, landing, found[0])
        if p.has_curves:
            _costs_on_curves(speeds, landing[:rows], h, g, q, curved, c, took, spent)
        else:
            costs(speeds, landing[:rows], h, g, q, here, c, took, spent)
        slowest = grid_speed(floor[k], envelope[k], 0, steps)
        if ends:
            _pack_last(k - first, slowest, found[0, 0], top, took[0], spent[0], moves)
            continue
        if floor[k + 1] < top:
            locations(landing, floor[k + 1], top, float(steps), found[2], found[3], spent)
        else:
            found[2:] = 0.0
        _pack(k - first, slowest, speeds, landing, found, moves)


@kernel
def _extremes(speeds, h, g, q, p, space):
    """Speeds after a step from each speed, as rows: full traction, coasting, full electric brake, all brakes."""
    high, coast, electric, low, force = space[0], space[1], space[2], space[3], space[4]
    full_effort_landings(1, speeds, h, g, q, p, high)
    force[:] = 0.0
    landings_under(force, speeds, h, g, q, p, coast)
    put(coast, electric)
    if not p.brakes_dissipate and p.electric_force_n > 0.0:
        full_effort_landings(-1, speeds, h, g, q, p, electric)
    put(electric, low)
    if p.friction_force_n > 0.0 or p.brakes_dissipate:
        full_brake_forces(speeds, p, force)
        landings_under(force, speeds, h, g, q, p, low)


@kernel
def _extremes_on_curves(speeds, h, g, q, p, space):
    """The results of `_extremes`, computed one speed at a time, with forces from the effort curves."""
    for j in range(speeds.size):
        space[0, j] = landing_speed(speeds[j], h, 1.0, g, q, p)
        space[1, j], space[2, j], space[3, j] = slower_landings(speeds[j], h, g, q, p)


@kernel
def _costs_on_curves(speeds, landings, h, g, q, p, c, time_s, energy_j):
    """The results of `costs`, one landing at a time."""
    for i in range(landings.shape[0]):
        for j in range(speeds.size):
            time_s[i, j], energy_j[i, j] = step_cost(speeds[j], landings[i, j], h, g, q, p, c)


@kernel
def _spread(speeds, top, landing, space):
    """Write the candidate landings from each speed (see `das.solver.kernels.landings`) to the rows of `landing`:
    `LANDINGS_BRAKE` from the hardest brake on, `LANDINGS_EFFORT` from full electric brake to full traction, coasting,
    holding.

    `space` contains the result of `_extremes`.
    """
    high, coast, electric, low = space[0], space[1], space[2], space[3]
    for j in range(speeds.size):
        most = min(high[j], top)
        low[j] = min(min(low[j], electric[j]), most)
        electric[j] = min(electric[j], most)
        landing[_COAST, j] = min(coast[j], most)
        landing[_HOLD, j] = speeds[j]
        high[j] = most
    for i in range(LANDINGS_BRAKE):
        for j in range(speeds.size):
            landing[i, j] = low[j] + (electric[j] - low[j]) * i / LANDINGS_BRAKE
    for i in range(LANDINGS_EFFORT):
        for j in range(speeds.size):
            landing[LANDINGS_BRAKE + i, j] = electric[j] + (high[j] - electric[j]) * i / (LANDINGS_EFFORT - 1)


@kernel
def _pack(row, slowest, speeds, landing, found, moves):
    """Keep only the feasible landings, packed without gaps for each speed; none from standstill."""
    dt, energy, target, weight, filled = moves
    for j in range(speeds.size):
        used = 0
        low, high = landing[0, j], landing[_COAST - 1, j]
        if high > 0.0 and (j > 0 or slowest > 0.0):
            brakes = low < landing[LANDINGS_BRAKE, j]
            holds = low < speeds[j] < high
            for i in range(0 if brakes else LANDINGS_BRAKE, LANDINGS if holds else _HOLD):
                if found[1, i, j] < INFEASIBLE:
                    dt[row, j, used] = found[0, i, j]
                    energy[row, j, used] = found[1, i, j]
                    target[row, j, used] = np.int32(found[2, i, j])
                    weight[row, j, used] = found[3, i, j]
                    used += 1
        filled[row, j] = used


@kernel
def _pack_last(row, slowest, high, top, time_s, energy_j, moves):
    """Keep the single landing at the end of a section, for each speed from which full traction reaches it."""
    dt, energy, target, weight, filled = moves
    for j in range(high.size):
        reached = high[j] >= top and (j > 0 or slowest > 0.0)
        dt[row, j, 0] = time_s[j]
        energy[row, j, 0] = energy_j[j]
        target[row, j, 0] = 0
        weight[row, j, 0] = 0.0
        filled[row, j] = 1 if reached else 0
