"""Table 2: each level's run at t+ = 7 %, evaluated at every level (section 4.7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
    TABLE2_TRAJECTORIES,
    StudyCase,
    Variant,
    Workbench,
    label,
)
from docs.studies.output import Output, markdown_table
from precompute.baselines import strategies as baselines

CSV_COLUMNS = ("trajectory", "level", "printed", "ours", "deviation_ratio")
FOUR_MODE_LEVELS = (L0_NOREG, L1, L2)
"""Levels whose optimum on level track is a run of four modes (section 4.5)."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A trajectory's energy at a level, in % of the fastest run's at L3 GTO."""

    trajectory: str
    level: str
    ours: float
    printed: float | None = None

    @property
    def deviation_ratio(self) -> float | None:
        """Our figure over the printed one, − 1; None if none is printed."""
        return None if self.printed is None else self.ours / self.printed - 1


def trajectories(bench: Workbench, case: StudyCase, buffer_percent: float) -> dict[str, Trajectory]:
    """The rows of the table: fastest, reduced maximum speed, each level's run; all but the first with the buffer."""
    time_s = bench.time_s(case, buffer_percent)
    rows = {
        "fastest": bench.fastest(case),
        "rms": baselines.reduced_maximum_speed(bench.section(case, L3), time_s).trajectory,
    }
    for variant in ALL_VARIANTS:
        rows[variant.name] = _best_run(bench, case, variant, time_s)
    return rows


def _best_run(bench: Workbench, case: StudyCase, variant: Variant, time_s: float) -> Trajectory:
    """The solver's run, or a four-mode run if that needs less: the two may differ by the solver's 0.01 to 0.05 %."""
    runs = [bench.front(case, variant).trajectory(time_s).trajectory]
    if variant in FOUR_MODE_LEVELS:
        runs.append(baselines.four_modes(bench.section(case, variant), time_s).trajectory)
    return min(runs, key=lambda run: bench.energy_j(run, variant))


def cross_evaluation(bench: Workbench, case: StudyCase, rows: dict[str, Trajectory]) -> list[Cell]:
    """Every trajectory's energy at every level, without printed values."""
    return [
        Cell(trajectory=name, level=variant.name, ours=bench.percent(case, run, variant))
        for name, run in rows.items()
        for variant in ALL_VARIANTS
    ]


def cells(bench: Workbench) -> list[Cell]:
    """All cells of Table 2, with the printed figures."""
    rows = trajectories(bench, COMPLETE, TABLE2_BUFFER_PERCENT)
    found = {(cell.trajectory, cell.level): cell.ours for cell in cross_evaluation(bench, COMPLETE, rows)}
    return [
        Cell(trajectory=trajectory, level=level, ours=found[trajectory, level], printed=TABLE2[trajectory, level])
        for trajectory in TABLE2_TRAJECTORIES
        for level in TABLE2_LEVELS
    ]


def table2(bench: Workbench, output: Output) -> dict[str, Any]:
    """Write Table 2 as tidy CSV and as Markdown; return its cells, deviations and the gains of L3."""
    found = cells(bench)
    output.csv(
        "table2.csv", CSV_COLUMNS, [(c.trajectory, c.level, c.printed, c.ours, c.deviation_ratio) for c in found]
    )
    output.text("table2.md", markdown(found))
    deviations = [(abs(c.deviation_ratio), c) for c in found if c.deviation_ratio is not None]
    worst = max(deviations, key=lambda item: item[0])[1]
    return {
        "cells": {f"{c.trajectory}/{c.level}": c.ours for c in found},
        "largest_deviation": {
            "trajectory": worst.trajectory, "level": worst.level, "printed": worst.printed, "ours": worst.ours,
            "ratio": worst.deviation_ratio,
        },
        "largest_deviation_ratio_by_level": {
            level: max(r for r, c in deviations if c.level == level) for level in TABLE2_LEVELS
        },
        "gains": {variant.name: gains(found, variant) for variant in ALL_VARIANTS[-2:]},
    }  # fmt: skip


def gains(found: list[Cell], variant: Variant) -> dict[str, Any]:
    """What the run optimal for an L3 map saves with that map against the second best and against RMS (ratios).

    The second best is the best run of levels L0 to L2: the paper has no run of the other L3 map in that column.
    """
    column = {c.trajectory: c.ours for c in found if c.level == variant.name}
    own = column[variant.name]
    others = {name: value for name, value in column.items() if not name.startswith("l3")}
    second = min(others, key=others.__getitem__)
    return {
        "second_best": second,
        "saves_against_second_best_ratio": 1 - own / column[second],
        "saves_against_rms_ratio": 1 - own / column["rms"],
        "saves_against_fastest_ratio": 1 - own / column["fastest"],
    }


def markdown(found: list[Cell]) -> str:
    """The table; each cell has the printed figure, ours and the deviation."""
    rows = []
    for trajectory in TABLE2_TRAJECTORIES:
        row = [c for c in found if c.trajectory == trajectory]
        rows.append([label(trajectory), *(_text(cell, found) for cell in row)])
    return (
        f"Energy at t+ = {TABLE2_BUFFER_PERCENT:g} % on 6 km, in % of the fastest run's at L3 GTO. "
        "Each cell: paper → ours (deviation); bold: least of its column in ours.\n\n"
        + markdown_table(["optimal for", *(f"at {label(level)}" for level in TABLE2_LEVELS)], rows)
    )


def _text(cell: Cell, found: list[Cell]) -> str:
    least = min(c.ours for c in found if c.level == cell.level)
    ours = f"{cell.ours:.2f}"
    ours = f"**{ours}**" if ours == f"{least:.2f}" else ours
    if cell.printed is None or cell.deviation_ratio is None:
        return f"– → {ours}"
    return f"{cell.printed:.2f} → {ours} ({100 * cell.deviation_ratio:+.1f} %)"
