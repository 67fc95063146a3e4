"""Numba kernels of what drivers foresee: speed ceilings, running times. Grids of even cells, w = v² at their nodes."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.domain.route import NEUTRAL
from sim.plant.kernels import brake_effort, running_resistance, traction_effort

_LEAST_BRAKING_MPS2 = 0.02
"""A train is assumed to brake at least this much (m/s²), because the ceiling would otherwise rise without end."""
_CRAWL_MPS = 0.5
"""A train in front of something that it cannot climb is assumed to crawl at this speed."""


@kernel
def ceiling(step, limit, line_n, tunnel, supply, braking, reserve, p):
    """w at the nodes from which limits ahead and the end's standstill are kept with the planned deceleration.

    Planned: at most `braking` (m/s²), and at most a share `reserve` of what the brakes can do at the faster end.
    """
    n = limit.size
    w = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        cap = min(limit[i], limit[max(i - 1, 0)]) ** 2
        w1 = min(w[i + 1], cap)
        v = math.sqrt(min(w1 + 2.0 * step * braking, cap))
        # Without motors only what does not need the line is left.
        effort = brake_effort(v, 1.0, p) if supply[i] >= 0.0 else min(p.friction_force_n, brake_effort(v, 1.0, p))
        can = (reserve * effort + running_resistance(v, 0.0, tunnel[i], p) + line_n[i]) / p.inertial_mass_kg
        w[i] = min(cap, w1 + 2.0 * step * max(min(braking, can), _LEAST_BRAKING_MPS2))
    return w


@kernel
def needed_braking(step, first, w, s, v, least_way):
    """The least steady deceleration (m/s²) from v at s that keeps under w everywhere ahead; negative: none is needed.

    Excess right ahead is given `least_way` (m) to go. `first` is the position of w's first node.
    """
    needed = -math.inf
    i = max(int((s - first) / step) + 1, 0)
    while i < w.size:
        way = max(first + step * i - s, least_way)
        needed = max(needed, (v * v - w[i]) / (2.0 * way))
        if v * v / (2.0 * way) < needed:
            break  # further on not even a standstill needs more
        i += 1
    return needed


@kernel
def run_time(step, top, cap, line_n, tunnel, supply, start, w0, p):
    """Time (s) of the fastest run from node `start`, where it has w0, under a ceiling `top` and a cap (w)."""
    w = min(w0, top[start], cap)
    v = math.sqrt(w)
    total = 0.0
    for i in range(start, line_n.size):
        pull = 0.0 if supply[i] == NEUTRAL else traction_effort(v, 1.0, p)
        rate = (pull - running_resistance(v, 0.0, tunnel[i], p) - line_n[i]) / p.inertial_mass_kg
        reached = max(w + 2.0 * step * min(rate, p.max_acceleration_mps2), _CRAWL_MPS * _CRAWL_MPS)
        w = min(reached, min(top[i + 1], cap))
        before = v
        v = math.sqrt(w)
        total += 2.0 * step / max(before + v, _CRAWL_MPS)
    return total


@kernel
def cap_for_time(step, top, line_n, tunnel, supply, start, w0, wanted, fastest_mps, slowest_mps, halvings, p):
    """The one highest speed (m/s) with which the run from node `start` takes the wanted time (s), by bisection."""
    low = slowest_mps
    high = fastest_mps
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        if run_time(step, top, middle * middle, line_n, tunnel, supply, start, w0, p) > wanted:
            low = middle
        else:
            high = middle
    return high
