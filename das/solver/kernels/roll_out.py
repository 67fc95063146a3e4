"""Runs rolled out over the integration nodes: under a policy, or between two runs."""

from __future__ import annotations

import math

import numpy as np

from das.compiling import kernel
from das.solver.kernels.best_landing import best_landing
from das.solver.kernels.driving import coast, drive, hurry, trip_time
from das.solver.kernels.forces import on_supply
from das.solver.kernels.landings import LANDINGS, landing_speed, landing_under
from das.solver.kernels.tuples import DecisionStep
from das.solver.tolerances import CREEP_MPS


@kernel
def roll_out(k0, decision, line, bounds, policy, policies, p, c, v):
    """Follow a policy from v[0] to the end; fills v, returns the trip time (s), or -1 after a stall.

    `decision[m]` are the integration nodes of decision nodes k0 + m; decision[0] = 0.
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
            # Nothing the table knows is feasible from here: as fast as the envelope lets (above it: brake).
            landing = envelope[i1]
        landing = max(landing, floor[i1])
        full = landing_speed(v[i0], h, 1.0, gh / h, qh / h, ahead.train)
        creeping = final and v[i0] < CREEP_MPS
        if landing >= full or creeping:
            # The decision step's full traction is a little rough: integrate it finely.
            moving = hurry(i0, i1, line, envelope, p, v)
        elif landing == landing_under(0.0, v[i0], h, gh / h, qh / h, ahead.train):
            # Held at one acceleration, the train would draw and feed back where the slope changes within the step.
            moving = coast(i0, i1, line, envelope, p, v)
            if not moving or v[i1] < floor[i1]:
                moving = hurry(i0, i1, line, envelope, p, v)
        else:
            # A landing at or above full electric brake needs no friction brake: none shall slip in from rounding.
            electric = landing_speed(v[i0], h, -1.0, gh / h, qh / h, ahead.train)
            friction_n = p.friction_force_n if p.brakes_dissipate or landing < 0.999 * electric else 0.0
            moving = drive(i0, i1, landing, friction_n, line, envelope, p, v)
            if not moving or v[i1] < floor[i1]:
                # A hill or the end speed can no longer be reached: this step needs full traction from its beginning.
                moving = hurry(i0, i1, line, envelope, p, v)
        if not moving:
            return -1.0
    return trip_time(step, v)


@kernel
def blend_runs(share, quick, slow, line, envelope, p, v):
    """Drive between two runs from the same state: v² is `share` of the quick one's and the rest of the slow one's.

    Cut to what the train can do in every step. Fills v, returns the trip time (s), or -1 after a stall.
    """
    v[0] = slow[0]
    for i in range(line.step_m.size):
        landing = math.sqrt(share * quick[i + 1] ** 2 + (1.0 - share) * slow[i + 1] ** 2)
        if not drive(i, i + 1, landing, p.friction_force_n, line, envelope, p, v):
            return -1.0
    return trip_time(line.step_m, v)
