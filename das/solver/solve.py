"""Solving a section: the backward sweep over its decision nodes for a ladder of multipliers."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.kernels.landings import LANDINGS
from das.solver.kernels.lanes import LANES
from das.solver.kernels.sweep import backward_sweep
from das.solver.kernels.transitions import transitions
from das.solver.kernels.tuples import LineArrays, Moves, SpeedBounds
from das.solver.memory import KEPT
from das.solver.section import Section

Floats = NDArray[np.float64]

BLOCK_NODES = 32
"""Transitions of this number of decision nodes are kept at a time: a few MB, and threads rarely wait for each other."""


def solve_front(
    section: Section,
    *,
    threads: int = 2,
    lambda_w: Floats | None = None,
    end_value_j: Floats | None = None,
    block_nodes: int = BLOCK_NODES,
) -> Front:
    """Solve a section for a ladder of multipliers (default: `default_ladder`).

    Where the end speed of the section is free, `end_value_j` holds for each of its J + 1 possible end speeds the energy
    (J) that the way behind the section costs.

    From the end in blocks of decision nodes, first the transitions of a block are found, each thread taking some
    of its nodes; then the block is swept, each thread taking some of the multipliers. The kernels release the GIL and
    share nothing that they write. Only the transitions of one block are kept, because all of them together would be as
    large as the result. The number of threads and the size of a block change no bit of the result.
    """
    ladder = default_ladder(section) if lambda_w is None else np.asarray(lambda_w, dtype=float)
    grid = DecisionGrid.of(section)
    n, states, size = len(grid.node_m) - 1, grid.speed_steps + 1, len(ladder)
    value, time_to_go = KEPT.empty((n + 1, states, size), np.float64), KEPT.empty((n + 1, states, size), np.float32)
    value[-1] = 0.0 if end_value_j is None else end_value_j[:, np.newaxis]
    time_to_go[-1] = 0.0
    working_space = Transitions.empty(min(block_nodes, n), states)
    with ThreadPoolExecutor(threads) as pool:
        for end in range(n, 0, -block_nodes):
            start = max(end - block_nodes, 0)
            moves = working_space.rows(0, end - start)
            in_parts(pool, threads, end - start, grid.fill, start, moves)
            rows = slice(start, end + 1)
            in_parts(pool, threads, size, moves.sweep, ladder, value[rows], time_to_go[rows], of=LANES)
    return Front(section=section, lambda_w=ladder, value_j=value, time_to_go_s=time_to_go)


def default_ladder(section: Section) -> Floats:
    """A few very small multipliers, a geometric ladder, and a few far above the power the train can use here (W)."""
    lowest, highest = np.array(tol.LADDER_LOWEST_RATIOS), np.array(tol.LADDER_HIGHEST_RATIOS)
    between = tol.LADDER_SIZE - len(lowest) - len(highest)
    ladder = np.geomspace(tol.LADDER_LOW_RATIO, tol.LADDER_HIGH_RATIO, between)
    usable_w = min(section.train.traction_power_w, section.train.traction_force_n * section.envelope_mps.max())
    return np.asarray(usable_w * np.concatenate((lowest, ladder, highest)), dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Moves from the speeds of some decision nodes to those of the next nodes (see `Moves`); none depends on λ."""

    time_s: NDArray[np.float32]
    energy_j: Floats
    target: NDArray[np.int32]
    weight: NDArray[np.float32]
    count: NDArray[np.int16]

    @classmethod
    def empty(cls, nodes: int, states: int) -> Transitions:
        """Room for the moves of this number of nodes and speeds."""
        shape = (nodes, states, LANDINGS)
        return cls(
            time_s=KEPT.empty(shape, np.float32),
            energy_j=KEPT.empty(shape, np.float64),
            target=KEPT.empty(shape, np.int32),
            weight=KEPT.empty(shape, np.float32),
            count=KEPT.empty(shape[:2], np.int16),
        )

    @property
    def moves(self) -> Moves:
        """The arrays as the kernels take them."""
        return Moves(self.time_s, self.energy_j, self.target, self.weight, self.count)

    def rows(self, first: int, last: int) -> Transitions:
        """The part of the nodes first … last − 1 (a view)."""
        return Transitions(**{name: array[first:last] for name, array in vars(self).items()})

    def sweep(
        self, first: int, last: int, lambda_w: Floats, value_j: Floats, time_to_go_s: NDArray[np.float32]
    ) -> None:
        """Fill values and times-to-go of these nodes for multipliers first … last − 1 from those of the node after."""
        backward_sweep(first, last, lambda_w, self.moves, value_j, time_to_go_s)


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

    @property
    def speed_steps(self) -> int:
        """Steps of the speed grid."""
        return self.section.speed_steps

    def fill(self, first: int, last: int, start: int, moves: Transitions) -> None:
        """Fill rows first … last − 1 of `moves`, whose row 0 is decision node `start`."""
        section = self.section
        transitions(
            start + first, start + last, self.line, self.bounds, self.speed_steps, section.train, section.loss_params,
            moves.rows(first, last).moves,
        )  # fmt: skip


def in_parts(
    pool: ThreadPoolExecutor, threads: int, size: int, work: Callable[..., None], *args: object, of: int = 1
) -> None:
    """Call work(first, last, *args) for equal parts of range(size), each on a thread of its own.

    The parts begin at multiples of `of`.
    """
    edges = [min(of * round(size * i / (threads * of)), size) for i in range(threads)] + [size]
    for future in [pool.submit(work, first, last, *args) for first, last in pairwise(edges)]:
        future.result()
