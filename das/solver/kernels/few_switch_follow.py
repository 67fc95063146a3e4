"""Following a schedule: what a train does that keeps to a few-switch trajectory from where it is now."""

from __future__ import annotations

import math

from das.compiling import kernel
from das.solver.kernels.driving import drive
from das.solver.kernels.few_switch_moves import BRAKE, COAST, CURVE, HOLD, TRACTION
from das.solver.kernels.few_switch_roll_out import speed_under, step_energy
from das.solver.kernels.forces import on_supply

UNSAID_MPS = 0.05
"""A limit ahead asks for brakes where the train would be faster than allowed by more than this (m/s)."""
CREEP_MPS, CREEP_M = 0.5, 1.0
"""A train that brakes to a stop and is slower than this (m/s) creeps on while there is more than this (m) to go."""
BELOW_MPS = 0.5
"""A speed to hold is held from this much (m/s) below it on; a train slower than that accelerates first."""


@kernel
def followed_speed(i, phase, back_share, way, line, curve, v):
    """The speed at the end of interval i that a train in a phase (kind, share, target) means to have.

    `way` (m) is left of the phase, and `curve` are the highest speeds allowed at both ends of the interval.
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
        effort = share if kind == TRACTION else back_share
        return min(speed_under(TRACTION, effort, v, step[i], g[i], q[i], here), target)
    if v < CREEP_MPS and way > CREEP_M:  # It would stop short of its mark.
        return min(speed_under(TRACTION, back_share, v, step[i], g[i], q[i], here), max(CREEP_MPS, target))
    if v <= target:
        return min(target, max(_coasting(i, line, v), v))
    if kind == BRAKE and share > 0.0:  # With one effort to the speed, which is held from there on.
        return min(max(speed_under(BRAKE, share, v, step[i], g[i], q[i], here), target), v)
    w, left = target * target, max(1.0 - step[i] / way, 0.0)  # By one deceleration to the end of the phase.
    if kind == CURVE and curve[1] >= curve[0] >= v:
        return v  # The braking curve is still ahead.
    if kind == CURVE and curve[0] > target:  # By one share of the braking curve.
        left = min(max(curve[1] * curve[1] - w, 0.0) / (curve[0] * curve[0] - w), 1.0)
    return min(_coasting(i, line, v), math.sqrt(w + (v * v - w) * left))


@kernel
def _coasting(i, line, v):
    """The speed at the end of interval i of a train that coasts."""
    step, g, q, here = line
    return speed_under(COAST, 0.0, v, step[i], g[i], q[i], here)


@kernel
def followed_step(i, phase, back_share, way, line, envelope, p, v):
    """Drive interval i in a `phase` (kind, share, target); fills v[i + 1].

    Returns the time (s), or -1 after a stall, and whether limits ahead ask for brakes, or for more of them, though the
    phase does not.
    """
    step, g, q, u = line
    here = (step, g, q, on_supply(p, u[i]))
    landing = followed_speed(i, phase, back_share, way, here, (envelope[i], envelope[i + 1]), v[i])
    moving = drive(i, i + 1, max(landing, 0.0), p.friction_force_n, line, envelope, p, v)
    # On a hill that the schedule cannot climb the train takes all its traction.
    if not moving and not drive(i, i + 1, envelope[i + 1], p.friction_force_n, line, envelope, p, v):
        return -1.0, False
    by_effort = phase[0] < BRAKE or (phase[0] == BRAKE and phase[1] > 0.0)
    unsaid = by_effort and landing > envelope[i + 1] + UNSAID_MPS and v[i + 1] < v[i]
    return 2.0 * step[i] / (v[i] + v[i + 1]), unsaid


@kernel
def follow(first, until, at, ends, phases, back_share, known, met_mps, line, envelope, p, c, v):
    """Follow a schedule from v[first] to the end; fills v.

    Returns the trip time (s), the energy at the current collector (J), and the time (s) in which limits ahead ask for
    brakes though no phase does; (-1, 0, 0) after a stall.

    `at[i]` is the phase that holds in interval i, `ends[i]` how far behind the interval it ends (m); `phases` are their
    kinds, shares and target speeds. Before interval `until` the train holds its first speed instead. `known` is a run
    that keeps to the schedule (speeds and time to go at every node): from where the speeds of the two are within
    `met_mps` of each other they are one (negative: nowhere).
    """
    kinds, shares, targets = phases
    total, energy, unsaid = 0.0, 0.0, 0.0
    n = line.step_m.size
    for i in range(first, n):
        k = at[i]
        kind, share, target = kinds[k], shares[k], targets[k]
        if i < until:
            kind, share, target = HOLD, 0.0, v[first]
        way = ends[i] + line.step_m[i]
        took, is_unsaid = followed_step(i, (kind, share, target), back_share, way, line, envelope, p, v)
        if took < 0.0:
            return -1.0, 0.0, 0.0
        total += took
        energy += step_energy(i, v[i], v[i + 1], line, p, c)
        unsaid += took if is_unsaid else 0.0
        if abs(v[i + 1] - known.speed_mps[i + 1]) < met_mps and i + 1 < n:
            for m in range(i + 1, n):
                v[m + 1] = known.speed_mps[m + 1]
                energy += step_energy(m, v[m], v[m + 1], line, p, c)
            return total + known.time_to_go_s[i + 1], energy, unsaid
    return total, energy, unsaid
