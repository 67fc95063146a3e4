"""Exact time–energy front of a section on the paper's grid (Nold & Corman 2024, section 4.1, figs. 3, 12, 13).

From both ends, layer by layer, every undominated partial run is kept, until the two halves meet and are joined. So
the result is the whole Pareto front of the grid, not only its supported points. A partial run (label) is dropped only
where a bound proves that it cannot lead to the front:

- *time*: the least time from and to every node, against the largest time asked for;
- *dual bounds*: V(λ, node), the least energy + λ·time from the node to the other end, bounds every completion of a
  label from below; known runs bound the front from above. A label is kept if, for at least one λ that bounds a stretch
  of the front best, its energy + λ·time + V does not exceed what the known runs still allow there.

The known runs come from the sweeps (supported points, and switches between neighbouring λ) and from quick passes that
keep one label per state and bucket of time; each pass tightens the bounds of the next.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.trajectory import Trajectory
from das.solver.section import Section
from das.solver.solution import trajectory_on
from precompute.exact import kernels
from precompute.exact.grid import Graph, Grid, Layer, fastest_run, totals, viable_layers
from precompute.exact.passes import Duals, Known, Pass, Progress, Search, first_ladder, refined_ladder, undominated

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STATES = "states"
"""Name of the step in which the states of the grid and the bounds are found, for `Progress`."""
SWEEPS = 5
"""Two sweeps find the states, three the bounds."""

NS_PER_MS = 1e6
BUCKETS_NS = (300_000_000, 30_000_000, 3_000_000, 0)
"""The buckets of time (ns) of the passes; the last pass, without buckets, is exact."""
LARGEST_MEMORY_BYTES = 20e9


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactFront:
    """Every Pareto-optimal run of a section on a grid, up to a time; or, with a `bucket_ms`, runs near them.

    `time_s` rises and `energy_j` (at the current collector) falls. `supported_j` is the supported front, the lower
    convex hull, at the same times. `swept_time_s` and `swept_energy_j` are the runs that the fast solver's method finds
    on this grid: with one multiplier, or with one up to a node and the neighbouring one from there on. `labels` counts
    all partial runs that were kept in the last pass. `bound_j` is the dual bound: no run on the grid needs less in the
    same time. If `bucket_ms` is not 0, the last pass kept one partial run per state and bucket of time, and the runs
    are the best of these and of the swept ones.
    """

    section: Section
    grid: Grid
    time_s: Floats
    energy_j: Floats
    supported_j: Floats
    swept_time_s: Floats
    swept_energy_j: Floats
    labels: int
    bound_j: Floats
    bucket_ms: float
    _graph: Graph
    _run_of: Callable[[int], Ints]

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
        """Index of the least-energy run that takes at most this time; DasError if there is none."""
        index = int(np.searchsorted(self.time_s, time_s + 1e-9, side="right")) - 1
        if index < 0:
            raise DasError(f"time {time_s:.3f} s: expected at least {self.least_time_s:.3f} s on this grid")
        return index

    def trajectory(self, index: int) -> Trajectory:
        """The run of one point of the front, on the nodes of the grid."""
        speeds = np.asarray(self._run_of(index) * self._graph.unit_mps, dtype=np.float64)
        return trajectory_on(self.section, self._graph.line, speeds)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits on what the search keeps.

    `max_memory_bytes` is the memory of its labels (None: 80 % of the machine's, at most 20 GB). With a `bucket_ms` it
    keeps one partial run per state and bucket of time: it finds runs near the front and a bound below it.
    """

    max_memory_bytes: float | None = None
    bucket_ms: float = 0.0


def solve_exact(
    section: Section,
    max_buffer_ratio: float,
    *,
    grid: Grid | None = None,
    threads: int = 2,
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> ExactFront:
    """All Pareto-optimal runs of a section that take at most (1 + max_buffer_ratio) times the least time of the grid.

    Raises InfeasibleError if no run exists on the grid, DasError if a boundary speed is not on it or the labels
    need more memory than `limits` allow.
    """
    graph = Graph.of(section, grid or Grid())
    limits = limits or Limits()
    layer_done = _counted(progress, SWEEPS * graph.intervals)
    layers, latest_ns = viable_layers(graph, max_buffer_ratio, layer_done)
    duals, swept, swept_runs = _swept(graph, layers, latest_ns, threads, layer_done)
    search = Search(
        graph=graph,
        layers=layers,
        to_end=duals,
        from_start=Duals(graph, layers, duals.lambda_w, threads, layer_done, onward=False),
        latest_ns=latest_ns,
        threads=threads,
        max_memory_bytes=default_memory_bytes() if limits.max_memory_bytes is None else limits.max_memory_bytes,
    )
    last = _last_pass(search, swept, limits.bucket_ms, progress)
    time_ns = np.concatenate((last.runs.time_ns, swept.time_ns))
    energy_mj = np.concatenate((last.runs.energy_mj, swept.energy_mj))
    keep = undominated(time_ns, energy_mj)
    time_s, energy_j = time_ns[keep] / kernels.NS, energy_mj[keep] / kernels.MJ
    hull = kernels.lower_hull(time_s, energy_j)
    passed = len(last.runs.time_ns)
    return ExactFront(
        section=section,
        grid=graph.grid,
        time_s=time_s,
        energy_j=energy_j,
        supported_j=np.interp(time_s, time_s[hull], energy_j[hull]),
        swept_time_s=swept.time_ns / kernels.NS,
        swept_energy_j=swept.energy_mj / kernels.MJ,
        labels=last.count,
        bound_j=duals.bound_j(time_s),
        bucket_ms=limits.bucket_ms,
        _graph=graph,
        _run_of=lambda index: last.run(int(keep[index])) if keep[index] < passed else swept_runs[keep[index] - passed],
    )


def _counted(progress: Progress | None, intervals: int) -> Callable[[], None]:
    """A function that reports, each time it is called, that one more interval of the sweeps is done."""
    done = count(1)
    return lambda: progress(STATES, min(next(done), intervals), intervals) if progress is not None else None


def _last_pass(search: Search, known: Known, bucket_ms: float, progress: Progress | None) -> Pass:
    """The last of the passes, after quicker ones whose runs make its bounds tight."""
    *buckets, last_bucket_ns = passes(bucket_ms)
    for bucket_ns in buckets:
        runs = Pass(search, known, bucket_ns, progress).runs
        known = known.with_runs(runs.time_ns, runs.energy_mj)
    return Pass(search, known, last_bucket_ns, progress)


def passes(bucket_ms: float) -> tuple[int, ...]:
    """The buckets (ns) of all passes; the last one has `bucket_ms`, which is 0 for the exact front."""
    last = round(bucket_ms * NS_PER_MS)
    return (*(bucket_ns for bucket_ns in BUCKETS_NS if bucket_ns > last), last)


def _swept(
    graph: Graph, layers: list[Layer], latest_ns: int, threads: int, layer_done: Callable[[], None]
) -> tuple[Duals, Known, Ints]:
    """Bounds for multipliers that cover the times asked for, and the runs that a sweep for each multiplier finds.

    The runs are returned as times with energies, and as speeds at the nodes (runs, nodes).
    """
    fastest = fastest_run(graph, layers)[np.newaxis]
    least_ns = int(totals(graph, fastest)[0][0])
    ladder = first_ladder(graph.section.train.traction_power_w)
    first_runs = Duals(graph, layers, ladder, threads, layer_done).runs()
    time_ns, _ = totals(graph, first_runs)
    ladder = refined_ladder(ladder, time_ns, least_ns, latest_ns)
    duals = Duals(graph, layers, ladder, threads, layer_done)
    runs = np.concatenate((fastest, first_runs, duals.runs(), duals.switched_runs()))
    duals.forget_runs()
    time_ns, energy_mj = totals(graph, runs)
    keep = undominated(time_ns, energy_mj)
    keep = keep[time_ns[keep] <= latest_ns]
    return duals, Known(time_ns=time_ns[keep], energy_mj=energy_mj[keep]), runs[keep]


def default_memory_bytes() -> float:
    """80 % of the machine's memory, at most 20 GB."""
    try:
        installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return LARGEST_MEMORY_BYTES
    return min(0.8 * installed, LARGEST_MEMORY_BYTES)
