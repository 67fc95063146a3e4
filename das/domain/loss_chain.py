"""A parametric loss chain from current collector to wheel: transformer, inverter, motors, gear, auxiliaries.

The measured maps behind the paper are confidential; this makes a map of the same kind from named components. Each
component's formula is the textbook one (e.g. Steimel, "Electric Traction", 2nd ed., ch. 4–9); parameters are
assumptions that the vehicle's file states.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.errors import InputError
from das.domain.losses import LossMap
from das.domain.units import KMH, KN

Floats = NDArray[np.float64]

MAP_SPEED_STEP_MPS = 1.0 * KMH
MAP_FORCE_STEP_N = 1.0 * KN
"""Grid of the map: 1 km/h × 1 kN, the paper's."""


@dataclass(frozen=True, kw_only=True)
class LossChain:
    """Parameters of the chain; losses in W at wheel force F (N) and speed v (m/s), P = |F·v|.

    auxiliaries:  auxiliary_w (fans, pumps, compressors of the traction equipment)
    transformer:  transformer_no_load_w + transformer_copper_per_w · P²      (iron; copper with current ∝ power)
    inverter:     inverter_fixed_w + inverter_ratio · P · pulse(v)            (conduction and switching)
                  pulse(v): the switching share falls by `clock_drop_ratio` at each of `clock_speeds_mps`, where the
                  GTO inverter changes to fewer pulses per period: the map's visible jumps
    motors:       motor_copper_w_per_n2 · F² · weak(v) + motor_iron_w · (v / v_base)^1.5
                  weak(v) = max(1, v / v_base)^0.5: field weakening needs more current for the same torque
    gear:         gear_ratio · P + gear_windage_w_per_mps · v
    """

    auxiliary_w: float
    transformer_no_load_w: float
    transformer_copper_per_w: float
    inverter_fixed_w: float
    inverter_ratio: float
    clock_speeds_mps: tuple[float, ...]
    clock_drop_ratio: float
    motor_copper_w_per_n2: float
    motor_iron_w: float
    base_speed_mps: float
    gear_ratio: float
    gear_windage_w_per_mps: float

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not np.isfinite(value).all() or np.any(np.asarray(value) < 0):
                raise InputError("loss chain", item.name, value, "finite and >= 0")
        if self.base_speed_mps <= 0:
            raise InputError("loss chain", "base_speed_mps", self.base_speed_mps, "a speed > 0")

    def loss_w(self, force_n: ArrayLike, speed_mps: ArrayLike) -> Floats:
        """Loss (W) of the whole chain at each force and speed."""
        force, speed = np.asarray(force_n, dtype=float), np.asarray(speed_mps, dtype=float)
        power = np.abs(force * speed)
        changes = np.searchsorted(np.asarray(self.clock_speeds_mps), speed, side="right")
        pulse = (1.0 - self.clock_drop_ratio) ** changes
        relative = speed / self.base_speed_mps
        transformer = self.transformer_no_load_w + self.transformer_copper_per_w * power**2
        inverter = self.inverter_fixed_w + self.inverter_ratio * power * pulse
        motors = (
            self.motor_copper_w_per_n2 * force**2 * np.sqrt(np.maximum(relative, 1.0))
            + self.motor_iron_w * relative**1.5
        )
        gear = self.gear_ratio * power + self.gear_windage_w_per_mps * speed
        return np.asarray(self.auxiliary_w + transformer + inverter + motors + gear, dtype=float)

    def to_map(self, name: str, max_force_n: float, max_brake_force_n: float, max_speed_mps: float) -> LossMap:
        """Tabulate at 1 kN × 1 km/h over the whole rectangle of forces and speeds."""
        speed = np.arange(np.ceil(max_speed_mps / MAP_SPEED_STEP_MPS - 1e-9) + 2) * MAP_SPEED_STEP_MPS
        low = -np.ceil(max_brake_force_n / MAP_FORCE_STEP_N) - 1
        high = np.ceil(max_force_n / MAP_FORCE_STEP_N) + 1
        force = np.arange(low, high + 1) * MAP_FORCE_STEP_N
        table = self.loss_w(force[np.newaxis, :], speed[:, np.newaxis])
        return LossMap(name=name, speed_mps=speed, force_n=force, loss_w_table=table)
