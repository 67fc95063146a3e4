"""The command list: what is installed, of this program and of other packages."""

from __future__ import annotations

import json
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Final

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import new_table, print_table, tell
from sim import doors


class Listed(StrEnum):
    """What can be listed."""

    SCENARIOS = "scenarios"
    DRIVERS = "drivers"
    PRESENTATIONS = "presentations"
    STUDIES = "studies"
    MEASURES = "measures"
    IMPORTERS = "importers"


DRIVERS: Final = {
    "perfect": "follows the full advice, speed and force, as exactly as the train lets",
    "literal": "does what the guide's card says and knows nothing else: no limit, no board, no signal",
    "fast": "drives as fast as allowed and brakes late",
    "top-speed": "holds one reduced maximum speed, the advised one or the driver's own",
    "timetable": "keeps time without advice",
    "human": "reacts, errs, refuses and learns, by the parameters below",
}
"""Behaviour of each driver."""
OUTSIDE: Final = {
    "package.module:Class": "a class of your own, in this process",
    "external": "a process of its own, over the bus",
    "desk": "a person at the cab desk, in the browser (das-sim desk)",
}
"""Drivers that users bring (docs/how-to/bring-your-own-driver.md)."""


def brought(group: str) -> dict[str, str]:
    """What other packages bring to a group: each name with its package."""
    return {name: f"of the package {door.package}" for name, door in doors.installed(group).items()}


def listing(
    what: Annotated[Listed | None, typer.Argument(metavar="[WHAT]", help="One kind [default: all, by name].")] = None,
    as_json: JsonOption = False,
) -> None:
    """List installed scenarios, drivers, presentations, studies, measures and importers, including plug-ins.

    With one kind it says what each is, and for scenarios and studies where its file is, to copy and change.
    """
    if what is not None:
        TOLD[what](as_json=as_json)
        return
    names = {str(one): NAMES[one]() for one in Listed}
    if as_json:
        print(json.dumps(names))
        return
    table = new_table("", ("names",), whole=("what",), lines=True)
    for one, listed in names.items():
        table.add_row(one, ", ".join(listed))
    print_table(table)
    tell("das-sim list WHAT says more of one kind")


def _scenarios(*, as_json: bool) -> None:
    """The bundled scenarios, and where their files are."""
    from sim.world.scenario import bundled_scenarios, read_scenario

    found = [read_scenario(path) for path in bundled_scenarios().values()]
    if as_json:
        kept = {one.id: {"title": one.title, "description": one.description, "file": str(one.source)} for one in found}
        print(json.dumps(kept))
        return
    table = new_table("bundled scenarios", ("what happens",), whole=("scenario",), lines=True)
    for one in found:
        table.add_row(one.id, f"{one.title}. {one.description}")
    print_table(table)
    tell(f"their files, to copy and change: {found[0].source.parent}")


def _drivers(*, as_json: bool) -> None:
    """The drivers, and the parameters of the human one with their default, range and source."""
    from dataclasses import fields

    from rich.table import Table

    from sim.drivers.parameters import HumanParameters, parameter_table

    if as_json:
        parameters = {f.name: {"default": f.default, **f.metadata} for f in fields(HumanParameters)}
        print(json.dumps({"drivers": DRIVERS, "outside": OUTSIDE | brought(doors.DRIVERS), "human": parameters}))
        return
    who = Table(title="drivers", title_justify="left", show_header=False)
    for name, meaning in (DRIVERS | OUTSIDE | brought(doors.DRIVERS)).items():
        who.add_row(name, meaning)
    print_table(who)
    table = new_table("human", ("range, meaning (source)",), whole=("parameter", "default"), lines=True)
    for name, default, unit, limits, meaning, source in parameter_table():
        table.add_row(name, f"{default} {unit}", f"{limits}: {meaning} ({source})")
    print_table(table)
    tell(
        "The table [human] of a scenario sets them, to values or ranges, and the trips made before "
        "(docs/reference/drivers.md)."
    )


def _meanings(title: str, found: dict[str, str], *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(found))
        return
    table = new_table(title, ("meaning",), whole=("name",), lines=True)
    for name, meaning in found.items():
        table.add_row(name, meaning)
    print_table(table)


def _presentations(*, as_json: bool) -> None:
    """The presentations, and what each shows."""
    from sim.drivers.kinds import Presentation
    from sim.drivers.presentations.presenter import presenter_of

    _meanings("presentations", {str(one): presenter_of(one).meaning for one in Presentation}, as_json=as_json)


def _studies(*, as_json: bool) -> None:
    """The bundled studies, and where their files are."""
    from sim.experiment.checking import print_studies
    from sim.experiment.design import bundled_studies, read_design

    found = [read_design(path) for path in bundled_studies().values()]
    if as_json:
        listed = [{"name": one.name, "title": one.title, "file": str(one.source)} for one in found]
        print(json.dumps(listed))
        return
    print_studies(found)
    tell(f"their files, to copy and change: {found[0].source.parent}")


def _measures(*, as_json: bool) -> None:
    """The measures of a trial, with their units and formulas."""
    from sim.experiment.measures import MEASURES

    found = {name: f"{one.title} ({one.unit}): {one.formula} ({one.source})" for name, one in MEASURES.items()}
    _meanings("measures", found, as_json=as_json)


def _importers(*, as_json: bool) -> None:
    """The kinds of files of trains that das-precompute vehicle import reads."""
    own = {
        "json": "rolling stock of OSRD",
        "yaml": "rolling stock of railtoolkit",
        "csv": "a table of efforts",
    }
    _meanings("importers of trains", own | brought(doors.IMPORTERS), as_json=as_json)


TOLD: Final[dict[Listed, Callable[..., None]]] = {
    Listed.SCENARIOS: _scenarios,
    Listed.DRIVERS: _drivers,
    Listed.PRESENTATIONS: _presentations,
    Listed.STUDIES: _studies,
    Listed.MEASURES: _measures,
    Listed.IMPORTERS: _importers,
}
"""The function that tells of each kind."""


def _names_of_scenarios() -> list[str]:
    from sim.world.scenario import bundled_scenarios

    return list(bundled_scenarios())


def _names_of_presentations() -> list[str]:
    from sim.drivers.kinds import Presentation

    return list(Presentation)


def _names_of_studies() -> list[str]:
    from das.domain.files.load import bundled_files

    return list(bundled_files("sim.experiment", "studies"))


def _names_of_measures() -> list[str]:
    from sim.experiment.measures import MEASURES

    return list(MEASURES)


NAMES: Final[dict[Listed, Callable[[], list[str]]]] = {
    Listed.SCENARIOS: _names_of_scenarios,
    Listed.DRIVERS: lambda: [*DRIVERS, *OUTSIDE, *doors.installed(doors.DRIVERS)],
    Listed.PRESENTATIONS: _names_of_presentations,
    Listed.STUDIES: _names_of_studies,
    Listed.MEASURES: _names_of_measures,
    Listed.IMPORTERS: lambda: ["json", "yaml", "csv", *doors.installed(doors.IMPORTERS)],
}
"""The function that names all of each kind."""
