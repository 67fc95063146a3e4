"""A simulated train with its own physics, sharing no code, and hence no programming errors, with the solver.

m·ρ·dv/dt = F_el + F_fr − R(v + wind) − R_tunnel − m·(g·i + R_curve), as in docs/explanation/physics.md. Moreover,
forces take time (dead time, build-up, jerk), and the adhesion at each place and time limits what wheels transmit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Final, NamedTuple

import numpy as np

from das.domain.conditions import Conditions
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError, InputError
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap, LossModel, outside_map
from das.domain.route import Floats, Route, Stretches
from das.domain.trajectory import EnergyBalance
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import BrakePolicy, Vehicle
from sim.plant import kernels
from sim.plant.kernels import (
    FORCE,
    LEVER,
    NO_LIMIT_N,
    SPEED,
    Actuator,
    Actuators,
    Command,
    LineNumbers,
    LossNumbers,
    PlantState,
    TrainNumbers,
)

__all__ = ["COAST", "Command", "Dynamics", "Efforts", "Patch", "Plant", "PlantState"]
__all__ += ["checked", "force", "lever", "lever_ratio", "speed", "train_numbers"]

NO_LIMIT_MPS2 = 1e6
"""An acceleration that no train reaches (finite, so that products stay defined)."""
DRAWN_AT_MPS = 1.0
"""Speed (m/s) at which the power without effort, less losses of the traction chain, is that of the auxiliaries."""


def force(force_n: float, *, friction_ratio: float = 0.0) -> Command:
    """The command for a wheel force (N)."""
    return Command(FORCE, force_n, friction_ratio=friction_ratio)


def lever(ratio: float, *, friction_ratio: float = 0.0) -> Command:
    """The command for a share of the largest effort at the present speed: 1 is full traction, −1 is both brakes."""
    return Command(LEVER, ratio, friction_ratio=friction_ratio)


def speed(
    speed_mps: float,
    *,
    rate_mps2: float = 0.0,
    force_n: float = 0.0,
    gain_per_s: float = 0.5,
    low_n: float = -NO_LIMIT_N,
    high_n: float = NO_LIMIT_N,
) -> Command:
    """The command to hold a speed that changes by `rate_mps2`; `force_n` is the force expected for that."""
    return Command(SPEED, speed_mps, rate_mps2, force_n, gain_per_s, low_n, high_n)


COAST = force(0.0)
"""The command for no force; a standing train does not move, held by its brakes."""


class Efforts(NamedTuple):
    """The largest forces (N) of a train at a speed on dry rail: traction, the electric brake, both brakes together."""

    traction_n: float
    electric_n: float
    brakes_n: float

    @classmethod
    def at(cls, speed_mps: float, train: TrainNumbers) -> Efforts:
        """The largest forces at a speed (m/s)."""
        return cls(*kernels.efforts(max(speed_mps, 0.0), 1.0, train))

    def lever_ratio(self, force_n: float) -> float:
        """The controller's setting (−1 … 1) that gives a wheel force."""
        most_n = self.traction_n if force_n >= 0 else self.brakes_n
        return min(max(force_n / most_n, -1.0), 1.0) if most_n > 0 else 0.0


def lever_ratio(force_n: float, speed_mps: float, train: TrainNumbers) -> float:
    """The controller's setting (−1 … 1) that gives a wheel force (N) at a speed."""
    return Efforts.at(speed_mps, train).lever_ratio(force_n)


_VALUES: Final = {
    FORCE: ("the wheel force", -NO_LIMIT_N, NO_LIMIT_N, "N"),
    LEVER: ("the lever's ratio", -1.0, 1.0, ""),
    SPEED: ("the speed to hold", 0.0, 200.0, "m/s"),
}
"""For each law of a command: name, range and unit of its value."""


def checked(answer: Any, who: str, time_s: float) -> Command:
    """The answer of a driver at a time (s on the cab's clock), with its numbers as plain floats.

    Raises DasError for anything but a Command, and for numbers that are NaN or out of range; `who` begins the message.
    """
    where = f"{who}: at {time_s:.1f} s it answered"
    if not isinstance(answer, Command):
        raise DasError(
            f"{where} {_short(answer)}: expected a Command, made by lever, force or speed of sim.plant.plant"
        )
    if answer.law not in _VALUES:
        raise DasError(f"{where} a Command of law {_short(answer.law)}: expected one made by lever, force or speed")
    name, low, high, unit = _VALUES[answer.law]
    return Command(
        answer.law,
        _within(answer.value, where, name, (low, high, unit)),
        _within(answer.rate_mps2, where, "rate_mps2", (-10.0, 10.0, "m/s²")),
        _within(answer.force_n, where, "force_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.gain_per_s, where, "gain_per_s", (0.0, 100.0, "1/s")),
        _within(answer.low_n, where, "low_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.high_n, where, "high_n", (-NO_LIMIT_N, NO_LIMIT_N, "N")),
        _within(answer.friction_ratio, where, "friction_ratio", (0.0, 1.0, "")),
    )


def _within(value: Any, where: str, name: str, limits: tuple[float, float, str]) -> float:
    low, high, unit = limits
    known = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not known or not low <= value <= high:
        raise DasError(f"{where} {name} = {_short(value)}: expected {low:g} to {high:g}{f' {unit}' if unit else ''}")
    return float(value)


def _short(value: Any) -> str:
    try:
        text = repr(value)
    except Exception:
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}…"


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """Times in which the forces of a train build up and fall, and the step of the integration."""

    traction_dead_s: float = 0.2
    """Time (s) from the command until traction begins; assumption of a size usual with electronic control."""
    traction_rise_s: float = 1.0
    """Time (s) in which traction rises from zero to its largest force; assumption of a usual size."""
    traction_fall_s: float = 0.7
    """Time (s) in which traction falls from its largest force to zero; assumption of a usual size."""
    electric_dead_s: float = 0.2
    """Time (s) from the command until the electric brake begins; assumption of a usual size."""
    electric_rise_s: float = 1.0
    """Time (s) in which the electric brake rises to its largest force; assumption of a usual size."""
    electric_fall_s: float = 0.7
    """Time (s) in which the electric brake falls from its largest force to zero; assumption of a usual size."""
    friction_dead_s: float = 0.5
    """Time (s) from the command until the friction brake begins; assumption."""
    friction_rise_s: float = 4.0
    """Time (s) in which the friction brake rises to its largest force: air brake in position P, 3 to 5 s (UIC 540)."""
    friction_fall_s: float = 15.0
    """Time (s) in which the friction brake is released: air brake in position P, 15 to 20 s (UIC 540)."""
    jerk_mps3: float = 0.8
    """Largest jerk (m/s³) that each force alone may cause, for the safety of standing passengers; assumption."""
    step_s: float = 0.05
    """Step (s) of the integration: 20 Hz, well below every time above; steps of 0.02 to 0.1 s give the same results."""

    @classmethod
    def of(cls, vehicle: Vehicle) -> Dynamics:
        """The usual dynamics of a train; without an electric brake, its friction brake acts fully after the time in its
        file (or that of the jerk limit), and its release takes longer in proportion."""
        if vehicle.electric_brake.max_force_n > 0.0:
            return cls()
        rise_s = max(vehicle.service_brake.build_up_s - cls.friction_dead_s, cls.step_s)
        return cls(friction_rise_s=rise_s, friction_fall_s=rise_s * cls.friction_fall_s / cls.friction_rise_s)

    def actuators(self, train: TrainNumbers) -> Actuators:
        """Dead times and rates of the forces of a train."""
        jerk_n_per_s = self.jerk_mps3 * train.inertial_mass_kg

        def actuator(force_n: float, dead_s: float, rise_s: float, fall_s: float) -> Actuator:
            return Actuator(dead_s, min(force_n / rise_s, jerk_n_per_s), min(force_n / fall_s, jerk_n_per_s))

        return Actuators(
            actuator(train.traction_force_n, self.traction_dead_s, self.traction_rise_s, self.traction_fall_s),
            actuator(train.electric_force_n, self.electric_dead_s, self.electric_rise_s, self.electric_fall_s),
            actuator(train.friction_force_n, self.friction_dead_s, self.friction_rise_s, self.friction_fall_s),
        )


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A stretch of line on which the state of the rail or the wind differs for some time.

    `adhesion_ratio` multiplies the adhesion, `head_wind_mps` adds to the wind, both by the share of the train on the
    stretch (axles are assumed to be spread evenly). Patches may overlap.
    """

    from_m: float = -math.inf
    to_m: float = math.inf
    from_s: float = -math.inf
    to_s: float = math.inf
    adhesion_ratio: float = 1.0
    head_wind_mps: float = 0.0

    def __post_init__(self) -> None:
        for first, last in (("from_m", "to_m"), ("from_s", "to_s")):
            if not getattr(self, first) < getattr(self, last):
                raise InputError("patch", last, getattr(self, last), f"more than {first} = {getattr(self, first):g}")
        # The ranges are the same as for conditions over the whole line.
        Conditions(adhesion_ratio=self.adhesion_ratio, head_wind_mps=self.head_wind_mps)


class Plant:
    """A train on a route, stepped under commands.

    `conditions` and `patches` are the deviations of the real train and line from the files of route and vehicle; plans
    may ignore them. A wind belongs in `conditions` or `patches`, not in the vehicle's resistance. A train with
    the brake policy FRICTION has only a friction brake, which gives the whole braking force; any other train uses the
    electric brake first, friction for the rest.

    Raises DasError for losses that do not cover the train's speeds and efforts, and for conditions without data.
    """

    def __init__(
        self,
        route: Route,
        vehicle: Vehicle,
        *,
        level: Level | None = None,
        conditions: Conditions | None = None,
        patches: Sequence[Patch] = (),
        dynamics: Dynamics | None = None,
    ) -> None:
        dynamics = dynamics or Dynamics.of(vehicle)
        conditions = conditions or Conditions()
        self.route = conditions.line(route)
        self.vehicle = replace(conditions, head_wind_mps=0.0).train(vehicle)
        self.level = vehicle.default_level if level is None else level
        self.step_s = dynamics.step_s
        self._train = train_numbers(self.vehicle, self.level)
        self._actuators = dynamics.actuators(self._train)
        if conditions.head_wind_mps:
            patches = (Patch(head_wind_mps=conditions.head_wind_mps), *patches)
        if any(p.adhesion_ratio != 1 for p in patches) and math.isinf(vehicle.adhesive_mass_kg):
            raise DasError(f"{vehicle.source}: adhesion is missing: expected [adhesion] adhesive_mass_t in the file")
        self._line = _line_numbers(self.route, self.vehicle, patches)
        chain = replace(self.vehicle, auxiliary_power_w=0.0).loss_model(self.level)
        _check_covered(chain, self.vehicle, self.route)
        self._loss = _loss_numbers(chain)

    def at(self, s_m: float, speed_mps: float = 0.0, time_s: float = 0.0) -> PlantState:
        """A state to start from, without any force."""
        return PlantState(float(time_s), float(s_m), float(speed_mps))

    def advance(self, state: PlantState, command: Command, duration_s: float = 1.0) -> PlantState:
        """The state after a time under one command; DasError if the time is not a whole number of steps."""
        steps = round(duration_s / self.step_s)
        if steps < 1 or abs(steps * self.step_s - duration_s) > 1e-9:
            raise DasError(f"train model: {duration_s} s is not a whole number of steps of {self.step_s} s")
        after: PlantState = kernels.advance(
            state, command, steps, self.step_s, self._line, self._train, self._actuators, self._loss
        )
        return after

    def gradient_ratio(self, s_m: float) -> float:
        """Gradient averaged over the train with its head at `s_m`."""
        return float(kernels.line_means(self._line, float(s_m), 0.0)[0])

    def weather(self, state: PlantState) -> tuple[float, float]:
        """State of the rail under the train (1 = dry) and head wind on it (m/s)."""
        rail, wind = kernels.weather_at(self._line, state.s_m, state.time_s, self.vehicle.train_length_m)
        return float(rail) * self._train.rail_ratio, float(wind)

    def balance(self, before: PlantState, after: PlantState) -> EnergyBalance:
        """The energy balance between two states; as a check, kinetic and potential energy are taken from the states."""
        vehicle, weight_n = self.vehicle, self.vehicle.mass_kg * STANDARD_GRAVITY_MPS2

        def used(name: str) -> float:
            return float(getattr(after, name) - getattr(before, name))

        return EnergyBalance(
            resistance=used("resistance_j"),
            component_loss=used("component_loss_j") + used("auxiliary_j"),
            friction_brake=used("friction_brake_j"),
            unreturned=used("unreturned_j"),
            kinetic=0.5 * vehicle.inertial_mass_kg * (after.speed_mps**2 - before.speed_mps**2),
            potential=weight_n * (self._altitude_m(after.s_m) - self._altitude_m(before.s_m)),
            input=used("input_j"),
            comfort=used("comfort_j"),
        )

    def _altitude_m(self, s_m: float) -> float:
        """Altitude averaged over the train with its head at `s_m`; exact: a parabola in each gradient."""
        length = self.vehicle.train_length_m
        if length == 0:
            return float(self.route.altitude_m(s_m))
        inside = self.route.gradients_ratio.start_m
        edges = np.concatenate(([s_m - length], inside[(inside > s_m - length) & (inside < s_m)], [s_m]))
        middle = 0.5 * (edges[:-1] + edges[1:])
        simpson = (
            self.route.altitude_m(edges[:-1]) + 4 * self.route.altitude_m(middle) + self.route.altitude_m(edges[1:])
        )
        return float(simpson @ np.diff(edges) / (6 * length))


def train_numbers(vehicle: Vehicle, level: Level | None = None) -> TrainNumbers:
    """The numbers of a train for the kernels, at a level of losses (default: the vehicle's)."""
    level = vehicle.default_level if level is None else level
    electric, friction_n = vehicle.electric_brake, vehicle.friction_brake_force_n
    if vehicle.brakes_at(level) is BrakePolicy.FRICTION:
        friction_n += electric.max_force_n
        electric = replace(electric, max_force_n=0.0)
    dry = replace(vehicle, adhesion_ratio=1.0)
    bare = replace(vehicle, auxiliary_power_w=0.0).loss_model(level)
    drawn_w = vehicle.loss_model(level).loss_w(0.0, DRAWN_AT_MPS) - bare.loss_w(0.0, DRAWN_AT_MPS)
    numbers = (
        vehicle.mass_kg,
        vehicle.inertial_mass_kg,
        vehicle.train_length_m,
        vehicle.resistance.c0_n,
        vehicle.resistance.c1_n_per_mps,
        vehicle.resistance.c2_n_per_mps2,
        vehicle.traction.max_force_n,
        vehicle.traction.max_power_w,
        electric.max_force_n,
        electric.max_power_w,
        friction_n,
        min(dry.adhesive_force_n, NO_LIMIT_N),
        min(dry.braked_adhesive_force_n, NO_LIMIT_N),
        vehicle.adhesion_ratio,
        min(vehicle.max_acceleration_mps2, NO_LIMIT_MPS2),
        min(vehicle.max_deceleration_mps2, NO_LIMIT_MPS2),
        drawn_w,
        vehicle.comfort_power_w,
    )
    return TrainNumbers(*map(float, numbers), _points(vehicle.traction), _points(electric))  # type: ignore[call-arg, arg-type]


def _points(effort: EffortEnvelope) -> Floats:
    """The points of an effort curve (n, 2): speed (m/s) and force (N); none if there is no curve."""
    curve = effort.curve
    return np.empty((0, 2)) if curve is None else np.array([curve.speed_mps, curve.force_n]).T.copy()


def _line_numbers(route: Route, vehicle: Vehicle, patches: Sequence[Patch]) -> LineNumbers:
    quantities = (route.gradients_ratio, vehicle.line_resistance_mps2(route), vehicle.tunnel_n_per_mps2(route))
    breaks = np.concatenate([q.start_m for q in quantities])
    node_m = np.unique(np.concatenate((breaks, breaks + vehicle.train_length_m)))
    supply = route.supply()
    weather = [[p.from_m, p.to_m, p.from_s, p.to_s, p.adhesion_ratio, p.head_wind_mps] for p in patches]
    return LineNumbers(
        node_m=node_m,
        profile=np.ascontiguousarray(np.hstack([_under_train(q, node_m, vehicle.train_length_m) for q in quantities])),
        supply_start_m=supply.start_m.copy(),
        supply=supply.value.copy(),
        weather=np.array(weather, dtype=float).reshape(-1, 6),
    )


def _under_train(quantity: Stretches, node_m: Floats, length_m: float) -> Floats:
    """Value, slope and integral (n, 3) of the mean of a quantity over a train with its head at each node.

    The mean of a piecewise constant quantity over a fixed length is piecewise linear: it bends at the breaks and at
    breaks + length.
    """
    if length_m == 0:
        value, slope = quantity.at(node_m), np.zeros(len(node_m))
    else:
        value = quantity.mean(node_m - length_m, node_m)
        slope = np.append(np.diff(value) / np.diff(node_m), 0.0)
    step = np.diff(node_m)
    upto = np.concatenate(([0.0], np.cumsum(step * (value[:-1] + 0.5 * slope[:-1] * step))))
    return np.stack([value, slope, upto], axis=1)


def _loss_numbers(loss: LossModel) -> LossNumbers:
    if isinstance(loss, EfficiencyLoss):
        ratios = (float(loss.traction_ratio), float(loss.brake_ratio), float(loss.idle_w))
        return LossNumbers(False, *ratios, 1.0, 0.0, 1.0, np.zeros((2, 2)))
    steps = (1.0 / loss.speed_step_mps, float(loss.force_n[0]), 1.0 / loss.force_step_n)
    # A writable copy: numba compiles again for read-only arrays.
    return LossNumbers(True, 0.0, 0.0, 0.0, *steps, np.array(loss.filled_w))


def _check_covered(loss: LossModel, vehicle: Vehicle, route: Route) -> None:
    """Raise DasError unless a loss map covers every effort of the train up to its highest speed on this route."""
    if not isinstance(loss, LossMap):
        return
    top_mps = min(float(route.limits_mps.value.max()), vehicle.max_speed_mps)
    speeds = np.linspace(0.0, top_mps, 2 + int(2 * top_mps / loss.speed_step_mps))
    for effort in (vehicle.traction_effort_n(speeds), -vehicle.electric_brake_effort_n(speeds)):
        outside = np.flatnonzero(~loss.covers(effort, speeds))
        if len(outside):
            raise outside_map(loss, float(effort[outside[0]]), float(speeds[outside[0]]))
