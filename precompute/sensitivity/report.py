"""What the variations of a plan look like: as rows for JSON and CSV, and as a table."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from das.command_line.printing import paragraph, print_table, tell
from das.domain.files.writing import write_whole
from das.domain.units import kwh
from das.solver.front import Solution
from das.solver.section import Section
from precompute.sensitivity.analysis import Followed, VariationOutcome

COLUMNS: dict[str, tuple[str, float, str]] = {
    "time\n+s": ("late_s", 1.0, "+z.1f"),
    "energy\n+%": ("extra_ratio", 100.0, "+z.2f"),
    "s per\nstep": ("late_s_per_step", 1.0, "+z.3f"),
    "% per\nstep": ("extra_ratio_per_step", 100.0, "+z.3f"),
    "off\nplan\n%": ("off_plan_ratio", 100.0, ".0f"),
    "on time\n+s": ("on_time_late_s", 1.0, "+z.1f"),
    "on time\n+%": ("on_time_extra_ratio", 100.0, "+z.2f"),
    "saved\n%": ("saved_ratio", 100.0, "z.2f"),
}
"""Heading of a column, its key in a row, factor and format."""
LEGEND = {
    "time, energy": "of a driver who follows the plan, against the plan",
    "per step": "the same for 1 % of mass, resistance, receptivity or adhesion, or for 1 km/h of wind",
    "off plan": "share of the way on which the train could not keep to the plan",
    "on time": "a new plan for the planned time: how late it is, and its energy, against the plan",
    "saved": "by a new plan for the time that following the old one took",
}


def outcome_row(outcome: VariationOutcome) -> dict[str, Any]:
    """One variation as `--json` and `--csv` give it; what there is not is null."""
    variation, followed = outcome.variation, outcome.followed
    return {
        "parameter": str(variation.parameter),
        "label": variation.label,
        "value": variation.value,
        "step": variation.step,
        "step_unit": variation.unit,
        "followed": followed is not None,
        "trouble": outcome.trouble,
        **_run("", followed),
        "late_s": outcome.late_s,
        "extra_ratio": outcome.extra_ratio,
        "late_s_per_step": outcome.per_step(outcome.late_s),
        "extra_ratio_per_step": outcome.per_step(outcome.extra_ratio),
        "off_plan_ratio": followed.off_plan_ratio if followed else None,
        **_run("on_time_", outcome.on_time),
        "on_time_late_s": outcome.on_time_late_s,
        "on_time_extra_ratio": outcome.on_time_extra_ratio,
        **_run("same_time_", outcome.same_time),
        "saved_ratio": outcome.saved_ratio,
    }


def _run(prefix: str, run: Followed | Solution | None) -> dict[str, float | None]:
    return {
        f"{prefix}time_s": run.time_s if run else None,
        f"{prefix}energy_input_kwh": kwh(run.ledger.input) if run else None,
    }


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the rows of `outcome_row` as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue().encode())


def print_rows(section: Section, planned: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Print the rows of `outcome_row` as a table with its legend, then the plan that they are told against."""
    table = Table(title=f"{section.name}, the plan in a changed world", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("changed", no_wrap=True)
    for name in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row["label"], *(_figure(row, *what) for what in COLUMNS.values()))
    print_table(table, LEGEND)
    buffer_percent = 100 * (planned["time_s"] / planned["min_time_s"] - 1)
    paragraph(
        f"plan: {planned['time_s']:.1f} s (buffer {buffer_percent:.2f} %, {planned['fit']}), "
        f"{planned['energy_input_kwh']:.2f} kWh; % of energy are of these"
    )
    for row in rows:
        if row["trouble"] is not None:
            tell(f"{row['label']}: {row['trouble']}")


def _figure(row: dict[str, Any], name: str, scale: float, form: str) -> str:
    value = row[name]
    return f"{scale * value:{form}}" if value is not None else "–"
