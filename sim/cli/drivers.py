"""The command `das-sim drivers`: who can drive, and the parameters of a human driver."""

from __future__ import annotations

import json
from typing import Final

from das.command_line.options import JsonOption
from das.command_line.printing import print_table, tell

DRIVERS: Final = {
    "perfect": "follows the full advice, speed and force, as exactly as the train lets",
    "fast": "drives as fast as allowed and brakes late",
    "rms": "holds one reduced maximum speed, the advised one or the driver's own",
    "timetable": "keeps time without advice",
    "human": "reacts, errs, refuses and learns, by the parameters below",
}
"""What each driver does."""
OUTSIDE: Final = {
    "package.module:Class": "a class of your own, in this process",
    "external": "a process of its own, over the bus",
}
"""Drivers that users bring (docs/how-to/bring-your-own-driver.md)."""


def drivers(as_json: JsonOption = False) -> None:
    """List who can drive, and the parameters of a human driver with their default, range and source."""
    from dataclasses import fields

    from rich.table import Table

    from sim.drivers.parameters import HumanParameters, parameter_table

    if as_json:
        parameters = {f.name: {"default": f.default, **f.metadata} for f in fields(HumanParameters)}
        print(json.dumps({"drivers": DRIVERS, "outside": OUTSIDE, "human": parameters}))
        return
    who = Table(title="drivers", title_justify="left", show_header=False)
    for name, meaning in (DRIVERS | OUTSIDE).items():
        who.add_row(name, meaning)
    print_table(who)
    table = Table(title="human", title_justify="left")
    for heading in ("parameter", "default"):
        table.add_column(heading, no_wrap=True)
    table.add_column("range, meaning (source)")
    for name, default, unit, limits, meaning, source in parameter_table():
        table.add_row(name, f"{default} {unit}", f"{limits}: {meaning} ({source})")
    print_table(table)
    tell(
        "The table [human] of a scenario sets them, to values or ranges, and the trips made before "
        "(docs/reference/drivers.md)."
    )
