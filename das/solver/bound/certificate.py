"""The certificate of a run: an energy that no run of its time goes below, and how far the run is above it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.solver import tolerances as tol
from das.solver.bound.ahead import behind_fastest, fastest_is_ahead
from das.solver.bound.planes import efficiency_planes
from das.solver.bound.relaxation import Task
from das.solver.bound.search import proven, proven_for_map
from das.solver.section import LineProfile

if TYPE_CHECKING:
    from das.solver.solution import Solution

Floats = NDArray[np.float64]

NOT_FOUND: Final = "no multipliers were found that prove a bound"
LARGEST_PRICE_W: Final = 1e9
"""First guess of the price of time (W) for a run whose price is not known to be finite."""


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A lower bound of the energy that is proven, or the reason why there is none.

    No run of the integrator from the same state to the same end that keeps the limits and takes at most `allowed_s`
    needs less than `bound_j`. Where `reason` is not empty, `bound_j` is NaN.
    """

    bound_j: float
    allowed_s: float
    reason: str = ""


def certificate(solution: Solution) -> Certificate:
    """The certificate of a solution; 0.01 to 0.1 s for a section, 0.2 to 2 s with a loss map.

    A run of least energy ends before its time: then the bound holds for the time that was asked for.
    """
    allowed_s = solution.time_s
    if solution.fit == "early":
        allowed_s = max(allowed_s, solution.requested_s)
    reason = _unkept(solution)
    task = task_of(solution, allowed_s)
    if reason:
        return Certificate(bound_j=math.nan, allowed_s=allowed_s, reason=reason)
    if fastest_is_ahead(task):
        if math.isinf(solution.lambda_w):
            return Certificate(bound_j=solution.ledger.input, allowed_s=allowed_s)
        task = behind_fastest(task)
    bound_j = bound_of(task, solution.trajectory.force_el_n, min(solution.lambda_w, LARGEST_PRICE_W))
    if not math.isfinite(bound_j):
        return Certificate(bound_j=math.nan, allowed_s=allowed_s, reason=NOT_FOUND)
    return Certificate(bound_j=bound_j, allowed_s=allowed_s)


def bound_of(task: Task, force_n: Floats, lambda_w: float) -> float:
    """The bound of a task (J), near a run whose motors give `force_n` and about the price of time `lambda_w`."""
    loss = task.section.loss
    if isinstance(loss, LossMap):
        return proven_for_map(task, loss, force_n, lambda_w).bound_j
    return proven(task, efficiency_planes(loss, task.line.supply), lambda_w).bound_j


def task_of(solution: Solution, allowed_s: float) -> Task:
    """What is to be bounded for a solution: every run from its state that takes at most a time (s)."""
    run, section = solution.trajectory, solution.section
    line = LineProfile(
        node_m=run.s_m,
        step_m=np.diff(run.s_m),
        grade_ratio=run.grade_ratio,
        constant_n=run.grade_and_curve_n,
        tunnel_n_per_mps2=run.tunnel_n_per_mps2,
        limit_mps=run.limit_mps,
        supply=run.supply,
    )
    envelope = section.envelope_mps[-len(run.v_mps) :]
    return Task(section=section, line=line, envelope_mps=envelope, speeds_mps=run.v_mps, allowed_s=allowed_s)


def _unkept(solution: Solution) -> str:
    """Which condition of the proof a run does not keep; empty where it keeps them all."""
    section, speeds = solution.section, solution.trajectory.v_mps
    if (speeds > section.envelope_mps[-len(speeds) :] + tol.SPEED_TOLERANCE_MPS).any():
        return "the run begins above the braking envelope"
    if not solution.feasible:
        return "the run does not keep the limits or the speed at the end"
    return ""
