"""The certificate of a run: a lower bound of the energy of every run that takes no more time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.domain.trajectory import EnergyBalance, Trajectory
from das.offline.bound.relaxation import MapPlanes, Task, acceleration_limits, efficiency_planes, joined, relaxation
from das.offline.kernels.interior_point import best_bound
from das.offline.kernels.relaxed_program import FIXED_ROWS, MeanSpeeds, Multipliers, Planes, Program, RelaxedRun
from das.solver import tolerances as tol
from das.solver.kernels.forces import TRACTION, adhesion_coefficient
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import CURVE_STEPS_PER_MPS, NO_LIMIT_N, TrainParams
from das.solver.line_profile import LineProfile
from das.solver.section import Section

Floats = NDArray[np.float64]


def fastest_is_ahead(task: Task) -> bool:
    """Whether it is certain that no run exceeds the speed of the fastest one anywhere.

    This holds if the speed after an interval at full traction rises with the speed before it. For that, the force that
    a faster start takes from the motors and adds to the resistance must be below the inertia
    (`docs/explanation/bounds.md`).
    """
    train, line = task.section.train, task.line
    if not _never_slips(train) or not _keeps_acceleration(task):
        return False
    motors = max(train.traction_force_n**3 / train.traction_power_w**2, _bend_of_curve(train))
    lost = motors + train.c2_n_per_mps2 + line.tunnel_n_per_mps2
    lost_in_all = line.step_m * lost + (2.0 / 3.0) * abs(train.c1_n_per_mps) * task.allowed_s
    return bool((lost_in_all < train.inertial_mass_kg).all())


def behind_fastest(task: Task) -> Task:
    """The same task with the speed bounded by the fastest run; valid only if `fastest_is_ahead`."""
    speeds = np.empty_like(task.envelope_mps)
    speeds[0] = task.speeds_mps[0]
    fastest_roll_out(task.line.for_kernels, task.envelope_mps, task.section.train, speeds)
    return replace(task, envelope_mps=np.minimum(task.envelope_mps, speeds))


def _bend_of_curve(train: TrainParams) -> float:
    """The largest change of the force of the traction's effort curve with v²/2 (N/(m²/s²)); 0 without a curve.

    That is the slope of the curve over the speed: infinite where the force changes from standstill on.
    """
    if not train.has_curves:
        return 0.0
    slope = np.abs(np.diff(train.curves_n[TRACTION])) * CURVE_STEPS_PER_MPS
    changes = slope > 0.0
    slower_mps = np.arange(len(slope))[changes] / CURVE_STEPS_PER_MPS
    with np.errstate(divide="ignore"):
        return float((slope[changes] / slower_mps).max(initial=0.0))


def _never_slips(train: TrainParams) -> bool:
    """Whether force or power, and never adhesion, limits the traction at every speed."""
    if train.adhesive_force_n >= NO_LIMIT_N:
        return True
    corner_mps = train.traction_power_w / max(train.traction_force_n, 1.0)
    return bool(train.adhesive_force_n * adhesion_coefficient(corner_mps) >= train.traction_force_n)


def _keeps_acceleration(task: Task) -> bool:
    """Whether the brakes can hold the train to its largest acceleration on every descent, if it has such a limit."""
    train, line = task.section.train, task.line
    lowest_n = train.c0_n + line.constant_n + min(train.c1_n_per_mps, 0.0) * float(task.envelope_mps.max())
    limits = acceleration_limits(task, lowest_n)
    return bool((limits < NO_LIMIT_N).all()) or train.max_acceleration_mps2 >= 1e5


MOST_STEPS: Final = 60
"""Maximum number of Newton steps; 25 to 35 are usual."""
ENOUGH_RATIO: Final = 1e-5
"""Tolerance of the search: the largest possible increase of the bound, as a share of the energy, when it ends."""
MOST_CUTS: Final = 3
"""Maximum number of rounds in which planes are added for a loss map."""
ENOUGH_CUT_RATIO: Final = 5e-4
"""Relative increase of the bound by the last planes below which no more are added."""
INSIDE: Final = 0.05
"""Distance of the first point from its bounds, as a share of their width."""
ROUNDING_RATIO: Final = 1e-9
"""Share of the magnitudes of its terms by which the bound is lowered, to cover rounding errors."""
LEAST_PRICE: Final = 1e-3
LARGEST_PRICE: Final = 1e3
"""Range of the first price of time, in units of force times speed."""


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

    After each search, planes that bound the energy from below are added near the relaxed run (cutting planes).
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
    """Initial multipliers: the planes share the weight of the energy, the slowness has the price of time.

    The multipliers of the other constraints follow from the slacks (see `das.offline.kernels.interior_point`).
    """
    step, count = program.motion.step_m, program.planes.force.shape[1]
    rows = np.repeat(step[:, None], FIXED_ROWS + count, axis=1)
    rows[:, FIXED_ROWS:] /= count
    price = float(np.clip(price, LEAST_PRICE, LARGEST_PRICE))
    rows[:, 0] *= price
    return Multipliers(rows, np.array([price]))


NOT_FOUND: Final = "no multipliers were found that prove a bound"
LARGEST_PRICE_W: Final = 1e9
"""First guess of the price of time (W) for a run whose price is not known to be finite."""


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """A proven lower bound of the energy, or the reason why there is none.

    No run of the integrator from the same state to the same end that keeps the limits and takes at most `allowed_s`
    needs less than `bound_j`. If there is a `reason`, `bound_j` is NaN.
    """

    bound_j: float
    allowed_s: float
    reason: str = ""


class BoundedRun(Protocol):
    """A run with everything that its certificate needs, such as a `das.solver.solution.Solution`."""

    @property
    def section(self) -> Section:
        """The section of the run: line, train and losses."""

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory of the run."""

    @property
    def balance(self) -> EnergyBalance:
        """The energy balance of the run (J)."""

    @property
    def time_s(self) -> float:
        """The time that the run takes (s)."""

    @property
    def requested_s(self) -> float:
        """The time that was asked for when the run was solved (s)."""

    @property
    def saves_time(self) -> bool:
        """Whether this is the run of least energy, which ends before the time that was asked for."""

    @property
    def lambda_w(self) -> float:
        """The run's price of time (W)."""

    @property
    def feasible(self) -> bool:
        """Whether the run keeps the limits and the speed at the end."""


def certificate(solution: BoundedRun) -> Certificate:
    """The certificate of a solution; proving it takes 0.01 to 0.1 s for a section, 0.2 to 2 s with a loss map.

    If the run of least energy ends early, the bound holds for the time that was asked for.
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
            return Certificate(bound_j=solution.balance.input, allowed_s=allowed_s)
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


def task_of(solution: BoundedRun, allowed_s: float) -> Task:
    """The task of bounding a solution: every run from its state that takes at most `allowed_s`."""
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
    """Which condition of the proof a run violates; empty if it meets them all."""
    section, speeds = solution.section, solution.trajectory.v_mps
    if (speeds > section.envelope_mps[-len(speeds) :] + tol.SPEED_TOLERANCE_MPS).any():
        return "the run begins above the braking envelope"
    if not solution.feasible:
        return "the run does not keep the limits or the speed at the end"
    return ""
