"""Few-switch trajectories rolled out over the integration nodes, and their energy."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.kernels.driving import drive, full_traction_speed, hurry, trip_time
from das.solver.kernels.few_switch_moves import BRAKE, COAST, CURVE, HOLD, TRACTION
from das.solver.kernels.few_switch_sweep import NO_NOTCH
from das.solver.kernels.forces import (
    electric_limit,
    electric_share,
    loss_power,
    mean_resistance,
    on_supply,
    traction_limit,
)
from das.solver.kernels.landings import speed_under_force

_STEPS = 6


@kernel
def speed_under(kind, share, v0, h, g, q, p):
    """Speed after a step of integration with a share of the largest traction or electric brake, or coasting."""
    if kind == TRACTION and share >= 1.0:
        return full_traction_speed(v0, h, g, q, p)
    v1 = v0
    for _ in range(_STEPS):
        faster = max(v0, v1)
        force = 0.0
        if kind == TRACTION:
            force = share * traction_limit(faster, p)
        elif kind == BRAKE:
            force = -share * electric_limit(faster, p)
        before, v1 = v1, speed_under_force(force, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
        if v1 == before:
            break  # Further steps find the same.
    return v1


@kernel
def in_notch(i, kind, share, held, goal, line, envelope, p, v):
    """Drive one step of integration in a notch, from v[i] to v[i + 1]; False after a stall.

    `held` is the speed that a train in the notch HOLD keeps, `goal` the lower speed at which the brakes are released.
    """
    step, g, q, u = line
    here = on_supply(p, u[i])
    friction_n = 0.0
    if kind == HOLD:
        landing, friction_n = held, p.friction_force_n
    elif kind == CURVE:
        landing, friction_n = envelope[i + 1], p.friction_force_n
        coasting = speed_under(COAST, 0.0, v[i], step[i], g[i], q[i], here)
        landing = min(landing, coasting)
    else:
        landing = speed_under(kind, share, v[i], step[i], g[i], q[i], here)
        if kind == BRAKE and landing < goal:
            landing = min(goal, speed_under(COAST, 0.0, v[i], step[i], g[i], q[i], here))
    if landing > envelope[i + 1]:
        friction_n = p.friction_force_n
    return drive(i, i + 1, landing, friction_n, line, envelope, p, v)


@kernel
def nearest_line(v, floor, top, steps):
    """The grid line nearest to a speed; a train that moves is never on the line of standstill."""
    if top <= floor:
        return 0
    j = int((v - floor) * (steps / (top - floor)) + 0.5)
    least = 1 if floor <= 0.0 and v > 0.0 else 0
    return min(max(j, least), steps)


@kernel
def few_switch_roll_out(k0, switch, quick, slow, decision, line, bounds, goal, notches, policy, p, v, notch):
    """Follow a few-switch policy from v[0] to the end: multiplier `quick` up to decision node `switch`, then `slow`.

    `decision[m]` are the integration nodes of decision nodes k0 + m; decision[0] = 0. `notch[0]` is the notch that the
    train is in (255: none). Fills v and the notch of every interval; returns the trip time (s), or -1 after a stall.
    """
    choice, stay = policy
    kinds, shares = notches
    floor, envelope = bounds
    now = np.int64(notch[0])
    held = v[0]
    steps = choice.shape[1] - 1
    for m in range(decision.size - 1):
        i0, i1 = decision[m], decision[m + 1]
        k = k0 + m
        l = quick if k < switch else slow
        j = nearest_line(v[i0], floor[i0], envelope[i0], steps)
        before = now
        if now == NO_NOTCH or not (stay[k, j, l] >> now) & 1:
            now = np.int64(choice[k, j, l])
        if now != before:
            held = v[i0]
        moving = now != NO_NOTCH
        if moving:
            for i in range(i0, i1):
                notch[i] = now
                moving = in_notch(i, kinds[now], shares[now], held, goal[i], line, envelope, p, v)
                if not moving:
                    break
        if not moving or v[i1] < floor[i1]:
            for i in range(i0, i1):
                notch[i] = 0
            now = 0
            if not hurry(i0, i1, line, envelope, p, v):
                return -1.0
    return trip_time(line.step_m, v)


@kernel
def step_energy(i, v0, v1, line, p, c):
    """Energy at the current collector (J) of interval i, at constant acceleration."""
    step, g, q, u = line
    here = on_supply(p, u[i])
    mid = 0.5 * (v0 + v1)
    force = p.inertial_mass_kg * (v1 * v1 - v0 * v0) / (2.0 * step[i]) + mean_resistance(v0, v1, q[i], p) + g[i]
    el = electric_share(force, max(v0, v1), here)
    energy = el * step[i] + loss_power(el, mid, c) * step[i] / mid
    return energy if energy > 0.0 else here.receptivity_ratio * energy


@kernel
def run_energy(line, p, c, v):
    """Energy at the current collector (J) of a run, at constant acceleration between its nodes."""
    total = 0.0
    for i in range(line.step_m.size):
        total += step_energy(i, v[i], v[i + 1], line, p, c)
    return total
