"""The command `das-sim example`: a working set of own files."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import SeedOption
from das.command_line.printing import busy, tell
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_folder_whole, write_whole


def example(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write: a new one, or an empty one.")],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files of the same names in a folder that is not empty.")
    ] = False,
    seed: SeedOption = 1,
) -> None:
    """Write a working set of own files, with the commands to run on them.

    The set holds a route, a vehicle, a journey, a plan of tables, a scenario, a recorded trip, kilometre posts and a
    README.txt. Route and vehicle are invented; the trip is simulated.
    """
    filled = _check(folder, overwrite)
    with busy("driving the recorded trip …"):
        from sim.bundled.example import example_files

        content = example_files(seed)
    if filled:
        for name in content:
            check_writable(folder / name, overwrite=True)
        for name, data in content.items():
            write_whole(folder / name, data)
    else:
        write_folder_whole(folder, content)
    for name in sorted(content):
        tell(f"written: {folder / name}")
    tell(f"what to do with them: cd {shlex.quote(str(folder))} and read README.txt")


def _check(folder: Path, overwrite: bool) -> bool:
    """Whether there is something in the folder already; DasError where it cannot be written."""
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")
    if not folder.exists():
        return False
    if not folder.is_dir():
        raise DasError(f"{folder}: is a file, expected a folder to write")
    try:
        filled = any(folder.iterdir())
    except OSError as error:
        raise DasError(f"{folder}: cannot be read ({error.strerror})") from error
    if filled and not overwrite:
        raise DasError(f"{folder}: there are files in it already; choose a new folder, or say --overwrite")
    return filled
