"""The bundled routes and vehicles, as `das-precompute show` lists them."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from das.command_line.files import load_route, load_vehicle
from das.command_line.printing import new_table, paragraph, print_table, tell
from das.domain.files.load import catalogue
from das.domain.units import KM, KMH, KW, TONNE
from precompute.cli import route_report, vehicle_report

SHOWN_OF_A_SOURCE = 300
"""Number of characters of a file's source that are printed; --json gives all of them."""
LEGEND = {"levels": "loss levels the vehicle has data for, its default first (docs/explanation/loss-maps.md)"}


def print_catalogue(*, as_json: bool) -> None:
    """Print the bundled routes and vehicles, each with its id, which commands take, and the source of its figures.

    JSON has the sources in full.
    """
    routes = [_route(name, path) for name, path in catalogue("routes").items()]
    vehicles = [_vehicle(name, path) for name, path in catalogue("vehicles").items()]
    if as_json:
        print(json.dumps({"routes": routes, "vehicles": vehicles}))
        return
    _print_routes(routes)
    _print_vehicles(vehicles)
    for one in (*routes, *vehicles):
        paragraph(f"{one['id']}: {_beginning(one['source'])}", hanging="  ")
        tell(f"  {one['file']}")


def _route(name: str, path: Path) -> dict[str, Any]:
    return {**route_report.as_dict(load_route(name)), "source": _source(path, "route"), "file": str(path)}


def _vehicle(name: str, path: Path) -> dict[str, Any]:
    return {**vehicle_report.as_dict(load_vehicle(name)), "source": _source(path, "vehicle"), "file": str(path)}


def _source(path: Path, table: str) -> str:
    """Where a file's figures come from, in one line: its source, else its description."""
    main = tomllib.loads(path.read_text(encoding="utf-8"))[table]
    return " ".join(str(main.get("source") or main.get("description") or "").split())


def _beginning(source: str) -> str:
    """Whole sentences from the beginning of a source."""
    if len(source) <= SHOWN_OF_A_SOURCE:
        return source
    whole, end, _ = source[:SHOWN_OF_A_SOURCE].rpartition(". ")
    return f"{whole}{end.strip()} …"


def _print_routes(routes: list[dict[str, Any]]) -> None:
    table = new_table("routes", ("id", "name"), ("km",))
    table.columns[0].no_wrap = True
    table.add_column("stops")
    for route in routes:
        stops = ", ".join(stop["name"] for stop in route["stops"])
        table.add_row(route["id"], route["name"], f"{route['length_m'] / KM:.1f}", stops)
    print_table(table)


def _print_vehicles(vehicles: list[dict[str, Any]]) -> None:
    table = new_table("vehicles", ("id", "name"), ("t", "m", "kW", "km/h"))
    table.columns[0].no_wrap = True
    table.add_column("levels")
    for vehicle in vehicles:
        table.add_row(
            vehicle["id"],
            vehicle["name"],
            f"{vehicle['mass_kg'] / TONNE:.0f}",
            f"{vehicle['length_m']:.0f}",
            f"{vehicle['max_power_w'] / KW:.0f}",
            f"{vehicle['max_speed_mps'] / KMH:.0f}",
            " ".join(vehicle["levels"]),
        )
    print_table(table, LEGEND)
