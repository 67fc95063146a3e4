"""Numba kernels that follow a policy forward from any state, on the integration grid.

Symbols as in `kernels`. A policy is a multiplier λ between two neighbours a and a + 1 of the ladder, given as the
ladder index `a`, the offset λ − λ_a and the gap λ_{a+1} − λ_a (0 for λ_a itself). Values are interpolated in λ by the
cubic through both values and both slopes (dV/dλ is the time-to-go) and in speed by a cubic, so that decisions are
smooth where the optimum is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from das.solver.compiling import kernel
from das.solver.kernels import (
    LANDINGS,
    brake_limit,
    full_traction_speed,
    landing_speed,
    landings,
    largest_loss,
    locate,
    mean_resistance,
    on_supply,
    step_cost,
    traction_limit,
)
from das.solver.tolerances import CREEP_MPS, INFEASIBLE, UNREACHABLE

FIRST = np.int64(0)
"""The first node or grid line; for a literal 0 numba would compile the kernel that is called once more."""

_GOLDEN = 0.3819660112501051
_POLISH_STEPS = 10
_BRAKE_STEPS = 60
_ROUNDING_W = 1e-9
"""A v² this little above the envelope's is rounding of the iterations."""


class PackedTimes(NamedTuple):
    """Times-to-go as a table on disk holds them: low_s + step_s·steps.

    `steps` (K + 1 decision nodes, J + 1 speeds, L multipliers), `low_s` and `step_s` (K + 1, L).
    """

    steps: NDArray[np.uint16]
    low_s: NDArray[np.float32]
    step_s: NDArray[np.float32]


def time_at(time_to_go, k, j, a):
    """Time-to-go (s) at decision node k, grid line j and multiplier a, of an array or of PackedTimes."""
    if isinstance(time_to_go, PackedTimes):
        return time_to_go.low_s[k, a] + time_to_go.step_s[k, a] * float(time_to_go.steps[k, j, a])
    return time_to_go[k, j, a]


@overload(time_at)
def _compiled_time_at(time_to_go, k, j, a):
    if isinstance(time_to_go, types.BaseNamedTuple):
        return lambda time_to_go, k, j, a: (
            time_to_go.low_s[k, a] + time_to_go.step_s[k, a] * float(time_to_go.steps[k, j, a])
        )
    return lambda time_to_go, k, j, a: time_to_go[k, j, a]


@kernel
def blended_values(value, time_to_go, k, first, last, a, offset, gap, row):
    """Values (J) of the policy at decision node k, grid lines first … last, into row[first … last]."""
    if gap <= 0.0:
        for j in range(first, last + 1):
            row[j] = value[k, j, a]
        return
    u = offset / gap
    r = 1.0 - u
    of_va = (1.0 + 2.0 * u) * r * r
    of_ta = u * r * r * gap
    of_vb = u * u * (3.0 - 2.0 * u)
    of_tb = -u * u * r * gap
    for j in range(first, last + 1):
        va = value[k, j, a]
        vb = value[k, j, a + 1]
        if va >= 0.5 * INFEASIBLE or vb >= 0.5 * INFEASIBLE:
            row[j] = INFEASIBLE
        else:
            ta = time_at(time_to_go, k, j, a)
            tb = time_at(time_to_go, k, j, a + 1)
            row[j] = of_va * va + of_ta * ta + of_vb * vb + of_tb * tb


@kernel
def value_at(row, v, floor, top):
    """Value (J) at speed v of a decision node whose grid lines hold `row`; floor and top bound the speed grid there.

    Only the lines that `needed_lines` names for v are read.
    """
    steps = row.size - 1
    i, s = locate(v, floor, top, steps)
    if i < 0:
        return INFEASIBLE
    y1 = row[i]
    if s == 0.0:
        return y1
    y2 = row[i + 1]
    if i < 2 or i > steps - 2:
        return (1.0 - s) * y1 + s * y2
    u = (v - floor) * (steps / (top - floor)) - i
    y0 = row[i - 1]
    y3 = row[i + 2]
    if max(max(y0, y1), max(y2, y3)) >= 0.5 * INFEASIBLE:
        return (1.0 - u) * y1 + u * y2
    return y1 + 0.5 * u * (y2 - y0 + u * (2.0 * y0 - 5.0 * y1 + 4.0 * y2 - y3 + u * (3.0 * (y1 - y2) + y3 - y0)))


@kernel
def needed_lines(low, high, floor, top, steps):
    """First and last grid line that `value_at` reads for speeds low … high."""
    first = max(locate(low, floor, top, steps)[0] - 1, 0)
    return first, min(max(locate(high, floor, top, steps)[0], 0) + 2, steps)


@kernel
def _total_cost(v0, v1, h, g, q, p, c, price, floor, top, row):
    if v0 + v1 <= 0.0:
        return INFEASIBLE
    dt, energy = step_cost(v0, v1, h, g, q, p, c)
    return energy + price * dt + value_at(row, v1, floor, top)


@kernel
def best_landing(k, v0, h, g, q, floor, top, final, price, a, offset, gap, value, time_to_go, p, c, out, row):
    """Landing speed at decision node k that minimises cost (at λ = price) plus value, and that least total.

    Tries all landings of the step into k, then narrows between the best one's neighbours by golden section.
    Returns (-1, INFEASIBLE) where no landing is feasible. `out` and `row` (LANDINGS and one per grid line) are
    working space.
    """
    m = landings(v0, h, g, q, top, final, p, out)
    if m == 0:
        return -1.0, INFEASIBLE
    if final:
        dt, energy = step_cost(v0, out[0], h, g, q, p, c)
        blended_values(value, time_to_go, k, FIRST, FIRST, a, offset, gap, row)
        return out[0], energy + price * dt + row[0]
    left = out[0]
    right = out[0]
    for i in range(m):
        left = min(left, out[i])
        right = max(right, out[i])
    first, last = needed_lines(left, right, floor, top, row.size - 1)
    blended_values(value, time_to_go, k, first, last, a, offset, gap, row)
    best = INFEASIBLE
    choice = -1.0
    for i in range(m):
        cost = _total_cost(v0, out[i], h, g, q, p, c, price, floor, top, row)
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
    y1 = _total_cost(v0, x1, h, g, q, p, c, price, floor, top, row)
    y2 = _total_cost(v0, x2, h, g, q, p, c, price, floor, top, row)
    for _ in range(_POLISH_STEPS):
        if y1 <= y2:
            right = x2
            x2 = x1
            y2 = y1
            x1 = left + _GOLDEN * (right - left)
            y1 = _total_cost(v0, x1, h, g, q, p, c, price, floor, top, row)
        else:
            left = x1
            x1 = x2
            y1 = y2
            x2 = right - _GOLDEN * (right - left)
            y2 = _total_cost(v0, x2, h, g, q, p, c, price, floor, top, row)
    if min(y1, y2) < best:
        if y1 <= y2:
            return x1, y1
        return x2, y2
    return choice, best


@kernel
def _hardest_brake_speed(v0, h, g, q, p, friction_n):
    """Speed after a step at full electric brake plus friction_n; the power limit holds over the whole step."""
    v1 = v0
    for _ in range(_BRAKE_STEPS):
        w1 = v0 * v0 - 2.0 * h * largest_loss(max(v0, v1), mean_resistance(v0, v1, q, p) + g, p, friction_n)
        new = math.sqrt(w1) if w1 > 0.0 else 0.0
        if abs(new - v1) <= 1e-13 * v0:
            return new
        v1 = new
    return v1


@kernel
def _attainable(a, b, h, g, q, p, friction_n):
    """Whether the train can go from speed a to b in a step within its forces, powers and accelerations."""
    rate = (b * b - a * a) / (2.0 * h)
    if rate > p.max_acceleration_mps2 or -rate > p.max_deceleration_mps2:
        return False
    force = p.inertial_mass_kg * rate + mean_resistance(a, b, q, p) + g
    faster = max(a, b)
    if force >= 0.0:
        return force <= traction_limit(faster, p)
    return -force <= brake_limit(faster, p, friction_n)


@kernel
def drive(first, last, landing, friction_n, step, g, q, u, envelope, p, v):
    """From v[first] towards the speed `landing` at integration node `last`, at constant acceleration.

    Every step is cut to what the train allows, with at most `friction_n` of friction brake, and to the envelope (with
    all brakes): at full traction the landing may be lower, at full electric brake or from above the envelope higher.
    Fills v[first + 1 … last]; returns False after a stall.
    """
    length = 0.0
    for i in range(first, last):
        length += step[i]
    w0 = v[first] * v[first]
    w1 = landing * landing
    done = 0.0
    for i in range(first, last):
        done += step[i]
        here = on_supply(p, u[i])
        a = v[i]
        b = landing if i == last - 1 else math.sqrt(w0 + (w1 - w0) * done / length)
        b = min(b, envelope[i + 1])
        if not _attainable(a, b, step[i], g[i], q[i], here, friction_n):
            top = full_traction_speed(a, step[i], g[i], q[i], here)
            if b > top:
                b = top
            else:
                b = max(b, _hardest_brake_speed(a, step[i], g[i], q[i], here, friction_n))
                if b > envelope[i + 1]:
                    b = max(envelope[i + 1], _hardest_brake_speed(a, step[i], g[i], q[i], here, here.friction_force_n))
                    if b * b <= envelope[i + 1] ** 2 + _ROUNDING_W:
                        b = envelope[i + 1]
            if b <= 0.0 and landing > 0.0:
                return False
        v[i + 1] = b
    return True


@kernel
def roll_out(k0, price, a, offset, gap, decision, step, g, q, u, floor, envelope, value, time_to_go, p, c, v):
    """Follow a policy from v[0] to the end; fills v, returns the trip time (s), or -1 after a stall.

    `decision[m]` are the integration nodes of decision nodes k0 + m; decision[0] = 0.
    """
    out = np.empty(LANDINGS)
    row = np.empty(value.shape[1])
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
        here = on_supply(p, u[i0])
        landing, _ = best_landing(
            k0 + m + 1,
            v[i0],
            h,
            gh / h,
            qh / h,
            floor[i1],
            envelope[i1],
            final,
            price,
            a,
            offset,
            gap,
            value,
            time_to_go,
            here,
            c,
            out,
            row,
        )
        if landing < 0.0:
            # Nothing the table knows is feasible from here: as fast as the envelope lets (above it: brake).
            landing = envelope[i1]
        landing = max(landing, floor[i1])
        full = landing_speed(v[i0], h, 1.0, gh / h, qh / h, here)
        creeping = final and v[i0] < CREEP_MPS
        if landing >= full or creeping:
            # The decision step's full traction is a little rough: integrate it finely.
            moving = hurry(i0, i1, step, g, q, u, envelope, p, v)
        else:
            # A landing at or above full electric brake needs no friction brake: none shall slip in from rounding.
            electric = landing_speed(v[i0], h, -1.0, gh / h, qh / h, here)
            friction_n = p.friction_force_n if p.brakes_dissipate or landing < 0.999 * electric else 0.0
            moving = drive(i0, i1, landing, friction_n, step, g, q, u, envelope, p, v)
            if not moving or v[i1] < floor[i1]:
                # A hill or the end speed can no longer be reached: this step needs full traction from its beginning.
                moving = hurry(i0, i1, step, g, q, u, envelope, p, v)
        if not moving:
            return -1.0
    return trip_time(step, v)


@kernel
def hurry(first, last, step, g, q, u, envelope, p, v):
    """From v[first] to integration node `last` as fast as train and envelope allow; False after a stall."""
    for i in range(first, last):
        if not drive(i, i + 1, envelope[i + 1], p.friction_force_n, step, g, q, u, envelope, p, v):
            return False
    return True


@kernel
def fastest_roll_out(step, g, q, u, envelope, p, v):
    """The fastest run from v[0]; fills v, returns the trip time (s), or -1 after a stall."""
    if not hurry(FIRST, step.size, step, g, q, u, envelope, p, v):
        return -1.0
    return trip_time(step, v)


@kernel
def least_time(first, way, speed, step, g, q, u, envelope, p, known, to_go):
    """Time (s) of the fastest run from a speed with `way` (m) left of interval `first`, or -1 after a stall.

    `known` is a fastest run at the nodes, `to_go` its time (s) from each of them: from where the two meet they are one.
    """
    steps = step.copy()
    steps[first] = way
    v = np.empty(step.size + 1)
    v[first] = speed
    total = 0.0
    for i in range(first, step.size):
        if not hurry(i, i + 1, steps, g, q, u, envelope, p, v):
            return -1.0
        total += 2.0 * steps[i] / (v[i] + v[i + 1])
        if v[i + 1] == known[i + 1]:
            return total + to_go[i + 1]
    return total


@kernel
def blend_runs(share, quick, slow, step, g, q, u, envelope, p, v):
    """Drive between two runs from the same state: v² is `share` of the quick one's and the rest of the slow one's.

    Cut to what the train can do in every step. Fills v, returns the trip time (s), or -1 after a stall.
    """
    v[0] = slow[0]
    for i in range(step.size):
        landing = math.sqrt(share * quick[i + 1] ** 2 + (1.0 - share) * slow[i + 1] ** 2)
        if not drive(i, i + 1, landing, p.friction_force_n, step, g, q, u, envelope, p, v):
            return -1.0
    return trip_time(step, v)


@kernel
def trip_time(step, v):
    total = 0.0
    for i in range(step.size):
        total += 2.0 * step[i] / (v[i] + v[i + 1])
    return total


@kernel
def one_step_totals(k0, v0, h, g, q, floor, top, final, lam, value, time_to_go, p, c, total, time_s):
    """For every λ of the ladder: least total cost (J) and time (s) from speed v0, one step of length h before k0."""
    out = np.empty(LANDINGS)
    row = np.empty(value.shape[1])
    steps = value.shape[1] - 1
    for a in range(lam.size):
        x, cost = best_landing(
            k0, v0, h, g, q, floor, top, final, lam[a], a, 0.0, 0.0, value, time_to_go, p, c, out, row
        )
        total[a] = cost
        if x < 0.0:
            time_s[a] = INFEASIBLE
            continue
        time_s[a] = 2.0 * h / (v0 + x)
        if not final:
            j, s = locate(x, floor, top, steps)
            time_s[a] += (1.0 - s) * time_at(time_to_go, k0, j, a) + s * time_at(time_to_go, k0, j + 1, a)
