"""Roll-out of trajectories over the integration nodes: under a policy, between two others, or as fast as possible."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.driving import coast, drive, full_traction_speed, hurry, trip_time
from das.solver.kernels.forces import on_supply
from das.solver.kernels.landings import LANDINGS, landing_speed, landing_under, landings, step_cost
from das.solver.kernels.policy_values import blended_values, locate, needed_lines, value_at
from das.solver.kernels.tuples import DecisionStep, LineArrays, Policy
from das.solver.tolerances import CREEP_MPS, INFEASIBLE, UNREACHABLE

_FIRST = np.int64(0)
"""Index of the first node or grid line. With a literal 0 numba would compile the called kernel a second time."""

_GOLDEN = 0.3819660112501051
_POLISH_STEPS = 10


@kernel
def _total_cost(v0, v1, step, price, c, row):
    if v0 + v1 <= 0.0:
        return INFEASIBLE
    dt, energy = step_cost(v0, v1, step.length_m, step.constant_n, step.tunnel_n_per_mps2, step.train, c)
    return energy + price * dt + value_at(row, v1, step.floor_mps, step.envelope_mps)


@kernel
def best_landing(v0, step, policy, policies, c, out, row):
    """The landing speed from v0 with the least sum of step cost and landing value, and that sum (J).

    All landings of the step are tried; the best one is then refined between its neighbours by golden section. Returns
    (-1, INFEASIBLE) if no landing is feasible. `out` (length LANDINGS) and `row` (one value per grid line) are working
    memory.
    """
    price = policy.price_w
    h, g, q, p = step.length_m, step.constant_n, step.tunnel_n_per_mps2, step.train
    m = landings(v0, h, g, q, step.envelope_mps, step.final, p, out)
    if m == 0:
        return -1.0, INFEASIBLE
    if step.final:
        dt, energy = step_cost(v0, out[0], h, g, q, p, c)
        blended_values(policies, policy, step.node, _FIRST, _FIRST, row)
        return out[0], energy + price * dt + row[0]
    left = out[0]
    right = out[0]
    for i in range(m):
        left = min(left, out[i])
        right = max(right, out[i])
    first, last = needed_lines(left, right, step.floor_mps, step.envelope_mps, row.size - 1)
    blended_values(policies, policy, step.node, first, last, row)
    best = INFEASIBLE
    choice = -1.0
    for i in range(m):
        cost = _total_cost(v0, out[i], step, price, c, row)
        if cost < best:
            best = cost
            choice = out[i]
    if choice < 0.0 or best > UNREACHABLE:
        return -1.0, INFEASIBLE
    for i in range(m):
        if left < out[i] < choice:
            left = out[i]
        if choice < out[i] < right:
            right = out[i]
    x1 = left + _GOLDEN * (right - left)
    x2 = right - _GOLDEN * (right - left)
    y1 = _total_cost(v0, x1, step, price, c, row)
    y2 = _total_cost(v0, x2, step, price, c, row)
    for _ in range(_POLISH_STEPS):
        if y1 <= y2:
            right = x2
            x2 = x1
            y2 = y1
            x1 = left + _GOLDEN * (right - left)
            y1 = _total_cost(v0, x1, step, price, c, row)
        else:
            left = x1
            x1 = x2
            y1 = y2
            x2 = right - _GOLDEN * (right - left)
            y2 = _total_cost(v0, x2, step, price, c, row)
    if min(y1, y2) < best:
        if y1 <= y2:
            return x1, y1
        return x2, y2
    return choice, best


@kernel
def one_step_totals(v0, step, policies, c, total, time_s):
    """Least total cost (J) and time (s) for every λ of the ladder, from speed v0 at the beginning of a step."""
    out = np.empty(LANDINGS)
    time_to_go, speeds = policies.time_to_go_s, policies.value_j.shape[1]
    row = np.empty(speeds)
    for a in range(policies.lambda_w.size):
        x, cost = best_landing(v0, step, Policy(policies.lambda_w[a], a, 0.0, 0.0), policies, c, out, row)
        total[a] = cost
        if x < 0.0:
            time_s[a] = INFEASIBLE
            continue
        time_s[a] = 2.0 * step.length_m / (v0 + x)
        if not step.final:
            k = step.node
            j, s = locate(x, step.floor_mps, step.envelope_mps, speeds - 1)
            time_s[a] += (1.0 - s) * time_to_go[k, j, a] + s * time_to_go[k, j + 1, a]


@kernel
def roll_out(k0, decision, line, bounds, policy, policies, p, c, v):
    """Follow a policy from v[0] to the end; fills v, returns the trip time (s), or -1 after a stall.

    `decision[m]` is the integration node at decision node k0 + m; decision[0] = 0.
    """
    out = np.empty(LANDINGS)
    row = np.empty(policies.value_j.shape[1])
    step, g, q, u = line
    floor, envelope = bounds
    n = decision.size - 1
    for m in range(n):
        i0 = decision[m]
        i1 = decision[m + 1]
        final = m == n - 1 and floor[i1] >= envelope[i1]
        h = 0.0
        gh = 0.0
        qh = 0.0
        for i in range(i0, i1):
            h += step[i]
            gh += g[i] * step[i]
            qh += q[i] * step[i]
        ahead = DecisionStep(k0 + m + 1, h, gh / h, qh / h, floor[i1], envelope[i1], final, on_supply(p, u[i0]))
        landing, _ = best_landing(v[i0], ahead, policy, policies, c, out, row)
        if landing < 0.0:
            # The table has no feasible landing from here: drive as fast as the envelope allows, or brake to it.
            landing = envelope[i1]
        landing = max(landing, floor[i1])
        full = landing_speed(v[i0], h, 1.0, gh / h, qh / h, ahead.train)
        creeping = final and v[i0] < CREEP_MPS
        if landing >= full or creeping:
            moving = False  # Full traction over one decision step is inaccurate: integrate it over the fine nodes.
        elif landing == landing_under(0.0, v[i0], h, gh / h, qh / h, ahead.train):
            # At constant acceleration the train would draw and feed back energy where the slope changes in the step.
            moving = coast(i0, i1, line, envelope, p, v)
        else:
            # A landing at or above full electric brake needs no friction brake; rounding must not add any.
            electric = landing_speed(v[i0], h, -1.0, gh / h, qh / h, ahead.train)
            friction_n = p.friction_force_n if p.brakes_dissipate or landing < 0.999 * electric else 0.0
            moving = drive(i0, i1, landing, friction_n, line, envelope, p, v)
        # If a hill or the end speed is out of reach, this step needs full traction from the start.
        if (not moving or v[i1] < floor[i1]) and not hurry(i0, i1, line, envelope, p, v):
            return -1.0
    return trip_time(step, v)


@kernel
def blend_runs(share, quick, slow, line, envelope, p, v):
    """Drive between two runs from the same state: v² = share · v² (quick run) + (1 − share) · v² (slow run).

    Every step is limited to the train's efforts. Fills v, returns the trip time (s), or -1 after a stall.
    """
    v[0] = slow[0]
    for i in range(line.step_m.size):
        landing = math.sqrt(share * quick[i + 1] ** 2 + (1.0 - share) * slow[i + 1] ** 2)
        if not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return -1.0
    return trip_time(line.step_m, v)


@kernel
def fastest_run(line, envelope, start_speed, p):
    """Speeds of the fastest run under the envelope, and the index of the interval where it stalls, or -1."""
    step, g, q, u = line
    n = step.size
    v = np.empty(n + 1)
    v[0] = start_speed
    for i in range(n):
        v1 = min(full_traction_speed(v[i], step[i], g[i], q[i], on_supply(p, u[i])), envelope[i + 1])
        if v1 <= 0.0 and i < n - 1:
            return v, i
        v[i + 1] = v1
    return v, -1


@kernel
def fastest_roll_out(line, envelope, p, v):
    """The fastest run from v[0]; fills v, returns the trip time (s), or -1 after a stall."""
    if not hurry(_FIRST, line.step_m.size, line, envelope, p, v):
        return -1.0
    return trip_time(line.step_m, v)


@kernel
def least_time(first, way, speed, line, envelope, p, known):
    """Time (s) of the fastest run from a speed with `way` (m) left of interval `first`, or -1 after a stall.

    `known` is a fastest run (`KnownRun`); where the two meet, its time to go is used for the rest.
    """
    steps = line.step_m.copy()
    steps[first] = way
    ahead = LineArrays(steps, line.constant_n, line.tunnel_n_per_mps2, line.supply)
    v = np.empty(steps.size + 1)
    v[first] = speed
    total = 0.0
    for i in range(first, steps.size):
        if not hurry(i, i + 1, ahead, envelope, p, v):
            return -1.0
        total += 2.0 * steps[i] / (v[i] + v[i + 1])
        if v[i + 1] == known.speed_mps[i + 1]:
            return total + known.time_to_go_s[i + 1]
    return total
