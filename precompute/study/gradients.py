"""Beyond the paper: the cross evaluation of Table 2 on a uniform gradient of ±10 ‰."""

from __future__ import annotations

from typing import Any

from das.domain.errors import DasError
from das.domain.trajectory import Trajectory
from das.domain.units import PERMILLE, kwh
from precompute.study.cases import ALL_VARIANTS, DOWNHILL, L3, UPHILL, StudyCase
from precompute.study.effort import effort
from precompute.study.figures_levels import effort_json
from precompute.study.output import Output, markdown_table
from precompute.study.printed import TABLE2_BUFFER_PERCENT
from precompute.study.runs import Workbench
from precompute.study.table2 import Cell, cross_evaluation, gains, label, trajectories

CASES = (UPHILL, DOWNHILL)


def gradients(bench: Workbench, output: Output) -> dict[str, Any]:
    """Write the cross evaluation uphill and downhill; a case that cannot be run is said, not left out."""
    result: dict[str, Any] = {"buffer_percent": TABLE2_BUFFER_PERCENT}
    rows: list[tuple[object, ...]] = []
    parts = []
    for case in CASES:
        try:
            runs = trajectories(bench, case, TABLE2_BUFFER_PERCENT)
            found = cross_evaluation(bench, case, runs)
        except DasError as error:
            result[case.name] = {"not_possible": str(error)}
            parts.append(f"{case.title}: not possible: {error}\n")
            continue
        result[case.name] = _json(bench, case, runs, found)
        rows += [(case.name, c.trajectory, c.level, c.ours) for c in found]
        parts.append(_markdown(bench, case, found))
    output.csv("gradients.csv", ["case", "trajectory", "level", "ours_percent"], rows)
    output.text("gradients.md", "\n".join(parts))
    return result


def _json(bench: Workbench, case: StudyCase, runs: dict[str, Trajectory], found: list[Cell]) -> dict[str, Any]:
    ledger = bench.ledger(runs["fastest"], L3)
    return {
        "gradient_permille": case.gradient_ratio / PERMILLE,
        "least_time_s": runs["fastest"].time_s,
        "fastest_l3_kwh": kwh(ledger.irreversible),
        "fastest_l3_input_kwh": kwh(ledger.input),
        "potential_kwh": kwh(ledger.potential),
        "gains": {variant.name: gains(found, variant) for variant in ALL_VARIANTS[-2:]},
        "reduced_effort": {
            variant.name: effort_json(effort(runs[variant.name], bench.vehicle(variant))) for variant in ALL_VARIANTS
        },
    }


def _markdown(bench: Workbench, case: StudyCase, found: list[Cell]) -> str:
    names = list(dict.fromkeys(c.trajectory for c in found))
    rows = [[label(name), *(f"{c.ours:.2f}" for c in found if c.trajectory == name)] for name in names]
    reference = kwh(bench.reference_j(case))
    return (
        f"{case.title}, t+ = {TABLE2_BUFFER_PERCENT:g} %, in % of the fastest run's at L3 GTO ({reference:.1f} kWh)\n\n"
        + markdown_table(["optimal for", *(f"at {v.label}" for v in ALL_VARIANTS)], rows)
    )
