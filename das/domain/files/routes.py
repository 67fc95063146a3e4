"""Reader of routes in this project's TOML format (docs/reference/file-formats.md)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, InputError, is_seen
from das.domain.files.reading import Fields, read_toml
from das.domain.plausibility import ACCEPTED, INSIST, ROUTE_CHECKS, checked
from das.domain.route import Altitudes, Route, Stop, Stretches, Tunnel, Zone

Floats = NDArray[np.float64]

SCHEMA_VERSION = 1
MOST_STOPS = 1000
"""Largest number of stops of a route. Assumption: the longest lines have a few hundred stops."""
MOST_POINTS = 200_000
"""Largest number of points of a route's geometry: 1000 km with a point every 5 m."""
MOST_OF_A_SOURCE = 2000
"""Longest source or licence (characters) of a route; both appear in its pictures and reports."""


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
    return checked(route, main.names(ACCEPTED, ROUTE_CHECKS), insist=INSIST % "route")


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
    for table in fields.tables("stops", MOST_STOPS, needed=True):
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
    start_m, value = zip(*fields.number_rows(key, {"position": "length", name: dimension}), strict=True)
    return Stretches(start_m=np.array(start_m), value=np.array(value))


def _zones(fields: Fields, key: str) -> tuple[Zone, ...]:
    rows = fields.optional_rows(key, {"position": "length", "length": "length"})
    return tuple(Zone(start_m=start, length_m=length) for start, length in rows)


def _tunnels(fields: Fields) -> tuple[Tunnel, ...]:
    rows = fields.optional_rows("tunnels", {"position": "length", "length": "length", "cross_section": "area"})
    return tuple(Tunnel(start_m=start, length_m=length, area_m2=area) for start, length, area in rows)


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
