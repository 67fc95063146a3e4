"""The results of a batch, by scenario, driver and presentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from rich import box
from rich.table import Table

from das.command_line.printing import print_table, tell
from sim.world.outcome import SHARES

SHARE_NAMES: Final = {
    "component_loss": "loss",
    "resistance": "run",
    "friction_brake": "fric",
    "unreturned": "lost",
    "comfort": "comf",
}
"""Headings of the shares: where the energy went."""
LEGEND: Final = {
    "n": "runs",
    "fail": "failed runs",
    "late": "mean delay at the last stop (s)",
    "kWh": "mean energy of a run",
    "opt": "least energy (kWh) for the times as driven",
    "loss, run, fric, lost, comf": "shares (%) of the energy that went to losses of the train, running resistance, "
    "friction brakes, brake resistors, comfort systems",
}
"""What is said below the table."""


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the seeds of each scenario, driver and presentation; failed runs are counted but left out of the
    means."""
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
    """Print the table at the end of a batch."""
    title = f"{found['runs']} runs, {found['made']} of them made now"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("scenario, driver, advice")
    for name in ("n", "fail", "late", "kWh", "opt", *SHARE_NAMES.values()):
        table.add_column(name, justify="right", no_wrap=True)
    for group in found["groups"]:
        table.add_row(*_cells(group))
    print_table(table, LEGEND)
    for group in found["groups"]:
        if group["error"] is not None:
            names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
            tell(f"note: {names}: {group['failed']} failed, the first: {group['error']}")
    tell(f"written: {found['file']}")


def _cells(group: dict[str, Any]) -> list[str]:
    names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
    cells = [names, str(group["runs"]), str(group["failed"])]
    if "energy_kwh" not in group:
        return cells
    cells += [f"{group['late_mean_s']:+.0f}", f"{group['energy_kwh']:.1f}", f"{group['energy_hindsight_kwh']:.1f}"]
    return cells + [f"{100 * group[f'{share}_ratio']:.1f}" for share in SHARE_NAMES]
