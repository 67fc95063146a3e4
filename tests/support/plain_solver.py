"""Simple versions of the solver's steps, as references for tests."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver import tolerances as tol
from das.solver.front import Front, TimeSearch
from das.solver.kernels.forces import on_supply
from das.solver.kernels.landings import LANDINGS, landings, step_cost
from das.solver.kernels.policy_values import grid_speed, locate
from das.solver.kernels.sweep import backward_sweep
from das.solver.kernels.tuples import Moves
from das.solver.section import Section
from das.solver.solve import BLOCK_NODES, DecisionGrid, default_ladder, empty_moves, in_parts, part_of
from das.solver.state import State

Floats = NDArray[np.float64]

LADDER_TOLERANCE = 1e-4
"""Share of a ladder step to which `bisected` narrows a jump."""


def plain_front(section: Section, threads: int) -> Front:
    """The front, with transitions computed one speed at a time, by this number of threads."""
    grid, ladder = DecisionGrid.of(section), default_ladder(section)
    n, states = len(grid.node_m) - 1, section.speed_steps + 1
    value = np.empty((n + 1, states, len(ladder)))
    time_to_go = np.empty(value.shape, np.float32)
    value[-1], time_to_go[-1] = 0.0, 0.0
    space = empty_moves(min(BLOCK_NODES, n), states)

    def fill(first: int, last: int, start: int) -> None:
        plain_transitions(
            start + first, start + last, grid.line, grid.bounds, section.speed_steps, section.train,
            section.loss_params, part_of(space, first, last),
        )  # fmt: skip

    with ThreadPoolExecutor(threads) as pool:
        for end in range(n, 0, -BLOCK_NODES):
            start = max(end - BLOCK_NODES, 0)
            in_parts(pool, threads, end - start, fill, start)
            swept = part_of(space, 0, end - start), value[start : end + 1], time_to_go[start : end + 1]
            in_parts(pool, threads, len(ladder), backward_sweep, ladder, *swept)
    return Front(section=section, lambda_w=ladder, value_j=value, time_to_go_s=time_to_go)


def numpy_sweep(moves: Moves, lambda_w: Floats) -> tuple[Floats, Floats]:
    """Values (J) and times-to-go (s) of every state and multiplier as in `Front`, from the end of a section."""
    n, states = moves.filled.shape
    shape = (n + 1, states, len(lambda_w))
    value, time_to_go = np.zeros(shape), np.zeros(shape)
    for k in range(n - 1, -1, -1):
        value[k], time_to_go[k] = tol.INFEASIBLE, tol.INFEASIBLE
        for i in range(moves.filled[k].max(initial=0)):
            here = np.flatnonzero(moves.filled[k] > i)
            below = moves.target[k, here, i].astype(np.intp)
            share = moves.weight[k, here, i, np.newaxis].astype(float)
            step_s = moves.time_s[k, here, i, np.newaxis].astype(float)
            cost = moves.energy_j[k, here, i, np.newaxis] + lambda_w * step_s
            cost += (1 - share) * value[k + 1, below] + share * value[k + 1, below + 1]
            time_s = step_s + (1 - share) * time_to_go[k + 1, below] + share * time_to_go[k + 1, below + 1]
            better = cost < value[k, here]
            value[k, here] = np.where(better, cost, value[k, here])
            time_to_go[k, here] = np.where(better, time_s, time_to_go[k, here])
        unreachable = value[k] > tol.UNREACHABLE
        value[k][unreachable], time_to_go[k][unreachable] = tol.INFEASIBLE, tol.INFEASIBLE
    return value, time_to_go


def bisected(front: Front, time_s: float) -> tuple[Floats, float]:
    """Speeds and time of the run nearest to a requested time, by bisection of λ over the whole ladder."""
    state = State.at(front.section)
    search = TimeSearch(front.policies, state, time_s, tol.TIME_TOLERANCE_S)
    low, high = 0.0, float(len(front.lambda_w) - 1)
    while True:
        trial = search.attempt(0.5 * (low + high))
        if abs(trial.miss_s) <= tol.TIME_TOLERANCE_S or high - low < LADDER_TOLERANCE:
            return trial.run.speeds_mps, trial.run.time_s
        low, high = (trial.place, high) if trial.miss_s > 0 else (low, trial.place)


@kernel
def plain_transitions(first, last, line, bounds, steps, p, c, moves):
    """All transitions of the decision nodes first … last − 1, as in `das.solver.kernels.transitions.transitions`."""
    floor, envelope = bounds
    dt, energy, target, weight, count = moves
    n = line.step_m.size
    out = np.empty(LANDINGS)
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        here = on_supply(p, line.supply[k])
        top = envelope[k + 1]
        final = k == n - 1 and floor[k + 1] >= top
        row = k - first
        for j in range(steps + 1):
            v0 = grid_speed(floor[k], envelope[k], j, steps)
            count[row, j] = 0
            if v0 <= 0.0:
                continue
            m = landings(v0, h, g, q, top, final, here, out)
            used = 0
            for i in range(m):
                v1 = out[i]
                lower = 0
                share = 0.0
                if not final:
                    lower, share = locate(v1, floor[k + 1], top, steps)
                    if lower < 0:
                        continue
                a, b = step_cost(v0, v1, h, g, q, here, c)
                dt[row, j, used] = a
                energy[row, j, used] = b
                target[row, j, used] = lower
                weight[row, j, used] = share
                used += 1
            count[row, j] = used
