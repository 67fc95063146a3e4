"""A line as it acts on a train, on a grid of positions: forces, limits and supply, averaged over the train."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from das.domain.formulary import line_force_n
from das.domain.route import Route, Stretches
from das.domain.vehicle import Vehicle
from das.solver.kernels.tuples import LineArrays

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LineProfile:
    """A line as it acts on a train, on a grid of positions `node_m` (route coordinates).

    The other arrays hold one value per interval: `step_m`, `grade_ratio` (gradient averaged over the train),
    `constant_n` (gradient and curve force), `tunnel_n_per_mps2`, `limit_mps` (over the whole train), and `supply`
    (receptivity, `NO_REGENERATION` or `NEUTRAL`; the least where an interval has several).
    """

    node_m: Floats
    step_m: Floats
    grade_ratio: Floats
    constant_n: Floats
    tunnel_n_per_mps2: Floats
    limit_mps: Floats
    supply: Floats

    @classmethod
    def on(cls, route: Route, vehicle: Vehicle, node_m: Floats, train_length_m: float) -> Self:
        """The line under a train of this length (m, 0: a point mass), between the given positions."""
        grade = _over_train(route.gradients_ratio, node_m, train_length_m)
        curve = _over_train(route.curve_resistance_mps2(), node_m, train_length_m)
        constant_n = line_force_n(vehicle.mass_kg, grade, curve)
        limit = np.minimum(
            route.limits_mps.minimum(node_m[:-1] - train_length_m, node_m[1:]),
            vehicle.max_speed_mps,
        )
        tunnel = _over_train(_tunnel_coefficient(route, vehicle), node_m, train_length_m)
        return cls(
            node_m=node_m,
            step_m=np.diff(node_m),
            grade_ratio=grade,
            constant_n=constant_n,
            tunnel_n_per_mps2=tunnel,
            limit_mps=limit,
            supply=route.supply().minimum(node_m[:-1], node_m[1:]),
        )

    def elapsed_s(self, speeds_mps: Floats) -> Floats:
        """Times (s, from 0) at the nodes of a run with these speeds, at constant acceleration between the nodes."""
        return np.concatenate(([0.0], np.cumsum(2.0 * self.step_m / (speeds_mps[:-1] + speeds_mps[1:]))))

    @property
    def for_kernels(self) -> LineArrays:
        """Step, constant force, tunnel coefficient and supply of each interval, as every kernel takes them."""
        return LineArrays(self.step_m, self.constant_n, self.tunnel_n_per_mps2, self.supply)


def _over_train(stretches: Stretches, node_m: Floats, length_m: float) -> Floats:
    """Mean over each interval of a quantity that is itself averaged over the train's length."""
    if length_m == 0:
        return stretches.mean(node_m[:-1], node_m[1:])
    # The train-averaged profile is linear between nodes that contain every breakpoint b and b + length.
    at_nodes = stretches.mean(node_m - length_m, node_m)
    return 0.5 * (at_nodes[:-1] + at_nodes[1:])


def _tunnel_coefficient(route: Route, vehicle: Vehicle) -> Stretches:
    starts, values = [0.0], [0.0]
    for tunnel in route.tunnels:
        if tunnel.start_m == starts[-1]:
            starts.pop(), values.pop()
        starts += [tunnel.start_m, tunnel.start_m + tunnel.length_m]
        values += [vehicle.tunnel_coefficient_n_per_mps2(tunnel.area_m2), 0.0]
    return Stretches(start_m=np.array(starts), value=np.array(values))
