"""The commands of `das-sim experiment`: they check a design, drive its trials, and analyse the data."""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import JsonOption, OutFolder, OutFolderOption, OverwriteOption
from das.command_line.printing import busy, paragraph
from das.domain.errors import DasError
from precompute.workers import Workers
from sim.cli.options import WorkersOption, check_packages, tell_written
from sim.options import PageFiles

DesignArgument = Annotated[
    str,
    typer.Argument(metavar="DESIGN", help="Design file (TOML), or a bundled study (das-sim experiment studies)."),
]


def check(
    design: DesignArgument,
    out: OutFolderOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a design: trials, balance, duration, and factors that no driver can sense; freeze it in a folder.

    Nothing is driven. With --out, the design is frozen there, and only this design can be run in that folder.
    """
    with busy("reading the design …"):
        from sim.experiment.checking import check_design, made_folder, print_check
        from sim.experiment.design import freeze, load_design

        asked = load_design(design)
    with contextlib.nullcontext() if out is None else made_folder(out):
        found = check_design(asked)
        if out is not None and not found.refusals:
            freeze(asked, out)
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
    as_json: JsonOption = False,
) -> None:
    """Drive all trials of a design; a stopped experiment continues where it left off and tries failed trials again.

    The folder holds trials.csv with one row a trial, the design, a README, and recordings if they are asked for. The
    design is checked and frozen there first, unless it was before.
    """
    hands = Workers.asked(workers, scheduler)
    if recordings and scheduler is not None:
        raise DasError("--recordings: not together with --scheduler, because recordings are written on this machine")
    with busy("reading the design …"):
        from sim.experiment.checking import checked_in
        from sim.experiment.design import load_design
        from sim.experiment.trials import jobs_of, run_study

        asked = load_design(design)
    checked_in(asked, out)
    found = run_study(asked, jobs_of(asked, out, record=recordings), out, hands)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        from sim.experiment.checking import print_run

        print_run(asked, found)
    if found.failed:
        from sim.experiment.study_files import FAILED_TABLE

        print(f"{len(found.failed)} of {found.trials} trials failed: see {out / FAILED_TABLE}", file=sys.stderr)
        raise typer.Exit(1)


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


StudyArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a study that das-sim experiment run made.")
]


def analyse(
    folder: StudyArgument,
    written: PageFiles,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a study that was run: planned differences with intervals, corrected p, effect sizes, a forest plot."""
    check_packages("experiment", "jinja2", "matplotlib", "scipy")
    from sim.experiment.analysis.comparing import analyse_study
    from sim.experiment.analysis.page import as_dict, page
    from sim.experiment.analysis.reading import read_study
    from sim.experiment.analysis.words import hangs_on, in_short
    from sim.experiment.design import DESIGN_JSON
    from sim.experiment.study_files import TRIALS_TABLE

    written.check([folder / name for name in (DESIGN_JSON, TRIALS_TABLE)], overwrite=overwrite)
    study = read_study(folder)
    with busy("analysing the trials …"):
        found = analyse_study(study)
    written.write(lambda: page(found))
    if as_json:
        print(json.dumps(as_dict(found)))
        return
    for line in hangs_on(found):
        paragraph(line)
    for name, line in in_short(found):
        paragraph(f"{name}: {line}" if name else line)
    tell_written(*written.paths)
