"""The command `das-sim view`: a recording in the viewer, or as a picture."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import OverwriteOption
from das.command_line.outputs import check_outputs, check_picture
from das.command_line.printing import busy, tell, typed
from das.domain.errors import DasError
from sim.options import OfTrainOption

SaveOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="File for rerun (.rrd) to write, instead of opening the viewer."),
]
PlotOption = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        "--png",
        metavar="FILE",
        help="Picture to write instead (.png, .pdf or .svg): over distance, over time, and what happened.",
    ),
]
StartOption = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="TIME",
        help="Show the drive from here on: 12:34 on its clock, or 08:16:34Z.",
        show_default=False,
    ),
]
EndOption = Annotated[
    str | None, typer.Option("--to", metavar="TIME", help="Show the drive up to here.", show_default=False)
]
ThemeOption = Annotated[str, typer.Option("--theme", metavar="NAME", help="Picture: light (for paper) or dark.")]
MapOption = Annotated[
    bool,
    typer.Option("--map", help="Viewer: a map as well; it loads its tiles from OpenStreetMap over the network."),
]


def view(
    file: Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) to look at.")],
    save: SaveOption = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    start: StartOption = None,
    end: EndOption = None,
    theme: ThemeOption = "light",
    with_map: MapOption = False,
    of_train: OfTrainOption = None,
) -> None:
    """Look at a recording in the rerun viewer, or as a picture: speed, limits, advice, forces, delay, events.

    For example: das-sim view run.mcap --from 10:00 --to 20:00 --plot part.pdf
    """
    check_picture(plot)
    check_outputs(save, plot, inputs=(file,), overwrite=overwrite)
    from sim.recording.clock import part_of
    from sim.recording.opening import open_recording
    from sim.review.colors import THEMES
    from sim.review.rerun_view import open_view, save_view
    from sim.review.whole_picture import save_picture

    if theme not in THEMES:
        raise DasError(f"--theme {theme}: expected one of {', '.join(THEMES)}")
    with busy(f"reading {file} …"):
        recording = part_of(open_recording(file, of_train), start, end)
    if save is None and plot is None:
        open_view(recording, with_map=with_map)
    if plot is not None:
        with busy(f"drawing {plot} …"):
            save_picture(recording, plot, THEMES[theme])
        tell(f"written: {plot}")
    if save is not None:
        with busy(f"writing {save} …"):
            save_view(recording, save, with_map=with_map)
        tell(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
