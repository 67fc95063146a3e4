"""A line from a map of tracks: limits of its direction, tunnels, bridges, stations and geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats, Stop, Tunnel, Zone
from das.domain.units import KM, KMH, PERCENT, kmh
from precompute.polylines import along_m, nearest_on_line
from precompute.route_import.line import ImportedLine, ImportOrder, Words, made_route, stretches, zones_where
from precompute.route_import.track_graph import FoundWay, TrackGraph
from precompute.route_import.track_map import (
    FIRST_THAT_IS_NO_STOP,
    RANK_OF_A_TRACK,
    MapPlace,
    TrackMap,
    same_station,
    stations_named,
)

BESIDE_M: Final = 150.0
"""Largest distance (m) from the path at which a station counts as a stop on the path."""
STOPS_APART_M: Final = 50.0
"""Distance (m) below which two stops are the same stop."""
MOST_ODD: Final = 12
"""Largest number of limits of an unusual form that a remark lists."""
TUNNEL_AREA_M2: Final = 50.0
"""Free cross section (m²) that is assumed for tunnels of a map; double-track tunnels have 40 to 90 m²."""
OSM_SOURCE: Final = "© OpenStreetMap contributors"
OSM_LICENCE: Final = "ODbL 1.0"


def line_from_map(the_map: TrackMap, ends: tuple[str, str], order: ImportOrder, words: Words) -> ImportedLine:
    """The line between two stations of a map; DasError if a station or a path is not found, or no limit is known."""
    stations = [stations_named(the_map, name) for name in (ends[0], *(order.via or ()), ends[1])]
    if stations[0] == stations[-1]:
        raise DasError(f"{the_map.source}: {ends[0]} and {ends[1]} are the same place on the tracks")
    way = TrackGraph(the_map).way(stations)
    at_m = along_m(way.latitude_deg, way.longitude_deg)
    if at_m[-1] < STOPS_APART_M:
        raise DasError(f"{the_map.source}: {ends[0]} and {ends[1]} are the same place on the tracks")
    length_m = round(float(at_m[-1]), 3)
    at_m[-1] = length_m
    stops = _stops(the_map, order, way, at_m)
    if the_map.is_osm:
        words = replace(
            words,
            source=OSM_SOURCE if words.source is None else words.source,
            licence=OSM_LICENCE if words.licence is None else words.licence,
        )
    limits_mps, about_limits = _limits(the_map, order, way, at_m)
    tunnels, bridges = (
        zones_where([step.track.lies_in(what) for step in way.steps], at_m) for what in ("tunnel", "bridge")
    )
    route = replace(
        made_route(words, stops, length_m, the_map.source, one_way=True),
        limits_mps=stretches(at_m[:-1], limits_mps, length_m),
        tunnels=tuple(Tunnel(start_m=zone.start_m, length_m=zone.length_m, area_m2=TUNNEL_AREA_M2) for zone in tunnels),
        geometry_position_m=np.asarray(np.round(at_m, 3), dtype=float),
        geometry_latitude_deg=way.latitude_deg.copy(),
        geometry_longitude_deg=way.longitude_deg.copy(),
    )
    structures = tuple(sorted((*tunnels, *bridges), key=lambda zone: zone.start_m))
    return ImportedLine(route=route, structures=structures).with_remarks(
        f"Tracks driven: {len({step.track.name for step in way.steps})} of {len(the_map.tracks)}.",
        *(
            f"{place.name} is no station of the map but the name of a track; the middle of the track was taken."
            for place, _ in way.stations
            if place.rank == RANK_OF_A_TRACK
        ),
        about_limits,
        _about_odd_limits(way, at_m),
        _about_tunnels(tunnels, bridges),
        "Limits and tracks are those of this direction: the line is one_way.",
    )


def _limits(the_map: TrackMap, order: ImportOrder, way: FoundWay, at_m: Floats) -> tuple[Floats, str]:
    """The limit on each step (m/s), and a remark on substitutes for missing limits; DasError if the map has none."""
    told = np.array([step.track.limit_mps(forward=step.forward) or math.nan for step in way.steps])
    unknown = np.isnan(told)
    if not unknown.any():
        return told, "Limits on 100 % of the length."
    missing = float((np.diff(at_m) * unknown).sum() / at_m[-1])
    if order.limit_kmh is not None:
        filled, by = np.where(unknown, order.limit_kmh * KMH, told), f"{order.limit_kmh:g} km/h (--limit)"
    elif unknown.all():
        raise DasError(f"{the_map.source}: no limit on the whole way (maxspeed): give one with --limit KMH")
    else:
        known = np.flatnonzero(~unknown)
        before = told[known[np.clip(np.searchsorted(known, np.arange(len(told)), side="right") - 1, 0, None)]]
        after = told[known[np.clip(np.searchsorted(known, np.arange(len(told))), None, len(known) - 1)]]
        filled, by = np.where(unknown, np.minimum(before, after), told), "the lower limit of their neighbours"
    first_km = at_m[:-1][unknown][0] / KM
    return filled, (
        f"Limits on {(1 - missing) / PERCENT:.1f} % of the length; the other {missing * at_m[-1]:.0f} m (the first at "
        f"km {first_km:.3f}) got {by}: {', '.join(f'{kmh(x):.0f}' for x in sorted(set(filled[unknown])))} km/h."
    )


def _about_odd_limits(way: FoundWay, at_m: Floats) -> str:
    """The limits of the map that are no plain speeds, each with its first track and the speed that was read."""
    first: dict[str, str] = {}
    for step, from_m in zip(way.steps, at_m, strict=False):
        if odd := step.track.odd_limit(forward=step.forward):
            speed_mps = step.track.limit_mps(forward=step.forward)
            read = "no speed" if speed_mps is None else f"{kmh(speed_mps):g} km/h"
            first.setdefault(odd, f"{odd} of {step.track.name} (km {from_m / KM:.3f}): {read}")
    if not first:
        return ""
    more = f" and {len(first) - MOST_ODD} more" if len(first) > MOST_ODD else ""
    listed = ", ".join(list(first.values())[:MOST_ODD])
    return f"Limits that are no plain speeds were read as the least number in them: {listed}{more}."


def _about_tunnels(tunnels: Sequence[Zone], bridges: Sequence[Zone]) -> str:
    if not tunnels and not bridges:
        return ""
    lengths = [sum(zone.length_m for zone in zones) / KM for zones in (tunnels, bridges)]
    area = f", free cross section assumed: {TUNNEL_AREA_M2:g} m² (cross_section_m2)" if tunnels else ""
    return f"Tunnels: {len(tunnels)} ({lengths[0]:.2f} km{area}); bridges: {len(bridges)} ({lengths[1]:.2f} km)."


def _stops(the_map: TrackMap, order: ImportOrder, way: FoundWay, at_m: Floats) -> list[Stop]:
    """The stations of the path: those that the user names, and all others next to it."""
    ends = way.stations[0], way.stations[-1]
    via = [one for one in way.stations[1:-1] if one[0].rank <= FIRST_THAT_IS_NO_STOP]
    asked = [_stop(place, float(at_m[vertex])) for place, vertex in (*ends, *via)]
    line = at_m, way.latitude_deg, way.longitude_deg
    for place in [] if order.only_named_stops else _stations_along(the_map, way):
        position_m, away_m = nearest_on_line(line, place.latitude_deg, place.longitude_deg)
        apart_m = [abs(position_m - stop.position_m) for stop in asked]
        known = any(same_station(name, stop.name) for name in place.names for stop in asked)
        if away_m <= BESIDE_M and not known and min(apart_m) >= STOPS_APART_M:
            asked.append(_stop(place, position_m))
    return sorted(asked, key=lambda stop: stop.position_m)


def _stations_along(the_map: TrackMap, way: FoundWay) -> list[MapPlace]:
    """The stations in the rectangle around the path, the best first; the order of the file does not matter."""
    margin = 0.01
    low, high = way.latitude_deg.min() - margin, way.latitude_deg.max() + margin
    west, east = way.longitude_deg.min() - margin, way.longitude_deg.max() + margin
    inside = [
        place
        for place in the_map.places
        if place.rank < FIRST_THAT_IS_NO_STOP
        and low <= place.latitude_deg <= high
        and west <= place.longitude_deg <= east
    ]
    return sorted(inside, key=lambda place: (place.rank, place.names, place.latitude_deg, place.longitude_deg))


def _stop(place: MapPlace, position_m: float) -> Stop:
    return Stop(
        name=place.name,
        position_m=round(position_m, 3),
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
    )
