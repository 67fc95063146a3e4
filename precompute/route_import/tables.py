"""Tables of a line: CSV files with units in the names of their columns, and running paths of railtoolkit (YAML)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.earth import steps_m
from das.domain.errors import DasError, InputError
from das.domain.files.reading import MOST_BYTES, MOST_OF_A_NAME, in_si, number
from das.domain.files.ttobench import curvature_stretches
from das.domain.route import Route, Stop, Stretches, Tunnel, Zone
from das.domain.units import FACTORS, KM
from precompute.csv_table import CsvTable, read_csv
from precompute.route_import.line import ImportedLine, Words, made_route, stretches
from precompute.yaml_file import read_yaml

Floats = NDArray[np.float64]

MOST_ROWS: Final = 200_000
"""Largest number of rows of a table."""
QUANTITIES: Final = {
    **dict.fromkeys(("position", "altitude", "length", "radius", "radius_start", "radius_end"), "length"),
    "limit": "speed",
    "gradient": "gradient",
    "cross_section": "area",
    "latitude": "angle",
    "longitude": "angle",
}
"""The quantities that a column may hold, with their dimensions."""
ALIASES: Final = {
    **dict.fromkeys(("latitude", "lat"), "latitude_deg"),
    **dict.fromkeys(("longitude", "lon", "lng"), "longitude_deg"),
    **dict.fromkeys(("km", "kilometre", "kilometer", "chainage_km"), "position_km"),
    **dict.fromkeys(("chainage_m", "distance_m", "s_m"), "position_m"),
    **dict.fromkeys(("distance_km",), "position_km"),
    **dict.fromkeys(("maxspeed_kmh", "speed_kmh", "v_kmh", "speed_limit_kmh"), "limit_kmh"),
    **dict.fromkeys(("elevation_m", "ele_m", "ele", "height_m"), "altitude_m"),
    **dict.fromkeys(("slope_permille", "incline_permille"), "gradient_permille"),
    **dict.fromkeys(("stop", "station", "stop_name"), "name"),
}
"""Other names of columns that mean the same."""
REMARKS: Final = frozenset({"source", "note", "comment", "remark", "description", ""})
"""Columns that are not read."""
ENDLESS: Final = ("radius", "radius_start", "radius_end")
"""Quantities that may be infinite: the radius of a straight track."""
STRAIGHT: Final = frozenset({"inf", "infinity", "straight", "∞"})
RAILTOOLKIT: Final = "https://railtoolkit.org/schema/running-path"


@dataclass(frozen=True, kw_only=True)
class LineTable:
    """A table of a line: numbers in SI by quantity, and names, one for each row (None: an empty cell); its lines."""

    path: Path
    lines: tuple[int, ...]
    numbers: Mapping[str, tuple[float | None, ...]]
    names: tuple[str, ...] = ()

    def has(self, *quantities: str) -> bool:
        """Whether the table has all of these columns."""
        return all(quantity in self.numbers for quantity in quantities)

    def rows(self, *quantities: str) -> list[tuple[float, ...]]:
        """The rows that have a value for all of these quantities."""
        columns = zip(*(self.numbers[quantity] for quantity in quantities), strict=True)
        return [row for row in columns if None not in row]

    def error(self, row: int, quantity: str, value: object, expected: str) -> InputError:
        """An error that names the file, the line and the column."""
        return InputError(self.path, f"line {self.lines[row]} {quantity}", value, expected)


def read_table(path: Path) -> LineTable:
    """Read a CSV table or a running path (YAML); DasError or InputError (file, line, column, value) if it is unusable.

    The first line of a CSV file has the names of the columns, each with its unit: `position_km`, `limit_kmh`. Commas,
    semicolons or tabs separate cells; with semicolons and tabs a comma is a decimal sign. A cell may be empty.
    """
    return _running_path(path) if path.suffix.lower() in (".yaml", ".yml") else _csv_table(path)


def _csv_table(path: Path) -> LineTable:
    table = read_csv(path, MOST_BYTES, "a line of column names like position_km, limit_kmh")
    (first, header), *rows = table.rows
    columns = [_column(path, name) for name in header]
    read = [quantity for quantity, _ in columns if quantity not in REMARKS]
    if len(set(read)) < len(read):
        raise InputError(path, f"line {first}", table.joined(header), "each quantity once")
    if not rows or len(rows) > MOST_ROWS:
        raise InputError(path, "number of rows", len(rows), f"1 to {MOST_ROWS}")
    for line, row in rows:
        if len(row) != len(columns):
            raise InputError(path, f"line {line}", table.joined(row), f"{len(columns)} cells: {', '.join(header)}")
    numbers = {
        quantity: tuple(_value(path, line, (quantity, unit), row[i], table) for line, row in rows)
        for i, (quantity, unit) in enumerate(columns)
        if quantity in QUANTITIES
    }
    names = [i for i, (quantity, _) in enumerate(columns) if quantity == "name"]
    return LineTable(
        path=path,
        lines=tuple(line for line, _ in rows),
        numbers=numbers,
        names=tuple(_checked_name(path, line, row[names[0]]) for line, row in rows) if names else (),
    )


def _column(path: Path, name: str) -> tuple[str, str]:
    """Quantity and unit of a column; InputError for an unknown name."""
    plain = re.sub(r"[\s\[\]()]+", "_", name.strip().casefold()).strip("_")
    plain = ALIASES.get(plain, plain)
    if plain == "name" or plain in REMARKS:
        return plain, ""
    for quantity in sorted(QUANTITIES, key=len, reverse=True):
        unit = plain[len(quantity) + 1 :]
        if plain.startswith(f"{quantity}_") and unit in FACTORS[QUANTITIES[quantity]]:
            return quantity, unit
    known = "position_km, limit_kmh, gradient_permille, altitude_m, radius_m, length_m, cross_section_m2, latitude_deg"
    raise InputError(path, "column", name, f"a quantity with its unit, of {known}, longitude_deg; or name, source")


def _value(path: Path, line: int, column: tuple[str, str], cell: str, table: CsvTable) -> float | None:
    """A cell in SI; None for an empty one."""
    quantity, unit = column
    key = f"line {line} {quantity}"
    if not cell:
        return None
    if quantity in ENDLESS and cell.casefold().lstrip("-+") in STRAIGHT:
        return float("inf")
    value = table.number(cell)
    if value is None:
        raise InputError(path, key, cell, "a number")
    return in_si(path, key, value, (unit, QUANTITIES[quantity]), unbounded=quantity in ENDLESS)


def _checked_name(path: Path, line: int, name: str) -> str:
    if len(name) > MOST_OF_A_NAME or not name.isprintable():
        raise InputError(
            path, f"line {line} name", name, f"at most {MOST_OF_A_NAME} characters without control characters"
        )
    return name


def _running_path(path: Path) -> LineTable:
    """The path of a file of railtoolkit: rows of position (m), limit (km/h) and path resistance (‰, its gradient)."""
    fields = read_yaml(path)
    paths = fields.data.get("paths")
    if not isinstance(paths, list) or not str(fields.data.get("schema", RAILTOOLKIT)).startswith(RAILTOOLKIT):
        raise DasError(f"{path}: not a running path of railtoolkit, expected a list of paths")
    if len(paths) != 1 or not isinstance(paths[0], dict):
        raise InputError(path, "paths", len(paths), "one path in a file")
    rows: Any = paths[0].get("characteristic_sections")
    if not isinstance(rows, list) or not 2 <= len(rows) <= MOST_ROWS:
        raise InputError(path, "paths[0].characteristic_sections", rows, f"2 to {MOST_ROWS} rows")
    columns = {"position": ("m", "length"), "limit": ("kmh", "speed"), "gradient": ("permille", "gradient")}
    numbers: dict[str, list[float | None]] = {name: [] for name in columns}
    for i, row in enumerate(rows):
        key = f"paths[0].characteristic_sections[{i}]"
        if not isinstance(row, list) or len(row) != len(columns):
            raise InputError(path, key, row, "position in m, limit in km/h, path resistance in ‰")
        for (name, unit), value in zip(columns.items(), row, strict=True):
            numbers[name].append(in_si(path, f"{key} {name}", number(path, key, value), unit))
    found = {name: tuple(values) for name, values in numbers.items()}
    return LineTable(path=path, lines=tuple(range(len(rows))), numbers=found)


def line_from_tables(
    tables: Sequence[LineTable], words: Words, *, ends: tuple[str, str], length_m: float | None
) -> ImportedLine:
    """A line from tables that together have limits and anything else; it is flat if none has gradients.

    `ends` name the first and last stop where the tables have no stops. `length_m` is the length of the line; None: it
    ends at its last stop, or else with the last row of the tables. Raises DasError or InputError for tables that do not
    fit.
    """
    source = ", ".join(str(table.path) for table in tables)
    tables = [_with_positions(table, length_m) for table in tables]
    stops = _stops(tables)
    whole_m = _length_m(tables, stops) if length_m is None else length_m
    if not stops:
        stops = [Stop(name=name, position_m=x) for name, x in zip(ends, (0.0, whole_m), strict=True)]
    route = made_route(words, stops, whole_m, source, one_way=True)
    limits = _steps(tables, "limit", whole_m)
    if limits is None:
        raise DasError(f"{source}: no column of limits, expected limit_kmh beside position_km")
    gradients = _steps(tables, "gradient", whole_m)
    route = replace(
        route,
        limits_mps=limits,
        curvature_per_m=_curves(tables, whole_m) or route.curvature_per_m,
        **_zones(tables),
        **_geometry(tables, route),
    )
    if gradients is not None:
        route = replace(route, gradients_ratio=gradients, altitudes=None)
    count = 0 if gradients is None else len(gradients.value)
    about = f"Limits: {len(route.limits_mps.value)} stretches; gradients: {count}."
    line = ImportedLine(route=route, has_gradients=gradients is not None)
    line = replace(line, structures=tuple(Zone(start_m=x.start_m, length_m=x.length_m) for x in route.tunnels))
    return line.with_remarks(about, "The tables are those of one direction: the line is one_way.")


def points_of(table: LineTable) -> list[tuple[int, tuple[float, ...]]]:
    """Row and values (latitude, longitude) of a table with coordinates."""
    pairs = zip(table.numbers["latitude"], table.numbers["longitude"], strict=True)
    return [(i, row) for i, row in enumerate(pairs) if None not in row]  # type: ignore[misc]


def check_coordinates(table: LineTable) -> None:
    """Raise InputError for the first latitude beyond ±90° or longitude beyond ±180°."""
    for name, most in (("latitude", 90.0), ("longitude", 180.0)):
        for i, value in enumerate(table.numbers.get(name, ())):
            if value is not None and abs(value) > most:
                raise table.error(i, name, value, f"{-most:g} to {most:g} degrees")


def _with_positions(table: LineTable, length_m: float | None) -> LineTable:
    """The table with positions: those of a polyline alone are the lengths along it, up to the length of the line."""
    check_coordinates(table)
    if table.has("position"):
        values = [(i, value) for i, value in enumerate(table.numbers["position"]) if value is not None]
        for (_, before), (i, value) in pairwise(values):
            if value <= before:
                raise table.error(i, "position", f"{value:g} m", f"more than {before:g} m: rows rise along the line")
        if values and values[0][1] < 0:
            raise table.error(values[0][0], "position", f"{values[0][1]:g} m", "a position >= 0 m")
        return table
    if not table.has("latitude", "longitude"):
        raise DasError(f"{table.path}: no column of positions, expected position_km or position_m")
    points = np.array([row for _, row in points_of(table)])
    if len(points) != len(table.lines) or len(points) < 2:
        raise DasError(
            f"{table.path}: without positions every row needs latitude and longitude, and there are two or more"
        )
    at_m = np.concatenate(([0.0], np.cumsum(steps_m(points[:, 0], points[:, 1]))))
    scale = 1.0 if length_m is None else length_m / at_m[-1]
    return replace(table, numbers={**table.numbers, "position": tuple((scale * at_m).tolist())})


def _stops(tables: Sequence[LineTable]) -> list[Stop]:
    """The stops: rows with a name and a position, in order."""
    stops: list[Stop] = []
    for table in tables:
        for i, name in enumerate(table.names):
            at_m = table.numbers["position"][i]
            if name and at_m is not None:
                place = [table.numbers.get(key, (None,) * (i + 1))[i] for key in ("latitude", "longitude")]
                latitude, longitude = place if None not in place else (None, None)
                stops.append(Stop(name=name, position_m=at_m, latitude_deg=latitude, longitude_deg=longitude))
    return sorted(stops, key=lambda stop: stop.position_m)


def _length_m(tables: Sequence[LineTable], stops: Sequence[Stop]) -> float:
    ends = [at_m for table in tables for at_m in table.numbers["position"] if at_m is not None]
    ends += [a + b for table in tables if table.has("length") for a, b in table.rows("position", "length")]
    return stops[-1].position_m if len(stops) > 1 else max(ends)


def _steps(tables: Sequence[LineTable], quantity: str, length_m: float) -> Stretches | None:
    """A quantity that holds from a row to the next, of the one table that has it; None if none has."""
    having = [table for table in tables if table.has(quantity)]
    if not having:
        return None
    if len(having) > 1:
        raise DasError(f"{having[0].path}, {having[1].path}: both have {quantity}s, expected one table of them")
    rows = having[0].rows("position", quantity)
    if not rows or rows[0][0] > 0:
        first = f"{rows[0][0] / KM:g} km" if rows else "none"
        raise InputError(having[0].path, f"first position of {quantity}", first, "0 km, so that the line is covered")
    return stretches([row[0] for row in rows], [row[1] for row in rows], length_m)


def _curves(tables: Sequence[LineTable], length_m: float) -> Stretches | None:
    for table in tables:
        if table.has("radius_start", "radius_end"):
            rows = [list(row) for row in table.rows("position", "radius_start", "radius_end")]
        elif table.has("radius"):
            rows = [[at_m, radius, radius] for at_m, radius in table.rows("position", "radius")]
        else:
            continue
        rows = rows if rows and rows[0][0] == 0 else [[0.0, np.inf, np.inf], *rows]
        inside = [row for row in rows if row[0] < length_m]
        return curvature_stretches(str(table.path), inside)
    return None


def _zones(tables: Sequence[LineTable]) -> dict[str, Any]:
    """Tunnels, neutral sections and zones without regeneration; the name of a file tells the latter two."""
    found: dict[str, tuple[Zone, ...]] = {}
    for table in (one for one in tables if one.has("length")):
        stem = table.path.stem.casefold()
        if table.has("cross_section"):
            rows = table.rows("position", "length", "cross_section")
            found["tunnels"] = tuple(Tunnel(start_m=a, length_m=b, area_m2=c) for a, b, c in rows)
        elif "neutral" in stem or "regeneration" in stem:
            key = "neutral_sections" if "neutral" in stem else "no_regeneration"
            found[key] = tuple(Zone(start_m=a, length_m=b) for a, b in table.rows("position", "length"))
        else:
            expected = "cross_section_m2 as well (tunnels), or a name of the file with neutral or no_regeneration in it"
            raise DasError(f"{table.path}: positions with lengths, expected {expected}")
    return found


def _geometry(tables: Sequence[LineTable], route: Route) -> dict[str, Any]:
    """The geometry: the coordinates of a table without names."""
    for table in tables:
        if table.has("latitude", "longitude") and not table.names:
            rows = np.array(table.rows("position", "latitude", "longitude"))
            rows = rows[rows[:, 0] <= route.length_m + 1e-6]
            names = ("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg")
            return {name: column.copy() for name, column in zip(names, rows.T, strict=True)}
    return {}


def altitude_rows(table: LineTable) -> list[tuple[int, float]]:
    """Row and altitude (m) of each row of a table that has one."""
    return [(i, value) for i, value in enumerate(table.numbers.get("altitude", ())) if value is not None]
