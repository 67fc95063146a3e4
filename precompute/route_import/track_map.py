"""Railway tracks and stations of a map: OpenStreetMap as Overpass JSON or GeoJSON, GeoJSON of infrastructure managers.

Tracks are joined by coordinates, not by numbers of nodes, which GeoJSON does not have.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from das.domain.earth import distances_m
from das.domain.errors import DasError, InputError, seen
from das.domain.files.reading import MOST_OF_A_NAME, Fields, read_json
from das.domain.plausibility import OF_ROUTES
from das.domain.units import KM, KMH, MPH
from precompute.gtfs import key_of

MOST_BYTES_OF_MAP: Final = 100_000_000
"""Largest file (bytes) of a map that is read."""
MOST_VERTICES: Final = 2_000_000
"""Largest number of vertices of all tracks of a map. Assumption: the tracks of a large country have fewer."""
FASTEST_MPS: Final = OF_ROUTES["speed_limit"].possible[1]
"""Highest credible limit (m/s) of a map; a higher one must be a mistake and counts as unknown."""
TRACKS: Final = frozenset({"rail", "narrow_gauge", "light_rail", "subway", "tram", "preserved", "monorail"})
"""Values of `railway=*` that are tracks in use."""
STATIONS: Final = {
    **{("railway", value): 0 for value in ("station", "halt", "tram_stop")},
    ("public_transport", "station"): 0,
    **{("railway", value): 1 for value in ("stop", "stop_position", "service_station")},
    **{("public_transport", value): 1 for value in ("stop_position", "stop_area")},
    ("building", "train_station"): 1,
    ("railway", "platform"): 2,
    ("public_transport", "platform"): 2,
    **{("railway", value): 3 for value in ("junction", "crossover", "yard", "site", "spur_junction")},
}
"""Tags that make a place a station, each with its rank: lower is preferred. Places of rank 2 or more are no stops."""
FIRST_THAT_IS_NO_STOP: Final = 2
OTHER_THING: Final = frozenset(
    {"highway", "waterway", "building", "natural", "landuse", "boundary", "aeroway", "power"}
)
"""Keys of features that are neither track nor station, in files without a key for tracks."""
LIMIT_KEYS: Final = ("maxspeed", "v_max", "vmax", "speed_limit", "maxspeed_kmh", "limit_kmh")
"""Keys of a speed limit: of OpenStreetMap, of SNCF, and of tables."""
_NAME_KEYS: Final = (
    *("name", "official_name", "alt_name", "short_name", "loc_name", "int_name", "uic_name", "old_name"),
    *("label", "title", "station", "station_name", "stop_name"),
)
"""Keys of names: of OpenStreetMap, and of other maps."""
_SPEED = re.compile(r"(\d+(?:\.\d+|,\d(?!\d))?)\s*(mph)?")
_PLAIN_SPEEDS = re.compile(r"(\d+(\.\d+)?\s*(km/h|kmh|kph|mph)?\s*(;\s*|$))+")
_HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"\s*=>\s*"((?:[^"\\]|\\.)*)"')
Key = tuple[int, int]
"""A place on the map: latitude and longitude in 10⁻⁷ degrees, the resolution of OpenStreetMap."""
UNITS_PER_DEGREE: Final = 1e7
"""The units of a `Key` in a degree."""


@dataclass(frozen=True, kw_only=True)
class TrackLine:
    """A piece of track: its vertices in the order of the map, and its tags."""

    name: str
    vertices: tuple[Key, ...]
    tags: Mapping[str, str]

    def limit_mps(self, *, forward: bool) -> float | None:
        """The limit (m/s) with or against the order of the vertices; None if the map has none.

        Of several speeds ("80;100") the least counts, in a text of another form ("60|80") the least number.
        """
        speeds_mps = (min(_speeds_mps(text), default=None) for _, text in self._told(forward=forward))
        return next((speed_mps for speed_mps in speeds_mps if speed_mps is not None), None)

    def odd_limit(self, *, forward: bool) -> str:
        """The value of the limit, with its key, if it is no plain speed or list of speeds; empty otherwise.

        If no value of the track names a speed, it is the first value.
        """
        told = list(self._told(forward=forward))
        for key, text in [one for one in told if _speeds_mps(one[1])] or told[:1]:
            plain = _PLAIN_SPEEDS.fullmatch(text.casefold()) and _speeds_mps(text)
            return "" if plain else f"{key} = {seen(text)[:MOST_OF_A_NAME]!r}"
        return ""

    def _told(self, *, forward: bool) -> Iterator[tuple[str, str]]:
        """The keys and values of a limit with or against the order of the vertices, the best first."""
        for key in (f"maxspeed:{'forward' if forward else 'backward'}", *LIMIT_KEYS):
            if text := self.tags.get(key, "").strip():
                yield key, text

    def lies_in(self, what: str) -> bool:
        """Whether the track is in a "tunnel", or on a "bridge"."""
        return self.tags.get(what, "no").casefold() not in ("no", "f", "false", "0", "")


@dataclass(frozen=True, kw_only=True)
class MapPlace:
    """A named place of the map; `rank` is that of `STATIONS`."""

    names: tuple[str, ...]
    latitude_deg: float
    longitude_deg: float
    rank: int

    @property
    def name(self) -> str:
        """The first name on the map."""
        return self.names[0]


@dataclass(frozen=True, kw_only=True)
class TrackMap:
    """The tracks and named places of some files.

    `crossings` are the vertices at which tracks cross on the level without a switch. `is_osm`: a file is from
    OpenStreetMap.
    """

    sources: tuple[Path, ...]
    tracks: tuple[TrackLine, ...]
    places: tuple[MapPlace, ...]
    crossings: frozenset[Key]
    is_osm: bool

    @property
    def source(self) -> str:
        """The files, for messages."""
        return ", ".join(map(str, self.sources))


@dataclass(frozen=True, kw_only=True)
class _Thing:
    """A feature of a map, whatever its format: lines and points in order, its tags and its name in the file."""

    name: str
    tags: Mapping[str, str]
    lines: Sequence[Sequence[Key]] = ()
    point: Key | None = None


def read_map(paths: Sequence[Path]) -> TrackMap:
    """Read tracks and stations from files; DasError for a file that is no map, or has no track."""
    things: list[_Thing] = []
    is_osm = False
    for path in paths:
        fields = read_json(path, MOST_BYTES_OF_MAP)
        if not isinstance(fields.data.get("elements"), list) and fields.data.get("type") != "FeatureCollection":
            raise DasError(f"{path}: neither an answer of Overpass (elements) nor GeoJSON (a FeatureCollection)")
        found = list(_elements(fields) if "elements" in fields.data else _features(fields))
        things += found
        is_osm |= "elements" in fields.data or _says_openstreetmap(fields, found)
    told = any("railway" in thing.tags for thing in things)
    tracks = tuple(_tracks(things, told))
    if not tracks:
        raise DasError(f"{', '.join(map(str, paths))}: no track in it: no line with railway = {' or '.join(TRACKS)}")
    if sum(len(track.vertices) for track in tracks) > MOST_VERTICES:
        raise DasError(f"{', '.join(map(str, paths))}: more than {MOST_VERTICES} vertices of tracks, expected fewer")
    return TrackMap(
        sources=tuple(paths),
        tracks=tracks,
        places=tuple(place for thing in things if (place := _place(thing)) is not None),
        crossings=frozenset(
            thing.point for thing in things if thing.point and thing.tags.get("railway") == "railway_crossing"
        ),
        is_osm=is_osm,
    )


def _says_openstreetmap(fields: Fields, things: Sequence[_Thing]) -> bool:
    """Whether GeoJSON names OpenStreetMap, or its features have names like way/123."""
    text = str(fields.data.get("copyright", "")) + str(fields.data.get("generator", ""))
    named = re.compile(r"(node|way|relation)/\d+")
    return "openstreetmap" in text.casefold() or "overpass" in text or any(named.fullmatch(x.name) for x in things)


def _tracks(things: Sequence[_Thing], told: bool) -> Iterator[TrackLine]:
    """The tracks; in files without the key `railway` (not `told`) every line that is no other feature."""
    for thing in things:
        railway = thing.tags.get("railway")
        if not _is_gone(thing) and (railway in TRACKS if told else not OTHER_THING & set(thing.tags)):
            for line in thing.lines:
                # A point twice in a row would be a piece of track without a length.
                vertices = tuple(key for i, key in enumerate(line) if not i or key != line[i - 1])
                if len(vertices) > 1:
                    yield TrackLine(name=thing.name, vertices=vertices, tags=thing.tags)


def _is_gone(thing: _Thing) -> bool:
    return any(thing.tags.get(key, "no") not in ("no", "") for key in ("disused", "abandoned", "razed"))


def _place(thing: _Thing) -> MapPlace | None:
    ranks = [rank for (key, value), rank in STATIONS.items() if thing.tags.get(key) == value]
    plain = thing.point is not None and not thing.lines and not OTHER_THING & set(thing.tags)
    plain = plain and thing.tags.get("railway", "rail") in TRACKS
    names = names_of(thing.tags)
    if not names or not (ranks or plain) or _is_gone(thing):
        return None
    vertices = [thing.point] if thing.point else [key for line in thing.lines for key in line]
    if not vertices:
        return None
    latitude, longitude = (sum(key[i] for key in vertices) / len(vertices) / UNITS_PER_DEGREE for i in (0, 1))
    return MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=min(ranks, default=4))


def names_of(tags: Mapping[str, str]) -> tuple[str, ...]:
    """All names that tags give, the plain one first; control characters are escaped."""
    keys = [*_NAME_KEYS, *sorted(key for key in tags if key.startswith("name:"))]
    names = [name.strip() for key in keys for name in tags.get(key, "").split(";")]
    return tuple(dict.fromkeys(seen(name)[:MOST_OF_A_NAME] for name in names if name))


def _speeds_mps(text: str) -> list[float]:
    """The speeds (m/s) that a value of `maxspeed` names; "none" and "signals" name none.

    A comma before a single digit is a decimal sign. Text in brackets is a remark.
    """
    matches = _SPEED.finditer(re.sub(r"\(.*?\)", " ", text.casefold()))
    speeds_mps = [float(match[1].replace(",", ".")) * (MPH if match[2] else KMH) for match in matches]
    return [speed_mps for speed_mps in speeds_mps if 0 < speed_mps <= FASTEST_MPS]


def _elements(fields: Fields) -> Iterator[_Thing]:
    elements = [one for one in fields.data["elements"] if isinstance(one, dict)]
    points = {
        one["id"]: _key(fields, f"elements: node {one['id']}", one.get("lon"), one.get("lat"))
        for one in elements
        if one.get("type") == "node" and isinstance(one.get("id"), int) and "lat" in one
    }
    for one in elements:
        name, tags = f"{one.get('type')}/{one.get('id')}", _tags(one.get("tags"))
        if one.get("type") == "node":
            if tags and isinstance(one.get("id"), int) and one["id"] in points:
                yield _Thing(name=name, tags=tags, point=points[one["id"]])
            continue
        lines = _way(fields, name, one, points) if one.get("type") == "way" else []
        centre = one.get("center")
        at = (centre.get("lon"), centre.get("lat")) if isinstance(centre, dict) else None
        point = _key(fields, f"{name} center", *at) if at else None
        if tags:
            yield _Thing(name=name, tags=tags, lines=lines, point=None if lines else point)
        for member in one.get("members") or () if one.get("type") == "relation" else ():
            if isinstance(member, dict) and isinstance(member.get("geometry"), list):
                yield _Thing(name=name, tags=tags, lines=_way(fields, name, member, points))


def _way(fields: Fields, name: str, way: Mapping[str, Any], points: Mapping[int, Key]) -> list[list[Key]]:
    """The lines of a way: several if nodes between them are outside the extract."""
    geometry, nodes = way.get("geometry"), way.get("nodes")
    if isinstance(geometry, list):
        keys = [
            _key(fields, f"{name} geometry", one.get("lon"), one.get("lat")) if isinstance(one, dict) else None
            for one in geometry
        ]
    elif isinstance(nodes, list):
        keys = [points.get(one) if isinstance(one, int) else None for one in nodes]
    else:
        return []
    pieces = groupby(keys, lambda key: key is not None)
    return [[key for key in piece if key is not None] for is_known, piece in pieces if is_known]


def _features(fields: Fields) -> Iterator[_Thing]:
    crs = fields.data.get("crs")
    if crs is not None and not re.search(r"CRS84|4326|WGS ?84", json.dumps(crs)[:500]):
        raise fields.error("crs", crs, "WGS 84 (EPSG:4326), the only one that GeoJSON has since RFC 7946")
    features = fields.data.get("features")
    if not isinstance(features, list):
        raise fields.error("features", features, "a list of features")
    for i, feature in enumerate(features):
        if not isinstance(feature, dict):
            raise fields.error(f"features[{i}]", feature, "a feature")
        properties = feature["properties"] if isinstance(feature.get("properties"), dict) else {}
        numbers = (properties.get("@id"), feature.get("id"), properties.get("osm_id"), properties.get("id"))
        name = str(next(filter(None, numbers), i))[:100]
        tags = _tags(properties)
        for geometry in _geometries(feature.get("geometry")):
            lines, point = _shape(fields, f"features[{i}]", geometry)
            yield _Thing(name=name, tags=tags, lines=lines, point=point)


def _geometries(geometry: Any) -> Iterator[Mapping[str, Any]]:
    """The geometry of a feature, or those of its collection (which may not hold collections)."""
    if isinstance(geometry, dict):
        many = geometry.get("geometries")
        yield from (one for one in (many if isinstance(many, list) else [geometry]) if isinstance(one, dict))


def _shape(fields: Fields, key: str, geometry: Mapping[str, Any]) -> tuple[list[list[Key]], Key | None]:
    """Lines and point of a geometry; the rings of an area count as lines."""
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    depth = {"Point": 0, "MultiPoint": 1, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
    if not isinstance(kind, str) or kind not in depth:
        return [], None
    lines: list[Any] = [coordinates]
    try:
        for _ in range(depth[kind] - 1):
            lines = [inner for line in lines for inner in line]
        lines = [lines] if depth[kind] == 0 else lines
        keys = [[_key(fields, key, *point[:2]) for point in line] for line in lines]
    except (TypeError, ValueError, IndexError, KeyError):
        raise fields.error(f"{key} coordinates", coordinates, f"those of a {kind}: longitude, latitude") from None
    if kind in ("Point", "MultiPoint"):
        return [], keys[0][0] if keys and keys[0] else None
    return keys, None


def _key(fields: Fields, key: str, longitude: Any, latitude: Any) -> Key:
    """A place on the map; InputError for anything but a longitude and a latitude (degrees)."""
    for name, value, most in (("longitude", longitude, 180.0), ("latitude", latitude, 90.0)):
        if not _is_number(value) or abs(value) > most:
            raise InputError(fields.source, f"{key} {name}", value, f"a number of degrees from {-most:g} to {most:g}")
    return round(latitude * UNITS_PER_DEGREE), round(longitude * UNITS_PER_DEGREE)


def _is_number(value: Any) -> bool:
    """Whether a value is a number that a double can hold."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _tags(properties: Any) -> dict[str, str]:
    """Tags as texts: of OpenStreetMap, of a nested table `tags`, and of the column `other_tags` that GDAL writes."""
    if not isinstance(properties, dict):
        return {}
    found: dict[str, str] = {}
    for spelled, value in properties.items():
        key = spelled.casefold()  # shape files have them in capitals
        if key == "other_tags" and isinstance(value, str):
            found |= {name: text.replace('\\"', '"') for name, text in _HSTORE.findall(value)}
        elif key == "tags" and isinstance(value, dict):
            found |= _tags({name: text for name, text in value.items() if name != "tags"})
        elif isinstance(value, str):
            found[key] = value[:1000]
        elif _is_number(value):
            found[key] = f"{value:g}"
    if "railway" not in found and found.get("fclass") in TRACKS:  # Geofabrik's shape files
        found["railway"] = found["fclass"]
    return found


MOST_SHOWN: Final = 25
"""Largest number of names in a message."""
ONE_STATION_M: Final = 3000.0
"""Largest distance (m) between places of one station, the length of the largest yards; beyond it names coincide."""
GENERIC: Final = frozenset(
    {
        *("station", "railway", "central", "halt", "of"),
        *("bahnhof", "hauptbahnhof", "haltepunkt", "der", "sbb"),
        *("gare", "centrale", "sncf", "cff", "de", "des", "du", "la", "le"),
        *("stazione", "ferroviaria", "fermata", "fs", "ffs", "di"),
        *("centraal", "estacion", "estacao", "stacja", "stanice", "nadrazi"),
    }
)
"""Words of a station's name that a user may leave out."""
RANK_OF_A_TRACK: Final = 8
"""Rank of a track with a station's name, which is used if the map has no station of that name."""
RANK_WITHOUT_NAME: Final = 9
"""Rank of a place that the user gives by its coordinates alone: the path leads over it without a stop."""
_ABBREVIATED: Final = {"st": "sankt", "saint": "sankt", "sant": "sankt", "hbf": "hauptbahnhof", "bf": "bahnhof"}
_AT = re.compile(r"(?:(?P<name>[^=]*)=)?\s*(?P<latitude>-?\d+(?:\.\d+)?)\s*[,;]\s*(?P<longitude>-?\d+(?:\.\d+)?)\s*")


def stations_named(the_map: TrackMap, wanted: str) -> tuple[MapPlace, ...]:
    """The places for a user's words, best rank first: a station, its stops and its platforms.

    `wanted` may also be a place, "48.208,15.625", or a place with a name, "St. Pölten=48.208,15.625". Raises DasError,
    which lists the names of the map, if none or several different stations fit.
    """
    at = _AT.fullmatch(wanted)
    if at is not None:
        latitude, longitude = float(at["latitude"]), float(at["longitude"])
        if abs(latitude) > 90 or abs(longitude) > 180:
            raise DasError(f"{wanted}: expected a latitude from -90 to 90 and a longitude from -180 to 180 degrees")
        name = (at["name"] or "").strip()
        names, rank = (name or f"{latitude:g},{longitude:g}",), 0 if name else RANK_WITHOUT_NAME
        return (MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=rank),)
    fits: tuple[Callable[[str], bool], ...] = (
        lambda name: _words(name) == _words(wanted),
        lambda name: "".join(_words(name)) == "".join(_words(wanted)),
        lambda name: bool(_core(wanted)) and "".join(_core(name)) == "".join(_core(wanted)),
        lambda name: bool(_core(wanted)) and set(_core(wanted)) <= set(_words(name)),
    )
    for fit in fits:
        found = [place for place in the_map.places if any(fit(name) for name in place.names)]
        if found:
            return _one_station(the_map, wanted, found)
    found = [place for place in _named_tracks(the_map) if any(fits[0](name) for name in place.names)]
    if found:
        return _one_station(the_map, wanted, found)
    raise DasError(_unknown(the_map, wanted))


def _named_tracks(the_map: TrackMap) -> Iterator[MapPlace]:
    """The middle of each track with a name, as a place."""
    for track in the_map.tracks:
        if names := names_of(track.tags):
            latitude, longitude = (degrees / UNITS_PER_DEGREE for degrees in track.vertices[len(track.vertices) // 2])
            yield MapPlace(names=names, latitude_deg=latitude, longitude_deg=longitude, rank=RANK_OF_A_TRACK)


def _one_station(the_map: TrackMap, wanted: str, found: Sequence[MapPlace]) -> tuple[MapPlace, ...]:
    """The places that fit, best rank first; DasError if the best ones have several names or are far apart."""
    kept = tuple(sorted(found, key=lambda place: place.rank))
    names = list(dict.fromkeys(place.name for place in kept if place.rank == kept[0].rank))
    if len({" ".join(_core(name)) or name for name in names}) > 1:
        raise DasError(f"{the_map.source}: {wanted!r} may be {_listed(names)}: give one of these names")
    first, *others = (place for place in kept if place.rank == kept[0].rank)
    for other in others:
        ends = first.latitude_deg, first.longitude_deg, other.latitude_deg, other.longitude_deg
        apart_m = float(distances_m(*ends))
        if apart_m > ONE_STATION_M:
            both = (f"{wanted}={place.latitude_deg:.5f},{place.longitude_deg:.5f}" for place in (first, other))
            places = " and ".join(both)
            raise DasError(f"{the_map.source}: {wanted!r} names places {apart_m / KM:.1f} km apart: give {places}")
    return kept


def _unknown(the_map: TrackMap, wanted: str) -> str:
    stations = {place.name for place in the_map.places if place.rank <= 1}
    names = sorted(stations or {place.name for place in the_map.places})
    if not names:
        return (
            f"{the_map.source}: no station {wanted!r}, because the file has no stations: give "
            f"{wanted}=LATITUDE,LONGITUDE, or add a file with stations (GeoJSON or Overpass JSON with "
            "node[railway=station], or CSV with name, latitude_deg, longitude_deg)"
        )
    spelled = {" ".join(_words(name)): name for name in names}
    close = [spelled[one] for one in difflib.get_close_matches(" ".join(_words(wanted)), list(spelled), 3, 0.6)]
    hint = f"; near: {_listed(close)}" if close else ""
    return f"{the_map.source}: no station {wanted!r}{hint}; it has {_listed(names)}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else ""
    return ", ".join(names[:MOST_SHOWN]) + more


def _words(name: str) -> list[str]:
    """The words of a name without case, accents and punctuation, with usual abbreviations written out."""
    return [_ABBREVIATED.get(word, word) for word in key_of(name).replace("ø", "o").replace("ł", "l").split()]


def _core(name: str) -> list[str]:
    return [word for word in _words(name) if word not in GENERIC]


def same_station(one: str, other: str) -> bool:
    """Whether two names may be spellings of the name of one station."""
    return "".join(_words(one)) == "".join(_words(other))
