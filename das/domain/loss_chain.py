"""A parametric loss chain from current collector to wheel: transformer, converter, motors, gear, auxiliaries.

The measured maps of the paper are confidential; this chain gives a map of the same kind. Parameters are assumptions or
results of the calibration; the vehicle's file states which (docs/explanation/loss-maps.md). Power is computed from the
wheel to the line: when driving, a component also carries the losses of those nearer to the wheel, when braking it
carries less power than the wheel delivers. Symbols: f = F_shaft/F_rated torque and φ flux of the motors relative to
their rated values, i motor current relative to that at rated torque and flux.

Sources: [S] Steimel, Electric Traction – Motive Power and Energy Supply (three-phase traction chain, pulse patterns,
field weakening); [M] Mohan, Undeland, Robbins, Power Electronics (conduction, switching, GTO snubbers); [B] Bose,
Modern Power Electronics and AC Drives (torque and magnetising current of the induction motor); [N] Niemann, Winter,
Maschinenelemente 2 (gear losses).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.errors import InputError
from das.domain.losses import LossMap, check_map_size
from das.domain.units import KMH, KN

Floats = NDArray[np.float64]

MAP_SPEED_STEP_MPS = 1.0 * KMH
MAP_FORCE_STEP_N = 1.0 * KN
"""Grid steps of the map: 1 km/h × 1 kN, as in the paper."""
LARGEST_PARAMETER = 1e12
"""Largest value of a parameter (SI units); a larger one is rejected."""

IRON_FREQUENCY_EXPONENT = 1.5
"""Exponent of the frequency f in the iron loss: between those of hysteresis (∝ f) and eddy currents (∝ f²)."""


@dataclass(frozen=True, kw_only=True)
class Auxiliaries:
    """Fans, pumps and compressor of the traction equipment, which run while the train moves.

    P = base_w + fan_w·(heat/rated_heat_w)³: the required air flow is proportional to the heat of the cooled components,
    the power of a fan to the cube of its air flow (affinity law). Thermal inertia is neglected.
    """

    base_w: float
    fan_w: float
    rated_heat_w: float

    def __post_init__(self) -> None:
        _check(self, "auxiliaries", positive=("rated_heat_w",))

    def power_w(self, heat_w: Floats) -> Floats:
        """Power (W) while the components to be cooled give off `heat_w`."""
        return self.base_w + self.fan_w * (heat_w / self.rated_heat_w) ** 3


@dataclass(frozen=True, kw_only=True)
class Transformer:
    """Iron loss at the line's constant voltage and frequency, copper loss ∝ current² [S].

    P_L = no_load_w + copper_w·(P/rated_power_w)²; at constant line voltage and unity power factor (four-quadrant
    converter) the current is proportional to the power P drawn or fed back.
    """

    no_load_w: float
    copper_w: float
    rated_power_w: float

    def __post_init__(self) -> None:
        _check(self, "transformer", positive=("rated_power_w",))

    def loss_w(self, power_w: Floats) -> Floats:
        """Loss (W) at the power through the windings (W, either sign)."""
        return self.no_load_w + self.copper_w * (power_w / self.rated_power_w) ** 2


@dataclass(frozen=True, kw_only=True)
class Converter:
    """Line-side converter and motor-side inverter with its clock steps.

    line side:   fixed_w + line_ratio·|P|: fixed clock, so conduction and switching follow the current ∝ power [M];
                 line_brake_ratio when feeding back (rectifying, the current flows in the diodes; feeding back, in
                 the switches)
    motor side:  conduction_w·i + (switching_w·i + snubber_w)·f_switch/asynchronous_hz [M]: on-state voltage × current,
                 switching energy ∝ current, and the charge of the (GTO) snubber capacitors, lost at any current
    f_switch(v): asynchronous_hz up to the first clock speed, then pulses × stator frequency, stator frequency =
                 stator_hz_per_mps·v: synchronous pulse patterns with decreasing numbers of pulses per period, down
                 to full block [S]. The loss jumps at each change.
    """

    fixed_w: float
    line_ratio: float
    line_brake_ratio: float
    conduction_w: float
    switching_w: float
    snubber_w: float
    asynchronous_hz: float
    stator_hz_per_mps: float
    clock_speeds_mps: tuple[float, ...]
    clock_pulses: tuple[float, ...]

    def __post_init__(self) -> None:
        _check(self, "converter", positive=("asynchronous_hz",))
        if len(self.clock_pulses) != len(self.clock_speeds_mps):
            raise InputError("converter", "clock_pulses", list(self.clock_pulses), "one number for each clock speed")
        if any(np.diff(self.clock_speeds_mps) <= 0):
            raise InputError("converter", "clock_speeds_mps", list(self.clock_speeds_mps), "increasing speeds")

    def switching_hz(self, speed_mps: Floats) -> Floats:
        """Switching frequency of the motor-side inverter at each speed."""
        mode = np.searchsorted(np.asarray(self.clock_speeds_mps), speed_mps, side="right")
        pulses = np.array([0.0, *self.clock_pulses])[mode]
        return np.asarray(
            np.where(mode == 0, self.asynchronous_hz, pulses * self.stator_hz_per_mps * speed_mps), dtype=float
        )

    def motor_side_w(self, current_ratio: Floats, speed_mps: Floats) -> Floats:
        """Loss (W) of the motor-side inverter at a current (relative to the rated one) and speed."""
        clock = self.switching_hz(speed_mps) / self.asynchronous_hz
        return self.conduction_w * current_ratio + (self.switching_w * current_ratio + self.snubber_w) * clock

    def line_side_w(self, power_w: Floats) -> Floats:
        """Loss (W) of the line-side converter at the power it passes on (W, either sign)."""
        return self.fixed_w + np.where(power_w < 0, self.line_brake_ratio, self.line_ratio) * np.abs(power_w)


@dataclass(frozen=True, kw_only=True)
class Motors:
    """All traction motors: induction machines in field orientation [B].

    φ = min(1, base_speed/v): above the base speed the voltage is at its limit and the field is weakened. i² = ((m·φ)² +
    h·(f/φ)²)/(1 + m²), m = magnetising_ratio: the torque-forming current grows as the field weakens, and near the
    pull-out torque T_p faster than the torque: h = 2·(1 − √(1 − x²))/x² with x = T/T_p, from Kloss's equation T/T_p =
    2/(s/s_p + s_p/s) and I_rotor² ∝ T·s; h = 1 for small torques, 2 at pull-out. T_p = pull_out_ratio·φ² times the
    rated torque (voltage at its limit). When braking, the torque-forming current is multiplied by brake_current_ratio
    (how well the electric brake uses the voltage; 1 = as well as when driving). Losses: copper_w·i² +
    iron_w·φ²·(v/base_speed)^1.5: copper ∝ current², iron ∝ flux²·frequency^1.5 (Steinmetz).
    """

    base_speed_mps: float
    rated_force_n: float
    magnetising_ratio: float
    pull_out_ratio: float
    brake_current_ratio: float
    copper_w: float
    iron_w: float

    def __post_init__(self) -> None:
        _check(self, "motors", positive=("base_speed_mps", "rated_force_n", "pull_out_ratio", "brake_current_ratio"))

    def flux_ratio(self, speed_mps: Floats) -> Floats:
        """Flux relative to the rated one."""
        return self.base_speed_mps / np.maximum(speed_mps, self.base_speed_mps)

    def current_ratio(self, shaft_force_n: Floats, speed_mps: Floats) -> Floats:
        """Current relative to that at rated torque and flux, at shaft force (N, referred to the wheel) and speed."""
        flux = self.flux_ratio(speed_mps)
        torque = shaft_force_n / self.rated_force_n * np.where(shaft_force_n < 0, self.brake_current_ratio, 1.0)
        # x²·h without dividing by x: 2·(1 − √(1 − x²)); no torque exists beyond pull-out, so a larger one is limited to
        # it.
        share = np.minimum(np.abs(torque) / (self.pull_out_ratio * flux**2), 1.0)
        torque_forming = self.pull_out_ratio * flux * np.sqrt(2.0 * (1.0 - np.sqrt(1.0 - share**2)))
        magnetising = self.magnetising_ratio
        return np.asarray(np.hypot(magnetising * flux, torque_forming) / np.hypot(magnetising, 1.0), dtype=float)

    def loss_w(self, current_ratio: Floats, speed_mps: Floats) -> tuple[Floats, Floats]:
        """Copper and iron loss (W) at a current (relative to the rated one) and speed."""
        iron = (
            self.iron_w * self.flux_ratio(speed_mps) ** 2 * (speed_mps / self.base_speed_mps) ** IRON_FREQUENCY_EXPONENT
        )
        return self.copper_w * current_ratio**2, iron


@dataclass(frozen=True, kw_only=True)
class Gear:
    """Gear and bearings: mesh friction ∝ power, churning oil ∝ v² (viscous torque ∝ speed) [N].

    P_L = mesh_ratio·|P| + churning_w·(v/churning_speed_mps)².
    """

    mesh_ratio: float
    churning_w: float
    churning_speed_mps: float

    def __post_init__(self) -> None:
        _check(self, "gear", positive=("churning_speed_mps",))

    def drag_n(self, force_n: Floats, speed_mps: Floats) -> Floats:
        """Loss per distance (N) at a wheel force (N, either sign) and speed: the motors give more or receive less."""
        return self.mesh_ratio * np.abs(force_n) + self.churning_w * speed_mps / self.churning_speed_mps**2


@dataclass(frozen=True, kw_only=True)
class LossChain:
    """The chain of all components."""

    auxiliaries: Auxiliaries
    transformer: Transformer
    converter: Converter
    motors: Motors
    gear: Gear

    def loss_by_component_w(self, force_n: ArrayLike, speed_mps: ArrayLike) -> dict[str, Floats]:
        """Loss (W) of each component at each force (N) and speed (m/s); all are 0 at standstill."""
        speed = np.asarray(speed_mps, dtype=float)
        losses = self._moving_w(np.asarray(force_n, dtype=float), speed)
        return {name: np.where(speed > 0, loss, 0.0) for name, loss in losses.items()}

    def loss_w(self, force_n: ArrayLike, speed_mps: ArrayLike) -> Floats:
        """Loss (W) of the whole chain at each force (N) and speed (m/s); 0 at standstill."""
        return _total(self.loss_by_component_w(force_n, speed_mps))

    def to_map(self, name: str, max_force_n: float, max_brake_force_n: float, max_speed_mps: float) -> LossMap:
        """Tabulate at 1 kN × 1 km/h over the whole rectangle of forces and speeds.

        The row of 0 km/h contains the losses of a train that is just moving; losses below 1 km/h are thus interpolated
        between moving states (at standstill the loss of any map is 0).
        """
        speeds = math.ceil(max_speed_mps / MAP_SPEED_STEP_MPS - 1e-9) + 2
        low, high = -math.ceil(max_brake_force_n / MAP_FORCE_STEP_N) - 1, math.ceil(max_force_n / MAP_FORCE_STEP_N) + 1
        check_map_size(name, speeds, high - low + 1)
        speed = np.arange(float(speeds)) * MAP_SPEED_STEP_MPS
        force = np.arange(float(low), float(high + 1)) * MAP_FORCE_STEP_N
        table = _total(self._moving_w(force[np.newaxis, :], speed[:, np.newaxis]))
        return LossMap(name=name, speed_mps=speed, force_n=force, loss_w_table=table)

    def _moving_w(self, force: Floats, speed: Floats) -> dict[str, Floats]:
        force, speed = np.broadcast_arrays(force, speed)
        wheel_power = force * speed
        drag = self.gear.drag_n(force, speed)
        gear = drag * speed
        current = self.motors.current_ratio(force + drag, speed)
        copper, iron = self.motors.loss_w(current, speed)
        inverter = self.converter.motor_side_w(current, speed)
        link_power = wheel_power + gear + copper + iron + inverter
        line_side = self.converter.line_side_w(link_power)
        transformer = self.transformer.loss_w(link_power + line_side + self.auxiliaries.base_w)
        auxiliaries = self.auxiliaries.power_w(transformer + line_side + inverter + copper + iron)
        return {
            "auxiliaries": auxiliaries,
            "transformer": transformer,
            "line converter": line_side,
            "motor inverter": inverter,
            "motor copper": copper,
            "motor iron": iron,
            "gear": gear,
        }


def _total(losses: dict[str, Floats]) -> Floats:
    return np.asarray(sum(losses.values()), dtype=float)


def _check(component: object, name: str, positive: tuple[str, ...] = ()) -> None:
    """Raise InputError unless all parameters are finite, >= 0 and plausible in size, and the `positive` ones > 0."""
    for item in fields(component):  # type: ignore[arg-type]
        value = getattr(component, item.name)
        if not np.isfinite(value).all() or np.any(np.asarray(value) < 0):
            raise InputError(name, item.name, value, "a finite number >= 0")
        if np.any(np.asarray(value) > LARGEST_PARAMETER):
            raise InputError(name, item.name, value, f"at most {LARGEST_PARAMETER:g}")
        if item.name in positive and value <= 0:
            raise InputError(name, item.name, value, "a finite number > 0")
