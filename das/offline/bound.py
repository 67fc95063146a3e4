"""Proven lower bounds of energy (`docs/explanation/bounds.md`): the convex relaxation of a section's runs, with every
limit rounded to the safe side, and the certificate of a run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.effort import EffortEnvelope
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.route import NEUTRAL
from das.offline.bound_kernels import (
    FIXED_ROWS,
    Box,
    MapRows,
    MeanSpeeds,
    Multipliers,
    Planes,
    Program,
    RelaxedEfforts,
    RelaxedMotion,
    RelaxedRun,
    best_bound,
    loss_planes,
    row_hulls,
)
from das.solver import tolerances as tol
from das.solver.kernels.forces import ELECTRIC, TRACTION, adhesion_coefficient, brake_limit, on_supply
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import CURVE_STEPS_PER_MPS, NO_LIMIT_N, TrainParams
from das.solver.line_profile import LineProfile
from das.solver.section import Section
from das.solver.solution import Solution
from das.solver.state import State

Floats = NDArray[np.float64]

LEAST_FORCE_N: Final = 0.1
"""Force (N) that the relaxation allows a train without motors or electric brake: the set of allowed forces then has an
interior, as the method requires, and over 10 km such a force yields only 0.0003 kWh."""
LEAST_POWER_W: Final = 1.0
"""The least power (W) of motors and of the electric brake, for the same reason."""
LEAST_START_SHARE: Final = 0.05
"""Least share of the faster speed that the slower speed of a cut must have for the cut of the power limit to be used;
otherwise the force limit is the lower one."""
ROUNDING_RATIO: Final = 1e-9
"""Ratio by which runs may exceed their limits by rounding, which the relaxation therefore allows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """The runs to bound: those with the speeds of a given run at both ends that take at most `allowed_s`.

    `line` is the section or its part from the state of the train on, `envelope_mps` the fastest speed at its nodes, and
    `speeds_mps` the given run, at which the cuts of the relaxation are made.
    """

    section: Section
    line: LineProfile
    envelope_mps: Floats
    speeds_mps: Floats
    allowed_s: float
    price_w: Floats | None = None
    """A price of time (W) of each interval that counts as energy, added to the price that the bound finds; None: 0."""

    @cached_property
    def high_w(self) -> Floats:
        """Largest v²/2 of each node (m²/s²)."""
        high = 0.5 * (self.envelope_mps + tol.SPEED_TOLERANCE_MPS) ** 2
        high[[0, -1]] = 0.5 * self.speeds_mps[[0, -1]] ** 2
        return high

    @cached_property
    def low_tau(self) -> Floats:
        """Least slowness of each interval (s/m): at the largest speeds."""
        fastest = np.sqrt(2.0 * self.high_w)
        return np.asarray(2.0 / (fastest[:-1] + fastest[1:]))

    @cached_property
    def high_tau(self) -> Floats:
        """Largest slowness of each interval (s/m), reached if all other intervals are driven in the least time."""
        spare_s = max(self.allowed_s - float(self.line.step_m @ self.low_tau), 0.0)
        return np.asarray(self.low_tau + spare_s / self.line.step_m)


class _Cut(NamedTuple):
    """A limit of a force by a power (N·s/m and N): force <= slope·slowness + offset."""

    slope: Floats
    offset: Floats


def relaxation(task: Task, planes: Planes) -> tuple[Program, float]:
    """The relaxation of a task, and its unit of force (N).

    The energy per metre (N) of a run is nowhere below `planes`.
    """
    section, line = task.section, task.line
    train, step = section.train, line.step_m
    scale_n = max(train.traction_force_n, 1.0)
    high_w = task.high_w
    resistance = _resistance(task)
    traction_n, electric_n = force_limits(task)
    traction = _power_cut(task, max(train.traction_power_w, LEAST_POWER_W), resistance.highest_n)
    electric = _power_cut(task, max(train.electric_power_w, LEAST_POWER_W), -resistance.lowest_n)
    if train.has_curves:
        traction = _tighter(task, traction, _curve_cut(task, train.curves_n[TRACTION]))
        electric = _tighter(task, electric, _curve_cut(task, train.curves_n[ELECTRIC]))
    free = np.ones(len(high_w), np.bool_)
    free[[0, -1]] = False
    adhesive = train.adhesive_force_n
    motion = RelaxedMotion(
        step_m=np.ascontiguousarray(step),
        inertia=train.inertial_mass_kg / step / scale_n,
        constant=resistance.constant_n / scale_n,
        linear=resistance.linear / scale_n,
        quadratic=resistance.quadratic / scale_n,
        max_acceleration=acceleration_limits(task, resistance.lowest_n),
    )
    efforts = RelaxedEfforts(
        traction_force=traction_n / scale_n,
        traction_power=traction.slope / scale_n,
        traction_offset=traction.offset / scale_n,
        electric_force=electric_n / scale_n,
        electric_power=electric.slope / scale_n,
        electric_offset=electric.offset / scale_n,
        adhesive_force=adhesive * (1.0 + ROUNDING_RATIO) / scale_n if adhesive < NO_LIMIT_N else -1.0,
    )
    box = Box(high_w, free, task.low_tau, task.high_tau)
    slowness = planes.slowness if task.price_w is None else planes.slowness + task.price_w[:, None]
    planes = Planes(planes.force, slowness / scale_n, planes.speed / scale_n, planes.constant / scale_n)
    program = Program(motion, efforts, box, planes, float(task.allowed_s))
    return program, scale_n


class _Resistance(NamedTuple):
    """Resistance over an interval: at least constant_n + linear/τ + quadratic·(w0 + w1), in N.

    If the linear part is negative (a tail wind), the mean speed is bounded from above by a tangent of the square root;
    the tangent is linear in w. `highest_n` and `lowest_n` bound the resistance of every run.
    """

    constant_n: Floats
    linear: Floats
    quadratic: Floats
    highest_n: Floats
    lowest_n: Floats


def _resistance(task: Task) -> _Resistance:
    train, line, high_w = task.section.train, task.line, task.high_w
    constant = train.c0_n + line.constant_n
    quadratic = train.c2_n_per_mps2 + line.tunnel_n_per_mps2
    linear = np.full_like(constant, max(train.c1_n_per_mps, 0.0))
    pushed = min(train.c1_n_per_mps, 0.0)
    fastest = np.sqrt(2.0 * np.maximum(high_w[:-1], high_w[1:]))
    at_mps = np.maximum(0.5 * (task.speeds_mps[:-1] + task.speeds_mps[1:]), tol.CREEP_MPS)
    return _Resistance(
        constant_n=constant + 0.5 * pushed * at_mps,
        linear=linear,
        quadratic=quadratic + 0.5 * pushed / at_mps,
        highest_n=constant + linear * fastest + quadratic * (high_w[:-1] + high_w[1:]),
        lowest_n=constant + pushed * fastest,
    )


def force_limits(task: Task) -> tuple[Floats, Floats]:
    """Largest traction and largest electric brake of each interval (N)."""
    train, supply = task.section.train, task.line.supply
    has_electric = (supply >= 0) & (not train.brakes_dissipate)
    traction = np.where(supply == NEUTRAL, 0.0, train.traction_force_n * (1.0 + ROUNDING_RATIO))
    electric = np.where(has_electric, train.electric_force_n * (1.0 + ROUNDING_RATIO), 0.0)
    return np.maximum(traction, LEAST_FORCE_N), np.maximum(electric, LEAST_FORCE_N)


def _slowness(task: Task) -> Floats:
    """The mean slowness τ of each interval in the given run (s/m)."""
    return 2.0 / np.maximum(task.speeds_mps[:-1] + task.speeds_mps[1:], tol.CREEP_MPS)


def _power_cut(task: Task, power_w: float, resisting_n: Floats) -> _Cut:
    """The power limit at the faster end of an interval as a limit that is linear in the slowness.

    A force F > `resisting_n` changes the speed, so that the faster end is faster than the mean: F is at most the root
    of F + G·F·(F − R) = P·τ with G = h·τ²/2M. The root is concave in τ, so its tangent at the given run bounds it. If
    the given run is too slow for the tangent, P·τ itself is the limit.
    """
    power_w *= 1.0 + ROUNDING_RATIO
    step, mass_kg = task.line.step_m, task.section.train.inertial_mass_kg
    tau = _slowness(task)
    bend = 0.5 * step * tau**2 / mass_kg
    rest = 1.0 - bend * resisting_n
    force = 2.0 * power_w * tau / (rest + np.sqrt(rest**2 + 4.0 * bend * power_w * tau))
    fast = power_w / force
    slow = 2.0 / tau - fast
    usable = (power_w * tau > resisting_n) & (slow > LEAST_START_SHARE * fast)
    change = (fast + step * power_w / (mass_kg * fast**2)) / np.where(usable, slow, 1.0)
    slope = np.where(usable, 2.0 * power_w / (fast**2 * tau**2 * (1.0 + change)), power_w)
    return _Cut(slope, np.where(usable, force - slope * tau, 0.0))


def _curve_cut(task: Task, samples_n: Floats) -> _Cut:
    """The limit of an effort curve at the faster end of an interval, as a limit that is linear in the slowness.

    The faster end is faster than the mean 1/τ, so the force is at most M(1/τ), where M(v) is the largest force of the
    curve from the speed v on. M(1/τ) rises with τ; the steps from one sample to the next lie above it. A line over
    their concave hull bounds it: of all sides of the hull, the one that is lowest at the given run.
    """
    most_n = np.maximum.accumulate(samples_n[::-1])[::-1]
    last_mps = (len(most_n) - 1) / CURVE_STEPS_PER_MPS
    tau = np.append(CURVE_STEPS_PER_MPS / np.arange(1, len(most_n)), 1.0 / (last_mps + 1.0))[::-1].copy()
    psi = -most_n[::-1][None, :].copy()
    hull_tau, hull_psi, count = np.empty_like(psi), np.empty_like(psi), np.empty(1, np.int64)
    row_hulls(tau, psi, np.zeros(1, np.int64), np.array([len(tau) - 1]), hull_tau, hull_psi, count)
    at_tau, at_n = hull_tau[0, : count[0]], -hull_psi[0, : count[0]]
    slope = np.append(np.diff(at_n) / np.diff(at_tau), 0.0).clip(min=0.0)
    offset = at_n - slope * at_tau
    run_tau = _slowness(task)
    lowest = np.argmin(run_tau[:, None] * slope + offset, axis=1)
    return _Cut(slope[lowest] * (1.0 + LIMIT_SLACK), offset[lowest] + LIMIT_SLACK * np.abs(offset[lowest]))


def _tighter(task: Task, one: _Cut, other: _Cut) -> _Cut:
    """The cut of each interval that is lower at the given run."""
    tau = _slowness(task)
    lower = one.slope * tau + one.offset <= other.slope * tau + other.offset
    return _Cut(np.where(lower, one.slope, other.slope), np.where(lower, one.offset, other.offset))


def least_brake_n(train: TrainParams, fastest_mps: float) -> float:
    """The least force (N) of all brakes at any speed up to the fastest one."""
    speeds_mps = [fastest_mps]
    if train.has_curves:
        size = int(fastest_mps * CURVE_STEPS_PER_MPS) + 1
        speeds_mps += [int(np.argmin(train.curves_n[ELECTRIC, :size])) / CURVE_STEPS_PER_MPS]
    return min(float(brake_limit(v_mps, train, train.friction_force_n)) for v_mps in speeds_mps)


def acceleration_limits(task: Task, lowest_n: Floats) -> Floats:
    """Largest acceleration of each interval (m/s²); no limit where a descent is too steep for the brakes to keep it."""
    train = task.section.train
    fastest_mps = float(task.envelope_mps.max()) + tol.SPEED_TOLERANCE_MPS
    weakest_n = np.array([least_brake_n(on_supply(train, u), fastest_mps) for u in task.line.supply])
    kept = -(weakest_n + lowest_n) <= train.max_acceleration_mps2 * train.inertial_mass_kg
    return np.where(kept, train.max_acceleration_mps2 * (1.0 + ROUNDING_RATIO), NO_LIMIT_N)


NEAR_FORCES_N: Final = (0.0, 8e3, -8e3)
"""Distances (N) from the force of the given run at which a loss map gets planes."""
NEAR_COASTING_N: Final = (-500.0, 500.0)
"""Forces (N) at which a loss map gets planes on both sides of coasting, in addition to half of the largest forces."""
LIMIT_SLACK: Final = 1e-6
"""Ratio by which runs may exceed the limits of their forces by rounding."""


def efficiency_planes(loss: EfficiencyLoss, supply: Floats) -> Planes:
    """The planes (N) of constant efficiencies and an idle power; the line takes the share `supply` of what is fed back.

    The energy per metre is the larger of gross and share·gross, and gross the larger of (1 + a)·f + idle·τ and
    (1 − b)·f + idle·τ: together exactly the largest of three planes, or of two if the share is 1.
    """
    share = np.clip(supply, 0.0, 1.0)
    one = np.ones_like(share)
    driving, braking = 1.0 + loss.traction_ratio, 1.0 - loss.brake_ratio
    kinds = [(one, driving), (one, braking)] + ([] if (share == 1.0).all() else [(share, braking)])
    force = np.stack([weight * slope for weight, slope in kinds], axis=1)
    slowness = np.stack([weight * loss.idle_w for weight, _ in kinds], axis=1)
    return Planes(force, slowness, np.zeros_like(force), np.zeros_like(force))


class MapPlanes:
    """Planes (N) below the energy of a loss map for a task.

    If the line does not take all that is fed back, each plane also occurs multiplied by the share that it takes.
    """

    def __init__(self, task: Task, loss: LossMap) -> None:
        self.task = task
        self._rows = map_rows(task, loss)

    def of_run(self, force_n: Floats, lambda_w: float) -> Planes:
        """Planes near the given run, whose motors give `force_n` in each interval, at a price of time (W)."""
        train, speeds = self.task.section.train, self.task.speeds_mps
        offsets = [force_n + offset for offset in NEAR_FORCES_N]
        fixed = [*NEAR_COASTING_N, 0.5 * train.traction_force_n, -0.5 * train.electric_force_n]
        forces = np.stack(offsets + [np.full_like(force_n, force) for force in fixed], axis=1)
        squares = 0.5 * speeds**2
        state = MeanSpeeds(2.0 / (speeds[:-1] + speeds[1:]), squares[:-1] + squares[1:])
        return self.near(forces, state, lambda_w)

    def near(self, forces_n: Floats, state: MeanSpeeds, lambda_w: float) -> Planes:
        """Planes near the forces (n, planes) at a mean speed of each interval and a price of time (W)."""
        ends_tau = self.task.low_tau, self.task.high_tau
        found: Planes = loss_planes(np.ascontiguousarray(forces_n), state, lambda_w, ends_tau, self._rows)
        share = np.clip(self.task.line.supply, 0.0, 1.0)
        if (share < 1.0).any():
            found = Planes(*(np.concatenate((plane, share[:, None] * plane), axis=1) for plane in found))
        return found


def map_rows(task: Task, loss: LossMap) -> MapRows:
    """Energies per metre at the speeds and forces of the map that the task's train can reach."""
    train = task.section.train
    fastest_mps = float(task.envelope_mps.max()) + tol.SPEED_TOLERANCE_MPS
    size = min(int(np.searchsorted(loss.speed_mps, fastest_mps)) + 1, len(loss.speed_mps))
    speed = loss.speed_mps[1:size]
    slower = loss.speed_mps[: size - 1]
    psi = loss.force_n + loss.filled_w[1:size] / speed[:, None]
    # A force between two speeds is at most the limit at the slower one; the next force of the map is beyond it.
    most = EffortEnvelope(max_force_n=train.traction_force_n, max_power_w=train.traction_power_w).force_n(slower)
    least = EffortEnvelope(max_force_n=train.electric_force_n, max_power_w=train.electric_power_w).force_n(slower)
    allowed = 1.0 + LIMIT_SLACK
    last = np.minimum(np.searchsorted(loss.force_n, allowed * most + LEAST_FORCE_N), len(loss.force_n) - 1)
    first = np.maximum(np.searchsorted(loss.force_n, -allowed * least - LEAST_FORCE_N, side="right") - 1, 0)
    hull_force, hull_psi, count = np.empty_like(psi), np.empty_like(psi), np.empty(len(speed), np.int64)
    row_hulls(np.array(loss.force_n), psi, first, last, hull_force, hull_psi, count)
    standing_w = float(loss.filled_w[0, first[0] : last[0] + 1].min())
    return MapRows(1.0 / speed, standing_w, hull_force, hull_psi, count)


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
    """The task with the speed bounded by the fastest run; valid only if `fastest_is_ahead`."""
    speeds = np.empty_like(task.envelope_mps)
    speeds[0] = task.speeds_mps[0]
    fastest_roll_out(task.line.for_kernels, task.envelope_mps, task.section.train, speeds)
    return replace(task, envelope_mps=np.minimum(task.envelope_mps, speeds))


def _bend_of_curve(train: TrainParams) -> float:
    """The largest change of the force of the traction's effort curve with v²/2 (N/(m²/s²)); 0 without a curve.

    This is the slope of the curve divided by the speed, and infinite if the force changes from standstill on.
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
    """Whether the brakes can keep the train within its largest acceleration on every descent, if it has one."""
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
"""Least relative increase of the bound by the last planes for which more are added."""
INSIDE: Final = 0.05
"""Distance of the first point from its bounds, as a share of their width."""
TERMS_RATIO: Final = 1e-9
"""Share of the magnitudes of its terms by which the bound is lowered, to cover rounding errors."""
LEAST_PRICE: Final = 1e-3
LARGEST_PRICE: Final = 1e3
"""Largest first price of time, in units of force times speed."""


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
    bound, price = best_bound(run, multipliers, program, MOST_STEPS, ENOUGH_RATIO)
    slack = TERMS_RATIO * (abs(bound) + price * program.allowed_s)
    in_newton = RelaxedRun(run.w, run.local * np.array([1.0, scale_n, scale_n]))
    return ProvenBound((bound - slack) * scale_n, price * scale_n, in_newton)


def proven_for_map(task: Task, loss: LossMap, force_n: Floats, lambda_w: float) -> ProvenBound:
    """The highest bound found for a task with a loss map, near a run whose motors give `force_n` (N).

    After each search, planes that bound the energy from below are added near the relaxed run (cutting planes).
    """
    maker, step_m = MapPlanes(task, loss), task.line.step_m
    price_w = 0.0 if task.price_w is None else float(task.price_w @ step_m / step_m.sum())  # mean over the distance
    planes = maker.of_run(force_n, price_w + lambda_w)
    best = proven(task, planes, lambda_w)
    last = best
    for _ in range(MOST_CUTS):
        w, local = last.relaxed
        if not (np.isfinite(local).all() and np.isfinite(w).all()):
            break
        state = MeanSpeeds(np.clip(local[:, 0], task.low_tau, task.high_tau), w[:-1] + w[1:])
        more = maker.near(local[:, 1:2], state, price_w + last.lambda_w)
        planes = Planes(*(np.concatenate(pair, axis=1) for pair in zip(planes, more, strict=True)))
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

    The multipliers of the other constraints follow from the slacks (see `das.offline.bound_kernels`).
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


def certificate(solution: Solution) -> Certificate:
    """The certificate of a solution; proving it takes 0.01 to 0.1 s for a section, 0.2 to 2 s with a loss map.

    If the run of least energy ends early, the bound holds for the requested time.
    """
    allowed_s = max(solution.time_s, solution.requested_s) if solution.saves_time else solution.time_s
    task, bound_j, reason = task_of(solution, allowed_s), math.nan, ""
    if (task.speeds_mps > task.envelope_mps + tol.SPEED_TOLERANCE_MPS).any():
        reason = "the run begins above the braking envelope"
    elif not solution.feasible:
        reason = "the run does not keep the limits or the speed at the end"
    elif math.isinf(solution.lambda_w) and fastest_is_ahead(task):
        bound_j = solution.balance.input
    else:
        bound_j = bound_of(task, solution.trajectory.force_el_n, min(solution.lambda_w, LARGEST_PRICE_W))
        reason = "" if math.isfinite(bound_j) else NOT_FOUND
    return Certificate(bound_j=math.nan if reason else bound_j, allowed_s=allowed_s, reason=reason)


def bound_of(task: Task, force_n: Floats, lambda_w: float) -> float:
    """The bound of a task (J), near a run whose motors give `force_n` and about the price of time `lambda_w`."""
    if fastest_is_ahead(task):
        task = behind_fastest(task)
    loss = task.section.loss
    if isinstance(loss, LossMap):
        return proven_for_map(task, loss, force_n, lambda_w).bound_j
    return proven(task, efficiency_planes(loss, task.line.supply), lambda_w).bound_j


def task_of(solution: Solution, allowed_s: float) -> Task:
    """The task of bounding a solution: every run from its state that takes at most `allowed_s`."""
    run, section = solution.trajectory, solution.section
    line = State.at(section, float(run.s_m[0]), float(run.v_mps[0]))
    envelope = section.envelope_mps[-len(run.v_mps) :]
    return Task(section=section, line=line, envelope_mps=envelope, speeds_mps=run.v_mps, allowed_s=allowed_s)
