"""What the kernels take: named tuples of arrays and numbers, which numba passes on without copying."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.solver.params import TrainParams

Floats = NDArray[np.float64]


class LineArrays(NamedTuple):
    """What the line asks of a train, one value per interval (n,).

    `step_m` is the length of the interval, `constant_n` the gradient and curve force, `tunnel_n_per_mps2` the extra
    resistance coefficient of a tunnel, and `supply` the receptivity, `NO_REGENERATION` or `NEUTRAL`.
    """

    step_m: Floats
    constant_n: Floats
    tunnel_n_per_mps2: Floats
    supply: Floats


class SpeedBounds(NamedTuple):
    """The slowest and the fastest speed at each node (n + 1,), between which the speed grid of a node lies."""

    floor_mps: Floats
    envelope_mps: Floats


class Moves(NamedTuple):
    """Landings from each speed of some decision nodes (nodes, speeds, landings); none depends on λ.

    `time_s` and `energy_j` are the cost of a landing. `target` is the speed index below the landing at the next node,
    and `weight` the share of the index above (linear in v²). Of each state the first `filled` (nodes,
    speeds) landings are filled.
    """

    time_s: NDArray[np.float32]
    energy_j: Floats
    target: NDArray[np.int32]
    weight: NDArray[np.float32]
    filled: NDArray[np.int16]


class PackedTimes(NamedTuple):
    """Times-to-go as a table on disk holds them: low_s + step_s·steps.

    `steps` (K + 1 decision nodes, J + 1 speeds, L multipliers), `low_s` and `step_s` (K + 1, L).
    """

    steps: NDArray[np.uint16]
    low_s: NDArray[np.float32]
    step_s: NDArray[np.float32]


class Policies(NamedTuple):
    """The solved policies of a section: `lambda_w` (L,), values and times-to-go (K + 1, J + 1, L) of every state."""

    lambda_w: Floats
    value_j: Floats | NDArray[np.float32]
    time_to_go_s: NDArray[np.float32] | PackedTimes


class Policy(NamedTuple):
    """A multiplier λ between two neighbours of the ladder: λ itself, the lower one's index, λ − λ_a, λ_{a+1} − λ_a.

    The gap is 0 for a multiplier of the ladder itself.
    """

    price_w: float
    ladder_index: int
    offset_w: float = 0.0
    gap_w: float = 0.0


class DecisionStep(NamedTuple):
    """The way to the decision node `node`: its length, mean forces, and the bounds of the speed at its end.

    `final` says that the node is the end of the section and has one end speed. `train` is the train on the supply of
    this step.
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
    """A run that is known: its speed at every integration node, and the time to go from there (s)."""

    speed_mps: Floats
    time_to_go_s: Floats
