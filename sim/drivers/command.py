"""The command das-sim drivers: who can drive, and what makes a human."""

from __future__ import annotations

import json
from dataclasses import fields
from textwrap import fill
from typing import Annotated

import typer
from rich.table import Table

from das.command_line.printing import print_table
from sim.drivers.parameters import HumanParameters, parameter_table

FOLDED = 52
"""Width of the column of meanings."""
DRIVERS = {
    "perfect": "follows the full advice, speed and force, as exactly as the train lets",
    "fast": "as fast as allowed, brakes late",
    "rms": "holds one reduced maximum speed, the advice's or his own",
    "timetable": "keeps time without advice",
    "human": "reacts, errs, refuses and learns, by the parameters below",
}


def drivers(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Who can drive, and the parameters of a human driver with default, range and source."""
    if as_json:
        parameters = {f.name: {"default": f.default, **f.metadata} for f in fields(HumanParameters)}
        print(json.dumps({"drivers": DRIVERS, "human": parameters}))
        return
    who = Table(title="drivers", title_justify="left", show_header=False)
    for name, meaning in DRIVERS.items():
        who.add_row(name, meaning)
    print_table(who)
    table = Table("parameter", "default", "range", "meaning", title="human", title_justify="left")
    for name, default, unit, limits, meaning, source in parameter_table():
        table.add_row(name, f"{default} {unit}", limits, f"{fill(meaning, FOLDED)}\n{fill(f'({source})', FOLDED)}")
    print_table(table)
    print("a scenario's table [human] sets them, to values or ranges, and trips made before")
    print("(docs/reference/drivers.md)")
