"""The command `das-precompute study`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, OutFolder
from das.command_line.outputs import offscreen_pyplot
from das.command_line.printing import paragraph, tell
from das.command_line.progress import shown
from das.domain.errors import DasError

if TYPE_CHECKING:
    from precompute.study.output import Output

ITEMS = ("fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "table2", "shares", "beyond", "gradients")
"""Everything the study makes, in the paper's order, then what goes beyond it."""


def study(
    out: OutFolder,
    only: Annotated[
        str | None, typer.Option("--only", metavar="LIST", help=f"Only these, with commas between: {', '.join(ITEMS)}.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Redo the study of the paper: figures 4 to 10, Table 2, the Zürich–Luzern shares.

    Table 2 is made with the train of the text and once more, as a hypothesis, with one of 200 kN and 140 km/h. Beside
    the shares stands a balance that fits them. Figures are written as PNG and SVG, their curves as CSV. Beyond the
    paper go peak power and jerk per level ("beyond") and Table 2 on a gradient of ±10 ‰ ("gradients"). The folder is
    created. The files of what is asked for are overwritten, and summary.json as well, which holds the items of this
    run.
    """
    wanted = chosen(only)
    offscreen_pyplot()  # refuse before the work begins
    with loading_solver():
        from das.solver.warm_up import warm_up
        from precompute.baselines import strategies
        from precompute.study.output import Output, plain

        output = Output(out)
        warm_up()
        strategies.warm_up()
    began = time.perf_counter()
    summary = make(wanted, output)
    if as_json:
        print(json.dumps(plain(summary), ensure_ascii=False))
        return
    for item in summary["items"].values():
        if "in_words" in item:
            paragraph(item["in_words"])
    tell(f"written: {len(output.written)} files in {out} ({time.perf_counter() - began:.0f} s)")


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
    from precompute.study.cases import GTO_VEHICLE, IGBT_VEHICLE
    from precompute.study.drawing import style
    from precompute.study.runs import Workbench

    makers, bench = _makers(), Workbench()
    with style():
        items = {name: makers[name](bench, output) for name in shown(wanted)}
    summary = {
        "paper": "M. Nold, F. Corman, Railway Engineering Science, 2024",
        "vehicles": {"gto": GTO_VEHICLE, "igbt": IGBT_VEHICLE},
        "items": items,
    }
    output.json("summary.json", summary)
    return summary


def _makers() -> dict[str, Callable[[Any, Output], dict[str, Any]]]:
    from precompute.study import (
        balance,
        beyond,
        figures_cruising,
        figures_levels,
        figures_savings,
        figures_vehicles,
        gradients,
        hypothesis,
    )

    return {
        "fig4": figures_cruising.fig4,
        "fig5": figures_levels.fig5,
        "fig6": figures_savings.fig6,
        "fig7": figures_levels.fig7,
        "fig8": figures_savings.fig8,
        "fig9": figures_levels.fig9,
        "fig10": figures_vehicles.fig10,
        "table2": hypothesis.both_trains,
        "shares": balance.shares_and_balance,
        "beyond": beyond.beyond,
        "gradients": gradients.gradients,
    }
