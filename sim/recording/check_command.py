"""The command `das-sim check`: whether a recording is whole and undamaged, and whether the node was in time."""

from __future__ import annotations

import json
from math import isnan
from typing import TYPE_CHECKING

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import busy, print_table, tell, typed
from sim.cli.options import OfTrainOption, RecordingArgument

if TYPE_CHECKING:
    from sim.recording.check import Checked
    from sim.recording.findings import CheckFinding

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

    figures = Table(title=str(found.recording.path), title_justify="left", show_header=False)
    figures.add_column(no_wrap=True)
    figures.add_column()
    for row in found.figures.items():
        figures.add_row(*row)
    print_table(figures)
    rates = Table(title="topics", title_justify="left")
    rates.add_column("topic", no_wrap=True)
    for name in ("messages", "a second", "usual interval", "longest gap"):
        rates.add_column(name, justify="right")
    for name, rate in found.rates.items():
        seconds = ("–" if isnan(value) else f"{value:.1f} s" for value in (rate.interval_s, rate.longest_gap_s))
        per_s = "–" if isnan(rate.per_s) else f"{rate.per_s:.2f}"
        rates.add_row(name, str(rate.messages), per_s, *seconds)
    print_table(rates)
    for note in found.notes:
        tell(f"note: {note}")
    for one in found.findings:
        tell(_line(one))
    if not found.findings:
        tell("nothing is wrong with this recording")
        return
    tell(f"{len(found.findings)} finding{'s' if len(found.findings) > 1 else ''}")
    if found.recording.health.damage or not found.recording.complete:
        tell(f"save what is sound: {typed('das-sim')} recover {found.recording.path} -o NEW.mcap")


def _line(one: CheckFinding) -> str:
    from sim.recording.check import utc

    when = f" at {utc(one.time_ns)} UTC" if one.time_ns else ""
    return f"finding ({one.kind}){when}: {one.text}"
