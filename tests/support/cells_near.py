"""Cells of speeds beside a run: the shortest path over them is near the run's own cost, and must not be above it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.solver.kernels.speed_cells import Cells


def cells_near(speeds_mps: NDArray[np.float64], cells: Cells) -> Cells:
    """The cells, with only those open that a run with these speeds at the nodes goes through, and one on each side."""
    at = np.minimum(np.floor(np.sqrt(speeds_mps) / cells.width).astype(int), cells.size - 1)
    cells.open[:] = False
    for beside in (-1, 0, 1):
        cells.open[cells.offset + np.clip(at + beside, 0, cells.size - 1)] = True
    return cells
