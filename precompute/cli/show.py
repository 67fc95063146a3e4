"""The command `das-precompute show`: content of a route, vehicle, journey, loss map or table, and warnings."""

from __future__ import annotations

import json
import shlex
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NoReturn

import typer

from das.command_line.application import is_given, refuse_given
from das.command_line.files import load_route, load_vehicle
from das.command_line.options import JsonOption, LoadOption, ModeOption, OverwriteOption, PlotOption
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, tell, warn
from das.domain.errors import DasError
from das.domain.units import KM, KMH, KW, TONNE
from precompute.cli.options import Files, OnRoute, picked

if TYPE_CHECKING:
    from rich.table import Table

    from das.drawing.picture import Picture

EXIT_WARNINGS: Final = 1
"""Exit code if a file has warnings."""
ROUTE, VEHICLE, JOURNEY, LOSS_MAP, TABLES = "route", "vehicle", "journey", "loss map", "tables"
BELONGS: Final = {
    "--route": (JOURNEY,),
    "--reverse": (JOURNEY,),
    "--vehicle": (JOURNEY, LOSS_MAP),
    "--mode": (VEHICLE,),
    "--load": (VEHICLE,),
    "--losses": (VEHICLE,),
    "--plot": (ROUTE, VEHICLE, JOURNEY, LOSS_MAP),
}
"""The kinds of files that an option applies to."""
OF_BENCHMARK: Final = {"mass": VEHICLE, "speed limits": ROUTE, "timing points": JOURNEY}
"""A key of each kind of JSON file of TTOBench; any other JSON file is a table."""


@dataclass(frozen=True, kw_only=True)
class ShownFile:
    """The content of a file: a dictionary for `--json`, functions that print and draw it, and warnings."""

    facts: dict[str, Any]
    tell: Callable[[], None]
    draw: Callable[[], Picture] | None = None
    warnings: Sequence[str] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class OfTrain:
    """Options for a train, and for the train of a journey or of a loss map."""

    vehicle: Annotated[
        str | None,
        typer.Option(
            metavar="VEHICLE",
            help="Train for the spare times of a journey (needs --route), or for the forces of a loss map "
            "[default: re460-ic].",
        ),
    ] = None
    mode: ModeOption = None
    load: LoadOption = None
    losses: Annotated[bool, typer.Option("--losses", help="Show the loss map of a vehicle.")] = False


@dataclass(frozen=True, kw_only=True)
class ShowFiles(Files):
    """The picture to write, and whether JSON is printed."""

    plot: PlotOption = None
    overwrite: OverwriteOption = False
    as_json: JsonOption = False


def show(
    on: OnRoute,
    of: OfTrain,
    files: ShowFiles,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]",
            help="Route, vehicle, journey (TOML, TTOBench or bundled; a journey with --route), loss map (CSV), table, "
            "or folder of tables.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Show and check a route, vehicle, journey, loss map or tables; without a file, list what is bundled.

    For a route or vehicle, unusual values are warnings and missing data are notes; the exit code is 1 with warnings and
    2 if the file cannot be used. With a train, the spare time of each section of a journey is shown. With --route, a
    name that bundled files share means the journey. Tables are checked as by `verify`, with its exit code; those with
    problems come last.
    """
    files.check(source, on.route, of.vehicle)
    if source is None:
        refuse_given("needs a file", *BELONGS)
        print_catalogue(as_json=files.as_json)
        return
    kind = _kind(source)
    refuse_given(f"{source} is {'a ' if kind != TABLES else ''}{kind}", *(x for x in BELONGS if kind not in BELONGS[x]))
    if kind == TABLES:
        from precompute.cli.tables import print_tables

        print_tables(Path(source), as_json=files.as_json)
        return
    _show(_READ[kind](source, on, of), files)


def _show(shown: ShownFile, files: ShowFiles) -> None:
    """Draw and print the content of a file; the command ends with code 1 if there are warnings."""
    if files.plot is not None and shown.draw is not None:
        with busy("drawing …"):
            shown.draw().save(files.plot, overwrite=True)
    if files.as_json:
        print(json.dumps({**shown.facts, "warnings": list(shown.warnings), "notes": list(shown.notes)}))
    else:
        shown.tell()
        for note in shown.notes:
            tell(f"note: {note}")
        for text in shown.warnings:
            warn(text)
        files.tell()
    if shown.warnings:
        raise typer.Exit(EXIT_WARNINGS)


def _kind(source: str) -> str:
    """The kind of a bundled name or a file; DasError for a file that `show` cannot read."""
    from das.domain.files.load import catalogue, foreign_format

    kinds = (JOURNEY, ROUTE, VEHICLE) if is_given("--route") else (ROUTE, VEHICLE, JOURNEY)
    for kind in kinds:
        if source in catalogue(f"{kind}s"):
            return kind
    path = Path(source)
    if path.is_dir():
        return TABLES
    found = foreign_format(path)
    if found is not None and found.name.endswith("this program"):
        own = found.name.split()[1]
        return own if own in kinds else _unknown(source)
    if found is not None and found.command:
        raise DasError(f"{source}: is {found.name}; to read it: {found.command.format(path=shlex.quote(source))}")
    by_suffix = {".csv": LOSS_MAP, ".toml": JOURNEY if is_given("--route") else ROUTE, ".json": TABLES}
    kind = by_suffix.get(path.suffix.lower()) or _unknown(source)
    return _of_json(path) if kind == TABLES else kind


def _of_json(path: Path) -> str:
    try:
        keys = set(json.loads(path.read_bytes()))
    except (OSError, ValueError, TypeError):
        return TABLES
    return next((kind for key, kind in OF_BENCHMARK.items() if key in keys), TABLES)


def _unknown(source: str) -> NoReturn:
    from das.domain.files.load import catalogue

    bundled = ", ".join(sorted({*catalogue("routes"), *catalogue("vehicles"), *catalogue("journeys")}))
    raise DasError(f"{source}: expected a route, vehicle, journey, loss map or tables, or one of {bundled}")


def _route(source: str, _on: OnRoute, _of: OfTrain) -> ShownFile:
    from das.domain.files.load import load_route
    from precompute.cli import route_report

    route = load_route(source)
    return ShownFile(
        facts=route_report.as_dict(route),
        tell=lambda: print_table(route_report.table(route)),
        draw=lambda: route_report.draw_line(route),
        warnings=route_report.warnings(route),
        notes=list(route_report.notes(route)),
    )


def _vehicle(source: str, _on: OnRoute, of: OfTrain) -> ShownFile:
    if of.losses:
        return _loss_map(source, _on, of)
    from das.domain.files.load import load_vehicle
    from precompute.cli import vehicle_report

    found = load_vehicle(source)
    train = picked(found, of.mode, of.load)

    def printed() -> None:
        for line in vehicle_report.facts(train):
            tell(line)
        print_table(vehicle_report.table(train), vehicle_report.LEGEND)

    return ShownFile(
        facts=vehicle_report.as_dict(train),
        tell=printed,
        draw=lambda: vehicle_report.draw_train(train),
        warnings=vehicle_report.warnings(found),
    )


def _loss_map(source: str, _on: OnRoute, of: OfTrain) -> ShownFile:
    from precompute import loss_maps

    model, train = loss_maps.map_of(source, of.vehicle)
    summary = loss_maps.loss_map_summary(model, train)

    def printed() -> None:
        for line in loss_maps.facts(model, train, summary):
            tell(line)
        print_table(loss_maps.table(summary), loss_maps.LEGEND)

    return ShownFile(facts=summary, tell=printed, draw=lambda: loss_maps.draw_maps(model, train))


def _journey(source: str, on: OnRoute, of: OfTrain) -> ShownFile:
    from das.domain.files.load import load_journey
    from precompute.cli import journey_report

    line = on.line()
    if of.vehicle is not None and line is None:
        raise DasError(f"--vehicle {of.vehicle}: needs --route")
    found = load_journey(source, line)
    spare: list[dict[str, Any]] = []
    if of.vehicle is not None and line is not None:
        train = load_vehicle(of.vehicle)
        with loading_solver():
            from das.offline.journey import JourneyPlanner

            planner = JourneyPlanner(found, line, train)
        spare = journey_report.spare_times(planner)

    def printed() -> None:
        print_table(journey_report.table(found), journey_report.LEGEND)
        if spare:
            print_table(journey_report.spare_table(found, spare), journey_report.SPARE_LEGEND)

    return ShownFile(
        facts={**journey_report.as_dict(found), "sections": spare},
        tell=printed,
        draw=lambda: journey_report.draw_timetable(found),
        warnings=journey_report.warnings(found, line),
    )


_READ: Final = {ROUTE: _route, VEHICLE: _vehicle, JOURNEY: _journey, LOSS_MAP: _loss_map}

SHOWN_OF_A_SOURCE = 300
"""Largest number of characters of a file's source that are printed; --json prints the whole source."""
LEGEND = {"levels": "loss levels the vehicle has data for, its default first (docs/explanation/loss-maps.md)"}


def print_catalogue(*, as_json: bool) -> None:
    """Print the bundled routes and vehicles, each with the id to use in commands, and the source of its data.

    JSON has the sources in full.
    """
    from das.domain.files.load import catalogue
    from precompute.cli.route_report import as_dict as of_route
    from precompute.cli.vehicle_report import as_dict as of_vehicle

    routes = [_bundled(path, "route", of_route(load_route(name))) for name, path in catalogue("routes").items()]
    trains = catalogue("vehicles").items()
    vehicles = [_bundled(path, "vehicle", of_vehicle(load_vehicle(name))) for name, path in trains]
    if as_json:
        print(json.dumps({"routes": routes, "vehicles": vehicles}))
        return
    table = _table("routes", ("km",), "stops")
    for route in routes:
        stops = ", ".join(stop["name"] for stop in route["stops"])
        table.add_row(route["id"], route["name"], f"{route['length_m'] / KM:.1f}", stops)
    print_table(table)
    table = _table("vehicles", ("t", "m", "kW", "km/h"), "levels")
    figures = {"mass_kg": TONNE, "length_m": 1.0, "max_power_w": KW, "max_speed_mps": KMH}
    for train in vehicles:
        numbers = (f"{train[key] / unit:.0f}" for key, unit in figures.items())
        table.add_row(train["id"], train["name"], *numbers, " ".join(train["levels"]))
    print_table(table, LEGEND)
    for one in (*routes, *vehicles):
        source = one["source"]
        if len(source) > SHOWN_OF_A_SOURCE:  # only whole sentences
            whole, end, _ = source[:SHOWN_OF_A_SOURCE].rpartition(". ")
            source = f"{whole}{end.strip()} …"
        paragraph(f"{one['id']}: {source}", hanging="  ")
        tell(f"  {one['file']}")


def _bundled(path: Path, table: str, facts: dict[str, Any]) -> dict[str, Any]:
    """The facts of a bundled file, the origin of the data (its source, else its description), and its path."""
    main = tomllib.loads(path.read_text(encoding="utf-8"))[table]
    source = " ".join(str(main.get("source") or main.get("description") or "").split())
    return {**facts, "source": source, "file": str(path)}


def _table(title: str, figures: Sequence[str], last: str) -> Table:
    table = new_table(title, ("id", "name"), figures)
    table.columns[0].no_wrap = True
    table.add_column(last)
    return table
