"""The paper's grid over a section, and its states that lie on a sufficiently fast run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InfeasibleError
from das.domain.route import NEUTRAL
from das.domain.units import KMH
from das.solver.kernels.forces import on_supply
from das.solver.kernels.tuples import TrainParams
from das.solver.line_profile import LineProfile
from das.solver.section import Section
from precompute.exact import kernels

Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """The paper's grid: nodes every `step_m`, speeds in steps of `speed_kmh`, coasting in steps of `coast_kmh`.

    Between the ends no speed is below `lowest_kmh` (or the limit, if that is lower).
    """

    step_m: float = 100.0
    speed_kmh: float = 0.25
    coast_kmh: float = 0.01
    lowest_kmh: float = 20.0

    @property
    def ratio(self) -> int:
        return round(self.speed_kmh / self.coast_kmh)

    @property
    def unit_mps(self) -> float:
        return self.coast_kmh * KMH


@dataclass(frozen=True, kw_only=True, eq=False)
class Graph:
    """A section on a grid. Speeds are whole numbers of `unit_mps`; those divisible by `ratio` are on the coarse grid.

    `lowest` and `highest` bound the speeds of every node; at both ends they are the section's.
    """

    section: Section
    grid: Grid
    line: LineProfile
    unit_mps: float
    ratio: int
    lowest: Ints
    highest: Ints

    @classmethod
    def of(cls, section: Section, grid: Grid) -> Graph:
        """Lay the grid over the section; raises DasError if a speed at its ends or a neutral section does not fit."""
        if (section.supply == NEUTRAL).any():
            raise DasError(
                f"{section.name}: no exact front: on its grid no train coasts exactly through a neutral section"
            )
        length = section.end_m - section.start_m
        count = max(int(np.ceil(length / grid.step_m - 1e-9)), 2)
        node = section.start_m + np.linspace(0, count, count + 1) * min(grid.step_m, length / 2)
        node[-1] = section.end_m
        line = LineProfile.on(section.route, section.vehicle, node, section.train_length_m)
        unit, ratio = grid.unit_mps, grid.ratio
        at_node = np.minimum(np.append(line.limit_mps, np.inf), np.append(np.inf, line.limit_mps))
        highest = np.floor(at_node / unit + 1e-6).astype(np.int64)
        lowest = np.minimum(round(grid.lowest_kmh / grid.coast_kmh), highest // ratio * ratio)
        for where, speed_mps in ((0, section.start_speed_mps), (-1, section.end_speed_mps)):
            steps = speed_mps / (unit * ratio)
            if abs(steps - round(steps)) > 1e-6:
                raise DasError(
                    f"exact front: a speed of {speed_mps / KMH:g} km/h at an end of the section, "
                    f"expected a multiple of {grid.speed_kmh:g} km/h"
                )
            lowest[where] = highest[where] = round(steps) * ratio
        return cls(section=section, grid=grid, line=line, unit_mps=unit, ratio=ratio, lowest=lowest, highest=highest)

    @property
    def intervals(self) -> int:
        return len(self.line.step_m)

    def interval(self, k: int) -> tuple[float, float, float]:
        """Length (m), constant resisting force (N) and tunnel coefficient of interval k."""
        return float(self.line.step_m[k]), float(self.line.constant_n[k]), float(self.line.tunnel_n_per_mps2[k])

    def train(self, k: int) -> TrainParams:
        """The train with the efforts allowed by the supply on interval k."""
        result: TrainParams = on_supply(self.section.train, float(self.line.supply[k]))
        return result

    def spans(self, k: int, speed: Ints) -> tuple[Ints, Ints, Ints]:
        """The reach of states of node k: first and last coarse speed (in coarse steps), and the speed by coasting."""
        first, last, coast = (np.empty(len(speed), np.int64) for _ in range(3))
        kernels.spans(
            speed, self.unit_mps, self.ratio, *self.interval(k), int(self.lowest[k + 1]), int(self.highest[k + 1]),
            self.train(k), first, last, coast,
        )  # fmt: skip
        return first, last, coast


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """The states of a node that lie on a sufficiently fast run, and the reach of each.

    Per state: `speed` (grid units, rising), earliest arrival and least time to go (ns), the coarse speeds `first` …
    `last` it can reach at the next node (in coarse steps) and the speed it coasts to (-1: none). `row[speed − lowest]`
    is the state's index, or -1.
    """

    speed: Ints
    reached_ns: Ints
    to_go_ns: Ints
    first: Ints
    last: Ints
    coast: Ints
    lowest: int
    row: Ints


def onward_arcs(graph: Graph, here: Layer, there: Layer) -> Arcs:
    """The arcs from the states of a node to the states of the next node, given by their rows."""
    return Arcs(*kernels.arcs(here.first, here.last, here.coast, graph.ratio, there.lowest, there.row))


class Arcs(NamedTuple):
    """Neighbours of states: other[start[i]] … other[start[i + 1] − 1] are the rows of the neighbours of state i."""

    start: Ints
    other: NDArray[np.int32]

    def turned(self, states: int) -> Arcs:
        """These arcs seen from the other node, which has `states` states; neighbours in rising order."""
        source = np.repeat(np.arange(len(self.start) - 1, dtype=np.int32), np.diff(self.start))
        order = np.argsort(self.other, kind="stable")
        counts = np.bincount(self.other, minlength=states)
        return Arcs(np.concatenate(([0], np.cumsum(counts))), source[order])


def viable_layers(graph: Graph, max_buffer_ratio: float, layer_done: Callable[[], None]) -> tuple[list[Layer], int]:
    """Layers of the states that lie on a run of at most (1 + buffer) times the least time, and this longest time (ns).

    `layer_done` is called after each interval, in the forward sweep and in the backward sweep. Raises InfeasibleError
    if the grid has no run at all.
    """
    reached, moves = _reached(graph, layer_done)
    least_ns = int(reached[-1][1][0])
    latest_ns = round(least_ns * (1 + max_buffer_ratio))
    layers: list[Layer] = []
    ahead = np.zeros(1, np.int64)
    for k in range(graph.intervals, -1, -1):
        layer_done()
        speed, time = reached[k]
        first, last, coast = moves[k]
        to_go = np.zeros(len(speed), np.int64)
        if k < graph.intervals:
            kernels.least_time_to_go(
                speed, first, last, coast, graph.unit_mps, graph.ratio, graph.interval(k)[0],
                int(graph.lowest[k + 1]), ahead, to_go,
            )  # fmt: skip
        keep = (to_go < kernels.NEVER) & (time <= latest_ns - np.minimum(to_go, latest_ns))
        span = int(graph.highest[k] - graph.lowest[k]) + 1
        row = np.full(span, -1, np.int64)
        row[speed[keep] - graph.lowest[k]] = np.arange(np.count_nonzero(keep))
        ahead = np.full(span, kernels.NEVER, np.int64)
        ahead[speed[keep] - graph.lowest[k]] = to_go[keep]
        layers.append(
            Layer(
                speed=speed[keep],
                reached_ns=time[keep],
                to_go_ns=to_go[keep],
                first=first[keep],
                last=last[keep],
                coast=coast[keep],
                lowest=int(graph.lowest[k]),
                row=row,
            )
        )
    return layers[::-1], latest_ns


def _reached(
    graph: Graph, layer_done: Callable[[], None]
) -> tuple[list[tuple[Ints, Ints]], list[tuple[Ints, Ints, Ints]]]:
    """Per node the speeds that can be reached, with the earliest arrival (ns), and their spans."""
    reached = [(np.array([graph.lowest[0]]), np.zeros(1, np.int64))]
    moves = []
    for k in range(graph.intervals):
        speed, time = reached[k]
        moves.append(graph.spans(k, speed))
        result = np.empty(graph.highest[k + 1] - graph.lowest[k + 1] + 1, np.int64)
        kernels.earliest(
            speed, time, *moves[k], graph.unit_mps, graph.ratio, graph.interval(k)[0], int(graph.lowest[k + 1]), result
        )
        index = np.flatnonzero(result < kernels.NEVER)
        if not len(index):
            raise InfeasibleError(
                f"{graph.section.name}: no run on the exact front's grid beyond {graph.line.node_m[k]:.0f} m"
            )
        reached.append((index + graph.lowest[k + 1], result[index]))
        layer_done()
    nothing = np.full(1, -1, np.int64)
    moves.append((nothing, nothing, nothing))
    return reached, moves


def totals(graph: Graph, runs: Ints) -> tuple[Ints, Ints]:
    """Time (ns) and energy (mJ) of runs given by their speeds at the nodes, (runs, nodes)."""
    time, energy = np.zeros(len(runs), np.int64), np.zeros(len(runs), np.int64)
    params = (*graph.line.for_kernels, graph.section.train, graph.section.loss_params)
    for i, run in enumerate(runs):
        time[i], energy[i] = kernels.run_total(run, graph.unit_mps, *params)
    return time, energy


def fastest_run(graph: Graph, layers: list[Layer]) -> Ints:
    """Speeds at the nodes of a run of least time."""
    run = [int(layers[0].speed[0])]
    for k in range(graph.intervals):
        here, there = layers[k], layers[k + 1]
        row = here.row[run[-1] - here.lowest]
        coarse, off = np.divmod(there.speed, graph.ratio)
        reachable = (off == 0) & (coarse >= here.first[row]) & (coarse <= here.last[row])
        reachable |= there.speed == here.coast[row]
        mean_mps = 0.5 * (run[-1] * graph.unit_mps + there.speed * graph.unit_mps)
        dt = np.round(graph.interval(k)[0] / mean_mps * kernels.NS).astype(np.int64)
        best = np.flatnonzero(reachable)[np.argmin((dt + there.to_go_ns)[reachable])]
        run.append(int(there.speed[best]))
    return np.array(run)
