"""Cells of speeds around a trajectory: the cheapest path through them must cost no more than the trajectory itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from docs.studies.tight_bound_kernels import Cells


def cells_near(speeds_mps: NDArray[np.float64], cells: Cells) -> Cells:
    """The cells, all closed except those that a trajectory with these speeds passes, and one on each side of them."""
    at = np.minimum(np.floor(np.sqrt(speeds_mps) / cells.width).astype(int), cells.size - 1)
    cells.open[:] = False
    for beside in (-1, 0, 1):
        cells.open[cells.offset + np.clip(at + beside, 0, cells.size - 1)] = True
    return cells
