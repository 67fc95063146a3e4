"""The command `das-sim check`: whether a recording is whole and undamaged, and whether the node was in time."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import busy, print_table, tell, typed
from sim.cli.options import RecordingArgument
from sim.options import OfTrainOption

if TYPE_CHECKING:
    from sim.recording.check import Checked

EXIT_FINDINGS = 1


def check(file: RecordingArgument, of_train: OfTrainOption = None, as_json: JsonOption = False) -> None:
    """Check a recording: checksums, holes, topics, rates, gaps, late advice, versions, input files.

    The exit code is 1 where something is wrong, 0 where nothing is.
    """
    from sim.recording.check import check_file

    with busy(f"checking {file} …"):
        found = check_file(file, of_train)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        _print(found)
    if found.findings:
        raise typer.Exit(EXIT_FINDINGS)


def _print(found: Checked) -> None:
    from rich.table import Table

    from sim.recording.check import RATE_COLUMNS

    figures = Table(title=str(found.recording.path), title_justify="left", show_header=False)
    figures.add_column(no_wrap=True)
    figures.add_column()
    for name, value in found.figures.items():
        figures.add_row(name, value)
    print_table(figures)
    rates = Table(title="topics", title_justify="left")
    rates.add_column(RATE_COLUMNS[0], no_wrap=True)
    for name in RATE_COLUMNS[1:]:
        rates.add_column(name, justify="right")
    for row in found.rate_rows():
        rates.add_row(*row)
    print_table(rates)
    for line in found.lines():
        tell(line)
    if found.recording.health.damage or not found.recording.complete:
        tell(f"save what is sound: {typed('das-sim')} recover {found.recording.path} -o NEW.mcap")
