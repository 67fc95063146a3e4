"""An import from files to a route: which file is what, and what is asked of the user where data are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from das.domain.plausibility import INSIST, check_route
from das.domain.route import Stop
from precompute.route_import.altitudes import Smoothing, with_altitudes
from precompute.route_import.from_map import MapOptions, line_from_map
from precompute.route_import.line import ImportedLine, Words, cut
from precompute.route_import.station_names import same_station
from precompute.route_import.tables import LineTable, altitude_rows, line_from_tables, points_of, read_table
from precompute.route_import.track_map import MapPlace, TrackMap, read_map

MAPS: Final = (".json", ".geojson")
TABLES: Final = (".csv", ".txt", ".tsv", ".yaml", ".yml")
OF_OTHER_SUFFIX: Final = {
    ".toml": "is a route already: das-precompute route merge puts routes together",
    **dict.fromkeys((".osm", ".pbf", ".xml"), "export it as Overpass JSON ([out:json]) or GeoJSON"),
    **dict.fromkeys((".zip", ".gz", ".bz2"), "unpack it first"),
    ".gpx": "is a recorded trip: its points have no limits; das-sim trip reads it",
    ".shp": "export it as GeoJSON (ogr2ogr -f GeoJSON)",
}
NEEDS_ALTITUDES: Final = (
    "no altitudes: give --altitudes FILE (stations and summits are enough), or say --flat; on four real sections the "
    "energies of a flat line were 1 to 29 % too low"
)


@dataclass(frozen=True, kw_only=True)
class ImportOrder:
    """What to import: files, names of the ends, what else is wanted of a map, and where altitudes come from.

    `length_m` is the length of a line from tables; None: that of its stops or rows.
    """

    files: tuple[Path, ...]
    start: str | None = None
    end: str | None = None
    of_map: MapOptions = field(default_factory=MapOptions)
    length_m: float | None = None
    flat: bool = False
    altitudes: Path | None = None
    smoothing: Smoothing = field(default_factory=Smoothing)


def imported(order: ImportOrder, words: Words) -> ImportedLine:
    """The line that files describe; DasError or InputError (file, place, value, expectation) where they do not."""
    if order.flat and order.altitudes is not None:
        raise DasError("--flat and --altitudes: give one of them")
    maps, tables = _sorted_files(order.files)
    line = _from_map(order, words, maps, tables) if maps else _from_tables(order, words, tables)
    if order.altitudes is not None:
        line = with_altitudes(line, read_table(order.altitudes), order.smoothing)
    elif not line.has_gradients and not order.flat:
        heights = [table for table in tables if altitude_rows(table)]
        if not heights:
            raise DasError(f"{line.route.source}: {NEEDS_ALTITUDES}")
        line = with_altitudes(line, heights[0], order.smoothing)
    check_route(line.route, insist=INSIST % "route")
    return line


def _sorted_files(files: Sequence[Path]) -> tuple[list[Path], list[LineTable]]:
    """The maps, and the tables as they are read; DasError for a file of another kind."""
    maps, tables = [], []
    for path in files:
        suffix = path.suffix.lower()
        if suffix in MAPS:
            maps.append(path)
        elif suffix in TABLES:
            tables.append(read_table(path))
        else:
            known = f"expected a map ({', '.join(MAPS)}) or a table ({', '.join(TABLES)})"
            raise DasError(f"{path}: {OF_OTHER_SUFFIX.get(suffix, known)}")
    return maps, tables


def _from_map(order: ImportOrder, words: Words, maps: Sequence[Path], tables: Sequence[LineTable]) -> ImportedLine:
    if order.start is None or order.end is None:
        raise DasError("a map needs --from and --to: the names of two stations")
    if order.length_m is not None:
        raise DasError("--length-km belongs to tables: the length of a line from a map is that of its tracks")
    the_map = _with_stations(read_map(maps), tables)
    return line_from_map(the_map, (order.start, order.end), order.of_map, words)


def _with_stations(the_map: TrackMap, tables: Sequence[LineTable]) -> TrackMap:
    """The map with the stations of tables that have names and coordinates."""
    found = []
    for table in tables:
        if not table.names or not table.has("latitude", "longitude"):
            wanted = "name, latitude_deg and longitude_deg of stations"
            raise DasError(
                f"{table.path}: beside a map a table has {wanted}; das-precompute route merge adds other tables"
            )
        for row, (latitude, longitude) in points_of(table):
            names = (table.names[row],)
            found.append(MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=0))
    return replace(the_map, places=(*found, *the_map.places))


def _from_tables(order: ImportOrder, words: Words, tables: Sequence[LineTable]) -> ImportedLine:
    if order.of_map != MapOptions():
        raise DasError("--via, --only-named-stops, --limit, --tunnel-area and --join-m belong to maps, not to tables")
    ends = order.start or "start", order.end or "end"
    named = any(table.names and table.has("position") for table in tables)
    line = line_from_tables(tables, words, ends=ends, length_m=order.length_m)
    if not named or (order.start is None and order.end is None):
        return line
    stops = line.route.stops
    start, end = (_stop(line, name) or default for name, default in ((order.start, stops[0]), (order.end, stops[-1])))
    shorter = cut(line, start, end)
    if words.id is None and words.name is None and (start, end) != (stops[0], stops[-1]):
        name = f"{start.name} – {end.name}"
        shorter = replace(shorter, route=replace(shorter.route, name=name))
    return shorter


def _stop(line: ImportedLine, name: str | None) -> Stop | None:
    """The stop of a line with a name, None without a name; DasError if no stop has it."""
    if name is None:
        return None
    for stop in line.route.stops:
        if same_station(stop.name, name):
            return stop
    return line.route.stop(name)
