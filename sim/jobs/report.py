"""The results of a batch, by scenario, driver and presentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from rich import box
from rich.table import Table

from das.command_line.printing import print_table, tell
from sim.jobs.split import SplitSaving
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
    print_savings(found["savings"])
    for group in found["groups"]:
        if group["error"] is not None:
            names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
            tell(f"note: {names}: {group['failed']} failed, the first: {group['error']}")
    tell(f"written: {found['file']}")


SPLIT_LEGEND: Final = {
    "saved": "energy saved against the same driver without advice on the same days, with its 95 % interval",
    "times": "because other running times have another optimum",
    "blend": "by less friction where the motors could brake",
    "profile": "by the speed profile: of the advice where a perfect driver drove it as well, else as driven",
    "track": "by keeping to that profile (–: no perfect driver in this batch, or none who follows this advice)",
}
"""What is said below the table of savings."""


def print_savings(found: Sequence[SplitSaving]) -> None:
    """Print what advice saved, split by what saved it; nothing where no run was without advice."""
    if not found:
        return
    title = "saved against no advice, split (kWh)"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("scenario, driver, advice")
    for name in ("n", *SPLIT_LEGEND):
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        table.add_row(
            f"{one.scenario}, {one.driver}, {one.advice}",
            str(one.pairs),
            f"{one.saved_kwh:+.1f} ± {one.interval_kwh:.1f}" if one.pairs > 1 else f"{one.saved_kwh:+.1f}",
            *(f"{part:+.1f}" for part in (one.time_shift_kwh, one.blending_kwh, one.profile_kwh)),
            "–" if one.tracking_kwh is None else f"{one.tracking_kwh:+.1f}",
        )
    print_table(table, SPLIT_LEGEND)


def _cells(group: dict[str, Any]) -> list[str]:
    names = f"{group['scenario']}, {group['driver']}, {group['advice']}"
    cells = [names, str(group["runs"]), str(group["failed"])]
    if "energy_kwh" not in group:
        return cells
    cells += [f"{group['late_mean_s']:+.0f}", f"{group['energy_kwh']:.1f}", f"{group['energy_hindsight_kwh']:.1f}"]
    return cells + [f"{100 * group[f'{share}_ratio']:.1f}" for share in SHARE_NAMES]
