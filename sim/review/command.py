"""The command das-sim view."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.printing import busy, typed
from das.domain.errors import DasError
from das.domain.files.writing import check_writable

EPILOG = "Example: das-sim view recordings/run.mcap --png run.png"


def view(
    file: Annotated[Path, typer.Argument(help="Recording (MCAP) to look at.")],
    save: Annotated[Path | None, typer.Option(help="Write a rerun file (.rrd) instead of opening the viewer.")] = None,
    png: Annotated[
        Path | None, typer.Option(help="Write a picture (.png) instead: over distance, over time, what happened.")
    ] = None,
) -> None:
    """Look at a recording in rerun, or as a picture: speed, limits, advice, what was shown, forces, delay, events."""
    from sim.review.rerun_view import open_view, save_view
    from sim.review.whole_picture import save_picture

    written = [path for path in (save, png) if path is not None]
    for path in written:
        if path.resolve() == file.resolve():
            raise DasError(f"{path}: the file to write is the recording to read")
        check_writable(path)
    if len({path.resolve() for path in written}) < len(written):
        raise DasError(f"{png}: --save and --png name the same file")
    if not written:
        open_view(file)
    if png is not None:
        with busy(f"drawing {png} …"):
            save_picture(file, png)
        print(f"written: {png}")
    if save is not None:
        with busy(f"writing {save} …"):
            save_view(file, save)
        print(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
