"""How a run uses its forces: reduced acceleration and reduced braking as in Nold & Corman (2024), sections 4.3 and 4.4.

Each interval has one mode, by the wheel force F as a share of the force available at its speed, and by the
acceleration a:

    cruising              |a| <= CRUISE_MPS2
    full effort           |F| >= FULL_RATIO · available
    coasting              |F| <= COAST_RATIO · available
    reduced acceleration  F > 0 between the two, and a > 0
    reduced braking       F < 0 between the two, and a < 0
    other                 force against the change of speed: F > 0 on a climb with a < 0, F < 0 on a descent with a > 0

Only an unbroken stretch of reduced effort counts that is at least LEAST_STRETCH_M long and changes the kinetic energy
by at least LEAST_KINETIC_RATIO of the run's highest: where a run of four modes switches, or where the solver blends two
runs to hit a time, the force is in between for some decision steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.trajectory import Trajectory
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.solver.tolerances import MAX_STEP_M
from docs.studies.cases import Floats

FULL_RATIO = 0.97
"""From this share of the available force on, the effort is full."""
COAST_RATIO = 0.03
"""Up to this share of the available force, the train coasts."""
CRUISE_MPS2 = 0.01
"""Up to this acceleration (36 km/h in 1000 s) the train holds its speed."""
LEAST_STRETCH_M = 2.5 * MAX_STEP_M
"""Shorter stretches of reduced effort are the solver's blending between two modes."""
LEAST_KINETIC_RATIO = 0.05
"""Stretches that change the kinetic energy by a smaller share of the run's highest are blending as well."""


class EffortRegime(IntEnum):
    """How the train is driven on an interval."""

    OTHER = 0
    FULL = 1
    COASTING = 2
    CRUISING = 3
    REDUCED_ACCELERATION = 4
    REDUCED_BRAKING = 5


@dataclass(frozen=True, kw_only=True)
class Reduced:
    """Use of reduced effort in a run; zeros (and empty `stretches_m`) if there is none.

    `way_ratio`, `time_ratio`: shares of the whole distance and time. `mean_force_ratio`: mean over this time of the
    force as a share of the available force. `lowest_mps`, `highest_mps`: range of speed. `stretches_m`: begin and end
    of each.
    """

    way_ratio: float = 0.0
    time_ratio: float = 0.0
    mean_force_ratio: float = 0.0
    lowest_mps: float = 0.0
    highest_mps: float = 0.0
    stretches_m: tuple[tuple[float, float], ...] = ()

    @property
    def used(self) -> bool:
        """Whether there is any reduced effort."""
        return bool(self.stretches_m)

    def as_json(self) -> dict[str, Any] | None:
        """What summary.json states about this; None if there is no reduced effort."""
        if not self.used:
            return None
        return {
            "way_ratio": self.way_ratio,
            "time_ratio": self.time_ratio,
            "mean_force_ratio": self.mean_force_ratio,
            "lowest_kmh": self.lowest_mps / KMH,
            "highest_kmh": self.highest_mps / KMH,
            "stretches_m": self.stretches_m,
        }


@dataclass(frozen=True, kw_only=True)
class ReducedEffort:
    """Reduced effort of a run, in acceleration and in braking."""

    acceleration: Reduced
    braking: Reduced

    def as_json(self) -> dict[str, Any]:
        """What summary.json states about this."""
        return {"acceleration": self.acceleration.as_json(), "braking": self.braking.as_json()}


def effort(trajectory: Trajectory, vehicle: Vehicle) -> ReducedEffort:
    """Reduced acceleration and braking of a run of this vehicle (definition: see the module)."""
    ratio = force_ratio(trajectory, vehicle)
    modes = driving_modes(trajectory, vehicle)
    return ReducedEffort(
        acceleration=_reduced(trajectory, ratio, modes == EffortRegime.REDUCED_ACCELERATION),
        braking=_reduced(trajectory, ratio, modes == EffortRegime.REDUCED_BRAKING),
    )


def force_ratio(trajectory: Trajectory, vehicle: Vehicle) -> Floats:
    """Wheel force of each interval as a share of the available one: 1 = full traction, −1 = full brake.

    The available force is the traction envelope or, for braking, the electric brake's envelope (the friction brake's if
    there is no electric one), at the interval's higher speed, cut to the vehicle's largest acceleration and
    deceleration.
    """
    faster = np.maximum(trajectory.v_mps[:-1], trajectory.v_mps[1:])
    resistance = vehicle.resistance.force_n(faster) + trajectory.grade_and_curve_n
    traction = np.minimum(
        vehicle.traction.force_n(faster), vehicle.inertial_mass_kg * vehicle.max_acceleration_mps2 + resistance
    )
    brake = vehicle.electric_brake.force_n(faster)
    brake = np.where(brake > 0, brake, vehicle.friction_brake_force_n)
    brake = np.minimum(brake, vehicle.inertial_mass_kg * vehicle.max_deceleration_mps2 - resistance)
    force = trajectory.force_el_n + trajectory.force_friction_n
    available = np.where(force >= 0, traction, brake)
    return np.asarray(force / np.maximum(available, 1.0), dtype=float)


def driving_modes(trajectory: Trajectory, vehicle: Vehicle) -> NDArray[np.int64]:
    """The `EffortRegime` of each interval."""
    ratio = force_ratio(trajectory, vehicle)
    change = np.diff(trajectory.v_mps) / trajectory.interval_s()
    modes = np.full(len(ratio), int(EffortRegime.OTHER))
    modes[(ratio > 0) & (change > 0)] = EffortRegime.REDUCED_ACCELERATION
    modes[(ratio < 0) & (change < 0)] = EffortRegime.REDUCED_BRAKING
    modes[np.abs(ratio) >= FULL_RATIO] = EffortRegime.FULL
    modes[np.abs(ratio) <= COAST_RATIO] = EffortRegime.COASTING
    modes[(np.abs(change) <= CRUISE_MPS2) & (np.abs(ratio) < FULL_RATIO)] = EffortRegime.CRUISING
    return modes


def _reduced(trajectory: Trajectory, ratio: Floats, reduced: NDArray[np.bool_]) -> Reduced:
    stretches = [(a, b) for a, b in _stretches(reduced) if _counts(trajectory, a, b)]
    if not stretches:
        return Reduced()
    kept = np.concatenate([np.arange(a, b) for a, b in stretches])
    interval_s = trajectory.interval_s()[kept]
    way_m = float(np.diff(trajectory.s_m)[kept].sum())
    speeds = np.concatenate((trajectory.v_mps[kept], trajectory.v_mps[kept + 1]))
    return Reduced(
        way_ratio=way_m / float(trajectory.s_m[-1] - trajectory.s_m[0]),
        time_ratio=float(interval_s.sum()) / trajectory.time_s,
        mean_force_ratio=float(np.abs(ratio[kept]) @ interval_s / interval_s.sum()),
        lowest_mps=float(speeds.min()),
        highest_mps=float(speeds.max()),
        stretches_m=tuple((float(trajectory.s_m[a]), float(trajectory.s_m[b])) for a, b in stretches),
    )


def _counts(trajectory: Trajectory, a: int, b: int) -> bool:
    """Whether the stretch from node a to node b is long enough and changes the speed enough to count."""
    v2 = trajectory.v_mps**2
    long_enough = trajectory.s_m[b] - trajectory.s_m[a] >= LEAST_STRETCH_M
    return bool(long_enough and abs(v2[b] - v2[a]) >= LEAST_KINETIC_RATIO * v2.max())


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one-past-last index of each unbroken run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
