"""Where on a section the solver decides: at each change of the line, and in between as often as line and speed need.

Within a decision step the train has one acceleration. If the best run switches inside a step of length h at speed v
(say from traction to coasting), a run from the table loses a time in proportion to h²/v³. The closer together the
changes of limit and gradient lie, the more switches the line needs. With d metres from one change to the next, a given
number of steps loses least if h is in proportion to v·d^(1/3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.domain.route import Route
from das.solver import tolerances as tol

Floats = NDArray[np.float64]

_SLOWEST_MPS = 1.0
"""Where the fastest run is slower than this (near a stop), the steps are those for this speed."""


def fixed_nodes(route: Route, ends_m: tuple[float, float], length_m: float, beside_m: float = 0.0) -> Floats:
    """Positions (m) that must be decision nodes: the line's changes, where the train's tail passes them, near stops.

    `length_m` is the length of the train, 0 for a point mass. With `beside_m` there are also nodes at this distance (m)
    before and after each change of the limit, again for the train's head and for its tail.
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
    """The fixed nodes with even steps between them; the fastest run on these nodes determines the decision steps."""
    return subdivide(fixed_m, np.ceil(np.diff(fixed_m) / _longest_m(fixed_m) - 1e-9).astype(np.int64))


def decision_nodes(
    route: Route, fixed_m: Floats, even_m: Floats, fastest_mps: Floats, asked_m: float | None = None
) -> Floats:
    """Positions (m) of the decision nodes: the fixed ones, and others so that no step is longer than its cap.

    `even_m` are the nodes of `even_nodes`, and `fastest_mps` is the speed of the fastest run there. With `asked_m` no
    step is longer than that.
    """
    cap_m = np.minimum(_caps_m(route, even_m, fastest_mps), np.inf if asked_m is None else asked_m)
    steps = np.concatenate(([0.0], np.cumsum(np.diff(even_m) / cap_m)))
    at_fixed = steps[np.searchsorted(even_m, fixed_m)]
    counts = np.maximum(np.ceil(np.diff(at_fixed) - 1e-6), 1.0).astype(np.int64)
    nodes_m = np.interp(subdivide(at_fixed, counts), steps, even_m)
    nodes_m[np.concatenate(([0], np.cumsum(counts)))] = fixed_m
    return nodes_m


def subdivide(nodes: Floats, counts: NDArray[np.int64]) -> Floats:
    """Split interval i of `nodes` into `counts[i]` equal parts."""
    index = np.repeat(np.arange(len(counts)), counts)
    part = np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = nodes[index] + np.diff(nodes)[index] * part / counts[index]
    return np.append(inner, nodes[-1])


def _longest_m(node_m: Floats) -> float:
    """The longest step (m) allowed anywhere on a section with these nodes."""
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
    """For each interval, the distance (m) between the changes of limit, or steep ones of gradient, on either side."""
    gradients = route.gradients_ratio
    steep = gradients.start_m[1:][np.abs(np.diff(gradients.value)) >= tol.STEEP_CHANGE_RATIO]
    at_m = np.unique(np.concatenate((route.limits_mps.start_m, steep)))
    at_m = np.concatenate((node_m[:1], at_m[(at_m > node_m[0]) & (at_m < node_m[-1])], node_m[-1:]))
    middle_m = 0.5 * (node_m[:-1] + node_m[1:])
    return np.diff(at_m)[np.searchsorted(at_m, middle_m) - 1]
