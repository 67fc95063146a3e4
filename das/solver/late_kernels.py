"""`python -m das.solver.late_kernels`: compile the kernels that a solved section needs last, on a tiny section.

A command that compiles the solver starts this beside itself: bound and refinement need most of the time and come last.
"""

from __future__ import annotations

from dataclasses import replace

from das.domain.files.load import load_vehicle
from das.solver.bound.certificate import bound_of, task_of
from das.solver.refinement import SETTINGS, Refinement
from das.solver.section import build_section
from das.solver.state import fastest
from das.solver.warm_up import tiny_route

TRAIN = "re460-ic"
"""A bundled train with a loss map, which its bound needs."""
PRICE_W = 1e5
"""Any price of time will do."""
SLOWER_RATIO = 1.2
"""The run to bound and to refine has this many times the least time."""


def main() -> None:
    """Bound and refine the fastest run of a tiny section as if it had time to spare."""
    run = fastest(build_section(tiny_route(), load_vehicle(TRAIN)))
    bound_of(task_of(run, SLOWER_RATIO * run.time_s), run.trajectory.force_el_n, PRICE_W)
    slower = replace(run, requested_s=SLOWER_RATIO * run.time_s)
    found = Refinement(slower, replace(SETTINGS, passes=1, most_rounds=1))
    found.search.best(found.given._replace(price_w=PRICE_W))


if __name__ == "__main__":
    main()
