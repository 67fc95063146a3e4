"""The command `das-sim view`: a recording in the viewer, or as a picture."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.outputs import check_outputs, check_picture
from das.command_line.printing import busy, tell, typed
from sim.cli.options import OfTrainOption


def view(
    file: Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) to look at.")],
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="FILE", help="File for rerun (.rrd) to write, instead of opening the viewer."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            "--png",
            metavar="FILE",
            help="Picture to write instead (.png, .pdf or .svg): over distance, over time, and what happened.",
        ),
    ] = None,
    of_train: OfTrainOption = None,
) -> None:
    """Look at a recording in the rerun viewer, or as a picture: speed, limits, advice, forces, delay, events."""
    check_picture(plot)
    check_outputs(save, plot, inputs=(file,))
    from sim.review.rerun_view import open_view, save_view
    from sim.review.whole_picture import save_picture

    if save is None and plot is None:
        open_view(file, of_train)
    if plot is not None:
        with busy(f"drawing {plot} …"):
            save_picture(file, plot, of_train)
        tell(f"written: {plot}")
    if save is not None:
        with busy(f"writing {save} …"):
            save_view(file, save, of_train)
        tell(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
