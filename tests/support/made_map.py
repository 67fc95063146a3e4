"""`python -m tests.support.made_map`: write the map and the altitudes of the example's line, which are fictitious.

`tracks.geojson` has the tags of OpenStreetMap. The line has two tracks, with crossovers, a siding, a yard, a branch, a
tunnel, a bridge, stations and platforms. `heights.csv` has the noise of a terrain model.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np

from das.domain.files.load import load_route
from das.domain.route import Floats, Route
from das.domain.units import KM, kmh
from tests.support.making import REPOSITORY

EXAMPLE: Final = REPOSITORY / "sim" / "bundled" / "example_files"
"""The folder of the example."""
TRACKS_APART_M: Final = 4.5
"""Distance (m) between the two tracks, the siding and the yard."""
DEGREE_M: Final = 111_200.0
"""Length of a degree of latitude (m)."""
SWITCH_M: Final = 80.0
"""Length (m) of a connection from a track to its neighbour."""
CROSSOVERS_KM: Final = (0.3, 5.7, 6.8, 13.4)
BRIDGE_KM: Final = (3.05, 3.15)
TUNNEL_KM: Final = (8.15, 8.95)
HEIGHT_EVERY_M: Final = 50.0
HEIGHT_SD_M: Final = 1.5
"""Standard deviation (m) of the altitudes, as in a terrain model."""


def map_files(route: Route) -> dict[str, bytes]:
    """The files of the map by name: tracks and stations (GeoJSON), and altitudes at coordinates (CSV)."""
    return {"tracks.geojson": _geojson(route), "heights.csv": _heights(route)}


def _geojson(route: Route) -> bytes:
    features = [*_main_tracks(route), *_other_tracks(route), *_places(route)]
    collection = {
        "type": "FeatureCollection",
        "copyright": "invented: no such railway exists; made by the driver advisory system developers",
        "features": [{**feature, "id": f"made/{i}"} for i, feature in enumerate(features)],
    }
    lines = json.dumps(collection, ensure_ascii=False).replace('{"type": "Feature"', '\n{"type": "Feature"')
    return (lines + "\n").encode()


def _places_of(route: Route, at_m: Floats, aside_m: float | Floats) -> list[list[float]]:
    """Longitude and latitude of points at positions, at a distance (m) to the left of the line."""
    at_m = np.clip(at_m, 0.0, route.length_m)
    found = [route.location_deg(at_m + half) for half in (-5.0, 5.0, 0.0)]
    (south, west), (north, east), (latitude, longitude) = [one for one in found if one is not None]
    stretch = np.cos(np.radians(latitude))
    ahead = np.stack(((east - west) * stretch, north - south))
    ahead = ahead / np.hypot(*ahead)
    aside = np.asarray(aside_m, dtype=float) / DEGREE_M
    places = np.stack((longitude - ahead[1] * aside / stretch, latitude + ahead[0] * aside), axis=1)
    found_places: list[list[float]] = np.round(places, 7).tolist()
    return found_places


def _track(coordinates: list[list[float]], tags: Mapping[str, str]) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": coordinates}
    return {"type": "Feature", "properties": {"railway": "rail", **tags}, "geometry": geometry}


def _main_tracks(route: Route) -> list[dict[str, Any]]:
    """Both tracks, cut where a limit, a structure or a switch begins; the second one is drawn backwards."""
    limits = route.limits_mps
    cuts = [0.0, route.length_m, *limits.start_m.tolist(), *(KM * x for x in (*BRIDGE_KM, *TUNNEL_KM))]
    cuts += [KM * at_km + more for at_km in (*CROSSOVERS_KM, 5.8, 6.5, 9.5, 13.5) for more in (0.0, SWITCH_M)]
    edges = np.unique(np.round(np.clip(cuts, 0.0, route.length_m), 3))
    found = []
    for start_m, end_m in pairwise(edges):
        inside = route.geometry_position_m[
            (route.geometry_position_m > start_m + 1) & (route.geometry_position_m < end_m - 1)
        ]
        at_m = np.concatenate(([start_m], inside, [end_m]))
        limit = f"{kmh(float(limits.at(start_m))):.0f}"
        middle_km = 0.5 * (start_m + end_m) / KM
        tags = {"usage": "main", "electrified": "contact_line", "maxspeed": limit}
        if BRIDGE_KM[0] < middle_km < BRIDGE_KM[1]:
            tags |= {"bridge": "yes"}
        if TUNNEL_KM[0] < middle_km < TUNNEL_KM[1]:
            tags |= {"tunnel": "yes", "maxspeed": "", "maxspeed:forward": limit, "maxspeed:backward": "60"}
        right = {key: text for key, text in tags.items() if text}
        found.append(_track(_places_of(route, at_m, 0.0), {**right, "railway:preferred_direction": "forward"}))
        left = _places_of(route, at_m, TRACKS_APART_M)[::-1]
        found.append(_track(left, {**right, "railway:preferred_direction": "forward"}))
    return found


def _other_tracks(route: Route) -> list[dict[str, Any]]:
    """Crossovers, a siding at the second stop, a yard at the last one, and a branch that leaves backwards."""
    found = []
    for number, at_km in enumerate(CROSSOVERS_KM):
        at_m = KM * at_km + np.array([0.0, SWITCH_M])
        aside_m = np.array([0.0, TRACKS_APART_M])
        found.append(
            _track(
                _places_of(route, at_m, aside_m[:: 1 if number % 2 else -1]), {"service": "crossover", "maxspeed": "60"}
            )
        )
    siding_m = np.array([5800.0, 5880.0, 6200.0, 6500.0, 6580.0])
    aside_m = -TRACKS_APART_M * np.array([0.0, 1.0, 1.0, 1.0, 0.0])
    found.append(_track(_places_of(route, siding_m, aside_m), {"service": "siding", "maxspeed": "40"}))
    yard_m, aside_m = np.array([13_500.0, 13_580.0, 13_990.0]), -TRACKS_APART_M * np.array([0.0, 1.0, 1.0])
    found.append(_track(_places_of(route, yard_m, aside_m), {"service": "yard", "maxspeed": "25"}))
    branch_m, aside_m = np.array([9500.0, 9300.0, 9000.0]), np.array([0.0, 40.0, 400.0])
    found.append(_track(_places_of(route, branch_m, aside_m), {"usage": "branch", "maxspeed": "50"}))
    return found


def _places(route: Route) -> list[dict[str, Any]]:
    """A station, a stop position and a platform for each stop of the line, and a house next to it."""
    found: list[dict[str, Any]] = []
    for stop in route.stops:
        at_m = np.array([stop.position_m])
        beside, on_track = (_places_of(route, at_m, aside_m)[0] for aside_m in (-25.0, 0.0))
        for place, tags in (
            (beside, {"railway": "station", "name": stop.name}),
            (on_track, {"railway": "stop", "public_transport": "stop_position", "name": stop.name}),
            (beside, {"building": "yes", "name": f"Inn of {stop.name}"}),
        ):
            geometry: dict[str, Any] = {"type": "Point", "coordinates": place}
            found.append({"type": "Feature", "properties": tags, "geometry": geometry})
        corners_m = stop.position_m + np.array([-80.0, 80.0, 80.0, -80.0, -80.0])
        ring = _places_of(route, corners_m, np.array([-3.0, -3.0, -7.0, -7.0, -3.0]))
        geometry = {"type": "Polygon", "coordinates": [ring]}
        tags = {"railway": "platform", "name": stop.name}
        found.append({"type": "Feature", "properties": tags, "geometry": geometry})
    return found


def _heights(route: Route) -> bytes:
    """Altitudes with the noise of a terrain model; over the tunnel they are those of the hill."""
    random = np.random.default_rng(34)
    at_m = np.arange(0.0, route.length_m + 1.0, HEIGHT_EVERY_M)
    altitude_m = route.altitude_m(at_m) + HEIGHT_SD_M * random.standard_normal(len(at_m))
    start_m, end_m = (KM * x for x in TUNNEL_KM)
    inside = (at_m > start_m) & (at_m < end_m)
    altitude_m = altitude_m + np.where(inside, 60.0 * np.sin(np.pi * (at_m - start_m) / (end_m - start_m)), 0.0)
    places = _places_of(route, at_m, 0.0)
    rows = [f"{lat:.6f},{lon:.6f},{height:.1f}" for (lon, lat), height in zip(places, altitude_m, strict=True)]
    return ("\n".join(["latitude_deg,longitude_deg,altitude_m", *rows]) + "\n").encode()


if __name__ == "__main__":
    for name, content in map_files(load_route(str(EXAMPLE / "route.toml"))).items():
        (EXAMPLE / name).write_bytes(content)
