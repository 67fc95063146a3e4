"""Simulation of the run that follows a policy over instructions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver.kernels.forces import on_supply
from das.solver.kernels.guide_policy import (
    CODE,
    CONTACT_MPS,
    HOLDS,
    KINDS,
    NO_INSTRUCTION,
    ON_CURVE,
    ROLLS,
    ROLLS_UP,
    SAME_MPS,
    SHARES,
    STANDS_S,
    WORD,
    top_line,
)
from das.solver.kernels.schedule import BRAKE, followed_speed, followed_step

STALLED = -1
"""The value for a train that has stopped before the end."""


class FineCurve(NamedTuple):
    """The final speed of the braking curve of each integration node, its number X and the distance to it (m)."""

    goal_mps: NDArray[np.float64]
    goal_x: NDArray[np.int64]
    way_m: NDArray[np.float64]


@kernel
def nearest_line(v, line_mps, top):
    """The line of a node nearest to a speed; a moving train is never on the line of standstill."""
    if v >= top - 0.25 * line_mps:
        return top_line(top, line_mps)
    return min(max(int(v / line_mps + 0.5), 1 if v > 0.0 else 0), top_line(top, line_mps))


@kernel
def now_held(now, v, goal_mps, goal_x, speeds):
    """The instruction at a speed: hold, once the speed to which it leads is reached, else unchanged."""
    m, x = now % CODE, now // CODE
    if now == NO_INSTRUCTION or m == HOLDS:
        return now
    if m == ON_CURVE:
        return goal_x * CODE + HOLDS if goal_x >= 0 and v <= goal_mps + CONTACT_MPS else now
    reached = v >= speeds[x] - SAME_MPS if m < ROLLS or m == ROLLS_UP else v <= speeds[x] + SAME_MPS
    return x * CODE + HOLDS if reached else now


@kernel
def chosen_anew(now, chosen, stays, anew, last):
    """The instruction from a decision node on, for a train in instruction `now` whose best new one is `chosen`.

    `stays`: the policy keeps `now`; `anew`: a new instruction is chosen all the same.
    """
    if now == NO_INSTRUCTION:
        return chosen
    # The braking curve may be ahead by less than a line; the train continues until it meets the curve.
    waits = chosen % CODE == ON_CURVE and KINDS[now % CODE] != BRAKE and not last
    return now if (stays and not anew) or waits or chosen == NO_INSTRUCTION else chosen


@kernel
def guide_roll_out(nodes, k0, decision, line, envelope, curve, grid, p, row0, policy, told, anew, v, said):
    """Follow a policy from node nodes[0] to nodes[1] of `decision`; `said` receives the instruction of every interval.

    `decision` contains the integration nodes of the decision nodes k0, k0 + 1, …; row 0 of the policy is decision node
    `row0`. `told` is the current instruction and its age (s); `anew`: the policy chooses now. Returns the last
    instruction (`STALLED` after a stall) and its age (s).
    """
    speeds, line_mps = grid.speeds_mps, grid.line_mps
    now, age_s = told
    step, g, q, u = line
    for d in range(nodes[0], nodes[1]):
        k, i0 = k0 + d, decision[d]
        now = now_held(now, v[i0], curve.goal_mps[i0], curve.goal_x[i0], speeds)
        j = nearest_line(v[i0], line_mps, grid.envelope_mps[k])
        m, x = now % CODE, now // CODE
        stays = (
            now != NO_INSTRUCTION
            and x < speeds.size
            and (policy.stay[k - row0, j, m, 1 if age_s < STANDS_S else 0, x // WORD] >> np.uint32(x % WORD))
            & np.uint32(1)
            > 0
        )
        chosen = np.int64(policy.choice[k - row0, j])
        new = chosen_anew(now, chosen, stays, anew and d == nodes[0], k == grid.line.step_m.size - 1)
        if new == NO_INSTRUCTION:
            new = (speeds.size - 1) * CODE  # The policy has no feasible instruction: drive as fast as possible.
        now, age_s = new, age_s if new == now else 0.0
        for i in range(i0, decision[d + 1]):
            now = now_held(now, v[i], curve.goal_mps[i], curve.goal_x[i], speeds)
            m, way, ends = now % CODE, curve.way_m[i], (envelope[i], envelope[i + 1])
            if m != ON_CURVE and envelope[i + 1] < v[i] - SAME_MPS:
                # Brake for a limit ahead that the instruction would exceed.
                phase = KINDS[m], SHARES[m], speeds[now // CODE]
                here = step, g, q, on_supply(p, u[i])
                if followed_speed(i, phase, way, here, ends, v[i]) > envelope[i + 1] + CONTACT_MPS:
                    now, m, age_s = ON_CURVE, ON_CURVE, 0.0
            target = curve.goal_mps[i] if m == ON_CURVE else speeds[now // CODE]
            took = followed_step(i, (KINDS[m], SHARES[m], target), way, line, envelope, p, v)
            if took < 0.0:
                return STALLED, 0.0
            said[i] = now
            age_s += took
    return now, age_s
