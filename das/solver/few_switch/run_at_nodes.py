"""A run at the integration nodes of its section, as the phases of its schedule are compared with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.solver.few_switch.phases import Phase

Floats = NDArray[np.float64]
STEADY_MPS = 0.01
"""A speed that changes by less than this (m/s) from node to node is held."""


class RunAtNodes(NamedTuple):
    """Speeds of a run and the highest ones allowed (m/s), the places of the nodes (m), and when it is there (s)."""

    speeds_mps: Floats
    envelope_mps: Floats
    node_m: Floats
    elapsed_s: Floats

    @classmethod
    def of(cls, speeds_mps: Floats, envelope_mps: Floats, step_m: Floats) -> RunAtNodes:
        """The run with these speeds over steps of these lengths (m)."""
        took_s = 2.0 * step_m / np.maximum(speeds_mps[:-1] + speeds_mps[1:], 1e-3)
        return cls(speeds_mps, envelope_mps, *(np.concatenate(([0.0], one.cumsum())) for one in (step_m, took_s)))

    def lasts_s(self, first: int, last: int) -> float:
        """How long the run takes from one node to another (s)."""
        return float(self.elapsed_s[last] - self.elapsed_s[first])


def ends_of(phases: Sequence[Phase], run: RunAtNodes) -> list[int]:
    """The last node of every phase."""
    return [*(one.begin for one in phases[1:]), len(run.speeds_mps) - 1]
