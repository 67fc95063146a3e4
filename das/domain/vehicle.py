"""The train: mass, resistance, force envelopes, brakes, losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from operator import attrgetter
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.effort import EffortEnvelope, EffortMode
from das.domain.errors import DasError, InputError, check_number
from das.domain.formulary import adhesion_coefficient, curve_resistance_mps2
from das.domain.levels import Level
from das.domain.losses import LOSSLESS, EfficiencyLoss, LossMap, LossModel, fit_mean_efficiency
from das.domain.route import NEUTRAL, Route, Stretches
from das.domain.summary import Summary
from das.domain.units import KMH, STANDARD_GRAVITY_MPS2, TONNE, kmh

Floats = NDArray[np.float64]


class BrakePolicy(StrEnum):
    """The brakes that a planned trajectory may use."""

    ELECTRIC = "electric"
    """Electric brake only; the recovered energy is fed back to the line."""
    BLENDED = "blended"
    """Electric brake first, friction brake for the rest."""
    FRICTION = "friction"
    """Both brakes up to their joint force limit; all braking energy is dissipated (level L0 NOREG)."""


@dataclass(frozen=True, kw_only=True)
class Resistance:
    """Running resistance R(v) = c0 + c1·v + c2·v² in N, v in m/s.

    Source: Davis (1926), "The tractive resistance of electric locomotives and cars", General Electric Review 29,
    pp. 685–707; Nold & Corman (2024), section 3.2, eq. 4, give the power v·R(v), with c1, c2, c3 for c0, c1, c2.
    """

    c0_n: float
    c1_n_per_mps: float
    c2_n_per_mps2: float

    def force_n(self, speed_mps: ArrayLike) -> Floats:
        """Resistance (N, >= 0) at each speed (m/s)."""
        v = np.asarray(speed_mps, dtype=float)
        return self.c0_n + self.c1_n_per_mps * v + self.c2_n_per_mps2 * v**2

    def scaled(self, ratio: float) -> Resistance:
        """The resistance with all three coefficients multiplied by a ratio."""
        return Resistance(
            c0_n=ratio * self.c0_n,
            c1_n_per_mps=ratio * self.c1_n_per_mps,
            c2_n_per_mps2=ratio * self.c2_n_per_mps2,
        )

    def in_head_wind(self, wind_mps: float) -> Resistance:
        """The resistance in a head wind (m/s, tail wind < 0): R(v) = c0 + c1·v + c2·(v + w)².

        Only c2 describes air resistance; the air meets the train at its own speed v plus the wind speed w. A tail wind
        faster than the train would push it; this formula counts that force as resistance.
        """
        c2 = self.c2_n_per_mps2
        return replace(
            self,
            c0_n=self.c0_n + c2 * wind_mps * wind_mps,
            c1_n_per_mps=self.c1_n_per_mps + 2 * c2 * wind_mps,
        )


AIR_BRAKE_BUILD_UP_S = 4.5
"""Build-up (s) of a train's brakes if its file has no electric brake and no time: position P, 3 to 5 s (UIC 540)."""


@dataclass(frozen=True, kw_only=True)
class ServiceBrake:
    """The braking of a train in normal service: the largest deceleration, and the time until its brakes act fully."""

    deceleration_mps2: float = 0.7
    """The largest deceleration in service (m/s²). Default (assumption): a usual value for passenger trains."""
    build_up_s: float = 1.5
    """Time (s) until the brakes act fully; electric brakes with electronic control take 1 to 2 s."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """A load state of a train: its total mass, and its constant resistance if known (else see `with_mass`)."""

    mass_kg: float
    c0_n: float | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class Vehicle(Summary):
    """A train as the planner sees it, in SI units.

    `rotating_mass_ratio` is the additional rotating mass as a share of `mass_kg` (0.06 = 6 %). `losses` contains the
    loss model of each level in the file; the other levels are derived from these (see `loss_model`). Accelerations may
    be inf. `adhesive_mass_kg` is the mass on the driven axles (inf: no adhesion limit), `adhesion_ratio` the state of
    the rail (1 = dry, as measured by Curtius and Kniffler). `auxiliary_power_w` is drawn while the train moves, on top
    of the losses of OWN, L2 or L3. `comfort_power_w` is not part of the optimisation. `traction` and `electric_brake`
    belong to the mode `mode`, "" if the file names no default; see `in_mode`.
    """

    id: str
    name: str
    source: str
    mass_kg: float
    rotating_mass_ratio: float
    train_length_m: float
    max_speed_mps: float
    resistance: Resistance
    traction: EffortEnvelope
    electric_brake: EffortEnvelope
    friction_brake_force_n: float
    brake_policy: BrakePolicy
    max_acceleration_mps2: float = np.inf
    max_deceleration_mps2: float = np.inf
    service_brake: ServiceBrake = ServiceBrake()
    adhesive_mass_kg: float = np.inf
    adhesion_ratio: float = 1.0
    auxiliary_power_w: float = 0.0
    comfort_power_w: float = 0.0
    tunnel_area_m2: tuple[float, ...] = ()
    tunnel_resistance_n_per_mps2: tuple[float, ...] = ()
    default_level: Level = Level.OWN
    losses: Mapping[Level, LossModel] = field(default_factory=lambda: MappingProxyType({}))
    loads: Mapping[str, Load] = field(default_factory=lambda: MappingProxyType({}))
    modes: Mapping[str, EffortMode] = field(default_factory=lambda: MappingProxyType({}))
    mode: str = ""

    def __post_init__(self) -> None:
        for key in (*_POSITIVE, *_NOT_NEGATIVE):
            check_number(self.source, key, float(attrgetter(key)(self)), positive=key in _POSITIVE)
        for name, load in self.loads.items():
            for key, given in vars(load).items():
                if given is not None:
                    check_number(self.source, f"loads.{name}.{key}", given, positive=True)
        _check_resistance(self)
        _check_curves(self)
        for key in ("max_acceleration_mps2", "max_deceleration_mps2", "adhesive_mass_kg"):
            value = getattr(self, key)
            if np.isnan(value) or value <= 0:
                raise InputError(self.source, key, value, "a number > 0")
        if self.default_level not in (*self.losses, Level.L0_NOREG, Level.L0_REG):
            raise InputError(self.source, "default_level", str(self.default_level), "a level of the vehicle")

    def facts(self) -> dict[str, str]:
        """Name, mass, length, top speed and loss levels."""
        modes = {"modes": ", ".join(self.modes)} if self.modes else {}
        return {
            "name": self.name,
            "mass": f"{self.mass_kg / TONNE:.0f} t",
            "length": f"{self.train_length_m:.0f} m",
            "top speed": f"{kmh(self.max_speed_mps):.0f} km/h",
            "levels": ", ".join(sorted({*self.losses, Level.L0_NOREG, Level.L0_REG})),
            **modes,
        }

    @property
    def inertial_mass_kg(self) -> float:
        """Effective mass for acceleration (kg), including the rotating parts."""
        return self.mass_kg * (1.0 + self.rotating_mass_ratio)

    def loss_model(self, level: Level) -> LossModel:
        """The component losses at `level`.

        L0 has no losses. L1 and L2 are read from the file, or fitted to the vehicle's L3 map; L1 may also be the mean
        of OWN's two ratios. L3 and OWN must be in the file. `auxiliary_power_w` is part of OWN, L2 and L3; L1 is a pure
        efficiency. Raises DasError if the vehicle has no data from which the level can be derived.
        """
        model = self._chain_loss(level)
        if self.auxiliary_power_w and level in (Level.OWN, Level.L2, Level.L3):
            return model.with_constant(self.auxiliary_power_w)
        return model

    def _chain_loss(self, level: Level) -> LossModel:
        if level in (Level.L0_NOREG, Level.L0_REG):
            return LOSSLESS
        if level in self.losses:
            return self.losses[level]
        l3 = self.losses.get(Level.L3)
        if isinstance(l3, LossMap) and level in (Level.L1, Level.L2):
            return fit_mean_efficiency(l3, self.traction.max_power_w, with_idle=level is Level.L2)
        own = self.losses.get(Level.OWN)
        if isinstance(own, EfficiencyLoss) and level is Level.L1:
            mean = 0.5 * (own.traction_ratio + own.brake_ratio)
            return EfficiencyLoss(traction_ratio=mean, brake_ratio=mean)
        have = ", ".join(str(x) for x in (Level.L0_NOREG, Level.L0_REG, *self.losses))
        hint = "give a loss map with --loss-map" if level is not Level.OWN else "choose another level"
        raise DasError(f"{self.source}: no data for level {level} (it has {have}); {hint}")

    def brakes_at(self, level: Level) -> BrakePolicy:
        """Brake policy at a level: L0 NOREG dissipates all braking energy; other levels have the train's policy."""
        return BrakePolicy.FRICTION if level is Level.L0_NOREG else self.brake_policy

    def traction_effort_n(self, speed_mps: ArrayLike) -> Floats:
        """Largest traction force (N, >= 0) at each speed: force, power and adhesion of the driven axles."""
        return np.asarray(np.minimum(self.traction.force_n(speed_mps), self._adhesion_n(speed_mps)))

    def electric_brake_effort_n(self, speed_mps: ArrayLike) -> Floats:
        """Largest force of the electric brake (N, >= 0) at each speed: force, power and adhesion."""
        return np.asarray(np.minimum(self.electric_brake.force_n(speed_mps), self._adhesion_n(speed_mps)))

    def brake_effort_n(self, speed_mps: ArrayLike) -> Floats:
        """Largest force of both brakes together (N, >= 0); at most the adhesion of all axles if that is a limit."""
        both = self.electric_brake_effort_n(speed_mps) + self.friction_brake_force_n
        return np.asarray(np.minimum(both, self.braked_adhesive_force_n * adhesion_coefficient(speed_mps)))

    @property
    def adhesive_force_n(self) -> float:
        """Weight on the driven axles multiplied by the adhesion ratio of the rail (N)."""
        return self.adhesive_mass_kg * STANDARD_GRAVITY_MPS2 * self.adhesion_ratio

    @property
    def braked_adhesive_force_n(self) -> float:
        """Weight on all axles multiplied by the adhesion ratio of the rail (N); inf without an adhesion limit."""
        if np.isinf(self.adhesive_mass_kg):
            return np.inf
        return self.mass_kg * STANDARD_GRAVITY_MPS2 * self.adhesion_ratio

    def _adhesion_n(self, speed_mps: ArrayLike) -> Floats:
        return np.asarray(self.adhesive_force_n * adhesion_coefficient(speed_mps))

    def electric_effort_n(self, force_n: ArrayLike, speed_mps: ArrayLike, level: Level, supply: ArrayLike) -> Floats:
        """The share of each wheel force (N) at a speed (m/s) that the motors provide; the friction brake provides the
        rest.

        `supply` is that of `das.domain.route.Route.supply`: where it forbids the electric brake, friction does all
        braking.
        """
        force = np.asarray(force_n, dtype=float)
        brakes = self.brakes_at(level)
        if brakes is BrakePolicy.FRICTION:
            return np.asarray(np.maximum(force, 0.0))
        supply = np.asarray(supply, dtype=float)
        most = np.where(
            supply >= 0, np.inf if brakes is BrakePolicy.ELECTRIC else self.electric_brake_effort_n(speed_mps), 0.0
        )
        return np.where(supply == NEUTRAL, 0.0, np.maximum(force, -most))

    def tunnel_coefficient_n_per_mps2(self, area_m2: float) -> float:
        """Additional resistance coefficient in a tunnel of this cross section (N/(m/s)²), 0 if the file has none.

        Linear between the file's cross sections, constant beyond.
        """
        if not self.tunnel_area_m2:
            return 0.0
        return float(np.interp(area_m2, self.tunnel_area_m2, self.tunnel_resistance_n_per_mps2))

    def tunnel_n_per_mps2(self, route: Route) -> Stretches:
        """The additional v² coefficient (N/(m/s)²) that tunnels give this train, along a line."""
        ends = [(one.start_m, one.start_m + one.length_m) for one in route.tunnels]
        start_m = np.unique([0.0, *(end for both in ends for end in both)])
        value = np.zeros(len(start_m))
        for one, (from_m, to_m) in zip(route.tunnels, ends, strict=True):
            value[(start_m >= from_m) & (start_m < to_m)] = self.tunnel_coefficient_n_per_mps2(one.area_m2)
        return Stretches(start_m=start_m, value=value)

    def line_resistance_mps2(self, route: Route) -> Stretches:
        """Curve resistance per unit of this train's mass (m/s²) along a line.

        The planner, simulated trains and drivers use it; each averages it over the train in its own way.
        """
        curves = route.curvature_per_m
        return Stretches(start_m=curves.start_m.copy(), value=curve_resistance_mps2(curves.value))

    def with_mass(self, mass_kg: float) -> Vehicle:
        """The train with another load.

        The rotating parts keep their mass; the constant resistance c0 (rolling friction) is proportional to the weight.
        """
        ratio = mass_kg / self.mass_kg
        return replace(
            self,
            mass_kg=mass_kg,
            rotating_mass_ratio=self.rotating_mass_ratio / ratio,
            resistance=replace(self.resistance, c0_n=self.resistance.c0_n * ratio),
        )

    def with_load(self, load: Load) -> Vehicle:
        """The train in a load state."""
        train = self.with_mass(load.mass_kg)
        return train if load.c0_n is None else replace(train, resistance=replace(train.resistance, c0_n=load.c0_n))

    def loaded(self, name: str) -> Vehicle:
        """The train in one of its load states or modes, or both ("empty+15kv"); DasError for an unknown name."""
        known = {*self.loads, *self.modes}
        train, parts = self, (name,) if name in known else tuple(name.split("+"))
        for part_of in (self.loads, self.modes):
            if sum(one in part_of for one in parts) > 1:
                raise DasError(f"{self.source}: load {name!r}: expected at most one load state and one mode")
        for one in parts:
            if one not in known:
                have = ", ".join((*self.loads, *self.modes)) or "none"
                raise DasError(f"{self.source}: no load {one!r}; it has {have}")
            train = train.in_mode(one) if one in self.modes else train.with_load(self.loads[one])
        return replace(train, id=f"{self.id}/{name}")

    def in_mode(self, name: str) -> Vehicle:
        """The train with the efforts of one of its modes (a voltage, its diesel engines, a kind of weather).

        Raises DasError if the file has no such mode.
        """
        if name not in self.modes:
            have = ", ".join(self.modes) or "none"
            raise DasError(f"{self.source}: no mode {name!r}; it has {have}")
        mode = self.modes[name]
        return replace(self, traction=mode.traction, electric_brake=mode.electric_brake, mode=name)

    def with_loss_map(self, loss_map: LossMap) -> Vehicle:
        """The train with `loss_map` in place of all its losses."""
        return replace(self, losses=MappingProxyType({Level.L3: loss_map}), default_level=Level.L3)


def _check_resistance(vehicle: Vehicle) -> None:
    """Raise InputError if the resistance is negative at any speed up to the top speed (c1 may be: a tail wind)."""
    c = vehicle.resistance
    if not np.isfinite(c.c1_n_per_mps):
        raise InputError(vehicle.source, "resistance.c1_n_per_mps", c.c1_n_per_mps, "a finite number")
    least_at = np.clip(-c.c1_n_per_mps / (2 * max(c.c2_n_per_mps2, 1e-9)), 0.0, vehicle.max_speed_mps)
    least_n = float(c.force_n(least_at))
    if least_n < 0:
        raise InputError(vehicle.source, f"resistance (N) at {least_at / KMH:.0f} km/h", least_n, "a force >= 0")


def _check_curves(vehicle: Vehicle) -> None:
    """Raise InputError for an effort curve that ends below the top speed or leaves the train unable to stop."""
    for name, effort in (("traction", vehicle.traction), ("electric_brake", vehicle.electric_brake)):
        curve = effort.curve
        if curve is not None and curve.speed_mps[-1] < vehicle.max_speed_mps * (1 - 1e-9):
            ends = f"{kmh(curve.speed_mps[-1]):g} km/h"
            expected = f"at least the top speed of {kmh(vehicle.max_speed_mps):g} km/h"
            raise InputError(vehicle.source, f"last speed of {name}.curve", ends, expected)
    curve = vehicle.electric_brake.curve
    if vehicle.brake_policy is BrakePolicy.ELECTRIC and curve is not None and curve.force_n[0] == 0:
        expected = "a force > 0, or a [friction_brake] with which the train stops"
        raise InputError(vehicle.source, "electric_brake.curve", "0 kN at 0 km/h", expected)


_POSITIVE = (
    *("mass_kg", "max_speed_mps", "traction.max_force_n", "traction.max_power_w", "adhesion_ratio"),
    "service_brake.deceleration_mps2",
)
_NOT_NEGATIVE = (
    *("rotating_mass_ratio", "train_length_m", "resistance.c0_n", "resistance.c2_n_per_mps2"),
    *("electric_brake.max_force_n", "electric_brake.max_power_w", "friction_brake_force_n"),
    *("service_brake.build_up_s", "auxiliary_power_w", "comfort_power_w"),
)
