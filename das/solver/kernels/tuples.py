"""Arguments of the kernels: named tuples of arrays and numbers, which numba passes without copying."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.effort import SAMPLE_STEP_MPS, EffortEnvelope
from das.domain.losses import EfficiencyLoss, LossModel
from das.domain.vehicle import BrakePolicy, Vehicle

NO_LIMIT_N = 1e30
"""A force (N) above that of any train; finite, so that products remain defined."""


class TrainParams(NamedTuple):
    """The parameters of a train in the form required by the kernels (SI).

    `adhesive_force_n` and `braked_adhesive_force_n` are the weights on the driven and on all axles multiplied by the
    adhesion ratio of the rail; multiplied by the adhesion coefficient, they limit the forces of the motors and of all
    brakes. `receptivity_ratio` is the share of the power fed back that the line accepts. `brakes_dissipate`: no brake
    feeds energy back. `has_curves`: the motors are also limited by `curves_n` (2, n), the samples of the effort curves
    of traction and of the electric brake.
    """

    inertial_mass_kg: float
    c0_n: float
    c1_n_per_mps: float
    c2_n_per_mps2: float
    traction_force_n: float
    traction_power_w: float
    electric_force_n: float
    electric_power_w: float
    friction_force_n: float
    adhesive_force_n: float
    braked_adhesive_force_n: float
    max_acceleration_mps2: float
    max_deceleration_mps2: float
    receptivity_ratio: float
    brakes_dissipate: bool
    has_curves: bool
    curves_n: NDArray[np.float64]


class ServiceParams(NamedTuple):
    """A service braking in the form required by the kernels: at most `deceleration_mps2`, with at most the share
    `force_share` of the force of all brakes (the electric brake and `friction_force_n`, even if plans use no friction).

    The brakes act with a delay of `delay_s`.
    """

    deceleration_mps2: float
    delay_s: float
    force_share: float
    friction_force_n: float


PlainTrain: Any = namedtuple("PlainTrain", TrainParams._fields[:-2])  # type: ignore[misc]
"""The parameters of a train without effort curves, for the kernels that are compiled into vector instructions."""


class LossParams(NamedTuple):
    """A loss model in the form required by the kernels.

    `table_w[i, j]` is the loss of a map at the speed i/steps_per_mps and the force force0_n + j/steps_per_n.
    """

    is_map: bool
    traction_ratio: float
    brake_ratio: float
    idle_w: float
    steps_per_mps: float
    force0_n: float
    steps_per_n: float
    table_w: NDArray[np.float64]


def train_params(vehicle: Vehicle, brakes: BrakePolicy) -> TrainParams:
    """The parameters of a train for a brake policy."""
    electric = vehicle.electric_brake
    has_friction = BrakePolicy.ELECTRIC not in (vehicle.brake_policy, brakes)
    return TrainParams(
        vehicle.inertial_mass_kg,
        vehicle.resistance.c0_n,
        vehicle.resistance.c1_n_per_mps,
        vehicle.resistance.c2_n_per_mps2,
        vehicle.traction.max_force_n,
        vehicle.traction.max_power_w,
        electric.max_force_n,
        electric.max_power_w,
        vehicle.friction_brake_force_n if has_friction else 0.0,
        min(vehicle.adhesive_force_n, NO_LIMIT_N),
        min(vehicle.braked_adhesive_force_n, NO_LIMIT_N),
        min(vehicle.max_acceleration_mps2, 1e6),
        min(vehicle.max_deceleration_mps2, 1e6),
        1.0,
        brakes is BrakePolicy.FRICTION,
        vehicle.traction.curve is not None or electric.curve is not None,
        _samples_n(vehicle.traction, electric),
    )


CURVE_STEPS_PER_MPS = 1.0 / SAMPLE_STEP_MPS
"""Number of samples of an effort curve per speed (s/m)."""


def _samples_n(*envelopes: EffortEnvelope) -> NDArray[np.float64]:
    """The samples (envelopes, n) of the effort curves, with the last one repeated; `NO_LIMIT_N` without a curve."""
    samples = [np.full(2, NO_LIMIT_N) if one.curve is None else one.curve.samples_n for one in envelopes]
    longest = max(len(one) for one in samples)
    return np.stack([np.pad(one, (0, longest - len(one)), mode="edge") for one in samples])


def loss_params(loss: LossModel) -> LossParams:
    """The parameters of a loss model."""
    if isinstance(loss, EfficiencyLoss):
        empty = np.zeros((2, 2))
        return LossParams(False, loss.traction_ratio, loss.brake_ratio, loss.idle_w, 1.0, 0.0, 1.0, empty)
    return LossParams(
        True,
        0.0,
        0.0,
        0.0,
        1.0 / loss.speed_step_mps,
        float(loss.force_n[0]),
        1.0 / loss.force_step_n,
        np.array(loss.filled_w),  # a writable copy: numba would compile again for a read-only array
    )


Floats = NDArray[np.float64]


class LineArrays(NamedTuple):
    """Resistance and supply of the line, one value per interval (n,).

    `step_m` is the length of the interval, `constant_n` the gradient and curve force, `tunnel_n_per_mps2` the extra
    resistance coefficient of a tunnel, and `supply` the receptivity, `NO_REGENERATION` or `NEUTRAL`.
    """

    step_m: Floats
    constant_n: Floats
    tunnel_n_per_mps2: Floats
    supply: Floats


class SpeedBounds(NamedTuple):
    """The lowest and the highest speed at each node (n + 1,): the bounds of its speed grid."""

    floor_mps: Floats
    envelope_mps: Floats


class Moves(NamedTuple):
    """The moves from each speed at some decision nodes to the next node (nodes, speeds, landings); none depends on λ.

    A landing is where a move ends; `time_s` and `energy_j` are the costs of the move. `target` is the speed index below
    the landing, and `weight` the share of the index above (linear in v²). Only the first `filled[node, speed]` landings
    of a state are used.
    """

    time_s: NDArray[np.float32]
    energy_j: Floats
    target: NDArray[np.int32]
    weight: NDArray[np.float32]
    filled: NDArray[np.int16]


class Policies(NamedTuple):
    """The solved policies of a section: `lambda_w` (L,), values and times-to-go (K + 1, J + 1, L) of every state."""

    lambda_w: Floats
    value_j: Floats
    time_to_go_s: NDArray[np.float32]


class Policy(NamedTuple):
    """A multiplier λ between the neighbouring multipliers λ_a and λ_{a+1} of the ladder.

    The fields are λ, the index a, the offset λ − λ_a and the gap λ_{a+1} − λ_a; the gap is 0 for a multiplier of the
    ladder itself.
    """

    price_w: float
    ladder_index: int
    offset_w: float = 0.0
    gap_w: float = 0.0


class DecisionStep(NamedTuple):
    """The step to the decision node `node`: its length, mean forces, and the bounds of the speed at its end.

    `final`: the node is the end of the section and has one end speed. `train` is the train on the supply of this step.
    """

    node: int
    length_m: float
    constant_n: float
    tunnel_n_per_mps2: float
    floor_mps: float
    envelope_mps: float
    final: bool
    train: TrainParams


class KnownRun(NamedTuple):
    """A known trajectory: its speed at every integration node (m/s), and the time to go from there (s)."""

    speed_mps: Floats
    time_to_go_s: Floats
