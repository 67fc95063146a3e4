"""Few-switch policies: where each notch leads, the best notch of every state, and the trajectory that follows it."""

from __future__ import annotations

import numpy as np

from das.compiling import compiled, kernel
from das.solver.kernels.arrays import put
from das.solver.kernels.driving import drive, full_traction_speed, hurry, trip_time
from das.solver.kernels.forces import (
    electric_limit,
    on_supply,
    traction_limit,
)
from das.solver.kernels.landings import landing_speed, landing_under, speed_under_force, step_cost
from das.solver.kernels.policy_values import grid_speed, locate
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

TRACTION, HOLD, COAST, BRAKE, CURVE = 0, 1, 2, 3, 4
"""The numbers of `das.solver.few_switch.few_switch.NotchRegime`."""
NO_MOVE = -1
"""The target of a notch that cannot be used from a speed."""
CONTACT_MPS = 0.2
"""A notch may lead up to the highest allowed speed only from a speed that is lower by more than this (m/s)."""


@kernel
def notch_landing(kind, share, v0, h, g, q, highest, top, goal, p):
    """Speed after a decision step in a notch, or -1 if the notch cannot be used.

    `highest` and `top` are the highest speeds at the two ends of the step, `goal` the lower speed that brakes lead to.
    """
    below = v0 < min(highest, top) - CONTACT_MPS
    if kind == TRACTION:
        if traction_limit(v0, p) <= 0.0:
            return -1.0
        v1 = landing_speed(v0, h, share, g, q, p)
    elif kind == HOLD:
        if v0 > top or v0 <= 0.0:
            return -1.0
        v1 = min(v0, landing_speed(v0, h, 1.0, g, q, p))
    elif kind == COAST:
        v1 = landing_under(0.0, v0, h, g, q, p)
    else:
        coasting = landing_under(0.0, v0, h, g, q, p)
        if kind == CURVE:
            v1 = top if top < v0 else -1.0
        else:
            v1 = landing_speed(v0, h, -share, g, q, p)
            if v1 < goal < v0:
                v1 = goal
            if v1 > top:
                return -1.0
        if v1 >= coasting:
            return -1.0
    if v1 <= 0.0:
        return -1.0
    if v1 > top:
        return top if below else -1.0
    return v1


@kernel
def final_landing(kind, share, v0, h, g, q, top, p):
    """Whether a notch may end a section whose end speed is `top`: the notch must lead to it by itself."""
    if top < v0:
        return kind == CURVE
    if kind == TRACTION:
        return landing_speed(v0, h, share, g, q, p) >= top
    return kind == HOLD and v0 >= top


@kernel
def few_switch_moves(first, last, line, bounds, goal, steps, notches, p, c, moves):
    """Fill the moves of decision nodes first … last − 1: where each notch leads and what the step costs.

    `line`, `bounds` and `goal` hold all decision nodes; row k of `moves` belongs to node k. A standing train has only
    the notches of traction.
    """
    floor, envelope = bounds
    kinds, shares = notches
    dt, energy, target, weight = moves
    n = line.step_m.size
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        here = on_supply(p, line.supply[k])
        top = envelope[k + 1]
        final = k == n - 1 and floor[k + 1] >= top
        for j in range(steps + 1):
            v0 = grid_speed(floor[k], envelope[k], j, steps)
            for m in range(kinds.size):
                target[k, j, m] = NO_MOVE
                if v0 <= 0.0 and kinds[m] != TRACTION:
                    continue
                if final:
                    if v0 <= 0.0 or not final_landing(kinds[m], shares[m], v0, h, g, q, top, here):
                        continue
                    v1, lower, share = top, 0, 0.0
                else:
                    v1 = notch_landing(kinds[m], shares[m], v0, h, g, q, envelope[k], top, goal[k], here)
                    if v1 <= 0.0:
                        continue
                    lower, share = locate(v1, floor[k + 1], top, steps)
                    if lower < 0:
                        continue
                a, b = step_cost(v0, v1, h, g, q, here, c)
                dt[k, j, m] = a
                energy[k, j, m] = b
                target[k, j, m] = lower
                weight[k, j, m] = share


NO_NOTCH = 255
"""The choice at a state from which no notch leads to the end."""


@compiled(fastmath=True)
def few_switch_sweep(first, last, prices, moves, policy, value):
    """Bellman sweep under multipliers first … last − 1, whose `prices` are those of time (W) and of a change (J).

    Of `policy`, `choice[k, j, l]` becomes the best notch of a state, and bit m of `stay[k, j, l]` says that a train in
    notch m keeps it. `value` (speeds, notches, L) holds the values of the last node before the sweep, and of the first
    node after it.
    """
    dt, energy, target, weight = moves
    choice, stay = policy
    n, states, count = target.shape
    lo = max(first, 0)
    size = last - lo
    price, change = prices[0][lo:last].copy(), prices[1][lo:last].copy()
    ahead = value[:, :, lo:last].copy()
    here = np.empty_like(ahead)
    best, which = np.empty(size), np.empty(size, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        for j in range(states):
            best[:] = INFEASIBLE
            which[:] = NO_NOTCH
            for m in range(count):
                a = np.int64(target[k, j, m])
                row = here[j, m]
                if a < 0:
                    row[:] = INFEASIBLE
                    continue
                s, e, t = float(weight[k, j, m]), float(energy[k, j, m]), float(dt[k, j, m])
                low, high = ahead[a, m], ahead[min(a + 1, states - 1), m]
                for l in range(size):
                    cost = e + price[l] * t + (1.0 - s) * low[l] + s * high[l]
                    row[l] = cost
                    better = cost < best[l]
                    best[l] = cost if better else best[l]
                    which[l] = m if better else which[l]
            for l in range(size):
                choice[k, j, lo + l] = which[l] if best[l] < UNREACHABLE else NO_NOTCH
                stay[k, j, lo + l] = 0
            for m in range(count):
                _keep(here[j, m], best, change, 1 << m, stay[k, j, lo:last])
        ahead, here = here, ahead
    for j in range(states):
        for m in range(count):
            put(ahead[j, m], value[j, m, lo:last])


@kernel
def _keep(row, best, change, bit, stay):
    """Limit the costs of being in a notch to those of leaving it; if the train keeps it, set its bit in `stay`."""
    for l in range(best.size):
        limit = best[l] + change[l]
        keeps = row[l] <= limit
        stay[l] |= bit if keeps else 0
        row[l] = (row[l] if keeps else limit) if best[l] < UNREACHABLE else INFEASIBLE


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
            break  # Further steps find the same speed.
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
