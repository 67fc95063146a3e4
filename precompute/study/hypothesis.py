"""Table 2 once more with a weaker and slower train: what the printed fastest run looks like, as a hypothesis.

The paper prints neither the force limits of its train nor the top speed that it reached; its text says 160 km/h. The
columns L0 to L2 do not depend on the confidential loss map but for the common 100 %, the fastest run's energy at L3.
They therefore tell force and speed up to one scale, which is fitted here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from das.domain.units import KMH, KN
from das.domain.vehicle import Vehicle
from precompute.study.cases import COMPLETE, L0_NOREG, L0_REG, L1, L2
from precompute.study.output import Output
from precompute.study.runs import Workbench
from precompute.study.table2 import Cell, cells, markdown, table2

FORCE_KN: Final = 200.0
TOP_SPEED_KMH: Final = 140.0
ROWS: Final = ("fastest", "rms", L0_NOREG.name, L0_REG.name, L1.name)
"""Rows of the comparison: those of Table 2 that need no loss map; the row of L2 is that of L1."""
LEVELS: Final = (L0_NOREG.name, L0_REG.name, L1.name, L2.name)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How near cells come to print.

    `own`: the largest deviation (ratio) where 100 % is the fastest run's energy at our L3. `scaled`: the largest where
    all cells are multiplied by the one `scale` that makes it least.
    """

    own: float
    scaled: float
    scale: float


def agreement(found: Sequence[Cell]) -> Agreement:
    """How near the cells of `ROWS` and `LEVELS` come to print."""
    deviations = [
        cell.deviation_ratio
        for cell in found
        if cell.trajectory in ROWS and cell.level in LEVELS and cell.deviation_ratio is not None
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
    """Write Table 2, and beside it the table of the hypothesis; return what both say."""
    result = table2(bench, output)
    main = cells(bench)
    other, least_time_s = hypothesis_cells()
    told = in_words(main, other)
    output.text("table2-hypothesis.md", f"{told}\n\n{markdown(other)}")
    return {**result, "hypothesis": as_json(main, other, least_time_s), "in_words": told}


def as_json(main: Sequence[Cell], other: Sequence[Cell], least_time_s: float) -> dict[str, Any]:
    """Both trains' agreement with print, and the cells of the hypothesis."""
    return {
        "force_kn": FORCE_KN,
        "top_speed_kmh": TOP_SPEED_KMH,
        "least_time_s": least_time_s,
        "cells_compared": len(ROWS) * len(LEVELS),
        "as_the_text_says": vars(agreement(main)),
        "hypothesis": vars(agreement(other)),
        "cells": {f"{c.trajectory}/{c.level}": c.ours for c in other},
    }


def in_words(main: Sequence[Cell], other: Sequence[Cell]) -> str:
    """One sentence on both trains."""
    a, b = agreement(main), agreement(other)
    return (
        f"Columns L0 to L2 of Table 2, {len(ROWS) * len(LEVELS)} cells: at most {100 * a.scaled:.1f} % from print with "
        f"300 kN and 160 km/h, {100 * b.scaled:.1f} % with {FORCE_KN:g} kN and {TOP_SPEED_KMH:g} km/h (one scale "
        f"fitted to each; by our own 100 %: {100 * a.own:.1f} and {100 * b.own:.1f} %)."
    )
