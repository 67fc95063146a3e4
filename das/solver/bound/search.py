"""The search for multipliers that prove a high bound."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.solver.bound.planes import MapPlanes, joined
from das.solver.bound.relaxation import Task, relaxation
from das.solver.kernels.interior_point import best_bound
from das.solver.kernels.loss_planes import MeanSpeeds
from das.solver.kernels.relaxed_interval import FIXED_ROWS
from das.solver.kernels.relaxed_tuples import Multipliers, Planes, Program, RelaxedRun

Floats = NDArray[np.float64]

MOST_STEPS: Final = 60
"""At most this number of Newton steps; 25 to 35 are usual."""
ENOUGH_RATIO: Final = 1e-5
"""The search ends where no bound of the relaxation can be higher by more than this share of the energy."""
MOST_CUTS: Final = 3
"""A loss map gets further planes at most this number of times."""
ENOUGH_CUT_RATIO: Final = 5e-4
"""It gets no more where the last ones raised the bound by less than this share."""
INSIDE: Final = 0.05
"""How far from its bounds the first point is, as a share of their width."""
LEAST_PRICE: Final = 1e-3
LARGEST_PRICE: Final = 1e3
"""The first price of time is between these, in units of force times speed."""
ROUNDING_RATIO: Final = 1e-9
"""The bound is lowered by this share of the sizes that it is the sum of, which is more than their rounding."""


class ProvenBound(NamedTuple):
    """A bound (J), the price of time at it (W), and the relaxed run at the end of the search with its forces in N."""

    bound_j: float
    lambda_w: float
    relaxed: RelaxedRun


def proven(task: Task, planes: Planes, lambda_w: float) -> ProvenBound:
    """The highest bound found for a task; `lambda_w` is a first guess of the price of time (W)."""
    program, scale_n = relaxation(task, planes)
    run = first_run(program, task.speeds_mps)
    multipliers = first_multipliers(program, lambda_w / scale_n)
    bound, price, _ = best_bound(run, multipliers, program, MOST_STEPS, ENOUGH_RATIO)
    slack = ROUNDING_RATIO * (abs(bound) + price * program.allowed_s)
    in_newton = RelaxedRun(run.w, run.local * np.array([1.0, scale_n, scale_n]))
    return ProvenBound((bound - slack) * scale_n, price * scale_n, in_newton)


def proven_for_map(task: Task, loss: LossMap, force_n: Floats, lambda_w: float) -> ProvenBound:
    """The highest bound found for a task with a loss map, near a run whose motors give `force_n` (N).

    After each search the relaxed run gets planes of its own, below which its energy cannot stay (cutting planes).
    """
    maker, price_w = MapPlanes(task, loss), task.mean_price_w
    planes = maker.of_run(force_n, price_w + lambda_w)
    best = proven(task, planes, lambda_w)
    last = best
    for _ in range(MOST_CUTS):
        w, local = last.relaxed
        if not (np.isfinite(local).all() and np.isfinite(w).all()):
            break
        state = MeanSpeeds(np.clip(local[:, 0], task.low_tau, task.high_tau), w[:-1] + w[1:])
        planes = joined(planes, maker.near(local[:, 1:2], state, price_w + last.lambda_w))
        last = proven(task, planes, last.lambda_w)
        gain_j = last.bound_j - best.bound_j
        best = max(best, last, key=lambda found: found.bound_j)
        if gain_j < ENOUGH_CUT_RATIO * abs(best.bound_j):
            break
    return best


def first_run(program: Program, speeds_mps: Floats) -> RelaxedRun:
    """The given run, moved a little away from every bound."""
    motion, efforts, planes, high_w = program.motion, program.efforts, program.planes, program.box.high_w
    given_w = 0.5 * speeds_mps**2
    w = np.where(program.box.free, np.clip(given_w, INSIDE * high_w, (1.0 - INSIDE) * high_w), given_w)
    v = np.sqrt(2.0 * w)
    tau = (1.0 + 0.1 * INSIDE) * 2.0 / (v[:-1] + v[1:])
    both = w[:-1] + w[1:]
    needed = motion.inertia * np.diff(w) + motion.constant + motion.linear / tau + motion.quadratic * both
    f = np.clip(needed + INSIDE, -(1.0 - INSIDE) * efforts.electric_force, (1.0 - INSIDE) * efforts.traction_force)
    heights = planes.force * f[:, None] + planes.slowness * tau[:, None] + planes.speed * both[:, None]
    return RelaxedRun(w, np.stack([tau, f, (heights + planes.constant).max(axis=1) + INSIDE], axis=1))


def first_multipliers(program: Program, price: float) -> Multipliers:
    """Multipliers to begin with: the planes share the weight of the energy, the slowness has the price of time.

    Those of the other constraints follow from the slacks (see `das.solver.kernels.interior_point`).
    """
    step, count = program.motion.step_m, program.planes.force.shape[1]
    rows = np.repeat(step[:, None], FIXED_ROWS + count, axis=1)
    rows[:, FIXED_ROWS:] /= count
    price = float(np.clip(price, LEAST_PRICE, LARGEST_PRICE))
    rows[:, 0] *= price
    return Multipliers(rows, np.array([price]))
