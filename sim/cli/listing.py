"""The command list, which lists installed objects of this program and of other packages."""

from __future__ import annotations

import json
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import new_table, print_table, tell
from sim import doors


class Listed(StrEnum):
    """The kinds of objects that can be listed."""

    SCENARIOS = "scenarios"
    DRIVERS = "drivers"
    PRESENTATIONS = "presentations"
    STUDIES = "studies"
    MEASURES = "measures"
    IMPORTERS = "importers"


DRIVERS: Final = {
    "perfect": "follows the full advice, speed and force, as exactly as the train can",
    "literal": "follows only the guide's card; ignores limits, boards and signals",
    "fast": "drives as fast as allowed and brakes late",
    "top-speed": "holds one reduced maximum speed, the advised one or the driver's own",
    "timetable": "keeps time without advice",
    "human": "reacts, errs, refuses and learns, by the parameters below",
}
"""Behaviour of each driver."""
OUTSIDE: Final = {
    "package.module:Class": "a class of your own, in the process of das-sim",
    "external": "a separate process, over the bus",
    "desk": "a person at the cab desk, in the browser (das-sim desk)",
}
"""Drivers provided by users (docs/how-to/bring-your-own-driver.md)."""


def brought(group: str) -> dict[str, str]:
    """The names of the objects in a group that other packages provide, each with its package."""
    return {name: f"of the package {door.package}" for name, door in doors.installed(group).items()}


def listing(
    what: Annotated[Listed | None, typer.Argument(metavar="[WHAT]", help="One kind [default: all, by name].")] = None,
    as_json: JsonOption = False,
) -> None:
    """List installed scenarios, drivers, presentations, studies, measures and importers, including plug-ins.

    With one kind, it prints the meaning of each object, and for scenarios and studies the file, to copy and change.
    """
    if what is None:
        names = {str(one): [*FOUND[one]()] for one in Listed}
        if as_json:
            print(json.dumps(names))
            return
        _print("", ("what", "names"), {one: ", ".join(listed) for one, listed in names.items()})
        tell("das-sim list WHAT gives details of one kind")
        return
    found = FOUND[what]()
    if as_json:
        print(json.dumps(_as_json(what, found)))
    elif what is Listed.SCENARIOS:
        told = {name: f"{one['title']}. {one['description']}" for name, one in found.items()}
        _print("bundled scenarios", ("scenario", "what happens"), told)
    elif what is Listed.DRIVERS:
        _print_drivers(found)
    elif what is Listed.STUDIES:
        from sim.experiment.checking import print_studies

        print_studies()
    else:
        _print("importers of trains" if what is Listed.IMPORTERS else str(what), ("name", "meaning"), found)
    if not as_json and what in (Listed.SCENARIOS, Listed.STUDIES):
        tell(f"their files, to copy and change: {Path(next(iter(found.values()))['file']).parent}")


def _print(title: str, heads: tuple[str, str], found: dict[str, str]) -> None:
    table = new_table(title, heads[1:], whole=heads[:1], lines=True)
    for name, meaning in found.items():
        table.add_row(name, meaning)
    print_table(table)


def _as_json(what: Listed, found: dict[str, Any]) -> Any:
    if what is Listed.STUDIES:
        return [{"name": name, **one} for name, one in found.items()]
    if what is not Listed.DRIVERS:
        return found
    from dataclasses import fields

    from sim.drivers.parameters import HumanParameters

    parameters = {f.name: {"default": f.default, **f.metadata} for f in fields(HumanParameters)}
    return {"drivers": DRIVERS, "outside": OUTSIDE | brought(doors.DRIVERS), "human": parameters}


def _print_drivers(found: dict[str, str]) -> None:
    from rich.table import Table

    from sim.drivers.parameters import parameter_table

    who = Table(title="drivers", title_justify="left", show_header=False)
    for name, meaning in found.items():
        who.add_row(name, meaning)
    print_table(who)
    table = new_table("human", ("range, meaning (source)",), whole=("parameter", "default"), lines=True)
    for name, default, unit, limits, meaning, source in parameter_table():
        table.add_row(name, f"{default} {unit}", f"{limits}: {meaning} ({source})")
    print_table(table)
    tell(
        "The table [human] of a scenario sets these parameters, to values or ranges, and the number of earlier trips "
        "(docs/reference/drivers.md)."
    )


def _scenarios() -> dict[str, dict[str, str]]:
    from sim.world.scenario import bundled_scenarios, read_scenario

    found = map(read_scenario, bundled_scenarios().values())
    return {one.id: {"title": one.title, "description": one.description, "file": str(one.source)} for one in found}


def _drivers() -> dict[str, str]:
    return DRIVERS | OUTSIDE | brought(doors.DRIVERS)


def _presentations() -> dict[str, str]:
    from sim.drivers.kinds import Presentation
    from sim.drivers.presentations.presenter import presenter_of

    return {str(one): presenter_of(one).meaning for one in Presentation}


def _studies() -> dict[str, dict[str, str]]:
    from sim.experiment.design import bundled_studies, read_design

    found = map(read_design, bundled_studies().values())
    return {one.name: {"title": one.title, "file": str(one.source)} for one in found}


def _measures() -> dict[str, str]:
    from sim.experiment.measures import MEASURES

    return {name: f"{one.title} ({one.unit}): {one.formula} ({one.source})" for name, one in MEASURES.items()}


def _importers() -> dict[str, str]:
    own = {
        "json": "rolling stock of OSRD",
        "yaml": "rolling stock of railtoolkit",
        "csv": "a table of efforts",
    }
    return own | brought(doors.IMPORTERS)


FOUND: Final[dict[Listed, Callable[[], dict[str, Any]]]] = {
    Listed.SCENARIOS: _scenarios,
    Listed.DRIVERS: _drivers,
    Listed.PRESENTATIONS: _presentations,
    Listed.STUDIES: _studies,
    Listed.MEASURES: _measures,
    Listed.IMPORTERS: _importers,
}
"""For each kind, the function that returns all objects by name, with the meaning of each or its data."""
