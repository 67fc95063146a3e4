"""The transitions of a whole section, computed as in the solver."""

from __future__ import annotations

from das.solver.kernels.tuples import Moves
from das.solver.section import Section
from das.solver.solve import DecisionGrid, empty_moves


def all_moves(section: Section) -> Moves:
    """The transitions of every decision node of a section."""
    grid = DecisionGrid.of(section)
    nodes = len(grid.node_m) - 1
    moves = empty_moves(nodes, section.speed_steps + 1)
    grid.fill(0, nodes, 0, moves)
    return moves
