"""Exact time–energy front of a section on the paper's grid (Nold & Corman 2024, section 4.1, figs. 3, 12, 13).

Layer by layer every undominated partial run is kept, so the result is the whole Pareto front of the grid, not only
its supported points. A partial run (label) is dropped only where a bound proves that it cannot lead to the front:

- *time*: the least time from and to every node, against the largest time asked for;
- *dual bounds*: V(λ, node), the least energy + λ·time to go, bounds every completion of a label from below; known runs
  bound the front from above. A label goes on where, for the λ that watches some stretch of the front, its energy +
  λ·time + V is not above what the known runs leave open there.

The known runs come from the sweeps (supported points and switches between neighbours) and from quick passes that keep
one label per state and bucket of time; each pass makes the next one's bounds tighter.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.trajectory import Trajectory
from das.solver.front import trajectory_on
from das.solver.section import Section
from precompute.exact import kernels
from precompute.exact.bounds import Duals, Known, allowed_j, first_ladder, refined_ladder
from precompute.exact.grid import Graph, Grid, Layer, fastest_run, totals, viable_layers

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many layers of it are done, and how many there are."""
STATES = "states"
"""What is being done while the states of the grid and the bounds are looked for."""

BUCKETS_NS = (50_000_000, 10_000_000, 2_000_000, 0)
"""One pass each; the last one, without buckets, is exact."""
BLOCKS = 24
"""Blocks of states of a layer, shared out among the threads."""
BYTES_PER_LABEL = 4
BYTES_PER_OPEN_LABEL = 72
"""Memory of a label for good (its parent), and while its layer is merged (times, energies, parents, sorting)."""
LARGEST_MEMORY_BYTES = 20e9


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactFront:
    """Every Pareto-optimal run of a section on a grid, up to a time.

    `time_s` rises and `energy_j` (at the current collector) falls. `supported_j` is the supported front, the lower
    convex hull, at the same times. `swept_time_s` and `swept_energy_j` are the runs that the fast solver's method finds
    on this grid: one multiplier, or one up to a node and its neighbour from there. `labels` counts all partial runs
    that were kept in the last pass.
    """

    section: Section
    grid: Grid
    time_s: Floats
    energy_j: Floats
    supported_j: Floats
    swept_time_s: Floats
    swept_energy_j: Floats
    labels: int
    _graph: Graph
    _last_pass: _Pass

    @property
    def least_time_s(self) -> float:
        return float(self.time_s[0])

    @property
    def gap_ratio(self) -> Floats:
        """How far each point lies above the supported front, relative to its energy."""
        return (self.energy_j - self.supported_j) / np.maximum(np.abs(self.energy_j), 1.0)

    @property
    def swept_gap_ratio(self) -> Floats:
        """How far each swept run lies above the exact front at its own time, relative to the front's energy."""
        front_j = self.energy_j[[self.index_at(time_s) for time_s in self.swept_time_s]]
        return (self.swept_energy_j - front_j) / np.maximum(np.abs(front_j), 1.0)

    def index_at(self, time_s: float) -> int:
        """The least-energy run that takes at most this time; DasError where there is none."""
        index = int(np.searchsorted(self.time_s, time_s + 1e-9, side="right")) - 1
        if index < 0:
            raise DasError(f"time {time_s:.3f} s: expected at least {self.least_time_s:.3f} s on this grid")
        return index

    def trajectory(self, index: int) -> Trajectory:
        """The run of one point of the front, on the nodes of the grid."""
        speeds = np.asarray(self._last_pass.run(index) * self._graph.unit_mps, dtype=np.float64)
        return trajectory_on(self.section, self._graph.line, speeds)


def solve_exact(
    section: Section,
    max_buffer_ratio: float,
    *,
    grid: Grid | None = None,
    threads: int = 2,
    max_memory_bytes: float | None = None,
    progress: Progress | None = None,
) -> ExactFront:
    """All Pareto-optimal runs of a section that take at most (1 + max_buffer_ratio) times the least time of the grid.

    Raises InfeasibleError where no run exists on the grid, DasError where a boundary speed is not on it or the labels
    need more than `max_memory_bytes` (default: 80 % of the machine's memory, at most 20 GB).
    """
    graph = Graph.of(section, grid or Grid())
    memory = default_memory_bytes() if max_memory_bytes is None else max_memory_bytes
    told = _States(progress, graph.intervals)
    layers, latest_ns = viable_layers(graph, max_buffer_ratio, told)
    known = Known.none().with_runs(*totals(graph, fastest_run(graph, layers)[np.newaxis]))
    ladder = first_ladder(section.train.traction_power_w)
    for _ in range(2):
        duals = Duals(graph, layers, ladder, threads, told)
        time_ns, energy_mj = totals(graph, duals.runs)
        known = known.with_runs(time_ns, energy_mj).until(latest_ns)
        ladder = refined_ladder(ladder, time_ns, int(known.time_ns[0]), latest_ns)
    swept = known.with_runs(*totals(graph, duals.switched_runs())).until(latest_ns)
    known, labels = swept, 0
    search = _Search(
        graph=graph, layers=layers, duals=duals, latest_ns=latest_ns, threads=threads, max_memory_bytes=memory
    )
    for bucket_ns in BUCKETS_NS:
        last = _Pass(search, known, bucket_ns, progress)
        known = known.with_runs(last.final.time_ns, last.final.energy_mj)
        labels = last.count
    time_s, energy_j = last.final.time_ns / kernels.NS, last.final.energy_mj / kernels.MJ
    hull = kernels.lower_hull(time_s, energy_j)
    return ExactFront(
        section=section,
        grid=graph.grid,
        time_s=time_s,
        energy_j=energy_j,
        supported_j=np.interp(time_s, time_s[hull], energy_j[hull]),
        swept_time_s=swept.time_ns / kernels.NS,
        swept_energy_j=swept.energy_mj / kernels.MJ,
        labels=labels,
        _graph=graph,
        _last_pass=last,
    )


def default_memory_bytes() -> float:
    """80 % of the machine's memory, at most 20 GB."""
    try:
        installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return LARGEST_MEMORY_BYTES
    return min(0.8 * installed, LARGEST_MEMORY_BYTES)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Labels:
    """The labels of one node, by state: offset[i] … offset[i + 1] − 1 belong to state i of the layer."""

    offset: Ints
    time_ns: Ints
    energy_mj: Ints


class _States:
    """Counts the intervals that come before the passes: two sweeps for the states, two for the bounds."""

    SWEEPS = 4

    def __init__(self, progress: Progress | None, intervals: int) -> None:
        self._progress, self._intervals, self._done = progress, intervals, 0

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(STATES, min(self._done, self.SWEEPS * self._intervals), self.SWEEPS * self._intervals)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """What all passes share: the grid and its states, the bounds, the latest arrival, threads and memory."""

    graph: Graph
    layers: list[Layer]
    duals: Duals
    latest_ns: int
    threads: int
    max_memory_bytes: float


class _Pass:
    """One forward pass over all layers; keeps times and energies of the last layer, and the exact pass all parents."""

    def __init__(self, search: _Search, known: Known, bucket_ns: int, progress: Progress | None) -> None:
        self.search, self.bucket_ns = search, bucket_ns
        graph, duals = search.graph, search.duals
        allowed = allowed_j(known, search.latest_ns, duals)
        self.watching = np.isfinite(allowed)
        self.allowed = np.ascontiguousarray(allowed[self.watching])
        self.lambda_w = np.ascontiguousarray(duals.lambda_w[self.watching])
        zero = np.zeros(1, np.int64)
        labels = _Labels(offset=np.array([0, 1]), time_ns=zero, energy_mj=zero)
        self.count = 1
        self.offsets = [labels.offset]
        self.parents = [np.zeros(1, np.uint32)]
        what = f"bounds, {bucket_ns / 1e6:g} ms" if bucket_ns else "exact front"
        with ThreadPoolExecutor(search.threads) as pool:
            for k in range(graph.intervals):
                labels = self._advance(pool, k, labels)
                self._check_memory(k, len(labels.time_ns))
                if progress is not None:
                    progress(what, k + 1, graph.intervals)
        self.final = labels

    def _check_memory(self, k: int, open_labels: int) -> None:
        graph = self.search.graph
        kept = sum(len(parents) for parents in self.parents)
        needed = kept * BYTES_PER_LABEL + open_labels * BYTES_PER_OPEN_LABEL
        if needed > self.search.max_memory_bytes or open_labels >= np.iinfo(np.uint32).max:
            raise DasError(
                f"{graph.section.name}: the exact front needs more than {self.search.max_memory_bytes / 1e9:.1f} GB at "
                f"node {k + 1} of {graph.intervals} ({self.count} partial runs); ask for a smaller buffer"
            )

    def _advance(self, pool: ThreadPoolExecutor, k: int, labels: _Labels) -> _Labels:
        """The labels of node k + 1 from those of node k."""
        graph, here, there = self.search.graph, self.search.layers[k], self.search.layers[k + 1]
        cost = np.empty((len(here.speed), len(self.lambda_w)))
        kernels.least_costs(labels.offset, labels.time_ns, labels.energy_mj, self.lambda_w, cost)
        ahead = np.ascontiguousarray(self.search.duals.value_j[k + 1][:, self.watching])
        latest = self.search.latest_ns - there.to_go_ns
        coast_start, coast_source = _coasting_sources(here, there)

        def block(part: tuple[int, int]) -> tuple[Ints, Ints, NDArray[np.uint32], Ints]:
            a, b = part
            return kernels.merge_labels(  # type: ignore[no-any-return]
                there.speed[a:b], coast_start[a : b + 1], coast_source, here.speed, labels.offset, cost,
                labels.time_ns, labels.energy_mj, here.first, here.last, graph.unit_mps, graph.ratio,
                *graph.interval(k), graph.train(k), graph.section.loss_params, self.lambda_w,
                self.allowed, ahead[a:b], latest[a:b], self.bucket_ns,
            )  # fmt: skip

        done = list(pool.map(block, _blocks(len(there.speed), BLOCKS)))
        counts = np.concatenate([x[3] for x in done])
        self.offsets.append(np.concatenate(([0], np.cumsum(counts))))
        if self.bucket_ns == 0:
            self.parents.append(np.concatenate([x[2] for x in done]))
        self.count += int(counts.sum())
        return _Labels(
            offset=self.offsets[-1],
            time_ns=np.concatenate([x[0] for x in done]),
            energy_mj=np.concatenate([x[1] for x in done]),
        )

    def run(self, label: int) -> Ints:
        """Speeds (grid units) at the nodes of the run that ends in a label of the last node."""
        layers = self.search.layers
        speeds = np.empty(len(layers), np.int64)
        for k in range(len(layers) - 1, -1, -1):
            state = int(np.searchsorted(self.offsets[k], label, side="right")) - 1
            speeds[k] = layers[k].speed[state]
            label = int(self.parents[k][label])
        return speeds


def _coasting_sources(here: Layer, there: Layer) -> tuple[Ints, Ints]:
    """For each state of the next node (CSR: start, source) the states that coast to it."""
    coasting = np.flatnonzero(here.coast >= 0)
    row = there.row[here.coast[coasting] - there.lowest]
    coasting, row = coasting[row >= 0], row[row >= 0]
    counts = np.bincount(row, minlength=len(there.speed))
    return np.concatenate(([0], np.cumsum(counts))), coasting[np.argsort(row, kind="stable")]


def _blocks(size: int, count: int) -> list[tuple[int, int]]:
    edges = [round(size * i / count) for i in range(count + 1)]
    return [(a, b) for a, b in pairwise(edges) if b > a]
