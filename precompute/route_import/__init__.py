"""Import of a route from files: the kinds of files, and the errors about missing data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from das.domain.files.load import ROUTES, refuse_foreign
from das.domain.plausibility import FLAT_ERROR, INSIST, checked
from das.domain.route import Altitudes, Route, Stop
from das.domain.units import KM
from precompute.route_import.altitudes import with_altitudes
from precompute.route_import.from_map import line_from_map
from precompute.route_import.line import ImportedLine, ImportOrder, Words, cut
from precompute.route_import.tables import LineTable, line_from_tables, read_table
from precompute.route_import.track_map import MapPlace, TrackMap, read_map, same_station

MAPS: Final = (".json", ".geojson")
TABLES: Final = (".csv", ".txt", ".tsv", ".yaml", ".yml")
OF_OTHER_SUFFIX: Final = {
    **dict.fromkeys((".osm", ".pbf", ".xml"), "export it as Overpass JSON ([out:json]) or GeoJSON"),
    **dict.fromkeys((".zip", ".gz", ".bz2"), "unpack it first"),
    ".shp": "export it as GeoJSON (ogr2ogr -f GeoJSON)",
}
NEEDS_ALTITUDES: Final = (
    f"no altitudes: give --altitudes FILE (stations and summits are enough), or say --flat: then {FLAT_ERROR}"
)


def imported(files: Sequence[Path], order: ImportOrder, words: Words) -> ImportedLine:
    """The line that files describe; DasError or InputError (file, place, value, expectation) for unusable files."""
    if order.flat and order.altitudes is not None:
        raise DasError("--flat and --altitudes: give one of them")
    if order.flat and (order.smooth_m, order.cap_permille) != (ImportOrder.smooth_m, ImportOrder.cap_permille):
        raise DasError("--smooth-m and --cap-permille belong to altitudes: with --flat none are read")
    maps, tables = _sorted_files(files)
    if maps:
        line = _with_gradients(order, _from_map(order, words, maps, tables), tables)
    else:
        line = _part(order, words, _with_gradients(order, _from_tables(order, words, tables), tables))
    checked(line.route, insist=INSIST % "route")
    return line


def _with_gradients(order: ImportOrder, line: ImportedLine, tables: Sequence[LineTable]) -> ImportedLine:
    """The line with gradients from altitudes, if these are requested; DasError if it has neither."""
    if order.altitudes is not None:
        return with_altitudes(line, read_table(order.altitudes), order)
    if line.route.altitudes is not Altitudes.NONE:
        if order.flat or (order.smooth_m, order.cap_permille) != (ImportOrder.smooth_m, ImportOrder.cap_permille):
            wanted = "--flat, --smooth-m and --cap-permille belong to lines without gradients"
            raise DasError(f"{line.route.source}: {wanted}: leave the column out, or the option")
        return line
    if order.flat:
        return line
    heights = next((table for table in tables if table.numbered("altitude")), None)
    if heights is None:
        raise DasError(f"{line.route.source}: {NEEDS_ALTITUDES}")
    return with_altitudes(line, heights, order)


def _sorted_files(files: Sequence[Path]) -> tuple[list[Path], list[LineTable]]:
    """The maps, and the tables as read; DasError for a file of another kind."""
    maps, tables = [], []
    for path in files:
        suffix = path.suffix.lower()
        refuse_foreign(path, "map or table of a line", reads=ROUTES)
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
    if order.length_km is not None:
        raise DasError("--length-km belongs to tables: the length of a line from a map is that of its tracks")
    the_map = _with_stations(read_map(maps), tables)
    return line_from_map(the_map, (order.start, order.end), order, words)


def _with_stations(the_map: TrackMap, tables: Sequence[LineTable]) -> TrackMap:
    found = []
    for table in tables:
        if not table.names or not table.has("latitude", "longitude"):
            wanted = "name, latitude_deg and longitude_deg of stations"
            raise DasError(f"{table.path}: with a map, a table has {wanted}; other rows are added to the route's file")
        for row, (latitude, longitude) in table.numbered("latitude", "longitude"):
            if name := table.names[row]:
                found.append(MapPlace(names=(name,), latitude_deg=latitude, longitude_deg=longitude, rank=0))
    return replace(the_map, places=(*found, *the_map.places))


def _from_tables(order: ImportOrder, words: Words, tables: Sequence[LineTable]) -> ImportedLine:
    if order.via or order.only_named_stops or order.limit_kmh is not None:
        raise DasError("--via, --only-named-stops and --limit belong to maps, not to tables")
    ends = order.start or "start", order.end or "end"
    length_m = None if order.length_km is None else order.length_km * KM
    return line_from_tables(tables, words, ends=ends, length_m=length_m)


def _part(order: ImportOrder, words: Words, line: ImportedLine) -> ImportedLine:
    """The part of a line from tables between the two of its stops that the order names."""
    route = line.route
    start = route.stops[0] if order.start is None else _stop(route, order.start)
    end = route.stops[-1] if order.end is None else _stop(route, order.end, after_m=start.position_m)
    return cut(line, start, end, words)


def _stop(route: Route, name: str, after_m: float = -1.0) -> Stop:
    """The stop with a name, the first one beyond a position (m) if several have it; DasError if none has it."""
    same = [stop for stop in route.stops if same_station(stop.name, name)] or [route.stop(name)]
    return next((stop for stop in same if stop.position_m > after_m), same[0])
