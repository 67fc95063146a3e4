"""The commands `das-sim experiment check` and `das-sim experiment run`."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.options import JsonOption, OutFolder, OutFolderOption
from das.command_line.printing import busy
from das.domain.errors import DasError
from das.domain.files.writing import make_folder
from precompute.workers import Workers
from sim.cli.options import WorkersOption

if TYPE_CHECKING:
    from sim.experiment.design import Design
    from sim.experiment.running import Keep

DesignArgument = Annotated[
    str,
    typer.Argument(metavar="DESIGN", help="Design file (TOML), or a bundled study (das-sim experiment studies)."),
]


def check(
    design: DesignArgument,
    out: OutFolderOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a design: trials, balance, duration, and whether the driver senses every factor; freeze it in a folder.

    A factor is refused if the driver asks the same of the train whatever its level is, on five days. With --out, the
    design is frozen there, and only this design can be run in that folder.
    """
    with busy("reading the design …"):
        from sim.experiment.checking import check_design, print_check
        from sim.experiment.design import freeze, load_design

        asked = load_design(design)
    _check_folder(out)
    with contextlib.nullcontext() if out is None else _made(out):
        found = check_design(asked)
        if out is not None and not found.refusals:
            freeze(asked, out)
            found.keep(out)
    print(json.dumps(found.as_dict())) if as_json else print_check(asked, found, out)
    if found.refusals:
        raise DasError(f"{asked.source}: {found.refusals[0]}")


def run(
    design: DesignArgument,
    out: OutFolder,
    workers: WorkersOption = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler that drives the trials, like tcp://10.0.0.1:8786."),
    ] = None,
    recordings: Annotated[
        bool, typer.Option("--recordings", help="Drive over the bus and keep a recording of every trial (slower).")
    ] = False,
    measures_only: Annotated[
        bool, typer.Option("--measures-only", help="Keep the table of trials, but no events and no series.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Drive all trials of a design; an experiment that was stopped goes on where it was, and failed trials are tried
    again.

    The folder holds trials.csv with one row a trial, and for each trial its events and a series. The design is checked
    and frozen there first, unless it was before.
    """
    hands = Workers.asked(workers, scheduler)
    _check_options(scheduler, recordings=recordings, measures_only=measures_only)
    _check_folder(out)
    with busy("reading the design …"):
        from sim.experiment.design import load_design
        from sim.experiment.running import Keep, jobs_of, run_study
        from sim.jobs.batch import require_pyarrow

        if not measures_only:
            require_pyarrow()
        asked = load_design(design)
    _checked(asked, out)
    keep: Keep = Keep.RECORDINGS if recordings else Keep.MEASURES if measures_only else Keep.SERIES
    jobs = jobs_of(asked, keep, out)
    found = run_study(asked, jobs, out, hands)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        from sim.experiment.checking import print_run

        print_run(asked, found)
    if found.failed:
        print(f"{len(found.failed)} of {found.trials} trials failed: see {out / 'failed.csv'}", file=sys.stderr)
        raise typer.Exit(1)


def _check_folder(folder: Path | None) -> None:
    """Refuse a folder that is a file."""
    if folder is not None and folder.exists() and not folder.is_dir():
        raise DasError(f"{folder}: is a file, expected a folder")


def _check_options(scheduler: str | None, *, recordings: bool, measures_only: bool) -> None:
    """Refuse options that contradict each other."""
    if recordings and measures_only:
        raise DasError("give either --recordings or --measures-only")
    if recordings and scheduler is not None:
        raise DasError("--recordings: expected without --scheduler, because recordings are written on this machine")


def _checked(design: Design, folder: Path) -> None:
    """Freeze a design in its folder, and check it first, unless it was checked before; DasError if it is refused."""
    from sim.experiment.checking import check_design, was_checked
    from sim.experiment.design import check_frozen, freeze, resolved
    from sim.experiment.plan import DESIGN_JSON

    digest = resolved(design)["hash"]
    if (folder / DESIGN_JSON).exists():
        check_frozen(design, folder, digest)
    if was_checked(folder, digest):
        return
    with _made(folder):
        found = check_design(design)
        if found.refusals:
            raise DasError(f"{design.source}: {found.refusals[0]}")
        freeze(design, folder)
        found.keep(folder)


@contextlib.contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder before minutes are spent on what goes into it; it is taken away again if nothing came into it."""
    new = not folder.exists()
    make_folder(folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise DasError(f"{folder}: cannot be written (Permission denied)")
    try:
        yield
    finally:
        if new and not any(folder.iterdir()):
            folder.rmdir()


def studies(as_json: JsonOption = False) -> None:
    """List the bundled studies and where their files are."""
    from sim.experiment.checking import print_studies
    from sim.experiment.design import bundled_studies, read_design

    found = [read_design(path) for path in bundled_studies().values()]
    if as_json:
        listed = [{"name": one.name, "title": one.title, "file": str(one.source)} for one in found]
        print(json.dumps(listed))
        return
    print_studies(found)
