"""The command worth: what advice would save a fleet, in five steps, from a study with a bundled or own design."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import JsonOption, OutFolderOption
from das.command_line.printing import busy, loading_solver
from precompute.workers import Workers
from sim.cli.experiment import RecordingsOption, SchedulerOption
from sim.cli.options import WorkersOption, check_packages, tell_written
from sim.options import DRAWN_DRIVERS

FEWEST, MOST = DRAWN_DRIVERS


def worth(
    design: Annotated[
        str, typer.Argument(metavar="DESIGN", help="Bundled design (intercity, suburban, freight), or TOML file.")
    ],
    drivers: Annotated[
        int | None,
        typer.Option(metavar="N", min=FEWEST, max=MOST, help="Number of drivers drawn [default: the design's]."),
    ] = None,
    out: OutFolderOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    recordings: RecordingsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate what advice would save a fleet: energy, money and CO₂ a year, in five steps from the optimum to people.

    For a fleet of your own, das-sim example writes fleet.toml beside a line, a train and a timetable.

    The folder (default: worth-NAME) is that of a study, with trials.csv, and holds worth.md, worth.json and
    tornado.svg. A stopped command goes on; new prices, or other inputs that only scale, need no new trials.
    """
    check_packages("experiment", "matplotlib")
    hands = Workers.asked(workers, scheduler)
    with loading_solver():
        from sim.experiment.study_files import FAILED_TABLE
        from sim.experiment.worth.findings import findings, print_findings, write_findings
        from sim.experiment.worth.study import load_worth, run_worth
    with busy("reading the design …"):
        asked = load_worth(design, drivers)
    folder = Path(f"worth-{asked.study.name}") if out is None else out
    failed = run_worth(asked, folder, hands, record=recordings).failed
    found = findings(asked, folder)
    written = write_findings(found, folder)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        print_findings(found)
        tell_written(*written)
    if failed:
        print(f"{len(failed)} trials failed: see {folder / FAILED_TABLE}", file=sys.stderr)
        raise typer.Exit(1)
