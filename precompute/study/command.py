"""The command `das-precompute study`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from das.command_line.running import busy, err
from das.domain.errors import DasError
from precompute.study.cases import GTO_VEHICLE, IGBT_VEHICLE
from precompute.study.drawing import require_matplotlib, style
from precompute.study.output import Output, plain

ITEMS = ("fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "table2", "shares", "beyond", "gradients")
"""Everything the study makes, in the paper's order, then what goes beyond it."""


def study(
    folder: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to; it is created.")],
    only: Annotated[
        str | None, typer.Option(help=f"Make only these, with commas between: {', '.join(ITEMS)}.", show_default=False)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what summary.json holds.")] = False,
) -> None:
    """Redo the study of the paper: figures 4 to 10 (PNG, SVG, curves as CSV), Table 2, the Zürich–Luzern shares.

    Beyond the paper: peak power and jerk per level (beyond), Table 2 on a gradient of ±10 ‰ (gradients). What is asked
    for is overwritten in the folder, summary.json as well; it holds the items of this run.
    """
    wanted = chosen(only)
    require_matplotlib()
    output = Output(folder)
    began = time.perf_counter()
    summary = make(wanted, output)
    if as_json:
        print(json.dumps(plain(summary), ensure_ascii=False))
        return
    print(f"written: {len(output.written)} files in {folder} ({time.perf_counter() - began:.0f} s)")


def chosen(only: str | None) -> list[str]:
    """The items asked for, in order and each once; DasError for one there is not."""
    if only is None:
        return list(ITEMS)
    asked = [name.strip() for name in only.split(",")]
    unknown = [name for name in asked if name not in ITEMS]
    if unknown:
        raise DasError(f"--only {only}: no item {unknown[0]!r}; expected some of {', '.join(ITEMS)}")
    return [name for name in ITEMS if name in asked]


def make(wanted: list[str], output: Output) -> dict[str, Any]:
    """Make items and summary.json; returns what that holds."""
    with busy("compiling the solver (once on a machine, about 20 s) …"):
        from das.solver.warm_up import warm_up
        from precompute.baselines import strategies as baselines
        from precompute.study.runs import Workbench

        warm_up()
        baselines.warm_up()
        makers = _makers()
    bench = Workbench()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    items: dict[str, Any] = {}
    with style(), Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        task = progress.add_task("", total=len(wanted))
        for name in wanted:
            progress.update(task, description=name)
            items[name] = makers[name](bench, output)
            progress.advance(task)
    summary = {
        "paper": "M. Nold, F. Corman, Railway Engineering Science, 2024",
        "vehicles": {"gto": GTO_VEHICLE, "igbt": IGBT_VEHICLE},
        "items": items,
    }
    output.json("summary.json", summary)
    return summary


def _makers() -> dict[str, Callable[[Any, Output], dict[str, Any]]]:
    from precompute.study import (
        beyond,
        energy_shares,
        figures_cruising,
        figures_levels,
        figures_savings,
        figures_vehicles,
        gradients,
        table2,
    )

    return {
        "fig4": figures_cruising.fig4,
        "fig5": figures_levels.fig5,
        "fig6": figures_savings.fig6,
        "fig7": figures_levels.fig7,
        "fig8": figures_savings.fig8,
        "fig9": figures_levels.fig9,
        "fig10": figures_vehicles.fig10,
        "table2": table2.table2,
        "shares": energy_shares.energy_shares,
        "beyond": beyond.beyond,
        "gradients": gradients.gradients,
    }
