"""The commands that simulate many days: batch and sensitivity."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.given import refuse_given
from das.command_line.options import JsonOption, LevelOption, OutFolder
from das.command_line.printing import busy, print_table, tell
from das.domain.errors import DasError
from das.domain.files.writing import make_folder
from precompute.workers import Workers
from sim.cli.options import (
    AdviceListOption,
    DriversOption,
    FrictionOption,
    Kind,
    ParticipantsOption,
    ScenarioArgument,
    WorkersOption,
    check_packages,
    chosen,
)
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.options import PopulationOption

if TYPE_CHECKING:
    from sim.drivers.parameters import Participant
    from sim.jobs.batch import BatchJob
    from sim.jobs.runner import Rows
    from sim.jobs.sensitivity import Sensitivity, SensitivityJob, SensitivityRun

TABLE = "runs.parquet"
"""Name of the table of runs in the folder of a batch."""
DaysOption = Annotated[str, typer.Option("--seeds", metavar="LIST", help="Seeds of the days, like 0-3 or 1,5.")]
ParametersOption = Annotated[
    str | None,
    typer.Option(
        "--parameters",
        metavar="LIST",
        help="Parameters to vary, separated by commas [default: all].",
    ),
]
MarkdownOption = Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown, for a document.")]


def batch(
    scenarios: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help="Bundled scenarios or TOML files, one or more.")
    ],
    out: OutFolder,
    seeds: Annotated[str, typer.Option(metavar="LIST", help="Seeds, like 0-99 or 1,5,10-19.")] = "0-9",
    drivers: DriversOption = "human",
    advice: AdviceListOption = "guide",
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    participants: ParticipantsOption = None,
    population: PopulationOption = None,
    level: LevelOption = None,
    workers: WorkersOption = None,
    record: Annotated[
        bool, typer.Option("--record", help="Run over the bus and keep the recordings (slower).")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run every scenario with every driver, presentation and seed; a stopped batch continues where it left off.

    The table runs.parquet in the folder has one row per run; a run is repeated only if one of its inputs has changed.
    """
    with busy("reading the scenarios …"):
        from sim.jobs.batch import Batch, parse_seeds
        from sim.jobs.report import print_summary

        check_packages("batch", "pyarrow")
        asked = Batch(
            scenarios=scenarios,
            drivers=(who := _drivers(drivers)),
            participants=_participants(who, participants, population),
            advice=_each(Presentation, "--advice", advice),
            seeds=parse_seeds(seeds),
            friction=friction,
            level=level,
            record=record,
            folder=out,
        )
        jobs = list(asked.jobs())
        make_folder(out)
    found = _run_all(jobs, out, Workers.asked(workers))
    as_text = json.dumps({**found, "savings": [one.as_dict() for one in found["savings"]]})
    print(as_text) if as_json else print_summary(found)
    if failed := sum(group["failed"] for group in found["groups"]):
        print(f"{failed} of {len(jobs)} runs failed: see the column error of {out / TABLE}", file=sys.stderr)
        raise typer.Exit(1)


def _run_all(jobs: Sequence[BatchJob], out: Path, workers: Workers) -> dict[str, Any]:
    """Run what is not finished yet and write the table, even if it is interrupted. Returns the summary."""
    from sim.jobs.batch import make_run, write_table
    from sim.jobs.report import savings, summary
    from sim.jobs.runner import JobWords, Runner

    finished: list[dict[str, Any]] = []

    def write(rows: Rows, _made: int) -> None:
        finished.extend(dict(rows[job.inputs_sha256]) for job in jobs if job.inputs_sha256 in rows)
        write_table(out / TABLE, finished)

    words = JobWords("batch", "runs", "make")
    made = Runner(make=make_run, folder=out, workers=workers, words=words).run(jobs, write)
    return {
        "file": str(out / TABLE),
        "runs": len(jobs),
        "made": made,
        "groups": summary(finished),
        "savings": savings(finished),
    }


def _each(kind: type[Kind], option: str, text: str) -> list[Kind]:
    """The members of an enumeration that a list with commas names, each once; DasError for an unknown name."""
    return list(dict.fromkeys(chosen(kind, option, part.strip()) for part in text.split(",")))


def _drivers(text: str) -> list[DriverKind | OwnClass]:
    """The drivers of a list; DasError for an unknown name, and for a driver that is a process of its own."""
    found: dict[DriverKind | OwnClass, None] = {}
    for part in text.split(","):
        driver = named_driver("--drivers", part.strip())
        if not isinstance(driver, DriverKind | OwnClass):
            raise DasError(f"--drivers {driver}: a batch cannot use an external driver; use das-sim run")
        found[driver] = None
    return list(found)


def _participants(
    drivers: Sequence[DriverKind | OwnClass], numbers: str | None, population: str | None
) -> list[Participant]:
    """The participants of a list; DasError without a human driver, or for a population that cannot be used."""
    if DriverKind.HUMAN not in drivers:
        refuse_given(f"needs --drivers {DriverKind.HUMAN}: only this driver has habits", "--participants", "--friction")
    from sim.drivers.parameters import DEFAULT, Participant, load_population
    from sim.jobs.batch import parse_seeds

    if numbers is None:
        refuse_given("needs --participants", "--population")
        return []
    found = load_population(DEFAULT if population is None else population)
    return [Participant(population=found, number=number) for number in parse_seeds(numbers, "--participants")]


def sensitivity(
    scenario: ScenarioArgument,
    advice: AdviceListOption = "guide",
    seeds: DaysOption = "0-3",
    parameters: ParametersOption = None,
    population: PopulationOption = None,
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    level: LevelOption = None,
    workers: Annotated[int, typer.Option(metavar="N", help="Number of processes.", min=1, max=1024)] = 1,
    markdown: MarkdownOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say by how many points the gap to the optimum changes with one standard deviation of each parameter.

    A point is 1 % of the optimum for the times as driven.

    Every parameter is set one standard deviation below and above its median, while all others stay at their
    medians; days and random numbers are the same. A parameter that the population does not draw is varied by a fifth
    of its default.
    """
    if as_json:
        refuse_given("--json prints no table", "--markdown")
    with busy("reading the scenario …"):
        from sim.drivers.parameters import DEFAULT, load_population
        from sim.jobs.batch import parse_seeds
        from sim.jobs.sensitivity import Study, sensitivities, sensitivity_markdown
        from sim.world.scenario import load_scenario

        study = Study(
            scenario=load_scenario(scenario).source,
            level=level,
            seeds=parse_seeds(seeds),
            advice=_each(Presentation, "--advice", advice),
            friction=friction,
            population=load_population(DEFAULT if population is None else population),
            parameters=None if parameters is None else [name.strip() for name in parameters.split(",")],
        )
        jobs = list(study.jobs())
    found = sensitivities(study, _runs_made(jobs, workers))
    if as_json:
        print(json.dumps([one.as_dict() for one in found]))
    elif markdown:
        print(sensitivity_markdown(found))
    else:
        _print_sensitivity(found)


def _runs_made(jobs: Sequence[SensitivityJob], workers: int) -> list[SensitivityRun]:
    """Make all runs of a study, with progress; DasError for a run that cannot be made."""
    from sim.jobs.runner import JobWords, made_with_progress
    from sim.jobs.sensitivity import drive

    found: list[SensitivityRun] = []
    words = JobWords("sensitivity", "runs", "make")
    with closing(made_with_progress(drive, jobs, Workers(count=workers), words, f"{len(jobs)} runs")) as coming:
        for made in coming:
            if made.result is None:
                raise made.error or DasError("a run ended without a result")
            found.append(made.result)
    return found


def _print_sensitivity(found: Sequence[Sensitivity]) -> None:
    """Print a row for each presentation and parameter."""
    from rich.table import Table

    from sim.jobs.sensitivity import shown_points

    table = Table(title="points of gap to the optimum per standard deviation", title_justify="left")
    table.add_column("advice, parameter", no_wrap=True)
    for name in ("−1 sd", "+1 sd", "points", "kWh"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("source")
    for one in found:
        varied = one.variation
        name = f"{one.advice}, {varied.name}" + ("" if varied.drawn else " *")
        figures = (f"{varied.low:.3g}", f"{varied.high:.3g}", shown_points(one), f"{one.energy_kwh:+.1f}")
        table.add_row(name, *figures, varied.source)
    print_table(table, {"points": "percentage points of the gap, in % of the optimum for the times as driven"})
    tell("* not drawn by the population: varied by a fifth of its default")
