"""A section: route × vehicle × level as arrays on the space grid, ready for the kernels.

A section has two nested grids. Decisions are made at the *decision nodes*: at every breakpoint, and between breakpoints
as densely as line and speed require (see `das.solver.line_profile`). Between decision nodes the motion is integrated
over the finer *integration nodes*, at which trajectories are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.braking import SERVICE_SHARE, ServiceBraking
from das.domain.errors import DasError, InfeasibleError, RunawayError
from das.domain.levels import Level
from das.domain.losses import LossMap, LossModel, outside_map
from das.domain.route import NEUTRAL, Route
from das.domain.summary import Summary
from das.domain.units import KM, KMH, KN, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver import tolerances as tol
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope, climbing_floor
from das.solver.kernels.forces import brake_limit, electric_limit, mean_resistance, on_supply, traction_limit
from das.solver.kernels.roll_out import fastest_roll_out, fastest_run
from das.solver.kernels.tuples import (
    KnownRun,
    LineArrays,
    LossParams,
    ServiceParams,
    SpeedBounds,
    TrainParams,
    loss_params,
    train_params,
)
from das.solver.line_profile import LineProfile, decision_nodes, even_nodes, fixed_nodes, subdivide

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Section(Summary, LineProfile):
    """A section of a route, from `start_m` to `end_m` (route positions), with the train that runs on it.

    The line profile has the integration nodes. `allowed_mps` (per node) is the highest speed from which full braking
    still keeps all limits and the end speed. `envelope_mps` is the highest planned speed, which is lower only if the
    section is planned with a service `braking`, or where plans have no brake because the motors have none. There,
    `guarded_mps` is the braking curve of the friction brake that plans exclude; elsewhere it is the envelope.
    `floor_mps` is the lowest speed from which the end speed can still be reached (usually 0). `train_length_m` is 0 for
    a point mass. `decision` holds the indices of the decision nodes among the integration nodes.
    """

    route: Route
    vehicle: Vehicle
    level: Level
    brakes: BrakePolicy
    train_length_m: float
    start_speed_mps: float
    end_speed_mps: float
    floor_mps: Floats
    envelope_mps: Floats
    guarded_mps: Floats
    allowed_mps: Floats
    decision: NDArray[np.int64]
    braking: ServiceBraking | None = None

    @cached_property
    def start_m(self) -> float:
        """Start of the section (route position)."""
        return float(self.node_m[0])

    @cached_property
    def end_m(self) -> float:
        """End of the section (route position)."""
        return float(self.node_m[-1])

    @cached_property
    def loss(self) -> LossModel:
        """The losses of the train at the level of the section."""
        return self.vehicle.loss_model(self.level)

    @cached_property
    def train(self) -> TrainParams:
        """The parameters of the train for the kernels, with the brakes of the section."""
        return train_params(self.vehicle, self.brakes)

    @cached_property
    def loss_params(self) -> LossParams:
        """The losses in the form required by the kernels."""
        return loss_params(self.loss)

    @cached_property
    def has_brake(self) -> NDArray[np.bool_]:
        """Whether plans have a brake in each interval: the motors may have none there."""
        return (self.supply >= 0.0) | (self.train.friction_force_n > 0.0) | self.train.brakes_dissipate

    @property
    def speed_steps(self) -> int:
        """Number of steps of the speed grid at every decision node."""
        return tol.SHORT_SPEED_STEPS if len(self.decision) <= tol.FEW_NODES else tol.SPEED_STEPS

    @property
    def bounds(self) -> SpeedBounds:
        """Floor and envelope at the integration nodes, in the form required by the kernels."""
        return SpeedBounds(self.floor_mps, self.envelope_mps)

    @cached_property
    def fastest_run(self) -> KnownRun:
        """The fastest trajectory from the start: speed at every integration node (m/s) and time to go from there (s).

        Raises InfeasibleError if the train stalls. The trajectory is computed once for each section; a section made
        with `dataclasses.replace` computes its own.
        """
        speeds = np.empty(len(self.node_m))
        speeds[0] = self.start_speed_mps
        time_s = fastest_roll_out(self.for_kernels, self.envelope_mps, self.train, speeds)
        self.finished_s(time_s, self.start_m, self.start_speed_mps)
        elapsed_s = self.elapsed_s(speeds)
        return KnownRun(speeds, float(elapsed_s[-1]) - elapsed_s)

    def resistance_n(self, s_m: float, v_mps: float) -> float:
        """The resistance (N) at a position and speed: running resistance, gradient, curve and tunnel."""
        interval = min(max(int(self.node_m.searchsorted(s_m, side="right")) - 1, 0), len(self.step_m) - 1)
        # Calling the compiled function from Python would cost more than the sum itself.
        running_n = mean_resistance.py_func(v_mps, v_mps, self.tunnel_n_per_mps2[interval], self.train)
        return float(running_n + self.constant_n[interval])

    def largest_n(self, v_mps: float) -> tuple[float, float]:
        """The largest forces (N) at a speed: traction, and all brakes of the train, even those not used in plans."""
        v, train = max(v_mps, 0.1), self.train
        return float(traction_limit(v, train)), float(brake_limit(v, train, self.vehicle.friction_brake_force_n))

    def finished_s(self, time_s: float, s_m: float, v_mps: float) -> float:
        """A kernel's trip time (s) from a state; raises InfeasibleError if the train does not reach the end."""
        if not 0 <= time_s < math.inf:
            raise InfeasibleError(
                f"{self.route.source}: the train stalls after {s_m:.1f} m from {v_mps / KMH:.1f} km/h"
            )
        return float(time_s)

    @property
    def end_stop_name(self) -> str:
        """The name of the stop at the end of the section; empty if there is none."""
        return self.route.stop_name_at(self.end_m)

    def facts(self) -> dict[str, str]:
        """Route, ends, train and loss level."""
        return {"way": self.way, "train": self.vehicle.name, "level": str(self.level)}

    @property
    def titles(self) -> tuple[str, ...]:
        """The names of a run or front on the section in pictures: ends, train and level."""
        return (self.way, self.vehicle.name, f"level {self.level}")

    @property
    def way(self) -> str:
        """The two ends, by the names of their stops or else by kilometre."""
        ends = (self.start_m, self.end_m)
        return " – ".join(self.route.stop_name_at(at_m) or f"km {at_m / KM:.3f}" for at_m in ends)

    @cached_property
    def name(self) -> str:
        """Route, positions, train and level, for messages."""
        return f"{self.route.id} {self.start_m:.0f}–{self.end_m:.0f} m, {self.vehicle.id}, {self.level}"


@dataclass(frozen=True, kw_only=True)
class SectionOptions:
    """Rarely needed options of a section; the defaults are a train of real length, from standstill to standstill."""

    start_speed_mps: float = 0.0
    """Speed (m/s) at which the train enters the section; 0 is a departure from a stop."""
    end_speed_mps: float = 0.0
    """Speed (m/s) at which the train leaves the section; 0 is a halt."""
    point_mass: bool = False
    """Whether the train's length is taken as 0, as in the public benchmark and in the paper."""
    brakes: BrakePolicy | None = None
    """The brakes that a trajectory may use; None: the vehicle's brakes at the level of the section."""
    longest_step_m: float | None = None
    """Largest distance (m) between decision nodes; None: the solver's setting."""
    braking: ServiceBraking | None = None
    """Braking for limits and stops; None: the train's full brakes without reserve."""


ORDINARY = SectionOptions()
"""A train of real length, from standstill to standstill, with the brakes of its level."""


def build_section(
    route: Route,
    vehicle: Vehicle,
    *,
    level: Level | None = None,
    start_m: float | None = None,
    end_m: float | None = None,
    options: SectionOptions = ORDINARY,
) -> Section:
    """Discretise a section of a route for a train.

    By default the section runs from the first to the last stop, at the vehicle's default level.

    Raises DasError if the loss map does not cover all forces and speeds possible on the section, InfeasibleError if the
    train cannot brake or climb.
    """
    start_m = route.stops[0].position_m if start_m is None else start_m
    end_m = route.stops[-1].position_m if end_m is None else end_m
    _check_ends(route, start_m, end_m)
    level = vehicle.default_level if level is None else level
    loss = vehicle.loss_model(level)
    brakes = vehicle.brakes_at(level) if options.brakes is None else options.brakes
    length_m = 0.0 if options.point_mass else vehicle.train_length_m

    task = _Task(route, vehicle, train_params(vehicle, brakes), length_m, options)
    decision_m, fastest_mps = task.decided(start_m, end_m)
    counts = _substep_counts(decision_m, fastest_mps, _slope_change(route, decision_m, length_m))
    fine = task.profile(subdivide(decision_m, counts))
    bounds = task.bounds(fine)
    if isinstance(loss, LossMap):
        _check_coverage(loss, vehicle, float(bounds.allowed_mps.max()))
    return Section(
        **{one.name: getattr(fine, one.name) for one in fields(fine)},
        route=route,
        vehicle=vehicle,
        level=level,
        brakes=brakes,
        train_length_m=length_m,
        start_speed_mps=options.start_speed_mps,
        end_speed_mps=options.end_speed_mps,
        floor_mps=bounds.floor_mps,
        envelope_mps=bounds.envelope_mps,
        guarded_mps=bounds.guarded_mps,
        allowed_mps=bounds.allowed_mps,
        decision=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        braking=options.braking,
    )


def rebuilt(
    section: Section,
    vehicle: Vehicle,
    brakes: BrakePolicy | None = None,
    braking: ServiceBraking | None = None,
) -> Section:
    """The section rebuilt with another vehicle, other brakes or a service braking.

    `brakes=None` keeps the brakes of the section; `braking=None` means full brakes. Errors as in `build_section`.
    """
    return build_section(
        section.route,
        vehicle,
        level=section.level,
        start_m=section.start_m,
        end_m=section.end_m,
        options=SectionOptions(
            start_speed_mps=section.start_speed_mps,
            end_speed_mps=section.end_speed_mps,
            point_mass=section.train_length_m == 0,
            brakes=section.brakes if brakes is None else brakes,
            braking=braking,
        ),
    )


def with_braking(section: Section, braking: ServiceBraking | None) -> Section:
    """The section planned with a service braking, or with full brakes; errors as in `build_section`."""
    return rebuilt(section, section.vehicle, braking=braking)


def capped(section: Section, cap_mps: ArrayLike) -> Section:
    """The section with a lower speed envelope: at each node the smaller of envelope and cap (m/s).

    `cap_mps` is one speed, or one for each integration node. The envelope remains at or above the floor: a train on it
    can still climb every hill ahead.
    """
    envelope, guarded = (
        np.maximum(np.minimum(speeds_mps, cap_mps), section.floor_mps)
        for speeds_mps in (section.envelope_mps, section.guarded_mps)
    )
    return replace(section, envelope_mps=envelope, guarded_mps=guarded)


def without_motors(vehicle: Vehicle, train: TrainParams) -> TrainParams:
    """The train where its motors have no brake; a friction brake that plans exclude counts there, but builds up slowly,
    so only up to the service deceleration (as in the last word)."""
    service_n = vehicle.service_brake.deceleration_mps2 * train.inertial_mass_kg
    friction_n = max(train.friction_force_n, min(vehicle.friction_brake_force_n, service_n))
    return train._replace(friction_force_n=friction_n)


class _Bounds(NamedTuple):
    """Bounds of the speed at the nodes of a grid (m/s, see `Section`), and the speeds of the fastest trajectory."""

    floor_mps: Floats
    envelope_mps: Floats
    guarded_mps: Floats
    allowed_mps: Floats
    fastest_mps: Floats


@dataclass(frozen=True)
class _Task:
    """A section to be built: line, train, the train's length (m, 0 for a point mass), and options."""

    route: Route
    vehicle: Vehicle
    train: TrainParams
    length_m: float
    options: SectionOptions

    def profile(self, node_m: Floats) -> LineProfile:
        """The line profile between these positions."""
        return LineProfile.on(self.route, self.vehicle, node_m, self.length_m)

    def decided(self, start_m: float, end_m: float) -> tuple[Floats, Floats]:
        """Positions of the decision nodes (m), and the fastest trajectory's speeds there (m/s)."""
        braking = self.options.braking
        beside_m = 0.0 if braking is None else braking.deviation_m
        fixed_m = fixed_nodes(self.route, (start_m, end_m), self.length_m, beside_m)
        even_m = even_nodes(fixed_m)
        fastest_mps = self.bounds(self.profile(even_m)).fastest_mps
        decision_m = decision_nodes(self.route, fixed_m, even_m, fastest_mps, self.options.longest_step_m)
        return decision_m, np.interp(decision_m, even_m, fastest_mps)

    def bounds(self, profile: LineProfile) -> _Bounds:
        """Climbing floor, envelopes and fastest trajectory on a grid; raises InfeasibleError if one is impossible."""
        source, train, line = self.route.source, self.train, profile.for_kernels
        start_speed_mps, end_speed_mps = self.options.start_speed_mps, self.options.end_speed_mps
        if end_speed_mps > profile.limit_mps[-1]:
            raise InfeasibleError(f"{source}: an end at {end_speed_mps / KMH:.1f} km/h is above the limit")
        off = without_motors(self.vehicle, train)
        excluded = off.friction_force_n > train.friction_force_n and bool((profile.supply < 0).any())
        planned = self._braked(profile, profile.limit_mps, FULL_BRAKES, train)
        allowed = self._braked(profile, profile.limit_mps, FULL_BRAKES, off) if excluded else planned
        if start_speed_mps > planned[0] + tol.SPEED_TOLERANCE_MPS:
            raise InfeasibleError(
                f"{source}: a start at {start_speed_mps / KMH:.1f} km/h is above the limit or too fast to brake"
            )
        floor = climbing_floor(line, allowed, tol.CREST_MPS, train)
        limits_mps, service = profile.limit_mps, FULL_BRAKES
        if self.options.braking is not None:
            limits_mps, service = self._service(profile, self.options.braking)
            planned = self._braked(profile, limits_mps, service, train)
        # The speed required for hills ahead takes priority over the brake reserve.
        envelope = guarded = np.minimum(np.maximum(planned, floor), allowed)
        if excluded:
            guarded = np.minimum(np.maximum(self._braked(profile, limits_mps, service, off), envelope), allowed)
        fastest, stuck = fastest_run(line, envelope, min(start_speed_mps, envelope[0]), train)
        if stuck >= 0:
            place = f"{1e3 * profile.grade_ratio[stuck]:.1f} ‰"
            if profile.supply[stuck] == NEUTRAL:
                place += ", in a neutral section"
            raise InfeasibleError(f"{source}: the train stalls at {profile.node_m[stuck]:.0f} m ({place})")
        if fastest[-1] < end_speed_mps - tol.SPEED_TOLERANCE_MPS:
            raise InfeasibleError(
                f"{source}: the train ends at {fastest[-1] / KMH:.1f} km/h, expected {end_speed_mps / KMH:.1f} km/h"
            )
        return _Bounds(floor, envelope, guarded, allowed, fastest)

    def _service(self, profile: LineProfile, braking: ServiceBraking) -> tuple[Floats, ServiceParams]:
        """The limits (m/s) of the intervals that service braking keeps, and the braking as the kernels take it.

        A limit also counts where the train may be within the extent of the limit by the error of its position.
        """
        node_m, beside_m = profile.node_m, braking.deviation_m
        limit = self.route.limits_mps.minimum(node_m[:-1] - self.length_m - beside_m, node_m[1:] + beside_m)
        limit = np.minimum(limit, profile.limit_mps)
        limit = np.maximum(limit - braking.below_limit_mps, np.minimum(limit, tol.SLOWEST_LIMIT_MPS))
        friction_n = float(self.vehicle.friction_brake_force_n)
        return limit, ServiceParams(braking.deceleration_mps2, braking.delay_s, SERVICE_SHARE, friction_n)

    def _braked(self, profile: LineProfile, limit_mps: Floats, service: ServiceParams, off: TrainParams) -> Floats:
        """The highest speeds (m/s) from which a braking keeps these limits and the end speed.

        `off` is the train where the motors have no brake. Raises RunawayError if the brakes cannot hold the train on a
        descent.
        """
        without = profile.supply < 0
        edges = [0, *(np.flatnonzero(np.diff(without)) + 1).tolist(), len(limit_mps)]
        speeds = np.full(len(limit_mps) + 1, self.options.end_speed_mps)
        for first, last in reversed(list(pairwise(edges))):
            part = LineArrays(*(one[first:last] for one in profile.for_kernels))
            train = off if without[first] else self.train
            found, stuck = braking_envelope(part, limit_mps[first:last], speeds[last], train, service)
            if stuck >= 0:
                raise self._runs_away(profile, first + stuck, float(found[stuck + 1]), service)
            speeds[first : last + 1] = found
        return speeds

    def _runs_away(self, profile: LineProfile, i: int, v_mps: float, service: ServiceParams) -> RunawayError:
        """The error for a train whose brakes cannot hold it in interval i, with the place and the key to change."""
        vehicle, train = self.vehicle, self.train
        here = on_supply(train, float(profile.supply[i]))
        resisting_n = mean_resistance(0.0, v_mps, profile.tunnel_n_per_mps2[i], here) + profile.constant_n[i]
        electric_n, friction_n = float(electric_limit(max(v_mps, 0.1), here)), vehicle.friction_brake_force_n
        needed_n = -resisting_n / service.force_share - electric_n
        wanted, unused = [], train.friction_force_n < friction_n or vehicle.brake_policy is BrakePolicy.ELECTRIC
        if unused and -resisting_n > electric_n:
            wanted.append(f"brakes.policy = {str(BrakePolicy.ELECTRIC)!r}: expected {str(BrakePolicy.BLENDED)!r}")
        if needed_n > friction_n:
            least_kn = math.ceil(needed_n / KN)
            wanted.append(f"friction_brake.max_force_kn = {friction_n / KN:g}: expected at least {least_kn}")
        with_what = "" if service is FULL_BRAKES else f" with {100 * service.force_share:.0f} % of its brakes"
        why = f"{vehicle.source}: {', '.join(wanted)}" if wanted else "wheels and rails take no more force"
        return RunawayError(
            f"{self.route.source}: the train cannot brake on the descent at {profile.node_m[i]:.0f} m "
            f"({1e3 * profile.grade_ratio[i]:.1f} ‰){with_what}: {why}",
            float(profile.node_m[i + 1]),
        )


def _check_ends(route: Route, start_m: float, end_m: float) -> None:
    if not (start_m >= 0 and end_m - start_m > tol.MIN_STEP_M and end_m <= route.length_m + tol.MIN_STEP_M):
        raise DasError(
            f"{route.source}: a section from {start_m:g} m to {end_m:g} m: expected one in the direction of the "
            f"route, within 0 … {route.length_m:g} m"
        )


def _slope_change(route: Route, node_m: Floats, length_m: float) -> Floats:
    """Change of the gradient under the train over each interval (ratio); 0 for a point mass."""
    if length_m == 0:
        return np.zeros(len(node_m) - 1)
    return np.abs(np.diff(route.gradients_ratio.mean(node_m - length_m, node_m)))


def _substep_counts(decision_m: Floats, fastest_mps: Floats, slope_change: Floats) -> NDArray[np.int64]:
    """The number of integration steps in each decision step, chosen such that speed and slope change little in each.

    A slope that changes evenly by Δi over h absorbs and returns the kinetic energy g·Δi·h/8 per unit of mass. With n
    steps, 1/n² of this energy remains as an error; divided by the speed, it is the error in speed.
    """
    mean = np.maximum(0.5 * (fastest_mps[:-1] + fastest_mps[1:]), 0.1)
    change = np.abs(np.diff(fastest_mps)) / mean
    counts = np.ceil(change / tol.SUBSTEP_SPEED_RATIO).astype(np.int64)
    # Near standstill the effort is limited by force, not by power: a few steps are enough.
    at_rest = np.minimum(fastest_mps[:-1], fastest_mps[1:]) < 2.0
    counts = np.where(at_rest, np.minimum(counts, 4), counts)
    drift_mps = STANDARD_GRAVITY_MPS2 * slope_change * np.diff(decision_m) / 8 / mean
    counts = np.maximum(counts, np.ceil(np.sqrt(drift_mps / tol.SUBSTEP_DRIFT_MPS)).astype(np.int64))
    return np.clip(counts, 1, tol.MAX_SUBSTEPS)


def _check_coverage(loss: LossMap, vehicle: Vehicle, top_speed_mps: float) -> None:
    """Raise DasError unless the map covers every force of the train up to the highest speed on the section."""
    speeds = np.append(np.arange(0.0, top_speed_mps, 0.5 * loss.speed_step_mps), top_speed_mps)
    for force in (vehicle.traction_effort_n(speeds), -vehicle.electric_brake_effort_n(speeds)):
        outside = np.flatnonzero(~loss.covers(force, speeds))
        if len(outside):
            raise outside_map(loss, float(force[outside[0]]), float(speeds[outside[0]]))
