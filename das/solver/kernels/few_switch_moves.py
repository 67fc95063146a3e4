"""Where each notch of a few-switch trajectory leads from every speed of the decision nodes, and what it costs."""

from __future__ import annotations

from das.compiling import kernel
from das.solver.kernels.forces import electric_limit, on_supply, traction_limit
from das.solver.kernels.landings import landing_speed, landing_under, speed_under_force, step_cost
from das.solver.kernels.speed_grid import grid_speed, locate

TRACTION, HOLD, COAST, BRAKE, CURVE = 0, 1, 2, 3, 4
"""The numbers of `das.solver.few_switch.notches.NotchRegime`."""
NO_MOVE = -1
"""The target of a notch that cannot be used from a speed."""
CONTACT_MPS = 0.2
"""A notch may run into the highest allowed speed only from further below it than this (m/s)."""

_LANDING_STEPS = 4


@kernel
def landing_with(kind, share, v0, h, g, q, p):
    """Speed after a decision step with a share of the largest traction or electric brake; 0 if the train stops."""
    v1 = v0
    for _ in range(_LANDING_STEPS):
        mid = 0.5 * (v0 + v1)
        force = share * traction_limit(mid, p) if kind == TRACTION else -share * electric_limit(mid, p)
        v1 = speed_under_force(force, v0, v1, h, g, q, p)
        if v1 <= 0.0:
            return 0.0
    return v1


@kernel
def notch_landing(kind, share, v0, h, g, q, highest, top, goal, p):
    """Speed after a decision step in a notch, or -1 where the notch cannot be used.

    `highest` and `top` are the highest speeds at the two ends of the step, `goal` the lower speed that brakes lead to.
    """
    below = v0 < min(highest, top) - CONTACT_MPS
    if kind == TRACTION:
        if traction_limit(v0, p) <= 0.0:
            return -1.0
        v1 = landing_with(kind, share, v0, h, g, q, p)
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
            v1 = landing_with(kind, share, v0, h, g, q, p)
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
    """Whether a notch may end a section whose end speed is `top`: only a step that comes near it by itself may."""
    if top < v0:
        return kind == CURVE
    if kind == TRACTION:
        return landing_with(kind, share, v0, h, g, q, p) >= top
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
