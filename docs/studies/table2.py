"""Table 2: each level's run at t+ = 7 %, evaluated at every level (section 4.7); another train; gradients.

The other train is a hypothesis: weaker and slower. The paper prints neither the force limits of its train nor the top
speed that it reached; its text says 160 km/h. The columns L0 to L2 do not depend on the confidential loss map, except
for the common 100 %, the fastest run's energy at L3. They therefore determine force and speed up to one scale, which is
fitted here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from das.domain.errors import DasError
from das.domain.trajectory import Trajectory
from das.domain.units import KMH, KN, PERMILLE, kwh
from das.domain.vehicle import Vehicle
from docs.studies.cases import (
    ALL_VARIANTS,
    COMPLETE,
    DOWNHILL,
    L0_NOREG,
    L0_REG,
    L1,
    L2,
    L3,
    TABLE2,
    TABLE2_BUFFER_PERCENT,
    TABLE2_LEVELS,
    TABLE2_TRAJECTORIES,
    UPHILL,
    StudyCase,
    Variant,
    Workbench,
    label,
)
from docs.studies.effort import effort
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


def table2(found: list[Cell], output: Output) -> dict[str, Any]:
    """Write Table 2 as tidy CSV and as Markdown; return its cells, deviations and the gains of L3."""
    output.csv(
        "table2.csv", CSV_COLUMNS, [(c.trajectory, c.level, c.printed, c.ours, c.deviation_ratio) for c in found]
    )
    output.page("table2.md", markdown(found))
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


FORCE_KN: Final = 200.0
TOP_SPEED_KMH: Final = 140.0
ROWS: Final = ("fastest", "rms", L0_NOREG.name, L0_REG.name, L1.name)
"""Rows of the comparison: those of Table 2 that need no loss map; the row of L2 is that of L1."""
COLUMNS: Final = (L0_NOREG.name, L0_REG.name, L1.name, L2.name)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How near cells come to the printed figures.

    `own`: the largest deviation (ratio) if 100 % is the fastest run's energy at our L3. `scaled`: the largest deviation
    if all cells are multiplied by the one `scale` that makes it smallest.
    """

    own: float
    scaled: float
    scale: float


def agreement(found: Sequence[Cell]) -> Agreement:
    """How near the cells of `ROWS` and `COLUMNS` come to the printed figures."""
    deviations = [
        cell.deviation_ratio
        for cell in found
        if cell.trajectory in ROWS and cell.level in COLUMNS and cell.deviation_ratio is not None
    ]
    low, high = 1 + min(deviations), 1 + max(deviations)
    return Agreement(own=max(high - 1, 1 - low), scaled=(high - low) / (high + low), scale=2 / (high + low))


def weaker(vehicle: Vehicle) -> Vehicle:
    """The train with the force limits and the top speed of the hypothesis."""
    return replace(
        vehicle,
        max_speed_mps=TOP_SPEED_KMH * KMH,
        traction=replace(vehicle.traction, max_force_n=FORCE_KN * KN),
        electric_brake=replace(vehicle.electric_brake, max_force_n=FORCE_KN * KN),
    )


def hypothesis_cells() -> tuple[list[Cell], float]:
    """All cells of Table 2 with the train of the hypothesis, and its least running time (s)."""
    bench = Workbench(changed=weaker)
    return cells(bench), bench.fastest(COMPLETE).time_s


def both_trains(bench: Workbench, output: Output) -> dict[str, Any]:
    """Write Table 2 and the table of the hypothesis; return both for the summary."""
    main = cells(bench)
    result = table2(main, output)
    other, least_time_s = hypothesis_cells()
    sentence = in_words(main, other)
    output.page("table2-hypothesis.md", f"{sentence}\n\n{markdown(other)}")
    return {**result, "hypothesis": _hypothesis_json(main, other, least_time_s), "in_words": sentence}


def _hypothesis_json(main: Sequence[Cell], other: Sequence[Cell], least_time_s: float) -> dict[str, Any]:
    """Both trains' agreement with the printed figures, and the cells of the hypothesis."""
    return {
        "force_kn": FORCE_KN,
        "top_speed_kmh": TOP_SPEED_KMH,
        "least_time_s": least_time_s,
        "cells_compared": len(ROWS) * len(COLUMNS),
        "as_the_text_says": vars(agreement(main)),
        "hypothesis": vars(agreement(other)),
        "cells": {f"{c.trajectory}/{c.level}": c.ours for c in other},
    }


def in_words(main: Sequence[Cell], other: Sequence[Cell]) -> str:
    """One sentence on both trains."""
    a, b = agreement(main), agreement(other)
    return (
        f"Columns L0 to L2 of Table 2, {len(ROWS) * len(COLUMNS)} cells: at most {100 * a.scaled:.1f} % from print "
        f"with 300 kN and 160 km/h, {100 * b.scaled:.1f} % with {FORCE_KN:g} kN and {TOP_SPEED_KMH:g} km/h (one scale "
        f"fitted to each; by our own 100 %: {100 * a.own:.1f} and {100 * b.own:.1f} %)."
    )


def gradients(bench: Workbench, output: Output) -> dict[str, Any]:
    """Write the cross evaluation uphill and downhill; a case that cannot be run is reported as impossible."""
    result: dict[str, Any] = {"buffer_percent": TABLE2_BUFFER_PERCENT}
    rows: list[tuple[object, ...]] = []
    parts = []
    for case in (UPHILL, DOWNHILL):
        try:
            runs = trajectories(bench, case, TABLE2_BUFFER_PERCENT)
            found = cross_evaluation(bench, case, runs)
        except DasError as error:
            result[case.name] = {"not_possible": str(error)}
            parts.append(f"{case.title}: not possible: {error}\n")
            continue
        result[case.name] = _gradient_json(bench, case, runs, found)
        rows += [(case.name, c.trajectory, c.level, c.ours) for c in found]
        parts.append(_gradient_markdown(bench, case, found))
    output.csv("gradients.csv", ["case", "trajectory", "level", "ours_percent"], rows)
    output.page("gradients.md", "\n".join(parts))
    return result


def _gradient_json(bench: Workbench, case: StudyCase, runs: dict[str, Trajectory], found: list[Cell]) -> dict[str, Any]:
    balance = bench.balance(runs["fastest"], L3)
    return {
        "gradient_permille": case.gradient_ratio / PERMILLE,
        "least_time_s": runs["fastest"].time_s,
        "fastest_l3_kwh": kwh(balance.irreversible),
        "fastest_l3_input_kwh": kwh(balance.input),
        "potential_kwh": kwh(balance.potential),
        "gains": {variant.name: gains(found, variant) for variant in ALL_VARIANTS[-2:]},
        "reduced_effort": {
            variant.name: effort(runs[variant.name], bench.vehicle(variant)).as_json() for variant in ALL_VARIANTS
        },
    }


def _gradient_markdown(bench: Workbench, case: StudyCase, found: list[Cell]) -> str:
    names = list(dict.fromkeys(c.trajectory for c in found))
    rows = [[label(name), *(f"{c.ours:.2f}" for c in found if c.trajectory == name)] for name in names]
    reference = kwh(bench.reference_j(case))
    return (
        f"{case.title}, t+ = {TABLE2_BUFFER_PERCENT:g} %, in % of the fastest run's at L3 GTO ({reference:.1f} kWh)\n\n"
        + markdown_table(["optimal for", *(f"at {v.label}" for v in ALL_VARIANTS)], rows)
    )
