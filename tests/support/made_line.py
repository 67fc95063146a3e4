"""A made-up line along a meridian or an arc, with kilometre posts, a motion on it and a record of that motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from das.domain.earth import MEAN_RADIUS_M
from das.domain.route import Floats, Route
from sim.trips.cleaning import FindingKind
from sim.trips.line import Line, read_kilometre_posts
from sim.trips.matching import MatchedTrip, match_trip
from sim.trips.record import Record
from tests.support.making import make_route

ORIGIN = (59.5, 16.2)
START_NS = 1_469_780_350_000_000_000


def north(s_m: Floats, east_m: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """Points `s_m` north of the origin along the meridian (exactly R·Δφ), and `east_m` east of it."""
    latitude = ORIGIN[0] + np.degrees(s_m / MEAN_RADIUS_M)
    return latitude, ORIGIN[1] + np.degrees(east_m / MEAN_RADIUS_M / np.cos(np.radians(latitude)))


def arc(s_m: Floats, radius_m: float) -> tuple[Floats, Floats]:
    """Points at arc length `s_m` along a circle that starts northwards from the origin."""
    angle = s_m / radius_m
    latitude = ORIGIN[0] + np.degrees(radius_m * np.sin(angle) / MEAN_RADIUS_M)
    east = radius_m * (1 - np.cos(angle))
    return latitude, ORIGIN[1] + np.degrees(east / MEAN_RADIUS_M / np.cos(np.radians(ORIGIN[0])))


def posts_file(folder: Path, latitude: Floats, longitude: Floats, first: int = 3490130, step: int = -1) -> Path:
    path = folder / "posts.csv"
    rows = zip(latitude, longitude, strict=True)
    path.write_text("".join(f"{a:.12f},{b:.12f},{first + step * i}\n" for i, (a, b) in enumerate(rows)))
    return path


def posts(folder: Path, length_m: float = 10_000.0) -> Line:
    """Kilometre posts along the meridian, with chainage 0 at the origin."""
    return read_kilometre_posts(posts_file(folder, *north(np.arange(0, length_m + 1, 1000.0))))


def route(length_m: float = 8000.0, *, geometry: bool = False) -> Route:
    """A level route; with `geometry` it runs along the meridian, with position 0 at the origin."""
    position = np.arange(0, length_m + 1, 500.0) if geometry else np.array([])
    latitude, longitude = north(position)
    return replace(
        make_route(length_m, [(0.0, 40.0)]),
        source="test.toml",
        geometry_position_m=position,
        geometry_latitude_deg=latitude,
        geometry_longitude_deg=longitude,
    )


def motion(length_m: float = 8000.0, a: float = 0.5, top: float = 30.0) -> tuple[Floats, Floats, Floats]:
    """Time, position and speed once a second: accelerate at a, cruise, brake at a; whole seconds in all."""
    ramp = top / a
    cruise = (length_m - top * ramp) / top
    t = np.append(np.arange(0.0, 2 * ramp + cruise), 2 * ramp + cruise)
    late = np.maximum(t - ramp - cruise, 0.0)
    v = np.minimum(a * t, top) - a * late
    s = np.where(t < ramp, a * t**2 / 2, top * (t - ramp / 2)) - a * late**2 / 2
    return t, s, v


def record(t: Floats, s: Floats, v: Floats, *, from_m: float = 1500.0, east_m: Floats | float = 0.0) -> Record:
    """The record of a motion along the meridian that starts `from_m` north of the origin."""
    latitude, longitude = north(from_m + s, np.broadcast_to(east_m, s.shape))
    return Record.of(
        "trip.csv",
        np.arange(len(t)) + 1,
        START_NS + np.rint(t * 1e9).astype(np.int64),
        latitude_deg=latitude,
        longitude_deg=longitude,
        speed_mps=v.copy(),
    )


def counts(trip: MatchedTrip) -> dict[FindingKind, int]:
    return {finding.kind: finding.count for finding in trip.report.cleaning.findings}


def matched(trip: Record, line: Line, on: Route) -> MatchedTrip:
    return match_trip(trip, line, on, (on.stops[0], on.stops[-1]))
