"""Schedules of phases: the motion of a train that follows one, over a step and over a whole run."""

from __future__ import annotations

import math

from das.compiling import kernel
from das.solver.kernels.driving import drive, full_traction_speed, step_energy
from das.solver.kernels.forces import electric_limit, on_supply, traction_limit
from das.solver.kernels.landings import speed_under_force

TRACTION, HOLD, COAST, BRAKE, CURVE = 0, 1, 2, 3, 4
"""The values of `das.solver.guide.schedule.PhaseKind`."""
CREEP_MPS, CREEP_M = 0.5, 1.0
"""Speed (m/s) below which, and remaining distance (m) above which, a train that brakes to a stop creeps to its mark."""
BELOW_MPS = 0.5
"""Largest shortfall (m/s) below the speed to hold with which the train holds it without accelerating first."""
BACK_SHARE = 0.6
"""Share of the traction with which a train slower than the speed to hold accelerates to it."""
_STEPS = 6
"""Number of iterations in `speed_under`; more of them would not change the speed."""


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
            break  # Further iterations do not change the speed.
    return v1


@kernel
def followed_speed(i, phase, way, line, curve, v):
    """The speed for the end of interval i in a phase (kind, share, target).

    `way` is the remaining distance of the phase (m); `curve` contains the highest speeds at the ends of the interval.
    """
    kind, share, target = phase
    step, g, q, here = line
    if kind == COAST:
        return _coasting(i, line, v)
    if kind in (TRACTION, HOLD):
        if v > target:
            return min(max(_coasting(i, line, v), target), v)
        if kind == HOLD and v >= target - BELOW_MPS:
            return target
        effort = share if kind == TRACTION else BACK_SHARE
        return min(speed_under(TRACTION, effort, v, step[i], g[i], q[i], here), target)
    if v < CREEP_MPS and way > CREEP_M:  # The train would stop short of its mark.
        return min(speed_under(TRACTION, BACK_SHARE, v, step[i], g[i], q[i], here), max(CREEP_MPS, target))
    if v <= target:
        return min(target, max(_coasting(i, line, v), v))
    if kind == BRAKE and share > 0.0:  # Brake with constant effort to the target, then hold it.
        return min(max(speed_under(BRAKE, share, v, step[i], g[i], q[i], here), target), v)
    w, left = target * target, max(1.0 - step[i] / way, 0.0)  # Constant deceleration to the end of the phase.
    if kind == CURVE and curve[1] >= curve[0] >= v:
        return v  # The braking curve is still ahead.
    if kind == CURVE and curve[0] > target:  # Brake with a constant share of the braking curve.
        left = min(max(curve[1] * curve[1] - w, 0.0) / (curve[0] * curve[0] - w), 1.0)
    return min(_coasting(i, line, v), math.sqrt(w + (v * v - w) * left))


@kernel
def _coasting(i, line, v):
    """The speed of a coasting train at the end of interval i."""
    step, g, q, here = line
    return speed_under(COAST, 0.0, v, step[i], g[i], q[i], here)


@kernel
def followed_step(i, phase, way, line, envelope, p, v):
    """Drive interval i in a `phase` (kind, share, target); fills v[i + 1]. Returns the time (s), -1 after a stall."""
    step, g, q, u = line
    here = (step, g, q, on_supply(p, u[i]))
    landing = followed_speed(i, phase, way, here, (envelope[i], envelope[i + 1]), v[i])
    moving = drive(i, i + 1, max(landing, 0.0), p.friction_force_n, line, envelope, p, v)
    # On a hill that the schedule cannot climb, the train uses full traction.
    if not moving and not drive(i, i + 1, envelope[i + 1], p.friction_force_n, line, envelope, p, v):
        return -1.0
    return 2.0 * step[i] / (v[i] + v[i + 1])


@kernel
def follow(first, at, ends, phases, known, met_mps, line, envelope, p, c, v):
    """Follow a schedule from v[first] to the end; fills v.

    Returns the trip time (s) and the energy at the current collector (J); (-1, 0) after a stall.

    `at[i]` is the number of the phase in interval i, and that phase ends `ends[i]` (m) beyond the interval; `phases`
    are the phases' kinds, shares and target speeds. `known` is a trajectory that follows the schedule (speeds and time
    to go at every node). Its remainder is used from the node where the two speeds are within `met_mps` of each other
    (negative: never).
    """
    kinds, shares, targets = phases
    total, energy = 0.0, 0.0
    n = line.step_m.size
    for i in range(first, n):
        k = at[i]
        phase = kinds[k], shares[k], targets[k]
        way = ends[i] + line.step_m[i]
        took = followed_step(i, phase, way, line, envelope, p, v)
        if took < 0.0:
            return -1.0, 0.0
        total += took
        energy += step_energy(i, v[i], v[i + 1], line, p, c)
        if abs(v[i + 1] - known.speed_mps[i + 1]) < met_mps and i + 1 < n:
            for m in range(i + 1, n):
                v[m + 1] = known.speed_mps[m + 1]
                energy += step_energy(m, v[m], v[m + 1], line, p, c)
            return total + known.time_to_go_s[i + 1], energy
    return total, energy
