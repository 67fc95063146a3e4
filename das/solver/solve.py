"""Solving a section: the backward sweep over its decision nodes for a ladder of multipliers."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.kernels.landings import LANDINGS
from das.solver.kernels.sweep import LANES, backward_sweep
from das.solver.kernels.transitions import transitions
from das.solver.kernels.tuples import LineArrays, Moves, SpeedBounds
from das.solver.section import Section
from das.solver.state import State

Floats = NDArray[np.float64]

BLOCK_NODES = 32
"""Number of decision nodes with transitions in memory: they take a few MB, and threads rarely wait for each other."""

BEHIND_M = 1_000.0
"""Distance (m) behind a moving train at which its front begins: more than any correction of its position."""


def solve_front(
    section: Section,
    *,
    threads: int = 2,
    lambda_w: Floats | None = None,
    end_value_j: Floats | None = None,
) -> Front:
    """Solve a section for a ladder of multipliers (default: `default_ladder`).

    If the end speed of the section is free, `end_value_j` holds for each of its J + 1 possible end speeds the cost of
    the line beyond the section (J).

    Blocks of decision nodes are solved one after another, from the end. First the transitions of a block are computed,
    with its nodes distributed among the threads; then the block is swept, with the multipliers distributed among the
    threads. The kernels release the GIL and write no shared data. Only the transitions of one block are in memory,
    because all of them together would be as large as the result. The result is identical, bit for bit, for any number
    of threads and size of block.
    """
    sweep = _Sweep(section, lambda_w, end_value_j, threads=threads)
    sweep.come_down_to(0)
    return sweep.front()


def solve_ahead(
    section: Section,
    s_m: float,
    *,
    threads: int = 2,
    lambda_w: Floats | None = None,
    end_value_j: Floats | None = None,
) -> Front:
    """The front of a section for a train at a position (m): only the part ahead of the train is solved.

    The sweep starts at the end, so the part ahead is the same as in the whole front, bit for bit. If a trajectory from
    a position more than `BEHIND_M` behind the train is requested, the front solves the rest first. The other arguments
    are those of `solve_front`.
    """
    sweep = _Sweep(section, lambda_w, end_value_j, threads=threads)
    # A trajectory follows the policies of the nodes ahead of it, not those of its first node.
    sweep.come_down_to(node_behind(section, s_m) + 1)
    return sweep.front()


def node_behind(section: Section, s_m: float) -> int:
    """The first decision node of the front that is solved for a train at a position (m)."""
    from_m = min(max(s_m - BEHIND_M, section.start_m), float(section.node_m[section.decision[-2]]))
    return State.at(section, from_m, 0.0).first_node


class _Sweep:
    """The partial sweep of a section from its end towards its start; thread-safe."""

    def __init__(self, section: Section, lambda_w: Floats | None, end_value_j: Floats | None, *, threads: int) -> None:
        self.grid = DecisionGrid.of(section)
        self.ladder = default_ladder(section) if lambda_w is None else np.asarray(lambda_w, dtype=float)
        n = len(self.grid.node_m) - 1
        shape = (n + 1, section.speed_steps + 1, len(self.ladder))
        self._value_j, self._time_to_go_s = np.empty(shape, np.float64), np.empty(shape, np.float32)
        self._value_j[-1] = 0.0 if end_value_j is None else end_value_j[:, np.newaxis]
        self._time_to_go_s[-1] = 0.0
        self._threads, self._lock = threads, Lock()
        self.known_from = n

    def come_down_to(self, first: int) -> None:
        """Solve all unsolved nodes from `first` on."""
        with self._lock:
            last, threads, ladder = self.known_from, self._threads, self.ladder
            if first >= last:
                return
            space = empty_moves(min(BLOCK_NODES, last - first), self.grid.section.speed_steps + 1)
            with ThreadPoolExecutor(threads) as pool:
                for end in range(last, first, -BLOCK_NODES):
                    start = max(end - BLOCK_NODES, first)
                    moves = part_of(space, 0, end - start)
                    in_parts(pool, threads, end - start, self.grid.fill, start, moves)
                    filled = self._value_j[start : end + 1], self._time_to_go_s[start : end + 1]
                    in_parts(pool, threads, len(ladder), backward_sweep, ladder, moves, *filled, of=LANES)
            self.known_from = first

    def front(self) -> Front:
        """The front of the nodes solved so far, which continues the sweep when a node further back is needed."""
        return Front(
            section=self.grid.section,
            lambda_w=self.ladder,
            value_j=self._value_j,
            time_to_go_s=self._time_to_go_s,
            sweep=self if self.known_from > 0 else None,
        )


def in_parts(
    pool: ThreadPoolExecutor, threads: int, size: int, work: Callable[..., None], *args: object, of: int = 1
) -> None:
    """Call work(first, last, *args) for parts of range(size), each in a thread; they begin at multiples of `of`."""
    edges = [min(of * round(size * i / (threads * of)), size) for i in range(threads)] + [size]
    for future in [pool.submit(work, first, last, *args) for first, last in pairwise(edges)]:
        future.result()


def default_ladder(section: Section) -> Floats:
    """The default multipliers (W): a few very small ones, a geometric ladder, a few far above the usable power."""
    lowest, highest = np.array(tol.LADDER_LOWEST_RATIOS), np.array(tol.LADDER_HIGHEST_RATIOS)
    between = tol.LADDER_SIZE - len(lowest) - len(highest)
    ladder = np.geomspace(tol.LADDER_LOW_RATIO, tol.LADDER_HIGH_RATIO, between)
    return np.asarray(usable_power_w(section) * np.concatenate((lowest, ladder, highest)), dtype=float)


def usable_power_w(section: Section) -> float:
    """The largest traction power (W) that the train can use on a section."""
    return float(min(section.train.traction_power_w, section.train.traction_force_n * section.envelope_mps.max()))


def empty_moves(nodes: int, states: int) -> Moves:
    """Unfilled arrays for the moves of this number of nodes and speeds."""
    shape = (nodes, states, LANDINGS)
    return Moves(
        time_s=np.empty(shape, np.float32),
        energy_j=np.empty(shape, np.float64),
        target=np.empty(shape, np.int32),
        weight=np.empty(shape, np.float32),
        filled=np.empty(shape[:2], np.int16),
    )


def part_of(moves: Moves, first: int, last: int) -> Moves:
    """The moves of the nodes first … last − 1 (a view)."""
    return Moves._make(array[first:last] for array in moves)


@dataclass(frozen=True, kw_only=True, eq=False)
class DecisionGrid:
    """The line between the decision nodes of a section: means over the integration steps of each decision step."""

    section: Section
    node_m: Floats
    line: LineArrays
    bounds: SpeedBounds

    @classmethod
    def of(cls, section: Section) -> DecisionGrid:
        """The decision grid of a section."""
        node, starts = section.node_m[section.decision], section.decision[:-1]
        length = np.diff(node)
        return cls(
            section=section,
            node_m=node,
            line=LineArrays(
                length,
                np.add.reduceat(section.constant_n * section.step_m, starts) / length,
                np.add.reduceat(section.tunnel_n_per_mps2 * section.step_m, starts) / length,
                section.supply[starts],
            ),
            bounds=SpeedBounds(
                np.ascontiguousarray(section.floor_mps[section.decision]),
                np.ascontiguousarray(section.envelope_mps[section.decision]),
            ),
        )

    def fill(self, first: int, last: int, start: int, moves: Moves) -> None:
        """Fill rows first … last − 1 of `moves`, whose row 0 is decision node `start`."""
        section = self.section
        transitions(
            start + first, start + last, self.line, self.bounds, section.speed_steps, section.train,
            section.loss_params, part_of(moves, first, last),
        )  # fmt: skip
