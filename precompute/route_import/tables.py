"""Tables of a line: CSV files with units in the names of their columns, and running paths of railtoolkit (YAML)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import MOST_BYTES, MOST_OF_A_NAME, in_si, number
from das.domain.files.routes import curvature_stretches
from das.domain.route import POSITION_TOLERANCE_M, Floats, Route, Stop, Stretches, Tunnel, Zone
from das.domain.units import FACTORS, KM
from precompute.foreign_text import CsvTable, read_csv, read_yaml
from precompute.polylines import along_m, projected_in_order
from precompute.route_import.line import DECIMALS, ImportedLine, Words, made_route, stretches

MOST_ROWS: Final = 200_000
"""Largest number of rows of a table."""
SHORTEST_M: Final = 1.0
"""Least length (m) of a line from tables; a shorter one could vanish in rounding."""
OFF_COURSE_M: Final = 500.0
"""Largest distance (m) of coordinates from the course of the line to which they belong."""
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
    **dict.fromkeys(("km", "kilometre", "kilometer", "chainage_km", "distance_km"), "position_km"),
    **dict.fromkeys(("chainage_m", "distance_m", "s_m"), "position_m"),
    **dict.fromkeys(("maxspeed_kmh", "speed_kmh", "v_kmh", "speed_limit_kmh"), "limit_kmh"),
    **dict.fromkeys(("elevation_m", "ele_m", "ele", "height_m"), "altitude_m"),
    **dict.fromkeys(("slope_permille", "incline_permille"), "gradient_permille"),
    **dict.fromkeys(("stop", "station", "stop_name"), "name"),
}
"""Alternative names of columns."""
REMARKS: Final = frozenset({"source", "note", "comment", "remark", "description", ""})
"""Columns that are not read."""
ENDLESS: Final = ("radius", "radius_start", "radius_end")
"""Quantities that may be infinite: the radius of a straight track."""
STRAIGHT: Final = frozenset({"inf", "infinity", "straight", "∞"})
Course = tuple[Floats, Floats, Floats]
"""The course of a line: position (m), latitude and longitude (deg) of each vertex."""
RAILTOOLKIT: Final = "https://railtoolkit.org/schema/running-path"


@dataclass(frozen=True, kw_only=True)
class LineTable:
    """A table of a line: for each row its line in the file, numbers (SI) by quantity (None: empty cell), and a name."""

    path: Path
    lines: tuple[int, ...]
    numbers: Mapping[str, tuple[float | None, ...]]
    names: tuple[str, ...] = ()

    def has(self, *quantities: str) -> bool:
        """Whether the table has all of these columns."""
        return all(quantity in self.numbers for quantity in quantities)

    def cell(self, row: int, quantity: str) -> float | None:
        """The value of a quantity in a row; None for an empty cell, or if there is no such column."""
        return self.numbers[quantity][row] if quantity in self.numbers else None

    def numbered(self, *quantities: str) -> list[tuple[int, tuple[float, ...]]]:
        """Index and values of each row that has a value for all of these quantities; empty if a column is missing."""
        columns = zip(*(self.numbers.get(quantity, ()) for quantity in quantities), strict=self.has(*quantities))
        whole = ((i, tuple(value for value in row if value is not None)) for i, row in enumerate(columns))
        return [(i, row) for i, row in whole if len(row) == len(quantities)]

    def rows(self, *quantities: str) -> list[tuple[float, ...]]:
        """The values of each row that has a value for all of these quantities."""
        return [row for _, row in self.numbered(*quantities)]

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
        expected = f"at most {MOST_OF_A_NAME} characters without control characters"
        raise InputError(path, f"line {line} name", name, expected)
    return name


def _running_path(path: Path) -> LineTable:
    """The path in a file of railtoolkit: position (m), limit (km/h) and path resistance (‰), read as the gradient."""
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
    """A line from tables, one of which has limits; it is flat if none has gradients.

    `ends` name the first and last stop if the tables have no stops. `length_m` is the length of the line; None: it ends
    at its last stop, or else with the last row of the tables. Raises DasError or InputError for tables that do not fit.
    """
    source = ", ".join(str(table.path) for table in tables)
    tables, course = _in_one_frame(tables, length_m)
    stops = _stops(tables)
    whole_m = _length_m(tables, stops) if length_m is None else length_m
    if whole_m < SHORTEST_M:
        raise InputError(tables[0].path, "length of the line", f"{whole_m:g} m", f"{SHORTEST_M:g} m or more")
    if not stops:
        stops = [Stop(name=name, position_m=x) for name, x in zip(ends, (0.0, whole_m), strict=True)]
    route = made_route(words, stops, whole_m, source, one_way=True)
    limits = _steps(tables, "limit", whole_m)
    if limits is None:
        raise DasError(f"{source}: no column of limits, expected limit_kmh and position_km")
    gradients = _steps(tables, "gradient", whole_m)
    route = replace(
        route,
        limits_mps=limits,
        curvature_per_m=_curves(tables, whole_m) or route.curvature_per_m,
        **_zones(tables),
        **_geometry(course, route),
    )
    if gradients is not None:
        route = replace(route, gradients_ratio=gradients, altitudes=None)
    count = 0 if gradients is None else len(gradients.value)
    return ImportedLine(route=route, structures=route.tunnels).with_remarks(
        f"Limits: {len(route.limits_mps.value)} stretches; gradients: {count}.",
        "The tables are those of one direction: the line is one_way.",
    )


def check_coordinates(table: LineTable) -> None:
    """Raise InputError for the first latitude beyond ±90° or longitude beyond ±180°."""
    for name, most in (("latitude", 90.0), ("longitude", 180.0)):
        for i, (value,) in table.numbered(name):
            if abs(value) > most:
                raise table.error(i, name, value, f"{-most:g} to {most:g} degrees")


def _in_one_frame(tables: Sequence[LineTable], length_m: float | None) -> tuple[list[LineTable], Course | None]:
    """The tables with a position in every row that has a value, and the course of the line.

    Rows without a position are projected on the course by their coordinates; the course is a table of coordinates
    without names. If it has no positions, they are computed as lengths along it, scaled to the length of the line if
    that is given.
    """
    for table in tables:
        check_coordinates(table)
    lines = [table for table in tables if table.rows("latitude", "longitude") and not table.names]
    measured = [table for table in lines if table.rows("position", "latitude", "longitude")]
    plain = [table for table in lines if table.numbers.keys() == {"latitude", "longitude"}]
    course = next(iter(measured or plain or lines), None)
    if not measured and len(plain or lines) > 1:
        raise DasError(f"{', '.join(str(x.path) for x in plain or lines)}: each may be the course, expected only one")
    along = None if course is None or measured else _with_lengths(course, length_m)
    ready = [along if along is not None and table is course else table for table in tables]
    on = _course(course if along is None else along)
    return [_with_positions(table, on) for table in ready], on


def _course(table: LineTable | None) -> Course | None:
    """Position (m), latitude and longitude (deg) of a table's rows; None if no row has all three."""
    rows = [] if table is None else table.rows("position", "latitude", "longitude")
    if not rows:
        return None
    at_m, latitude, longitude = np.array(rows).T
    return at_m, latitude, longitude


def _with_lengths(course: LineTable, length_m: float | None) -> LineTable:
    """A course whose positions are the lengths along it, or these lengths scaled to the length of the line (m)."""
    points = np.array(course.rows("latitude", "longitude"))
    if len(points) < len(course.lines) or not (points[1:] != points[:1]).any():
        needs = "a course without positions needs coordinates in every row, and at least two different places"
        raise DasError(f"{course.path}: {needs}")
    lengths_m = along_m(*points.T)
    scale = 1.0 if length_m is None else length_m / lengths_m[-1]
    return replace(course, numbers={**course.numbers, "position": tuple((scale * lengths_m).tolist())})


def _with_positions(table: LineTable, course: Course | None) -> LineTable:
    """The table with a position in each row that has a value; InputError if one is missing or they do not rise."""
    if not table.has("position") and not table.has("latitude", "longitude"):
        raise DasError(f"{table.path}: no column of positions, expected position_km or position_m")
    given = [table.cell(i, "position") for i in range(len(table.lines))]
    columns = [values for name, values in table.numbers.items() if name != "position"]
    used = [any(one[i] is not None for one in columns) or any(table.names[i : i + 1]) for i in range(len(given))]
    lacking = [i for i, at_m in enumerate(given) if at_m is None and used[i]]
    found_m = dict(zip(lacking, _projected(table, lacking, course), strict=True)) if lacking else {}
    at_m = tuple(found_m.get(i, value) for i, value in enumerate(given))
    whole = replace(table, numbers={**table.numbers, "position": at_m})
    positions = whole.numbered("position")
    if not positions:
        raise DasError(f"{table.path}: no row has a position")
    for (_, (before_m,)), (i, (here_m,)) in pairwise(positions):
        if here_m <= before_m:
            raise table.error(i, "position", f"{here_m:g} m", f"more than {before_m:g} m: positions must rise")
    first, (start_m,) = positions[0]
    if start_m < 0:
        raise table.error(first, "position", f"{start_m:g} m", "a position >= 0 m")
    return whole


def _projected(table: LineTable, rows: Sequence[int], course: Course | None) -> list[float]:
    """The positions (m) of rows on a course by their coordinates; InputError for a row without any or far away."""
    places = [[table.cell(i, name) for name in ("latitude", "longitude")] for i in rows]
    for i, place in zip(rows, places, strict=True):
        if None in place:
            raise table.error(i, "position", MISSING, "a position, or latitude and longitude, for the other values")
    if course is None or len(course[0]) < 2:
        expected = "a position, or a table of latitude_deg and longitude_deg: the course of the line"
        raise table.error(rows[0], "position", MISSING, expected)
    found = projected_in_order(course, np.array(places, dtype=float), OFF_COURSE_M)
    for i, off_m in zip(rows, found.off_m.tolist(), strict=True):
        if off_m > OFF_COURSE_M:
            far = f"{off_m:.0f} m from the course after the previous row"
            raise table.error(i, "latitude, longitude", far, f"at most {OFF_COURSE_M:g} m")
    return [round(at_m, DECIMALS) for at_m in found.position_m.tolist()]


def _stops(tables: Sequence[LineTable]) -> list[Stop]:
    stops: list[Stop] = []
    for table in tables:
        for i, name in enumerate(table.names):
            at_m = table.numbers["position"][i]
            if name and at_m is not None:
                place = [table.cell(i, key) for key in ("latitude", "longitude")]
                latitude, longitude = place if None not in place else (None, None)
                stops.append(Stop(name=name, position_m=at_m, latitude_deg=latitude, longitude_deg=longitude))
    return sorted(stops, key=lambda stop: stop.position_m)


def _length_m(tables: Sequence[LineTable], stops: Sequence[Stop]) -> float:
    if len(stops) > 1:
        return stops[-1].position_m
    columns = ("position",), ("position", "length")
    return max(sum(row) for table in tables for wanted in columns for row in table.rows(*wanted))


def _the_one_with(tables: Sequence[LineTable], what: str, *quantities: str) -> LineTable | None:
    """The table that has one of these columns; None if none has, DasError if several have."""
    having = [table for table in tables if any(map(table.has, quantities))]
    if len(having) > 1:
        raise DasError(f"{having[0].path}, {having[1].path}: both have {what}, expected only one such table")
    return having[0] if having else None


def _steps(tables: Sequence[LineTable], quantity: str, length_m: float) -> Stretches | None:
    """A quantity that applies from each row to the next, from the only table that has it; None if no table has it."""
    table = _the_one_with(tables, f"{quantity}s", quantity)
    if table is None:
        return None
    rows = table.rows("position", quantity)
    if not rows or rows[0][0] > 0:
        first = f"{rows[0][0] / KM:g} km" if rows else "none"
        raise InputError(table.path, f"first position of {quantity}", first, "0 km, so that the line is covered")
    return stretches([row[0] for row in rows], [row[1] for row in rows], length_m)


def _curves(tables: Sequence[LineTable], length_m: float) -> Stretches | None:
    table = _the_one_with(tables, "curves", "radius", "radius_start", "radius_end")
    if table is None:
        return None
    ends = ("radius_start", "radius_end") if table.has("radius_start", "radius_end") else ("radius", "radius")
    if not table.has(*ends):
        raise DasError(f"{table.path}: a curve has radius_start_m and radius_end_m, or radius_m")
    rows = [list(row) for row in table.rows("position", *ends) if row[0] < length_m]
    return curvature_stretches(str(table.path), rows if rows and rows[0][0] == 0 else [[0.0, np.inf, np.inf], *rows])


def _zones(tables: Sequence[LineTable]) -> dict[str, Any]:
    """Tunnels, neutral sections and zones without regeneration; the name of a file distinguishes the latter two."""
    found: dict[str, tuple[Zone, ...]] = {}
    for table in (one for one in tables if one.has("length")):
        stem = table.path.stem.casefold()
        zones: tuple[Zone, ...]
        if table.has("cross_section"):
            key, rows = "tunnels", table.rows("position", "length", "cross_section")
            zones = tuple(Tunnel(start_m=a, length_m=b, area_m2=c) for a, b, c in rows)
        elif "neutral" in stem or "regeneration" in stem:
            key = "neutral_sections" if "neutral" in stem else "no_regeneration"
            zones = tuple(Zone(start_m=a, length_m=b) for a, b in table.rows("position", "length"))
        else:
            expected = "cross_section_m2 as well (tunnels), or a file name with neutral or no_regeneration in it"
            raise DasError(f"{table.path}: positions with lengths, expected {expected}")
        if key in found:
            raise DasError(f"{table.path}: a second table of {key}, expected only one")
        found[key] = zones
    return found


def _geometry(course: Course | None, route: Route) -> dict[str, Any]:
    """The geometry of a route: its course, up to the end of the line."""
    if course is None or course[0][0] > route.length_m + POSITION_TOLERANCE_M:
        return {}
    at_m, *place = course
    kept_m = at_m[at_m <= route.length_m + POSITION_TOLERANCE_M]
    if len(kept_m) < len(at_m) and kept_m[-1] < route.length_m - POSITION_TOLERANCE_M:
        kept_m = np.append(kept_m, route.length_m)
    names = ("geometry_position_m", "geometry_latitude_deg", "geometry_longitude_deg")
    return dict(zip(names, (kept_m, *(np.interp(kept_m, at_m, one) for one in place)), strict=True))
