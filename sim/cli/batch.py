"""The command `das-sim batch`: many days in closed loop, on all cores, into one table."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.options import JsonOption, LevelOption, OutFolder
from das.command_line.printing import busy
from das.domain.errors import DasError
from sim.cli.options import DriversOption, FrictionOption, ParticipantsOption
from sim.cli.shared import Kind, chosen
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.options import PopulationOption

if TYPE_CHECKING:
    from sim.drivers.population import Participant
    from sim.jobs.batch import BatchJob
    from sim.jobs.runner import Rows

TABLE = "runs.parquet"


def batch(
    scenarios: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help="Bundled scenarios or TOML files, one or more.")
    ],
    out: OutFolder,
    seeds: Annotated[str, typer.Option(metavar="LIST", help="Seeds, like 0-99 or 1,5,10-19.")] = "0-9",
    drivers: DriversOption = "human",
    advice: Annotated[
        str, typer.Option(metavar="LIST", help="What the display shows, with commas between (see das-sim run -h).")
    ] = "vector",
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    participants: ParticipantsOption = None,
    population: PopulationOption = None,
    level: LevelOption = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Number of processes [default: one a core].", min=1, max=1024)
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Run over the bus and keep the recordings (slower).")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run every scenario with every driver, presentation and seed; a batch that was stopped goes on where it was.

    The table runs.parquet in the folder has one row a run; a run is made again only if one of its inputs changed.
    """
    with busy("reading the scenarios …"):
        from sim.jobs.batch import Batch, parse_seeds, require_pyarrow
        from sim.jobs.report import print_summary

        require_pyarrow()
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
        _make_folder(out)
    found = _run_all(jobs, out, workers or os.cpu_count() or 1)
    as_text = json.dumps({**found, "savings": [one.as_dict() for one in found["savings"]]})
    print(as_text) if as_json else print_summary(found)
    _check_all_done(found, jobs, out)


def _check_all_done(found: Mapping[str, Any], jobs: Sequence[BatchJob], out: Path) -> None:
    """End with code 1 where runs failed."""
    if failed := sum(group["failed"] for group in found["groups"]):
        print(f"{failed} of {len(jobs)} runs failed: see the column error of {out / TABLE}", file=sys.stderr)
        raise typer.Exit(1)


def _run_all(jobs: Sequence[BatchJob], out: Path, workers: int) -> dict[str, Any]:
    """Run what is not finished yet and write the table, even if it is interrupted. Returns what came out."""
    from precompute.workers import Workers
    from sim.jobs.batch import make_run, write_table
    from sim.jobs.report import savings, summary
    from sim.jobs.runner import JobWords, Runner

    finished: list[dict[str, Any]] = []

    def write(rows: Rows, _made: int) -> None:
        finished.extend(dict(rows[job.inputs_sha256]) for job in jobs if job.inputs_sha256 in rows)
        write_table(out / TABLE, finished)

    words = JobWords("batch", "runs", "make")
    made = Runner(make=make_run, folder=out, workers=Workers(count=workers), words=words).run(jobs, write)
    return {
        "file": str(out / TABLE),
        "runs": len(jobs),
        "made": made,
        "groups": summary(finished),
        "savings": savings(finished),
    }


def _each(kind: type[Kind], option: str, text: str) -> list[Kind]:
    return list(dict.fromkeys(chosen(kind, option, part.strip()) for part in text.split(",")))


def _drivers(text: str) -> list[DriverKind | OwnClass]:
    """The drivers of a list; DasError for a name that there is not, and for a driver that is a process of its own."""
    found: dict[DriverKind | OwnClass, None] = {}
    for part in text.split(","):
        driver = named_driver("--drivers", part.strip())
        if not isinstance(driver, DriverKind | OwnClass):
            raise DasError(f"--drivers {driver}: a batch has no place for a process of its own; expected das-sim run")
        found[driver] = None
    return list(found)


def _participants(
    drivers: Sequence[DriverKind | OwnClass], numbers: str | None, population: str | None
) -> list[Participant]:
    """The participants of a list; DasError without a human driver, or for a population that cannot be used."""
    from sim.drivers.population import DEFAULT, Participant, load_population
    from sim.jobs.batch import parse_seeds

    if numbers is None:
        if population is not None:
            raise DasError(f"--population {population}: expected with --participants")
        return []
    if DriverKind.HUMAN not in drivers:
        raise DasError(f"--participants {numbers}: expected with the driver human, who alone has parameters")
    found = load_population(population or DEFAULT)
    return [Participant(population=found, number=number) for number in parse_seeds(numbers, "--participants")]


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DasError(f"{out}: cannot be made ({error.strerror})") from error
