"""The solver's steps written plainly in numpy: the baselines of the bench, and witnesses in its tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.search import TimeSearch
from das.solver.solve import Transitions
from das.solver.state import State

Floats = NDArray[np.float64]

LADDER_TOLERANCE = 1e-4
"""`bisected` ends when it has narrowed a jump to this part of a step of the ladder."""


def numpy_sweep(moves: Transitions, lambda_w: Floats) -> tuple[Floats, Floats]:
    """Values (J) and times-to-go (s) of every state and multiplier as `Front` holds them, from the end of a section."""
    n, states = moves.count.shape
    shape = (n + 1, states, len(lambda_w))
    value, time_to_go = np.zeros(shape), np.zeros(shape)
    for k in range(n - 1, -1, -1):
        value[k], time_to_go[k] = tol.INFEASIBLE, tol.INFEASIBLE
        for i in range(moves.count[k].max(initial=0)):
            here = np.flatnonzero(moves.count[k] > i)
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
    """Speeds and time of the run nearest to a wanted time that bisection of λ over the whole ladder finds."""
    state = State.at(front.section)
    search = TimeSearch(front.policies, state, time_s, quickest=state.fastest())
    low, high = 0.0, float(len(front.lambda_w) - 1)
    while True:
        trial = search.attempt(0.5 * (low + high))
        if abs(trial.miss_s) <= tol.TIME_TOLERANCE_S or high - low < LADDER_TOLERANCE:
            return trial.run.speeds_mps, trial.run.time_s
        low, high = (trial.place, high) if trial.miss_s > 0 else (low, trial.place)
