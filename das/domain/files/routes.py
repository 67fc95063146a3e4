"""Reader of routes and journeys in this project's TOML format (docs/reference/file-formats.md)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError, InputError, is_seen
from das.domain.files.reading import Fields, bound_of_window, read_toml
from das.domain.journey import Call, Journey, Passing, Window
from das.domain.plausibility import ACCEPTED, INSIST, ROUTE_CHECKS, check_route
from das.domain.route import Altitudes, Route, Stop, Stretches, Tunnel, Zone

Floats = NDArray[np.float64]

SCHEMA_VERSION = 1
MOST_STOPS = 1000
"""Largest number of stops of a route. Assumption: the longest lines have a few hundred stops."""
MOST_POINTS = 200_000
"""Largest number of points of a route's geometry: 1000 km with a point every 5 m."""
MOST_OF_A_SOURCE = 2000
"""Longest source or licence (characters) of a route; both appear in its pictures and reports."""
TOLERANCE_S = 30.0
"""Default tolerance (s) of a passing that is a wish: timetables are rounded to minutes."""
_CLOCK = re.compile(r"(\d{1,3}):([0-5]\d)(?::([0-5]\d(?:\.\d+)?))?")
_PLACE = {"position": "length"}
_SPEEDS = {"lowest_speed": "speed", "highest_speed": "speed"}


def read_route(path: Path) -> Route:
    """Read a route; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(
        [
            *("schema_version", "route", "stops", "speed_limits", "gradients", "curves", "tunnels", "geometry"),
            *("receptivity", "neutral_sections", "no_regeneration"),
        ]
    )
    main = fields.table("route")
    main.check_keys(
        [
            *("id", "name", "source", "licence", "description", "illustrative", "time_zone", "one_way", "altitudes"),
            ACCEPTED,
            *main.quantity_keys({"length": "length", "altitude_at_start": "length"}),
        ]
    )
    position_m, latitude_deg, longitude_deg = _geometry(fields)
    route = Route(
        id=main.name("id"),
        name=main.name("name"),
        source=str(path),
        illustrative=main.flag("illustrative", False),
        length_m=main.quantity("length", "length"),
        stops=_stops(fields),
        limits_mps=_stretches(fields, "speed_limits", "limit", "speed"),
        gradients_ratio=_stretches(fields, "gradients", "gradient", "gradient"),
        curvature_per_m=_curvature(fields),
        tunnels=_tunnels(fields),
        receptivity_ratio=(
            _stretches(fields, "receptivity", "receptivity", "ratio")
            if fields.has("receptivity")
            else Stretches.constant(1.0)
        ),
        neutral_sections=_zones(fields, "neutral_sections"),
        no_regeneration=_zones(fields, "no_regeneration"),
        altitude_at_start_m=main.quantity("altitude_at_start", "length", 0.0),
        time_zone=_time_zone(main),
        data_source=_stated(main, "source"),
        licence=_stated(main, "licence"),
        one_way=main.flag("one_way", False),
        altitudes=main.choice("altitudes", Altitudes) if main.has("altitudes") else None,
        geometry_position_m=position_m,
        geometry_latitude_deg=latitude_deg,
        geometry_longitude_deg=longitude_deg,
    )
    return check_route(route, main.names(ACCEPTED, ROUTE_CHECKS), insist=INSIST % "route")


def _stated(main: Fields, key: str) -> str:
    """Source or licence as stated in a file, on one line; InputError if it is longer than `MOST_OF_A_SOURCE`."""
    text = " ".join(main.text(key, "").split())
    if not is_seen(text) or len(text) > MOST_OF_A_SOURCE:
        raise main.error(key, text, f"a text of at most {MOST_OF_A_SOURCE} characters without control characters")
    return text


def _time_zone(main: Fields) -> str:
    name = main.text("time_zone", "UTC")
    try:
        return ZoneInfo(name).key
    except (KeyError, ValueError, OSError):  # an unknown zone; not a zone name; the name of a folder of zones
        raise main.error("time_zone", name, 'a time zone like "Europe/Zurich" (IANA)') from None


def _geometry(fields: Fields) -> tuple[Floats, Floats, Floats]:
    """Position (m), latitude and longitude (deg) of each point of the geometry; empty if the file has none."""
    wanted = {"position": "length", "latitude": "angle", "longitude": "angle"}
    rows = fields.optional_rows("geometry", wanted, most=MOST_POINTS)
    position_m, latitude_deg, longitude_deg = (np.array([row[i] for row in rows]) for i in range(3))
    return position_m, latitude_deg, longitude_deg


def _curvature(fields: Fields) -> Stretches:
    wanted = {"position": "length", "radius_start": "length", "radius_end": "length"}
    rows = fields.optional_rows("curves", wanted, unbounded=("radius_start", "radius_end"))
    return curvature_stretches(str(fields.source), rows or [(0.0, np.inf, np.inf)])


def _stops(fields: Fields) -> tuple[Stop, ...]:
    stops = []
    for table in _tables(fields, "stops", needed=True):
        places = {"position": "length", "altitude": "length", "latitude": "angle", "longitude": "angle"}
        table.check_keys(["name", "source", *table.quantity_keys(places)])
        table.quantity("altitude", "length", 0.0)  # not used, but it must be readable
        latitude, longitude = (
            table.within(name, "angle", most, (-most, most)) if table.given_keys(name, "angle") else None
            for name, most in (("latitude", 90.0), ("longitude", 180.0))
        )
        if (latitude is None) != (longitude is None):
            raise table.error("latitude_deg", MISSING if latitude is None else latitude, "both coordinates, or none")
        at_m = table.quantity("position", "length")
        stops.append(Stop(name=table.name("name"), position_m=at_m, latitude_deg=latitude, longitude_deg=longitude))
    return tuple(stops)


def _stretches(fields: Fields, key: str, name: str, dimension: str) -> Stretches:
    columns = fields.columns(key, {"position": "length", name: dimension})
    return Stretches(start_m=np.array(columns["position"]), value=np.array(columns[name]))


def _zones(fields: Fields, key: str) -> tuple[Zone, ...]:
    rows = fields.optional_rows(key, {"position": "length", "length": "length"})
    return tuple(Zone(start_m=start, length_m=length) for start, length in rows)


def _tunnels(fields: Fields) -> tuple[Tunnel, ...]:
    rows = fields.optional_rows("tunnels", {"position": "length", "length": "length", "cross_section": "area"})
    return tuple(Tunnel(start_m=start, length_m=length, area_m2=area) for start, length, area in rows)


def read_journey(path: Path, route: Route | None) -> Journey:
    """Read a journey on a route; raises DasError or InputError (file, key, value, expectation) if it is unusable.

    Without a route, all points must state their positions.
    """
    return journey_of(read_toml(path), route)


def journey_of(fields: Fields, route: Route | None) -> Journey:
    """The journey described by the fields of a file; errors as in `read_journey`."""
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "journey", "stops", "passings"])
    main = fields.table("journey")
    main.check_keys(["id", "name", "source", "description", "route", "mode"])
    if route is not None and main.text("route", route.id) != route.id:
        raise main.error("route", main.text("route"), f"{route.id}, the route it is planned on")
    points: list[Call | Passing] = [_call(table, route) for table in _tables(fields, "stops")]
    points += [_passing(table, route) for table in _tables(fields, "passings")]
    return Journey(
        id=main.name("id"),
        name=main.name("name"),
        source=str(fields.source),
        points=tuple(sorted(points, key=lambda point: point.position_m)),
        mode=main.name("mode", ""),
    )


def _tables(fields: Fields, key: str, *, needed: bool = False) -> list[Fields]:
    entries = fields.data.get(key, MISSING if needed else [])
    if not isinstance(entries, list):
        raise fields.error(key, entries, f"a list of [[{key}]]")
    fields.check_count(key, entries, MOST_STOPS)
    return [Fields.of(fields.source, entry, f"{key}[{i}].") for i, entry in enumerate(entries)]


def _call(fields: Fields, route: Route | None) -> Call:
    times = ("arrival_earliest", "arrival", "departure", "departure_latest")
    fields.check_keys([*_place_keys(fields), *_time_keys(fields, *times), *fields.quantity_keys({"dwell": "time"})])
    name, position_m = _place(fields, route)
    return Call(
        name=name,
        position_m=position_m,
        arrival=_window(fields, "arrival_earliest", "arrival"),
        departure=_window(fields, "departure", "departure_latest"),
        dwell_s=fields.quantity("dwell", "time", 0.0),
    )


def _passing(fields: Fields, route: Route | None) -> Passing:
    times = _time_keys(fields, "earliest", "latest", "time")
    own = ["wish", *fields.quantity_keys({**_SPEEDS, "tolerance": "time"})]
    fields.check_keys([*_place_keys(fields), *times, *own])
    name, position_m = _place(fields, route)
    wish = fields.flag("wish", False)
    for key in () if wish else fields.given_keys("tolerance", "time"):
        raise fields.error(key, fields.data[key], "no tolerance without wish = true")
    return Passing(
        name=name,
        position_m=position_m,
        window=_passing_window(fields),
        wish=wish,
        tolerance_s=fields.within("tolerance", "time", TOLERANCE_S, (0.0, 3600.0)) if wish else 0.0,
        lowest_mps=fields.quantity("lowest_speed", "speed", 0.0),
        highest_mps=fields.quantity("highest_speed", "speed", math.inf, unbounded=True),
    )


def _passing_window(fields: Fields) -> Window:
    """The window of a passing: from `earliest` to `latest`, or exactly at `time`."""
    exact = [key for key in _time_keys(fields, "time") if key in fields.data]
    if not exact:
        return _window(fields, "earliest", "latest")
    for key in _time_keys(fields, "earliest", "latest"):
        if key in fields.data:
            raise fields.error(key, fields.data[key], f"no window together with {exact[0]}")
    return _window(fields, "time", "time")


def _place_keys(fields: Fields) -> list[str]:
    return ["stop", "name", *fields.quantity_keys(_PLACE)]


def _place(fields: Fields, route: Route | None) -> tuple[str, float]:
    """Name and position (m) of a point: those of the stop of the route that the file names, or those in the file."""
    if not fields.has("stop"):
        return fields.name("name"), fields.quantity("position", "length")
    for key in ("name", *fields.given_keys("position", "length")):
        if fields.has(key):
            raise fields.error(key, fields.data[key], "no name or position together with stop (a stop of the route)")
    wanted = fields.data["stop"]
    if route is None:
        raise fields.error("stop", wanted, "name and position, because no route is given; or give the route (--route)")
    number = isinstance(wanted, int) and not isinstance(wanted, bool)
    try:
        stop = route.stop(str(wanted) if number else fields.text("stop"))
    except InputError:
        raise fields.error("stop", wanted, "name or number of a stop of the route") from None
    except DasError as error:
        raise fields.error("stop", wanted, f"a stop of the route ({error})") from None
    return stop.name, stop.position_m


def _time_keys(fields: Fields, *names: str) -> list[str]:
    return [*names, *fields.quantity_keys(dict.fromkeys(names, "time"))]


def _window(fields: Fields, earliest: str, latest: str) -> Window:
    return Window(earliest_s=_time_s(fields, earliest, -math.inf), latest_s=_time_s(fields, latest, math.inf))


def _time_s(fields: Fields, name: str, default: float) -> float:
    """A time (s): a text (`arrival = "07:12:30"`, from midnight) or a quantity (`arrival_s = 450`)."""
    value: Any = fields.data.get(name, MISSING)
    if value is MISSING:
        time_s = fields.quantity(name, "time", default, unbounded=True)
        return bound_of_window(fields.source, f"{fields.prefix}{name}", time_s)
    match = _CLOCK.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise fields.error(name, value, f'a time in quotes like "07:12:30", or {name}_s')
    for key in fields.given_keys(name, "time"):
        raise fields.error(key, fields.data[key], f"only one of {name} and {key}")
    hours, minutes, seconds = match.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds or 0.0)


def curvature_stretches(source: str, rows: Sequence[Sequence[float]]) -> Stretches:
    """Mean |curvature| of each stretch from rows of position and signed radii at its start and end (m).

    A radius below 60 m is rejected: no main line has one, and the resistance formula has a pole at 55 m.
    """
    for i, (_, start, end) in enumerate(rows):
        if min(abs(start), abs(end)) < 60:
            raise InputError(source, f"curves[{i}] radius", min(start, end, key=abs), "a radius of at least 60 m")
    return Stretches(
        start_m=np.array([row[0] for row in rows]),
        value=np.array([abs(1 / start + 1 / end) / 2 for _, start, end in rows]),
    )
