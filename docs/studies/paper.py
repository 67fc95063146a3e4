"""`python -m docs.studies.paper -o DIR`: reproduce the paper's study (Nold & Corman 2024, sections 4.2 to 4.7)."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Annotated, Final

import typer

from das.command_line.application import run_app, single_command
from das.command_line.options import OutFolder
from das.command_line.printing import loading_solver, shown, tell
from das.domain.errors import DasError
from das.solver.warm_up import warm_up
from docs.studies import figures_energy, figures_runs, shares, table2
from docs.studies.cases import ACCELERATION, COMPLETE, DECELERATION, Workbench
from docs.studies.drawing import style
from docs.studies.output import Output
from precompute.baselines import strategies

ITEMS: Final[dict[str, Callable[[Workbench, Output], None]]] = {
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
) -> None:
    """Redo the study of the paper: figures 4 to 10, Table 2, the Zürich–Luzern shares.

    Figures are written as PNG, tables as Markdown. The folder is created, and files in it are overwritten.
    """
    wanted, output = chosen(only), Output(out)
    with loading_solver():
        warm_up()
        strategies.warm_up()
    began = time.perf_counter()
    make(wanted, output)
    tell(f"written: {len(output.written)} files in {out} ({time.perf_counter() - began:.0f} s)")


def chosen(only: str | None) -> list[str]:
    """The items listed by `--only`, each once and in the paper's order (None: all); DasError for an unknown one."""
    asked = list(ITEMS) if only is None else [name.strip() for name in only.split(",")]
    for name in asked:
        if name not in ITEMS:
            raise DasError(f"--only {only}: no item {name!r}; expected some of {', '.join(ITEMS)}")
    return [name for name in ITEMS if name in asked]


def make(wanted: list[str], output: Output) -> None:
    """Make items of the study."""
    bench = Workbench()
    with style():
        for name in shown(wanted):
            ITEMS[name](bench, output)


def main() -> None:
    """Run the command; an input error gives one line and exit code 2."""
    name = "python -m docs.studies.paper"
    run_app(single_command(name, study, (f"{name} -o study --only fig9,table2",)), name)


if __name__ == "__main__":
    main()
