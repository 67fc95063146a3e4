"""Table 2: the optimal run for each level with a buffer t+ of 7 %, evaluated at every level (section 4.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from das.domain.trajectory import Trajectory
from docs.studies.cases import (
    ALL_VARIANTS,
    COMPLETE,
    L0_NOREG,
    L1,
    L2,
    L3,
    TABLE2,
    TABLE2_BUFFER_PERCENT,
    TABLE2_LEVELS,
    Variant,
    Workbench,
    label,
)
from docs.studies.output import Output, csv_text
from precompute.baselines import strategies as baselines

FOUR_MODE_LEVELS = (L0_NOREG, L1, L2)
"""Loss levels whose optimum on flat track consists of four driving modes (section 4.5)."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A trajectory's energy at a level, in % of that of the fastest run at level L3 (GTO)."""

    trajectory: str
    level: str
    ours: float
    printed: float

    @property
    def deviation_ratio(self) -> float:
        """The computed figure over the printed one, minus 1; NaN if none is printed."""
        return self.ours / self.printed - 1


def trajectories(bench: Workbench) -> dict[str, Trajectory]:
    """The rows of the table: fastest, reduced maximum speed, each level's run; all but the first with the buffer."""
    time_s = bench.time_s(COMPLETE, TABLE2_BUFFER_PERCENT)
    rows = {
        "fastest": bench.fastest(COMPLETE),
        "top-speed": baselines.reduced_maximum_speed(bench.section(COMPLETE, L3), time_s).trajectory,
    }
    for variant in ALL_VARIANTS:
        rows[variant.name] = _best_run(bench, variant, time_s)
    return rows


def _best_run(bench: Workbench, variant: Variant, time_s: float) -> Trajectory:
    """The solver's run, or a four-mode run if better: the solver's error is 0.01 to 0.05 %."""
    runs = [bench.front(COMPLETE, variant).trajectory(time_s).trajectory]
    if variant in FOUR_MODE_LEVELS:
        runs.append(baselines.four_modes(bench.section(COMPLETE, variant), time_s).trajectory)
    return min(runs, key=lambda run: bench.energy_j(run, variant))


def cells(bench: Workbench) -> list[Cell]:
    """Every run's energy at every level, with the printed figures."""
    rows = trajectories(bench)
    return [
        Cell(
            trajectory=name,
            level=variant.name,
            ours=bench.percent(COMPLETE, rows[name], variant),
            printed=printed,
        )
        for name, values in TABLE2.items()
        for variant, printed in zip(ALL_VARIANTS, values, strict=True)
    ]


def table2(bench: Workbench, output: Output) -> None:
    """Write Table 2 as CSV."""
    output.text("table2.csv", as_csv(cells(bench)))


def as_csv(found: list[Cell]) -> str:
    """The table as CSV; each cell contains the printed figure, the computed one and the deviation."""
    rows = []
    for trajectory in TABLE2:
        row = [c for c in found if c.trajectory == trajectory]
        rows.append([label(trajectory), *map(_text, row)])
    return csv_text([["optimal for", *(f"at {label(level)}" for level in TABLE2_LEVELS)], *rows])


def _text(cell: Cell) -> str:
    ours = f"{cell.ours:.2f}"
    if np.isnan(cell.printed):
        return f"– → {ours}"
    return f"{cell.printed:.2f} → {ours} ({100 * cell.deviation_ratio:+.1f} %)"
