"""The certificate of a run: an energy that no run of its time goes below, and how far the run is above it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.domain.trajectory import Ledger, Trajectory
from das.solver import tolerances as tol
from das.solver.bound.ahead import behind_fastest, fastest_is_ahead
from das.solver.bound.cells import SETTINGS as TIGHT
from das.solver.bound.cells import Incumbent, tightened_j
from das.solver.bound.planes import efficiency_planes
from das.solver.bound.relaxation import Task
from das.solver.bound.search import proven, proven_for_map
from das.solver.line_profile import LineProfile
from das.solver.section import Section

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


class BoundedRun(Protocol):
    """What is known of a run that is to be bounded, as a `das.solver.solution.Solution` has it."""

    @property
    def section(self) -> Section:
        """Line, train and losses."""

    @property
    def trajectory(self) -> Trajectory:
        """The run."""

    @property
    def ledger(self) -> Ledger:
        """Where its energy goes (J)."""

    @property
    def time_s(self) -> float:
        """How long it takes (s)."""

    @property
    def requested_s(self) -> float:
        """The time that was asked for (s)."""

    @property
    def saves_time(self) -> bool:
        """Whether it is the run of least energy, and ends before the time that was asked for."""

    @property
    def lambda_w(self) -> float:
        """Its price of time (W)."""

    @property
    def feasible(self) -> bool:
        """Whether it keeps the limits and the speed at the end."""


def certificate(solution: BoundedRun, tight_s: float = 0.0) -> Certificate:
    """The certificate of a solution; 0.01 to 0.1 s for a section, 0.2 to 2 s with a loss map.

    With a loss map, a search of about `tight_s` seconds more can raise the bound (see `das.solver.bound.cells`); with
    constant efficiencies there is nothing to raise. A run of least energy ends before its time: then the bound holds
    for the time that was asked for.
    """
    allowed_s = solution.time_s
    if solution.saves_time:
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
    if tight_s > 0:
        bound_j = _raised_j(task, solution, bound_j, tight_s)
    if not math.isfinite(bound_j):
        return Certificate(bound_j=math.nan, allowed_s=allowed_s, reason=NOT_FOUND)
    return Certificate(bound_j=bound_j, allowed_s=allowed_s)


def _raised_j(task: Task, solution: BoundedRun, bound_j: float, tight_s: float) -> float:
    """The bound (J) that cells of speeds prove in a time (s), or the one given where that is higher or good enough."""
    loss, energy_j = task.section.loss, solution.ledger.input
    if not isinstance(loss, LossMap) or energy_j - bound_j <= TIGHT.enough_ratio * abs(energy_j):
        return bound_j
    incumbent = Incumbent(energy_j, min(solution.lambda_w, LARGEST_PRICE_W))
    tight_j = tightened_j(task, loss, incumbent, tight_s)
    return max(tight_j, bound_j) if math.isfinite(bound_j) else tight_j


def bound_of(task: Task, force_n: Floats, lambda_w: float) -> float:
    """The bound of a task (J), near a run whose motors give `force_n` and about the price of time `lambda_w`."""
    loss = task.section.loss
    if isinstance(loss, LossMap):
        return proven_for_map(task, loss, force_n, lambda_w).bound_j
    return proven(task, efficiency_planes(loss, task.line.supply), lambda_w).bound_j


def task_of(solution: BoundedRun, allowed_s: float) -> Task:
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


def _unkept(solution: BoundedRun) -> str:
    """Which condition of the proof a run does not keep; empty where it keeps them all."""
    section, speeds = solution.section, solution.trajectory.v_mps
    if (speeds > section.envelope_mps[-len(speeds) :] + tol.SPEED_TOLERANCE_MPS).any():
        return "the run begins above the braking envelope"
    if not solution.feasible:
        return "the run does not keep the limits or the speed at the end"
    return ""
