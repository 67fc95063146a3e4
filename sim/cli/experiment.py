"""The commands of `das-sim experiment`: they check a design, drive its trials, and analyse the data."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.options import JsonOption, OutFolder, OutFolderOption, OverwriteOption
from das.command_line.printing import busy, new_table, paragraph, print_table
from das.domain.errors import DasError
from precompute.workers import Workers
from sim.cli.options import WorkersOption, check_packages, tell_written
from sim.experiment.plan import DESIGN_JSON, FAILED_TABLE, TRIALS_SIDECAR, TRIALS_TABLE
from sim.options import PageFiles, PowerAsked

if TYPE_CHECKING:
    from sim.experiment.analysis.power import PowerAnswer


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
        from sim.experiment.checking import check_design, made_folder, print_check
        from sim.experiment.design import freeze, load_design

        asked = load_design(design)
    with contextlib.nullcontext() if out is None else made_folder(out):
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
    as_json: JsonOption = False,
) -> None:
    """Drive all trials of a design; a stopped experiment continues where it left off and tries failed trials again.

    The folder holds trials.csv with one row a trial, and for each trial its events and a series. The design is checked
    and frozen there first, unless it was before.
    """
    hands = Workers.asked(workers, scheduler)
    if recordings and scheduler is not None:
        raise DasError("--recordings: not together with --scheduler, because recordings are written on this machine")
    with busy("reading the design …"):
        from sim.experiment.checking import checked_in
        from sim.experiment.design import load_design
        from sim.experiment.trials import Keep, jobs_of, run_study

        check_packages("batch", "pyarrow")
        asked = load_design(design)
    checked_in(asked, out)
    jobs = jobs_of(asked, Keep.RECORDINGS if recordings else Keep.SERIES, out)
    found = run_study(asked, jobs, out, hands)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        from sim.experiment.checking import print_run

        print_run(asked, found)
    if found.failed:
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
EffectsOption = Annotated[
    list[float] | None,
    typer.Option(
        "--effect",
        metavar="X",
        help="Also say how many participants would show a difference of X, in the unit of the report (points for a "
        "ratio); may be given several times.",
    ),
]


def analyse(
    folder: StudyArgument,
    written: PageFiles,
    effect: EffectsOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a study that was run: paired differences with intervals, a mixed model, checks."""
    check_packages("experiment", "jinja2", "matplotlib", "scipy", "statsmodels")
    read = [folder / name for name in (DESIGN_JSON, TRIALS_TABLE, TRIALS_SIDECAR)]
    written.check(read, overwrite=overwrite)
    for one in effect or ():
        _check_effect(one)
    from sim.experiment.analysis.comparing import analyse_study
    from sim.experiment.analysis.page import as_dict, page
    from sim.experiment.analysis.reading import read_study
    from sim.experiment.analysis.words import hangs_on, in_short

    study = read_study(folder)
    with busy("analysing the trials …"):
        found = analyse_study(study, tuple(effect or ()))
    written.write(lambda: page(found))
    if as_json:
        print(json.dumps(as_dict(found)))
        return
    for line in hangs_on(found):
        paragraph(line)
    for name, line in in_short(found):
        paragraph(f"{name}: {line}" if name else line)
    tell_written(*written.paths)


def _check_effect(effect: float) -> None:
    if not (math.isfinite(effect) and effect > 0):
        raise DasError(f"--effect {effect:g}: expected a number above 0")


def power(asked: PowerAsked, as_json: JsonOption = False) -> None:
    """Say how often an experiment would find a difference, and how many participants it needs."""
    check_packages("experiment", "scipy")
    _check_effect(asked.effect)
    from sim.experiment.analysis.power import answer

    with busy("simulating experiments …"):
        found = answer(asked)
    if as_json:
        print(json.dumps(found.as_dict()))
        return
    _print_power(found)


def _print_power(found: PowerAnswer) -> None:
    paragraph(found.about)
    heads = ("in each group" if found.groups else "participants", "power", "95 %", "corrected")
    table = new_table("", (), heads if found.strict else heads[:3], lines=True)
    for index, one in enumerate(found.points):
        low, high = one.interval
        cells = [str(one.participants), f"{one.power:.0%}", f"{low:.0%} to {high:.0%}"]
        table.add_row(*cells, *([f"{found.strict[index].power:.0%}"] if found.strict else []))
    legend = {
        "power": "share of simulated experiments that find the difference",
        "95 %": "how well that share is known",
    }
    if found.strict:
        legend["corrected"] = "power where only this one of the planned comparisons is true, and p is corrected"
    print_table(table, legend)
    for line in found.sentences:
        paragraph(line)
