"""Compiles the kernels that a solved section needs, on a tiny section (`python -m precompute.late_kernels`).

A command that compiles the solver starts this module in a second process. It compiles the kernels in the order in which
the command needs them, except those that share most of their code with the command's own kernels: the sweep, and the
tubes of the refinement.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from das.domain.errors import InfeasibleError
from das.domain.files.load import load_vehicle
from das.offline.bound import bound_of, task_of
from das.solver.kernels.tuples import Policies, Policy
from das.solver.section import Section, build_section
from das.solver.solve import DecisionGrid
from das.solver.state import State, fastest
from das.solver.tolerances import INFEASIBLE
from das.solver.warm_up import tiny_route

TRAIN = "re460-ic"
"""A bundled train with a loss map, so that the kernels of the bound for loss maps are compiled, too."""
PRICE_W = 1e5
"""Price of time (W); any value is suitable."""
SLOWER_RATIO = 1.2
"""Time of the run to bound, as a multiple of the least time."""


def main() -> None:
    """Roll out policies of a tiny section, and bound its fastest run as if there were spare time."""
    section = build_section(tiny_route(), load_vehicle(TRAIN))
    state, policies = State.at(section), _unsolved_policies(section)
    state.totals(policies)
    with suppress(InfeasibleError):
        state.roll_out(policies, Policy(price_w=PRICE_W, ladder_index=0))
    run = fastest(section)
    bound_of(task_of(run, SLOWER_RATIO * run.time_s), run.trajectory.force_el_n, PRICE_W)


def _unsolved_policies(section: Section) -> Policies:
    """Policies that no sweep has filled: no train can follow them, but their kernels are compiled."""
    grid, prices_w = DecisionGrid.of(section), np.array([PRICE_W, 2.0 * PRICE_W])
    shape = len(grid.node_m), section.speed_steps + 1, len(prices_w)
    return Policies(prices_w, np.full(shape, INFEASIBLE), np.zeros(shape, np.float32))


if __name__ == "__main__":
    main()
