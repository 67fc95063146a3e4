"""Exact time–energy front of a section on the paper's grid (Nold & Corman 2024, section 4.1, figs. 3, 12, 13).

From both ends, layer by layer, every non-dominated partial run (label) is kept, until the two halves meet and are
joined: the result is the whole Pareto front of the grid. A label is dropped only if its least total time exceeds the
requested time, or if a dual bound proves it useless. V(λ, node), the least energy + λ·time from the node to the other
end, bounds completions from below; known runs bound the front from above. Known runs come from the sweeps and from
quick passes that keep one label per state and bucket of time; each pass tightens the bounds of the next.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.trajectory import Trajectory
from das.solver.section import Section
from das.solver.solution import trajectory_on
from precompute.exact import kernels
from precompute.exact.grid import Graph, Grid, Ints, Layer, fastest_run, onward_arcs, totals, viable_layers

Labels32 = NDArray[np.uint32]

Progress = Callable[[str, int, int], None]
"""Progress callback: called with the name of the step, the number of finished intervals and their total."""

BLOCKS = 24
"""Number of blocks into which the states of a node are split for the threads."""
LADDER = 90
FIRST_RATIOS = np.concatenate(([0.0, 1e-3], np.geomspace(0.01, 30.0, 38)))
"""First multipliers, as multiples of the train's power: they span the front of any train."""
STEEPER = tuple(2.0**i for i in range(1, 11))
"""Factors on the refined ladder's largest multiplier that extend the ladder: the front is steep near the least time."""
ROUNDING_J = 1.0
"""Slack (J) of every comparison with a bound: far more than the rounding of the sums, far less than any saving."""
ROUNDING_RATIO = 1e-12
BYTES_PER_LABEL = 4
BYTES_PER_OPEN_LABEL = 72
"""Bytes of a label: those kept to the end (its parent), and those held while its layer is merged (all its values)."""
KNOWN_STEPS = 1 << 18
"""Number of time steps in the table of the known runs' energies: steps of 80 µs if runs may take 21 s longer."""


def undominated(time_ns: Ints, energy_mj: Ints) -> Ints:
    """Indices of the non-dominated runs, by rising time; the first of several equal runs."""
    order = np.lexsort((energy_mj, time_ns))
    energy = energy_mj[order]
    before = np.concatenate(([kernels.NEVER], np.minimum.accumulate(energy)[:-1]))
    kept: Ints = order[energy < before]
    return kept


def best_of(runs: Iterable[Sequence[NDArray[Any]]]) -> list[NDArray[Any]]:
    """The non-dominated ones of several groups of runs, whose first columns are times (ns) and energies (mJ)."""
    columns = [np.concatenate(parts) for parts in zip(*runs, strict=True)]
    keep = undominated(columns[0], columns[1])
    return [column[keep] for column in columns]


class Known(NamedTuple):
    """Times (ns, rising) and energies (mJ, falling) of feasible runs; no run that they dominate is on the front."""

    time_ns: Ints
    energy_mj: Ints


class Duals:
    """Least energy + λ·time (J) from every state to the end of the section, per node an array (states, multipliers).

    With `onward=False` it is the least value from the start to every state. `layer_done` is called after each interval.
    """

    def __init__(
        self,
        graph: Graph,
        layers: list[Layer],
        lambda_w: Floats,
        threads: int,
        layer_done: Callable[[], None],
        *,
        onward: bool = True,
    ) -> None:
        self.lambda_w = lambda_w
        self.value_j = [np.zeros((len(layer.speed), len(lambda_w))) for layer in layers]
        self._layers = layers
        self._choice: list[NDArray[np.int32]] = []
        with ThreadPoolExecutor(threads) as pool:
            for k in range(graph.intervals)[:: -1 if onward else 1]:
                choice = self._step(graph, pool, k, onward=onward)
                if onward:
                    self._choice.append(choice)
                layer_done()
        self._choice.reverse()

    def _step(self, graph: Graph, pool: ThreadPoolExecutor, k: int, *, onward: bool) -> NDArray[np.int32]:
        """Find the values at one end of interval k from those at its other end; returns the rows chosen at that end."""
        arcs = onward_arcs(graph, self._layers[k], self._layers[k + 1])
        at, beyond = (k, k + 1) if onward else (k + 1, k)
        speed, other = self._layers[at].speed, self._layers[beyond].speed
        arcs = arcs if onward else arcs.turned(len(speed))
        choice = np.empty(self.value_j[at].shape, np.int32)

        def block(part: tuple[int, int]) -> None:
            kernels.dual_values(
                *part, *arcs, speed, other, onward, graph.unit_mps, *graph.interval(k), graph.train(k),
                graph.section.loss_params, self.lambda_w, self.value_j[beyond], self.value_j[at], choice,
            )  # fmt: skip

        list(pool.map(block, _blocks(len(speed))))
        return choice

    def runs(self) -> Ints:
        """Speeds at the nodes (multipliers, nodes) for each multiplier, of the run with the least energy + λ·time."""
        every = np.arange(len(self.lambda_w))
        return self._followed(every, every, np.zeros_like(every))

    def bound_j(self, time_s: Floats) -> Floats:
        """Lower bound (J) on the energy of every run on the grid that takes at most these times (s)."""
        best = np.full(len(time_s), -np.inf)
        for lambda_w, value_j in zip(self.lambda_w, self.value_j[0][0], strict=True):
            np.maximum(best, value_j - lambda_w * time_s, out=best)
        return best

    def switched_runs(self) -> Ints:
        """Runs that follow one multiplier up to some node and the next one from there, for all neighbours and nodes."""
        count, nodes = len(self.lambda_w) - 1, len(self._layers) - 2
        first = np.repeat(np.arange(count), nodes)
        at = np.tile(np.arange(1, nodes + 1), count)
        return np.concatenate((self._followed(first, first + 1, at), self._followed(first + 1, first, at)))

    def forget_runs(self) -> None:
        """Free the memory that is needed only to make runs."""
        self._choice = []

    def _followed(self, first: Ints, then: Ints, at: Ints) -> Ints:
        """Speeds at the nodes of runs that follow multiplier first[i] before node at[i] and then[i] from it on."""
        speeds = np.empty((len(at), len(self._layers)), np.int64)
        row: NDArray[np.integer] = np.zeros(len(at), np.int64)
        speeds[:, 0] = self._layers[0].speed[0]
        for k, choice in enumerate(self._choice):
            row = choice[row, np.where(k < at, first, then)]
            speeds[:, k + 1] = self._layers[k + 1].speed[row]
        return speeds


def refined_ladder(lambda_w: Floats, time_ns: Ints, least_ns: int, latest_ns: int) -> Floats:
    """Multipliers whose runs are spread evenly over the requested times."""
    order = np.argsort(time_ns, kind="stable")
    times = np.linspace(least_ns, latest_ns, LADDER)
    logs = np.interp(times, time_ns[order], np.log(np.maximum(lambda_w[order], 1.0)))
    inner = np.unique(np.exp(logs))
    return np.concatenate((inner, inner[-1] * np.array(STEEPER)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """The common data of all passes: the grid and its states, the bounds, the latest arrival, threads and memory."""

    graph: Graph
    layers: list[Layer]
    to_end: Duals
    from_start: Duals
    latest_ns: int
    threads: int
    max_memory_bytes: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Labels:
    """The labels of one node, by state: offset[i] … offset[i + 1] − 1 belong to state i of the layer."""

    offset: Ints
    time_ns: Ints
    energy_mj: Ints

    def __len__(self) -> int:
        return len(self.time_ns)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """The multipliers λ (W) with the best bound on a stretch of the front, and a run's largest energy + λ·time (J)."""

    lambda_w: Floats
    allowed_j: Floats
    watching: NDArray[np.bool_]

    @classmethod
    def of(cls, search: Search, known: Known) -> Bounds:
        """The bounds from known runs.

        A run not yet known that belongs to the front lies between two neighbours of the known front: it takes less time
        than the later one and no more energy than the earlier one. Each such stretch is bounded by the λ whose bound is
        highest at the stretch's end.
        """
        duals = search.to_end
        allowed = np.full(len(duals.lambda_w), -np.inf)
        end_s = np.append(known.time_ns[1:], search.latest_ns) / kernels.NS
        best = np.argmax(duals.value_j[0][0] - duals.lambda_w * end_s[:, np.newaxis], axis=1)
        np.maximum.at(allowed, best, known.energy_mj / kernels.MJ + duals.lambda_w[best] * end_s)
        watching = np.isfinite(allowed)
        allowed = allowed[watching]
        allowed += ROUNDING_J + ROUNDING_RATIO * np.abs(allowed)
        return cls(lambda_w=duals.lambda_w[watching], allowed_j=allowed, watching=watching)


class Half:
    """The labels from one end of the section: from its start (`onward`), or from its end.

    `node` is the node that the labels have reached. The parents of all labels are kept, so that their runs can be
    traced back.
    """

    def __init__(self, search: Search, bounds: Bounds, bucket_ns: int, *, onward: bool) -> None:
        self._search, self._bounds, self._bucket_ns, self._onward = search, bounds, bucket_ns, onward
        self.node = 0 if onward else search.graph.intervals
        zero = np.zeros(1, np.int64)
        self.labels = Labels(offset=np.array([0, 1]), time_ns=zero, energy_mj=zero)
        self.count = 1
        self._offsets = [self.labels.offset]
        self._parents = [np.zeros(1, np.uint32)]

    def advance(self, pool: ThreadPoolExecutor) -> None:
        """Advance to the next node."""
        search, bounds, onward = self._search, self._bounds, self._onward
        k = self.node if onward else self.node - 1
        arcs = onward_arcs(search.graph, search.layers[k], search.layers[k + 1])
        behind, self.node = self.node, self.node + (1 if onward else -1)
        here, there = search.layers[behind], search.layers[self.node]
        arcs = arcs.turned(len(there.speed)) if onward else arcs
        duals = search.to_end if onward else search.from_start
        ahead = np.ascontiguousarray(duals.value_j[self.node][:, bounds.watching])
        latest = search.latest_ns - (there.to_go_ns if onward else there.reached_ns)
        cost = self._least_costs(pool)
        before = self.labels

        def block(part: tuple[int, int]) -> tuple[Ints, Ints, Labels32, Ints]:
            a, b = part
            return kernels.merge_labels(  # type: ignore[no-any-return]
                arcs.start[a : b + 1], arcs.other, there.speed[a:b], here.speed, onward,
                before.offset, cost, before.time_ns, before.energy_mj, search.graph.unit_mps,
                *search.graph.interval(k), search.graph.train(k), search.graph.section.loss_params,
                bounds.lambda_w, bounds.allowed_j, ahead[a:b], latest[a:b], self._bucket_ns,
            )  # fmt: skip

        self._take(list(pool.map(block, _blocks(len(there.speed)))))

    def _take(self, done: list[tuple[Ints, Ints, Labels32, Ints]]) -> None:
        counts = np.concatenate([x[3] for x in done])
        self._offsets.append(np.concatenate(([0], np.cumsum(counts))))
        self._parents.append(np.concatenate([x[2] for x in done]))
        self.count += int(counts.sum())
        self.labels = Labels(
            offset=self._offsets[-1],
            time_ns=np.concatenate([x[0] for x in done]),
            energy_mj=np.concatenate([x[1] for x in done]),
        )

    def _least_costs(self, pool: ThreadPoolExecutor) -> Floats:
        """Least energy + λ·time (J) among the labels of each state, (states, multipliers)."""
        labels, lambda_w = self.labels, self._bounds.lambda_w
        cost = np.empty((len(labels.offset) - 1, len(lambda_w)))

        def block(part: tuple[int, int]) -> None:
            kernels.least_costs(*part, labels.offset, labels.time_ns, labels.energy_mj, lambda_w, cost)

        list(pool.map(block, _blocks(len(cost))))
        return cost

    @property
    def bytes_needed(self) -> int:
        """Memory of the labels (bytes), including those of the next node while they are made."""
        return self.count * BYTES_PER_LABEL + len(self.labels) * BYTES_PER_OPEN_LABEL

    def run(self, label: int) -> list[int]:
        """Speeds (grid units) from the node of the labels to the end at which they began."""
        speeds = []
        step = -1 if self._onward else 1
        nodes = range(self.node, self.node + step * len(self._offsets), step)
        for node, offset, parents in zip(nodes, self._offsets[::-1], self._parents[::-1], strict=True):
            state = int(np.searchsorted(offset, label, side="right")) - 1
            speeds.append(int(self._search.layers[node].speed[state]))
            label = int(parents[label])
        return speeds


class Joined(NamedTuple):
    """Runs joined from two halves, time rising and energy falling, with the two labels of each run."""

    time_ns: Ints
    energy_mj: Ints
    first: Labels32
    second: Labels32


class Pass:
    """One pass over all intervals; `runs` are the non-dominated runs of its joined labels."""

    def __init__(self, search: Search, known: Known, bucket_ns: int, progress: Progress) -> None:
        self._search = search
        bounds = Bounds.of(search, known)
        self._first = Half(search, bounds, bucket_ns, onward=True)
        self._second = Half(search, bounds, bucket_ns, onward=False)
        what = f"bounds, {bucket_ns / NS_PER_MS:g} ms" if bucket_ns else "exact front"
        intervals = search.graph.intervals
        with ThreadPoolExecutor(search.threads) as pool:
            for done in range(1, intervals + 1):
                first = len(self._first.labels) <= len(self._second.labels)
                (self._first if first else self._second).advance(pool)
                self._check_memory(done)
                progress(what, done, intervals)
            self.runs = self._joined(pool, known)

    @property
    def count(self) -> int:
        """Partial runs that were kept."""
        return self._first.count + self._second.count

    def run(self, index: int) -> Ints:
        """Speeds (grid units) at the nodes of a run."""
        behind = self._first.run(int(self.runs.first[index]))
        ahead = self._second.run(int(self.runs.second[index]))
        return np.array([*behind[::-1], *ahead[1:]])

    def _check_memory(self, done: int) -> None:
        search = self._search
        needed = self._first.bytes_needed + self._second.bytes_needed
        open_labels = max(len(self._first.labels), len(self._second.labels))
        if needed > search.max_memory_bytes or open_labels >= np.iinfo(np.uint32).max:
            raise DasError(
                f"{search.graph.section.name}: the exact front needs more than {search.max_memory_bytes / 1e9:.1f} GB "
                f"after {done} of {search.graph.intervals} intervals ({self.count} partial runs); "
                "ask for a smaller buffer"
            )

    def _joined(self, pool: ThreadPoolExecutor, known: Known) -> Joined:
        """The non-dominated runs of all pairs of labels of one state at the node where the halves meet."""
        a, b, latest_ns = self._first.labels, self._second.labels, self._search.latest_ns
        origin_ns = int(known.time_ns[0])
        width_ns = (latest_ns - origin_ns) // KNOWN_STEPS + 1
        step_ns = origin_ns + np.arange(KNOWN_STEPS + 1) * width_ns
        known_mj = _least_mj(known.time_ns, known.energy_mj, step_ns)

        def block(part: tuple[int, int]) -> Joined:
            none, no_label = np.empty(0, np.int64), np.empty(0, np.uint32)
            found, least_mj, (state, stop) = Joined(none, none, no_label, no_label), known_mj, part
            while state < stop:
                *runs, state = kernels.join_labels(
                    state, stop, a.offset, a.time_ns, a.energy_mj, b.offset, b.time_ns, b.energy_mj,
                    latest_ns, least_mj, origin_ns, width_ns,
                )  # fmt: skip
                found = Joined(*best_of((found, runs)))
                if state < stop:
                    least_mj = np.minimum(least_mj, _least_mj(found.time_ns, found.energy_mj, step_ns))
            return found

        return Joined(*best_of(pool.map(block, _blocks(len(a.offset) - 1))))


def _least_mj(time_ns: Ints, energy_mj: Ints, until_ns: Ints) -> Ints:
    """Least energy (mJ) of the runs that take at most each of the times `until_ns`; NEVER if there is none."""
    count = np.searchsorted(time_ns, until_ns, side="right")
    return np.concatenate(([kernels.NEVER], energy_mj))[count]


def _blocks(size: int) -> list[tuple[int, int]]:
    edges = [round(size * i / BLOCKS) for i in range(BLOCKS + 1)]
    return [(a, b) for a, b in pairwise(edges) if b > a]


STATES = "states"
"""Name of the step in which the states of the grid and the bounds are computed, for `Progress`."""
SWEEPS = 5
"""Number of sweeps: two find the states, three the bounds."""

NS_PER_MS = 1e6
BUCKETS_NS = (300_000_000, 30_000_000, 3_000_000)
"""The buckets of time (ns) of the passes before the last one, as far as they are larger than its buckets."""
LARGEST_MEMORY_BYTES = 20e9


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactFront:
    """Every Pareto-optimal run of a section on a grid, up to a time; or, with `Limits.bucket_ms`, runs near these.

    `time_s` rises and `energy_j` (at the current collector) falls. `supported_j` is the supported front, the lower
    convex hull, at the same times. `swept_time_s` and `swept_energy_j` are the runs that the fast solver's method finds
    on this grid: with one multiplier, or with one up to a node and the neighbouring one from there on. `labels` counts
    all partial runs that were kept in the last pass. `bound_j` is the dual bound: no run on the grid needs less in the
    same time. With `Limits.bucket_ms` the runs are the best of those that the last pass kept and of the swept ones.
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
    _graph: Graph
    _run_of: Callable[[int], Ints]

    @property
    def least_time_s(self) -> float:
        return float(self.time_s[0])

    @property
    def gap_ratio(self) -> Floats:
        """The distance of each point above the supported front, relative to its energy."""
        return (self.energy_j - self.supported_j) / np.maximum(np.abs(self.energy_j), 1.0)

    @property
    def swept_gap_ratio(self) -> Floats:
        """The distance of each swept run above the exact front at its own time, relative to the front's energy."""
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
    """Limits of the search.

    `max_memory_bytes` is the memory for labels (None: 80 % of the machine's, at most 20 GB). If `bucket_ms` is not
    0, the search keeps one partial run per state and bucket of time: it finds only runs near the front, and a lower
    bound.
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
    progress: Progress = lambda _step, _done, _whole: None,
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
        max_memory_bytes=_usual_memory_bytes() if limits.max_memory_bytes is None else limits.max_memory_bytes,
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
        _graph=graph,
        _run_of=lambda index: last.run(int(keep[index])) if keep[index] < passed else swept_runs[keep[index] - passed],
    )


def _counted(progress: Progress, intervals: int) -> Callable[[], None]:
    """A function that reports, each time it is called, that one more interval of the sweeps is done."""
    done = count(1)
    return lambda: progress(STATES, min(next(done), intervals), intervals)


def _last_pass(search: Search, known: Known, bucket_ms: float, progress: Progress) -> Pass:
    """The last of the passes, after quicker ones whose runs make its bounds tight."""
    last_bucket_ns = round(bucket_ms * NS_PER_MS)
    for bucket_ns in (one for one in BUCKETS_NS if one > last_bucket_ns):
        known = Known(*best_of((known, Pass(search, known, bucket_ns, progress).runs[:2])))
    return Pass(search, known, last_bucket_ns, progress)


def _swept(
    graph: Graph, layers: list[Layer], latest_ns: int, threads: int, layer_done: Callable[[], None]
) -> tuple[Duals, Known, Ints]:
    """Bounds for multipliers that cover the requested times, and the runs that a sweep for each multiplier finds.

    The runs are returned as times with energies, and as speeds at the nodes (runs, nodes).
    """
    fastest = fastest_run(graph, layers)[np.newaxis]
    least_ns = int(totals(graph, fastest)[0][0])
    ladder = graph.section.train.traction_power_w * FIRST_RATIOS
    first_runs = Duals(graph, layers, ladder, threads, layer_done).runs()
    time_ns, _ = totals(graph, first_runs)
    ladder = refined_ladder(ladder, time_ns, least_ns, latest_ns)
    duals = Duals(graph, layers, ladder, threads, layer_done)
    runs = np.concatenate((fastest, first_runs, duals.runs(), duals.switched_runs()))
    duals.forget_runs()
    time_ns, energy_mj = totals(graph, runs)
    keep = undominated(time_ns, energy_mj)
    keep = keep[time_ns[keep] <= latest_ns]
    return duals, Known(time_ns[keep], energy_mj[keep]), runs[keep]


def _usual_memory_bytes() -> float:
    """80 % of the machine's memory, if the system states it, and at most 20 GB."""
    try:
        return min(0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), LARGEST_MEMORY_BYTES)
    except (AttributeError, ValueError, OSError):
        return LARGEST_MEMORY_BYTES
