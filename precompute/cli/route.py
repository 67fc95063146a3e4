"""The commands `das-precompute route import`, `show`, `check`, `merge` and `new`."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.application import Entry
from das.command_line.files import load_route
from das.command_line.options import JsonOption, RouteArgument
from das.command_line.printing import busy, new_table, paragraph, print_table, tell
from das.domain.errors import DasError
from das.domain.units import KM, KMH, PERMILLE, kmh
from precompute.cli.files import ShownFiles, TableFiles, end_check
from precompute.route_import.order import FASTEST_KMH, ImportOrder, Words

if TYPE_CHECKING:
    from das.domain.route import Route
    from precompute.route_import.line import ImportedLine

COMMANDS = (
    Entry(
        name="import",
        where="precompute.cli.route:import_route",
        summary="Make a route from a map of OpenStreetMap, or from tables of limits, gradients, curves and stops.",
        examples=(
            "das-precompute route import tracks.geojson --from A --to B --flat -o my.toml",
            "das-precompute route import limits.csv --altitudes heights.csv -o my.toml",
        ),
    ),
    Entry(
        name="show",
        where="precompute.cli.route:show",
        summary="Show a route: stops, limits, gradients, curves, tunnels, origin of the data; --plot draws it.",
        examples=("das-precompute route show zurich-luzern --plot line.png",),
    ),
    Entry(
        name="check",
        where="precompute.cli.route:check",
        summary="Check a route: warnings for unusual values, notes for missing data.",
        examples=("das-precompute route check my.toml",),
    ),
    Entry(
        name="merge",
        where="precompute.cli.route:merge",
        summary="Merge routes of one line and direction: limits from one file, gradients from another.",
        examples=("das-precompute route merge my.toml --gradients heights.toml -o whole.toml",),
    ),
    Entry(
        name="new",
        where="precompute.cli.route:new",
        summary="Write the file of a flat line with one limit, to fill in by hand.",
        examples=("das-precompute route new Adorf=0 Bestadt=12.5 --limit 120 -o my.toml",),
    ),
)
"""The commands of `das-precompute route`."""


@dataclass(frozen=True, kw_only=True)
class RouteFiles(TableFiles):
    """The file of a route that a command writes, and its picture."""

    suffix = ".toml"
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Route to write (.toml).")] = field()

    def write(self, line: ImportedLine) -> None:
        """Write the route and its picture, and print what it is and what was assumed."""
        from das.domain.files.writing import write_whole
        from precompute.route_import.route_file import route_toml

        write_whole(self.out, route_toml(line.route, line.remarks).encode())
        route = load_route(str(self.out))
        if self.plot is not None:
            _draw(self.plot, route)
        if self.as_json:
            print(json.dumps({**route_json(route), "remarks": list(line.remarks), "file": str(self.out)}))
            return
        _print_route(route)
        for remark in line.remarks:
            paragraph(remark)
        self.tell()


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

    From a map comes the way of a train between two stations: it never reverses, never turns by more than 40°, and
    avoids sidings and the track of the other direction. Names of stations are found without regard to case and accents.
    Limits are those of the direction, so the route is one_way: import the other direction as well.

    Tables are CSV files whose columns have their units in their names (position_km, limit_kmh, gradient_permille,
    altitude_m, radius_m, length_m with cross_section_m2, name, latitude_deg, longitude_deg); what a file has in its
    columns is what it is. A row holds until the next one.

    Without altitudes energies are wrong by up to a third, so a line without them needs --flat.
    """
    written.check(*files, order.altitudes)
    stated.check()
    with busy("importing …"):
        from precompute.route_import.importing import imported

        line = imported(files, order, stated)
    written.write(line)


def show(route: RouteArgument, files: ShownFiles) -> None:
    """Show a route: stops, limits, gradients, curves, tunnels, origin of the data; --plot draws it.

    The picture has limits, altitude, gradients, curves, tunnels and stops over the position, and the course of the line
    on a map without a background.
    """
    files.check(route)
    line = load_route(route)
    if files.plot is not None:
        _draw(files.plot, line)
    if files.as_json:
        print(json.dumps(route_json(line)))
        return
    _print_route(line)
    files.tell()


def check(route: RouteArgument, as_json: JsonOption = False) -> None:
    """Check a route: warnings for unusual values, notes for missing data.

    The exit code is 0 without warnings, 1 with warnings, and 2 if the file cannot be used.
    """
    from das.domain.files.load import load_route as read
    from precompute.route_import.checks import findings_of

    found = findings_of(read(route))

    def show() -> None:
        for kind, texts in (("warning", found.warnings), ("note", found.notes)):
            for text in texts:
                paragraph(f"{kind}: {text}", hanging="  ")
        tell(f"{len(found.warnings)} warnings, {len(found.notes)} notes")

    end_check(found.warnings, show, as_json=as_json, notes=found.notes)


@dataclass(frozen=True, kw_only=True)
class TakenFrom:
    """From which other route each quantity is taken; None: from the first."""

    limits: Annotated[str | None, typer.Option(metavar="ROUTE", help="Take the limits of this route.")] = None
    gradients: Annotated[
        str | None, typer.Option(metavar="ROUTE", help="Take gradients and altitudes of this route.")
    ] = None
    curves: Annotated[str | None, typer.Option(metavar="ROUTE", help="Take the curves of this route.")] = None
    tunnels: Annotated[str | None, typer.Option(metavar="ROUTE", help="Take the tunnels of this route.")] = None
    stops: Annotated[str | None, typer.Option(metavar="ROUTE", help="Take the stops of this route.")] = None
    geometry: Annotated[str | None, typer.Option(metavar="ROUTE", help="Take the geometry of this route.")] = None
    supply: Annotated[
        str | None,
        typer.Option(metavar="ROUTE", help="Take receptivity, neutral sections and zones without regeneration."),
    ] = None

    def given(self) -> dict[str, str]:
        """The routes that are given, by what is taken of each."""
        return {name: value for name, value in vars(self).items() if value is not None}


def merge(route: RouteArgument, taken: TakenFrom, stated: Words, written: RouteFiles) -> None:
    """Merge routes of one line and direction: limits from one file, gradients from another.

    Lengths may differ by up to 2 %: positions of the other route are then scaled, and the file says so. Sources and
    licences of all are kept. The result is one_way if a part that depends on the direction is.
    """
    from precompute.route_import.merging import merged

    parts = taken.given()
    if not parts:
        raise DasError("route merge: nothing to take from another route; give --limits, --gradients, … ROUTE")
    written.check(route, *parts.values())
    base = load_route(route)
    stated.check()
    written.write(merged(base, {what: load_route(name) for what, name in parts.items()}, stated))


def new(
    stops: Annotated[
        list[str], typer.Argument(metavar="NAME=KM", help="Stops with their positions: Adorf=0 Bestadt=12.5.")
    ],
    written: RouteFiles,
    stated: Words,
    limit_kmh: Annotated[
        float, typer.Option("--limit", metavar="KMH", min=1.0, max=FASTEST_KMH, help="Limit of the whole line.")
    ],
) -> None:
    """Write the file of a flat line with one limit, to fill in by hand."""
    from precompute.route_import.merging import new_line

    written.check()
    stated.check()
    written.write(new_line(stops, limit_kmh * KMH, stated))


def _draw(path: Path, route: Route) -> None:
    with busy("drawing …"):
        from precompute.drawing.line import draw_line

        draw_line(route).save(path, overwrite=True)


def route_json(route: Route) -> dict[str, Any]:
    """A route in figures, as `--json` prints it."""
    from precompute.route_import.altitudes import climb_and_fall_m

    climb_m, fall_m = climb_and_fall_m(route)
    gradients = route.gradients_ratio.value / PERMILLE
    curves = route.curvature_per_m.value
    return {
        "id": route.id,
        "name": route.name,
        "length_m": route.length_m,
        "stops": [{"name": stop.name, "position_m": stop.position_m} for stop in route.stops],
        "limits": len(route.limits_mps.value),
        "lowest_limit_kmh": float(kmh(route.limits_mps.value.min())),
        "highest_limit_kmh": float(kmh(route.limits_mps.value.max())),
        "gradients": len(gradients),
        "steepest_up_permille": max(float(gradients.max()), 0.0),
        "steepest_down_permille": min(float(gradients.min()), 0.0),
        "climb_m": climb_m,
        "fall_m": fall_m,
        "altitudes": route.altitudes and str(route.altitudes),
        "smallest_radius_m": 1.0 / float(curves.max()) if curves.max() > 0 else None,
        "tunnels": len(route.tunnels),
        "tunnels_m": sum(tunnel.length_m for tunnel in route.tunnels),
        "geometry_points": len(route.geometry_position_m),
        "one_way": route.one_way,
        "time_zone": route.time_zone,
        "source": route.data_source,
        "licence": route.licence,
    }


def _print_route(route: Route) -> None:
    found = route_json(route)
    table = new_table(f"{route.id}: {route.name}", ("", ""), ())
    table.show_header, table.columns[0].no_wrap = False, True
    radius_m = found["smallest_radius_m"]
    rows = {
        "length": f"{route.length_m / KM:.3f} km, {'one way' if route.one_way else 'both ways'}",
        "stops": ", ".join(f"{stop.name} ({stop.position_m / KM:.3f})" for stop in route.stops),
        "limits": f"{found['limits']}: {found['lowest_limit_kmh']:.0f} to {found['highest_limit_kmh']:.0f} km/h",
        "gradients": (
            f"{found['gradients']}: {found['steepest_up_permille']:+.1f} to {found['steepest_down_permille']:+.1f} ‰, "
            f"climb {found['climb_m']:.1f} m, fall {found['fall_m']:.1f} m"
        ),
        "curves": "none" if radius_m is None else f"{len(route.curvature_per_m.value)}: radius from {radius_m:.0f} m",
        "tunnels": f"{found['tunnels']}, {found['tunnels_m'] / KM:.2f} km" if found["tunnels"] else "none",
        "geometry": f"{found['geometry_points']} points" if found["geometry_points"] else "none",
        "data": route.credit or "source and licence not stated",
    }
    for name, text in rows.items():
        table.add_row(name, text)
    print_table(table)
