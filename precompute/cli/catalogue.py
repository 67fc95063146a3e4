"""The commands `das-precompute catalogue` and `das-precompute loss-map`."""

from __future__ import annotations

import contextlib
import json
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import busy, new_table, paragraph, print_table, tell
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.units import KM, KMH, KW, TONNE
from precompute.cli.files import MapFiles

if TYPE_CHECKING:
    from das.domain.losses import LossMap
    from das.domain.vehicle import Vehicle

SHOWN_OF_A_SOURCE = 300
"""Number of characters of a file's source that are printed; --json gives all of them."""
LEGEND = {"levels": "loss levels the vehicle has data for, its default first (docs/explanation/loss-maps.md)"}


def catalogue(as_json: JsonOption = False) -> None:
    """List the bundled routes and vehicles.

    Each is shown with its id, which is the word to give to the other commands, and with the source of its figures. The
    files can be copied and changed: a route or vehicle of your own is a file like them. --json gives the sources in
    full.
    """
    from das.domain.files import load

    routes = [_route(name, path) for name, path in load.catalogue("routes").items()]
    vehicles = [_vehicle(name, path) for name, path in load.catalogue("vehicles").items()]
    if as_json:
        print(json.dumps({"routes": routes, "vehicles": vehicles}))
        return
    _print_routes(routes)
    _print_vehicles(vehicles)
    for one in (*routes, *vehicles):
        paragraph(f"{one['id']}: {_beginning(one['source'])}", hanging="  ")
        tell(f"  {one['file']}")


def _route(name: str, path: Path) -> dict[str, Any]:
    from das.command_line.files import load_route

    route = load_route(name)
    return {
        "id": route.id,
        "name": route.name,
        "illustrative": route.illustrative,
        "length_m": route.length_m,
        "stops": [{"name": stop.name, "position_m": stop.position_m} for stop in route.stops],
        "source": _source(path, "route"),
        "file": str(path),
    }


def _vehicle(name: str, path: Path) -> dict[str, Any]:
    from das.command_line.files import load_vehicle

    vehicle = load_vehicle(name)
    levels, default = _levels(vehicle), str(vehicle.default_level)
    return {
        "id": vehicle.id,
        "name": vehicle.name,
        "mass_kg": vehicle.mass_kg,
        "length_m": vehicle.train_length_m,
        "max_power_w": vehicle.traction.max_power_w,
        "max_speed_mps": vehicle.max_speed_mps,
        "levels": [default, *(level for level in levels if level != default)],
        "loads": list(vehicle.loads),
        "source": _source(path, "vehicle"),
        "file": str(path),
    }


def _levels(vehicle: Vehicle) -> list[str]:
    """The loss levels that a vehicle has data for."""
    found = []
    for level in Level:
        with contextlib.suppress(DasError):
            vehicle.loss_model(level)
            found.append(str(level))
    return found


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


MAP_LEGEND = {
    "fit": "level whose constant efficiency is fitted to the map",
    "idle": "constant loss of the fit",
    "mean/in": "mean deviation of the fit, relative to the mean input power",
    "mean/max, rms/max": "mean and root mean square deviation, relative to the largest loss",
    "cruising": "mean of (map − fit)/fit at 40 to 160 km/h on the level, |cruising| of its magnitude",
}


def loss_map(
    source: Annotated[
        str, typer.Argument(metavar="VEHICLE|MAP.csv", help="Bundled vehicle, vehicle file, or loss map (CSV).")
    ],
    files: MapFiles,
    vehicle: Annotated[
        str | None,
        typer.Option("--vehicle", metavar="VEHICLE", help="Train whose forces bound a CSV map [default: re460-ic]."),
    ] = None,
) -> None:
    """Describe a loss map: coverage, fits of L1 and L2 with their errors, best efficiency, largest losses."""
    files.check(source, vehicle)
    from das.domain.files.writing import write_whole
    from precompute.loss_maps import csv_bytes, loss_map_summary, map_of

    model, train = map_of(source, vehicle)
    summary = loss_map_summary(model, train)
    if files.plot is not None:
        from precompute.loss_maps import draw_maps

        with busy("drawing …"):
            draw_maps(files.plot, model, train)
    if files.out is not None:
        write_whole(files.out, csv_bytes(model))
    if files.as_json:
        print(json.dumps(summary))
        return
    _print_facts(model, train, summary)
    _print_fits(summary)
    files.tell()


def _print_facts(model: LossMap, train: Vehicle, summary: dict[str, Any]) -> None:
    cover = summary["coverage"]
    (slow, fast), (least, most) = cover["speed_kmh"], cover["force_kn"]
    tell(f"{model.name}\ncovers {slow:g} … {fast:g} km/h, {least:g} … {most:g} kN")
    tell(f"{cover['operating_points']} operating points within {train.traction.max_power_w / KW:g} kW of {train.id}")
    full = [f"{name} {loss:.0f} kW" for name, loss in summary["full_power_loss_kw"].items() if loss is not None]
    tell(f"largest loss {summary['largest_loss_kw']:.0f} kW; mean at full power: {', '.join(full) or 'none'}")
    for name, best in summary["best"].items():
        if best is not None:
            tell(
                f"best efficiency {name}: {best['efficiency_ratio']:.1%} at {best['speed_kmh']:.0f} km/h, "
                f"{best['force_kn']:.0f} kN ({best['power_share_ratio']:.0%} of the power)"
            )


def _print_fits(summary: dict[str, Any]) -> None:
    errors = ("mean/in\n%", "mean/max\n%", "rms/max\n%", "cruising\n%", "|cruising|\n%")
    table = new_table("", (), ("fit", "mean\nefficiency", "idle\nkW", *errors))
    for level, fit in summary["fits"].items():
        cruising, absolute = fit["cruising_deviation_ratio"], fit["cruising_absolute_deviation_ratio"]
        table.add_row(
            level,
            f"{fit['mean_efficiency_ratio']:.4f}",
            f"{fit['idle_kw']:.1f}",
            *(
                f"{100 * fit[f'error_{name}_ratio']:.2f}"
                for name in ("mean_to_input", "mean_to_largest", "rms_to_largest")
            ),
            f"{100 * cruising:+.2f}" if cruising is not None else "–",
            f"{100 * absolute:.2f}" if absolute is not None else "–",
        )
    print_table(table, MAP_LEGEND)
