"""`python -m docs.studies.paper -o DIR`: redo the study of the paper: Nold & Corman (2024), sections 4.2 to 4.7."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Final

import typer

from das.command_line.application import run_app, single_command
from das.command_line.options import JsonOption, OutFolder
from das.command_line.printing import loading_solver, shown, tell
from das.solver.warm_up import warm_up
from docs.studies import figures_energy, figures_runs, shares, table2
from docs.studies.cases import ACCELERATION, COMPLETE, DECELERATION, GTO_VEHICLE, IGBT_VEHICLE, Workbench
from docs.studies.drawing import style
from docs.studies.output import Output, plain
from precompute.baselines import strategies
from precompute.cli.options import chosen

ITEMS: Final[dict[str, Callable[[Workbench, Output], dict[str, Any]]]] = {
    "fig4": figures_energy.fig4,
    "fig5": partial(figures_runs.runs_figure, "fig5", ACCELERATION),
    "fig6": partial(figures_energy.savings_figure, "fig6", ACCELERATION),
    "fig7": partial(figures_runs.runs_figure, "fig7", DECELERATION),
    "fig8": partial(figures_energy.savings_figure, "fig8", DECELERATION),
    "fig9": partial(figures_runs.runs_figure, "fig9", COMPLETE),
    "fig10": figures_runs.fig10,
    "table2": table2.table2,
    "shares": shares.energy_shares,
}
"""The function that makes each item of the study, in the paper's order."""


def study(
    out: OutFolder,
    only: Annotated[
        str | None, typer.Option("--only", metavar="LIST", help=f"Only these, separated by commas: {', '.join(ITEMS)}.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Redo the study of the paper: figures 4 to 10, Table 2, the Zürich–Luzern shares.

    Figures are written as PNG and SVG, their curves as CSV. The folder is created. The files of what is asked for are
    overwritten, and summary.json as well, which holds the items of this run.
    """
    wanted, output = chosen(only, ITEMS, "item"), Output(out)
    with loading_solver():
        warm_up()
        strategies.warm_up()
    began = time.perf_counter()
    summary = make(wanted, output)
    if as_json:
        print(json.dumps(plain(summary), ensure_ascii=False))
        return
    tell(f"written: {len(output.written)} files in {out} ({time.perf_counter() - began:.0f} s)")


def make(wanted: list[str], output: Output) -> dict[str, Any]:
    """Make items and summary.json; returns the content of summary.json."""
    bench = Workbench()
    with style():
        items = {name: ITEMS[name](bench, output) for name in shown(wanted)}
    summary = {
        "paper": "M. Nold, F. Corman, Railway Engineering Science, 2024",
        "vehicles": {"gto": GTO_VEHICLE, "igbt": IGBT_VEHICLE},
        "items": items,
    }
    output.json("summary.json", summary)
    return summary


def main() -> None:
    """Run the command; bad input ends in one line and exit code 2."""
    name = "python -m docs.studies.paper"
    run_app(single_command(name, study, (f"{name} -o study --only fig9,table2",)), name)


if __name__ == "__main__":
    main()
