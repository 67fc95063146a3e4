"""The line profile of a train: forces, limits and supply, averaged over the train, on a grid of positions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from das.domain.formulary import line_force_n
from das.domain.route import Route, Stretches
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol
from das.solver.kernels.tuples import LineArrays

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LineProfile:
    """The profile of a line under a train, on a grid of positions `node_m` (route coordinates).

    The other arrays have one value per interval: `step_m`, `grade_ratio` (gradient averaged over the train),
    `constant_n` (gradient and curve force), `tunnel_n_per_mps2`, `limit_mps` (over the whole train), and `supply`
    (receptivity, `NO_REGENERATION` or `NEUTRAL`; the lowest if an interval has several).
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
        """The profile between the given positions for a train of this length (m, 0: a point mass)."""
        grade = _over_train(route.gradients_ratio, node_m, train_length_m)
        curve = _over_train(vehicle.line_resistance_mps2(route), node_m, train_length_m)
        constant_n = line_force_n(vehicle.mass_kg, grade, curve)
        limit = np.minimum(
            route.limits_mps.minimum(node_m[:-1] - train_length_m, node_m[1:]),
            vehicle.max_speed_mps,
        )
        tunnel = _over_train(vehicle.tunnel_n_per_mps2(route), node_m, train_length_m)
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
        """Times (s, from 0) at the nodes for these node speeds and constant acceleration between them."""
        return np.concatenate(([0.0], np.cumsum(2.0 * self.step_m / (speeds_mps[:-1] + speeds_mps[1:]))))

    @cached_property
    def for_kernels(self) -> LineArrays:
        """Step, constant force, tunnel coefficient and supply of each interval, in the form required by the kernels."""
        return LineArrays(self.step_m, self.constant_n, self.tunnel_n_per_mps2, self.supply)


def _over_train(stretches: Stretches, node_m: Floats, length_m: float) -> Floats:
    """Mean over each interval of a quantity averaged over the train's length."""
    if length_m == 0:
        return stretches.mean(node_m[:-1], node_m[1:])
    # The train-averaged profile is linear between nodes that contain every breakpoint b and b + length.
    at_nodes = stretches.mean(node_m - length_m, node_m)
    return 0.5 * (at_nodes[:-1] + at_nodes[1:])


_SLOWEST_MPS = 1.0
"""Lowest speed (m/s) for which decision steps are computed; a slower trajectory (near a stop) has the same steps."""


def fixed_nodes(route: Route, ends_m: tuple[float, float], length_m: float, beside_m: float = 0.0) -> Floats:
    """Positions (m) that must be decision nodes: at and near stops, and where the head or tail meets a change of the
    line.

    `length_m` is the length of the train, 0 for a point mass. With `beside_m` there are also nodes at this distance (m)
    before and after each change of the limit.
    """
    start_m, end_m = ends_m
    breaks = route.breakpoints_m()
    if beside_m > 0.0:
        limits = route.limits_mps.start_m
        breaks = np.concatenate((breaks, limits - beside_m, limits + beside_m))
    offsets = np.array([x for x in tol.STOP_OFFSETS_M if x < (end_m - start_m) / 2])
    nodes = np.concatenate((breaks, breaks + length_m, start_m + offsets, end_m - offsets))
    nodes = np.unique(nodes[(nodes > start_m + tol.MIN_STEP_M) & (nodes < end_m - tol.MIN_STEP_M)])
    nodes = np.concatenate(([start_m], nodes, [end_m]))
    return nodes[np.concatenate(([True], np.diff(nodes) > tol.MIN_STEP_M))]


def even_nodes(fixed_m: Floats) -> Floats:
    """The fixed nodes and evenly spaced ones between; the fastest trajectory on them determines the decision steps."""
    return subdivide(fixed_m, np.ceil(np.diff(fixed_m) / _longest_m(fixed_m) - 1e-9).astype(np.int64))


def decision_nodes(
    route: Route, fixed_m: Floats, even_m: Floats, fastest_mps: Floats, asked_m: float | None = None
) -> Floats:
    """Positions (m) of the decision nodes: the fixed ones, and others that limit each step to its cap.

    `even_m` are the nodes of `even_nodes`, and `fastest_mps` is the speed of the fastest trajectory there. With
    `asked_m`, steps are also at most that long.
    """
    cap_m = np.minimum(_caps_m(route, even_m, fastest_mps), np.inf if asked_m is None else asked_m)
    steps = np.concatenate(([0.0], np.cumsum(np.diff(even_m) / cap_m)))
    at_fixed = steps[np.searchsorted(even_m, fixed_m)]
    counts = np.maximum(np.ceil(np.diff(at_fixed) - 1e-6), 1.0).astype(np.int64)
    # Rounded to the micrometre: the last digits of a cube root depend on the processor, and trajectories depend on the
    # last digit of a node.
    nodes_m = np.round(np.interp(subdivide(at_fixed, counts), steps, even_m), 6)
    nodes_m[np.concatenate(([0], np.cumsum(counts)))] = fixed_m
    return nodes_m


def subdivide(nodes: Floats, counts: NDArray[np.int64]) -> Floats:
    """Split interval i of `nodes` into `counts[i]` equal parts."""
    index = np.repeat(np.arange(len(counts)), counts)
    part = np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = nodes[index] + np.diff(nodes)[index] * part / counts[index]
    return np.append(inner, nodes[-1])


def _longest_m(node_m: Floats) -> float:
    """The longest step (m) allowed on a section with these nodes."""
    share_m = (node_m[-1] - node_m[0]) / tol.STEPS_OF_A_SECTION
    return float(np.clip(share_m, tol.SHORTEST_MAX_STEP_M, tol.MAX_STEP_M))


def _caps_m(route: Route, node_m: Floats, fastest_mps: Floats) -> Floats:
    """The longest decision step (m) that each interval allows."""
    mean_mps = np.maximum(0.5 * (fastest_mps[:-1] + fastest_mps[1:]), _SLOWEST_MPS)
    apart = _changes_apart_m(route, node_m) / tol.USUAL_APART_M
    factor = np.clip(np.cbrt(apart), tol.DENSE_FACTOR, tol.SPARSE_FACTOR)
    cap_m: Floats = np.clip(tol.STEP_S * mean_mps * factor, tol.SHORTEST_MAX_STEP_M, _longest_m(node_m))
    return cap_m


def _changes_apart_m(route: Route, node_m: Floats) -> Floats:
    """The distance (m) between the changes of limit, or steep gradient changes, on both sides of each interval."""
    gradients = route.gradients_ratio
    steep = gradients.start_m[1:][np.abs(np.diff(gradients.value)) >= tol.STEEP_CHANGE_RATIO]
    at_m = np.unique(np.concatenate((route.limits_mps.start_m, steep)))
    at_m = np.concatenate((node_m[:1], at_m[(at_m > node_m[0]) & (at_m < node_m[-1])], node_m[-1:]))
    middle_m = 0.5 * (node_m[:-1] + node_m[1:])
    return np.diff(at_m)[np.searchsorted(at_m, middle_m) - 1]
