"""What came out of a batch, by scenario, driver and presentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from das.command_line.printing import PRINTED_WIDTH
from sim.world.outcome import SHARES

SHARE_NAMES = {
    "component_loss": "losses",
    "resistance": "running",
    "friction_brake": "friction",
    "unreturned": "lost",
    "comfort": "comfort",
}
"""Headings of where the energy went (lost: in brake resistors)."""


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the seeds of each scenario, driver and presentation; failed runs are counted and left out."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["scenario"], row["driver"], row["advice"]), []).append(row)
    return [_summed(*key, group) for key, group in groups.items()]


def _summed(scenario: str, driver: str, advice: str, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    good = [row for row in rows if row.get("error") is None]
    found: dict[str, Any] = {
        "scenario": scenario, "driver": driver, "advice": advice, "runs": len(rows), "failed": len(rows) - len(good),
        "error": next((row["error"] for row in rows if row.get("error") is not None), None),
    }  # fmt: skip
    if not good:
        return found
    late_s = np.array([row["late_s"] for row in good])
    found |= {"late_mean_s": float(late_s.mean()), "late_p95_s": float(np.quantile(late_s, 0.95))}
    for name in ("energy_kwh", "energy_hindsight_kwh", *(f"{share}_kwh" for share in SHARES)):
        found[name] = float(np.mean([row[name] for row in good]))
    total = sum(found[f"{share}_kwh"] for share in SHARES)
    return found | {f"{share}_ratio": found[f"{share}_kwh"] / total for share in SHARES}


def print_summary(found: dict[str, Any]) -> None:
    """The table at the end of a batch."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = PRINTED_WIDTH
    title = f"{found['runs']} runs, {found['made']} of them made now"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("scenario, driver, advice", no_wrap=True)
    for name in ("runs", "failed", "late s", "kWh", "opt.", *SHARE_NAMES.values()):
        table.add_column(name, justify="right", no_wrap=True)
    for group in found["groups"]:
        table.add_row(*_cells(group))
    console.print(table)
    for group in found["groups"]:
        if group["error"] is not None:
            names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
            console.print(f"note: {names}: {group['failed']} failed, the first: {group['error']}", soft_wrap=True)
    console.print(
        "opt.: least energy for the times as driven; from losses on: shares in % (lost: in brake resistors)",
        soft_wrap=True,
    )
    console.print(f"written: {found['file']}", soft_wrap=True)


def _cells(group: dict[str, Any]) -> list[str]:
    names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
    cells = [names, str(group["runs"]), str(group["failed"])]
    if "energy_kwh" not in group:
        return cells
    cells += [f"{group['late_mean_s']:+.0f}", f"{group['energy_kwh']:.1f}", f"{group['energy_hindsight_kwh']:.1f}"]
    return cells + [f"{100 * group[f'{share}_ratio']:.1f}" for share in SHARE_NAMES]
