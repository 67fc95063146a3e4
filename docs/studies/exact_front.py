"""The exact front of the paper's complete case, as computed by `das-precompute front flat-6km re460-ic --exact`.

`python -m docs.studies.exact_front` updates the tables in docs/results/0.2/exact-front.md (about five minutes on two
cores).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from das.command_line.files import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.units import KM
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from docs.studies.output import DOCS, write_csv, write_table
from precompute.exact.front import ExactFront, Limits, solve_exact
from precompute.exact.grid import Grid

PAGE: Final = DOCS / "results" / "0.2" / "exact-front.md"
CASE: Final = PAGE.with_name("exact-front-case.csv")
LEVELS: Final = (Level.L0_NOREG, Level.L1, Level.L2, Level.L3)
BUFFERS: Final = (0.02, 0.05, 0.07, 0.1)
LENGTHS_KM: Final = (2.0, 3.0, 4.0, 5.0, 6.0)
SPEED_STEPS_KMH: Final = (0.5, 0.25, 0.1)
STEP_BUFFER: Final = 0.07
"""Buffer over the least time of the paper's own grid at which speed steps are compared."""
BUCKET_MS: Final = 3.0
MILLION: Final = 1e6


def case(level: Level, length_km: float = LENGTHS_KM[-1]) -> Section:
    """The section on the paper's level line of 6 km, or its first part, for the Re 460."""
    return build_section(load_route("flat-6km"), load_vehicle("re460-ic"), level=level, end_m=length_km * KM)


def solver_against(front: Front, exact: ExactFront, time_s: float) -> str:
    """Relative difference between the energies of the solver and of the exact front for the same time."""
    found_j = front.trajectory(time_s).balance.input
    return f"{100.0 * (found_j / float(exact.energy_j[exact.index_at(time_s)]) - 1.0):+.2f} %"


def case_table(levels: Sequence[Level] = LEVELS, buffers: Sequence[float] = BUFFERS) -> Iterator[str]:
    """The lines of the table of the complete case: its size, and the two comparisons on the grid."""
    at = " | ".join(f"solver at {100 * buffer:g} %" for buffer in buffers)
    yield (
        "| level | points of the front | partial runs kept, million | supported front below it: worst, "
        f"mean | the solver's method on this grid above it: worst, mean | {at} |"
    )
    yield f"|---|{'---:|' * (4 + len(buffers))}"
    for level in levels:
        section = case(level)
        exact = solve_exact(section, max(buffers))
        front = solve_front(section)
        below, above = 100.0 * exact.gap_ratio, 100.0 * exact.swept_gap_ratio
        cells = [
            f"{len(exact.time_s)}",
            f"{exact.labels / MILLION:.2g}",
            f"{below.max():.3f} %, {below.mean():.4f} %",
            f"{above.max():.3f} %, {above.mean():.4f} %",
            *(solver_against(front, exact, exact.least_time_s * (1.0 + buffer)) for buffer in buffers),
        ]
        yield f"| {level} | {' | '.join(cells)} |"


def growth_table(lengths_km: Sequence[float] = LENGTHS_KM, buffer_ratio: float = BUFFERS[-1]) -> Iterator[str]:
    """The lines of the table for increasing lengths of the line, with the loss map."""
    yield "| length | points of the front | partial runs kept, million |"
    yield "|---:|---:|---:|"
    for length_km in lengths_km:
        exact = solve_exact(case(Level.L3, length_km), buffer_ratio)
        yield f"| {length_km:g} km | {len(exact.time_s)} | {exact.labels / MILLION:.2g} |"


def step_table(steps_kmh: Sequence[float] = SPEED_STEPS_KMH) -> Iterator[str]:
    """The lines of the table for finer speed steps, at L1, for one time; the coasting grid is unchanged."""
    section = case(Level.L1)
    front = solve_front(section)
    coarse = solve_exact(section, 0.0)
    time_s = coarse.least_time_s * (1.0 + STEP_BUFFER)
    yield "| step of speed | energy of the solver relative to the exact front |"
    yield "|---:|---:|"
    for step_kmh in steps_kmh:
        grid = Grid(speed_kmh=step_kmh)
        least_s = solve_exact(section, 0.0, grid=grid).least_time_s
        exact = solve_exact(section, time_s / least_s - 1.0 + 1e-6, grid=grid)
        yield f"| {step_kmh:g} km/h | {solver_against(front, exact, time_s)} |"


def bounded_lines() -> Iterator[str]:
    """The sentence on L0 REG, whose front is only bounded."""
    exact = solve_exact(case(Level.L0_REG), BUFFERS[-1], limits=Limits(bucket_ms=BUCKET_MS))
    above = 100.0 * (exact.energy_j - exact.bound_j) / np.maximum(np.abs(exact.energy_j), 1.0)
    yield (
        f"With one partial run kept for each state and each {BUCKET_MS:g} ms of time, "
        f"{exact.labels / MILLION:.2g} million partial runs give {len(exact.time_s)} complete runs; their energies are "
        f"at most {above.max():.4f} %, on average {above.mean():.4f} %, above the dual bound."
    )


def main() -> None:
    """Write the tables again."""
    write_csv(CASE, case_table())
    for name, lines in (
        ("bounded", bounded_lines()),
        ("growth", growth_table()),
        ("steps", step_table()),
    ):
        write_table(PAGE, name, lines)


if __name__ == "__main__":
    main()
