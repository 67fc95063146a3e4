"""All moves between the speeds of neighbouring decision nodes."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.abreast import costs, full_brake_forces, full_effort_landings, landings_under, locations
from das.solver.kernels.forces import on_supply
from das.solver.kernels.landings import LANDINGS
from das.solver.kernels.policy_values import grid_speed
from das.solver.tolerances import INFEASIBLE, LANDINGS_BRAKE, LANDINGS_EFFORT

_COAST = LANDINGS_BRAKE + LANDINGS_EFFORT
_HOLD = _COAST + 1
_STANDING_MPS = 1e-3
"""A train that stands is calculated as if it moved this slowly (m/s); its moves are left out afterwards."""


@kernel
def transitions(first, last, line, bounds, steps, p, c, moves):
    """All transitions of the decision nodes first … last − 1.

    `line` and `bounds` hold all decision nodes, `steps` is the number of steps of the speed grid. Row k of `moves` is
    filled for node first + k. Of each state `filled` landings are filled.
    """
    floor, envelope = bounds
    n = line.step_m.size
    speeds = np.empty(steps + 1)
    landing = np.empty((LANDINGS, steps + 1))
    found = np.empty((4, LANDINGS, steps + 1))
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        here = on_supply(p, line.supply[k])
        top = envelope[k + 1]
        for j in range(steps + 1):
            speeds[j] = max(grid_speed(floor[k], envelope[k], j, steps), _STANDING_MPS)
        if k == n - 1 and floor[k + 1] >= top:
            full_effort_landings(1, speeds, h, g, q, here, found[0, 0])
            landing[0, :] = top
            costs(speeds, landing[:1], h, g, q, here, c, found[0, 1:2], found[1, :1])
            _pack_last(
                k - first,
                grid_speed(floor[k], envelope[k], 0, steps),
                found[0, 0],
                top,
                found[0, 1],
                found[1, 0],
                moves,
            )
            continue
        _fill_landings(speeds, h, g, q, top, here, landing, found[0])
        costs(speeds, landing, h, g, q, here, c, found[0], found[1])
        if floor[k + 1] < top:
            locations(landing, floor[k + 1], top, float(steps), found[2], found[3], found[1])
        else:
            found[2:] = 0.0
        _pack(k - first, grid_speed(floor[k], envelope[k], 0, steps), speeds, landing, found, moves)


@kernel
def _fill_landings(speeds, h, g, q, top, p, landing, space):
    """The landings worth trying from each speed (see `das.solver.kernels.landings.landings`): rows of `landing`.

    First `LANDINGS_BRAKE` from the hardest brake on, then `LANDINGS_EFFORT` from full electric brake to full traction,
    then coasting and holding the speed.
    """
    high, coast, electric, low, force = space[0], space[1], space[2], space[3], space[4]
    full_effort_landings(1, speeds, h, g, q, p, high)
    force[:] = 0.0
    landings_under(force, speeds, h, g, q, p, coast)
    electric[:] = coast
    if not p.brakes_dissipate and p.electric_force_n > 0.0:
        full_effort_landings(-1, speeds, h, g, q, p, electric)
    low[:] = electric
    if p.friction_force_n > 0.0 or p.brakes_dissipate:
        full_brake_forces(speeds, p, force)
        landings_under(force, speeds, h, g, q, p, low)
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
    """The landings that a train can make, one after the other for each speed; none from a standstill."""
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
    """The one landing at the end of a section, from each speed from which full traction gets there."""
    dt, energy, target, weight, filled = moves
    for j in range(high.size):
        reached = high[j] >= top and (j > 0 or slowest > 0.0)
        dt[row, j, 0] = time_s[j]
        energy[row, j, 0] = energy_j[j]
        target[row, j, 0] = 0
        weight[row, j, 0] = 0.0
        filled[row, j] = 1 if reached else 0
