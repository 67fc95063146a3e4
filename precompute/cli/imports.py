"""The commands that make files from those of other programs: `das-precompute route`, `vehicle` and `journey import`."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.files import load_route
from das.command_line.options import JsonOption, PlotOption
from das.command_line.printing import busy, paragraph, print_table, tell, typed
from das.domain.errors import DasError
from das.domain.units import KM, TONNE, kmh
from precompute.cli.options import MadeFile, OnRoute
from precompute.gtfs import TripChoice
from precompute.journey_import import TimesRead
from precompute.route_import.line import ImportOrder, Words
from precompute.vehicle_import.tables import Figures


@dataclass(frozen=True, kw_only=True)
class RouteFiles(MadeFile):
    """The file of a route that a command writes, and its picture."""

    plot: PlotOption = None
    as_json: JsonOption = False


def import_route(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="Map of tracks (Overpass JSON, GeoJSON) or tables (CSV, railtoolkit YAML)."
        ),
    ],
    order: ImportOrder,
    stated: Words,
    written: RouteFiles,
) -> None:
    """Make a route from a map of OpenStreetMap, or from tables of limits, gradients, curves and stops.

    From a map, the command takes the path of a train between two stations. It never reverses, never turns by more than
    40°, and avoids sidings and the track of the other direction. Names of stations are found without regard to case and
    accents. Limits are those of the direction, so the route is one_way: import the other direction as well.

    Tables are CSV files whose columns have their units in their names (position_km, limit_kmh, gradient_permille,
    altitude_m, radius_m, length_m with cross_section_m2, name, latitude_deg, longitude_deg); the columns determine the
    content of a file. The values of a row apply up to the next row.

    Without altitudes energies are wrong by up to a third, so a line without them needs --flat.
    """
    written.check(*files, order.altitudes)
    stated.check()
    with busy("importing …"):
        from das.domain.files.writing import write_whole
        from precompute.cli import route_report
        from precompute.route_import import imported
        from precompute.route_import.line import route_toml

        line = imported(files, order, stated)
        write_whole(written.out, route_toml(line.route, line.remarks).encode())
    route = load_route(str(written.out))
    if written.plot is not None:
        route_report.draw_line(route).save(written.plot, overwrite=True)
    if written.as_json:
        facts = route_report.as_dict(route)
        print(json.dumps({**facts, "remarks": list(line.remarks), "file": str(written.out)}))
        return
    print_table(route_report.table(route))
    for remark in line.remarks:
        paragraph(remark)
    written.tell()


@dataclass(frozen=True, kw_only=True)
class AssumedOptions:
    """Values that the files of other programs lack, and the parts to read."""

    losses: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Losses of the traction chain: lossless, a mean efficiency like 0.85, or the vehicle (bundled name or "
            "file) whose efficiency the train has.",
        ),
    ] = None
    train: Annotated[
        str | None, typer.Option(metavar="ID", help="Train of a railtoolkit file [default: the first].")
    ] = None
    electric_brake: Annotated[
        float | None, typer.Option(metavar="RATIO", help="Add an electric brake with this share of the traction.")
    ] = None
    accept: Annotated[
        list[str] | None, typer.Option(metavar="CHECK", help="Accept an implausible value; the error names the check.")
    ] = None


def import_vehicle(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="Rolling stock (.json, .yaml), or a table (.csv).")],
    assumed: AssumedOptions,
    figures: Figures,
    written: MadeFile,
) -> None:
    """Make a vehicle file from rolling stock of OSRD or railtoolkit, or from a table of efforts.

    These files contain no losses, and most contain no electric brake. The assumptions are printed, and written in the
    file. The modes of a train (voltage, comfort) become modes of the vehicle: --mode picks one.
    """
    if assumed.losses is None:
        known = "lossless, a mean efficiency like 0.85, or a vehicle like re460-ic"
        raise DasError(f"--losses is missing: {source.name} gives no losses; expected {known}")
    written.check(source, assumed.losses)
    from precompute.vehicle_import import import_train

    found = import_train(
        source,
        assumed.losses,
        figures,
        train_id=assumed.train,
        electric_brake=assumed.electric_brake,
        accepted=assumed.accept or (),
    )
    made = found.vehicle
    modes = f", modes: {len(made.modes)}, default {made.mode}" if made.modes else ""
    about = f"{made.name}, {made.mass_kg / TONNE:.4g} t, {kmh(made.max_speed_mps):.4g} km/h{modes}"
    written.write(found.text, found.notes, about)
    tell(f"look at it: {typed('das-precompute')} show {written.out} --plot train.png")


def import_journey(
    feed: Annotated[Path, typer.Argument(metavar="FEED.zip", help="GTFS feed, as published (zip).")],
    choice: TripChoice,
    times: TimesRead,
    on: OnRoute,
    written: MadeFile,
) -> None:
    """Make a journey file from a trip of a GTFS feed.

    The trip is named by its id (--trip), or is the first from one stop to another at a time or later (--from, --to,
    --at); with --trip, --from and --to select a part of the trip. With --route, stops are found by their names, else by
    their places, within 500 m of the route; stops beyond its ends are left out. Without a route, positions are
    distances along the feed's shape.

    Public timetables are rounded and seldom state dwell times. Assumptions are printed and written in the
    file.
    """
    written.check(feed, on.route)
    from das.domain.files.reading import Fields
    from das.offline.asked_journey import journey_of
    from precompute.gtfs import read_trip
    from precompute.journey_import import journey_text, notes, placed

    line = on.line()
    with busy("reading the feed …"):
        found = read_trip(feed, choice)
    placement = placed(found, line)
    text = journey_text(found, placement, times, line, "das-precompute journey import")
    made = journey_of(Fields.of(feed, tomllib.loads(text)), line)
    way_km = (made.points[-1].position_m - made.points[0].position_m) / KM
    about = f"{made.name}, {len(made.calls)} stops, {way_km:.1f} km"
    written.write(text, notes(found, placement, times, line), about)
    tell(f"plan it: {typed('das-precompute')} journey {written.out} {on.words()}")
    named = f"--route {on.route or 'ROUTE'} --vehicle VEHICLE{' --reverse' if on.reverse else ''}"
    tell(f"drive it: {typed('das-sim')} example day.toml {named} --journey {written.out}")
