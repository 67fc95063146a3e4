"""A trip to replay, from a GPS record or from an MCAP recording of ours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from das.bus import das_pb2
from das.bus.topics import DELAY, JOURNEY, LOCATION, POSITION
from das.domain.errors import DasError, InputError
from das.domain.route import Route, Stop
from sim.recording import read_recording
from sim.trips.gps_csv import GpsTrip, read_gps_trip
from sim.trips.line import Line, read_kilometre_posts
from sim.trips.matching import STANDING_MPS, MatchedTrip, MatchReport, check_within, flattened, match_trip
from sim.trips.profile import DrivenRun, to_profile


@dataclass(frozen=True, kw_only=True, eq=False)
class Trip:
    """A trip matched to a route, its smooth run, and what a recording says besides (journey, delays)."""

    path: Path
    matched: MatchedTrip
    run: DrivenRun
    journey: Any | None = None
    delays: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class RecordedJourney:
    """What a recording's journey names, to choose route, vehicle and stops from."""

    route_id: str
    vehicle_id: str
    reversed: bool
    from_stop: str
    to_stop: str


def peek_journey(path: Path) -> RecordedJourney | None:
    """The journey of an MCAP recording, None for a GPS record or a recording without one."""
    if path.suffix.lower() != ".mcap":
        return None
    journeys = read_recording(path).of(JOURNEY)
    if not journeys or len(journeys[0].message.stops) < 2:
        return None
    journey = journeys[0].message
    return RecordedJourney(
        route_id=journey.route_id,
        vehicle_id=journey.vehicle_id,
        reversed=journey.reversed,
        from_stop=journey.stops[0].name,
        to_stop=journey.stops[-1].name,
    )


def load_trip(path: Path, route: Route, start: Stop, end: Stop, line_path: Path | None) -> Trip:
    """Read a trip and match it to the route as driven (positions increasing from `start` to `end`).

    A GPS record needs kilometre posts, or a route with geometry; a recording of ours has positions on the route.
    Raises DasError or InputError for anything unusable.
    """
    if path.suffix.lower() == ".mcap":
        return _from_recording(path, start, end)
    trip = read_gps_trip(path)
    matched = match_trip(trip, _line(route, line_path), route, start, end)
    return Trip(path=path, matched=matched, run=to_profile(matched))


def _line(route: Route, line_path: Path | None) -> Line:
    if line_path is not None:
        return read_kilometre_posts(line_path)
    if not len(route.geometry_position_m):
        raise DasError(f"{route.source}: the route has no geometry to match GPS to; give kilometre posts with --line")
    return Line.from_route(route)


def _from_recording(path: Path, start: Stop, end: Stop) -> Trip:
    recording = read_recording(path)
    data = recording.columns(POSITION, "time_ns", "s_m", "speed_mps", "quality", "uncertainty_m")
    if len(data["time_ns"]) < 2:
        raise DasError(f"{path}: the recording has {len(data['time_ns'])} positions, expected at least 2")
    gps = _as_gps(path, recording, data)
    matched = _as_matched(gps, data, start, end)
    delays = recording.columns(DELAY, "time_ns", "delay_s")
    journeys = recording.of(JOURNEY)
    return Trip(
        path=path,
        matched=matched,
        run=to_profile(matched),
        journey=journeys[0].message if journeys else None,
        delays=tuple(zip(delays["time_ns"].tolist(), delays["delay_s"].tolist(), strict=True)),
    )


def _as_gps(path: Path, recording: Any, data: dict[str, Any]) -> GpsTrip:
    """The positions of a recording with their locations; NaN where it has none."""
    time_ns = data["time_ns"]
    for name in ("s_m", "speed_mps"):
        bad = np.flatnonzero(~np.isfinite(data[name]))
        if len(bad):
            raise InputError(path, f"position[{bad[0]}].{name}", float(data[name][bad[0]]), "a finite number")
    backwards = np.flatnonzero(data["speed_mps"] < -STANDING_MPS)
    if len(backwards):
        i = int(backwards[0])
        raise InputError(path, f"position[{i}].speed_mps", float(data["speed_mps"][i]), "a speed >= 0")
    late = np.flatnonzero(np.diff(time_ns) <= 0)
    if len(late):
        raise InputError(path, f"position[{late[0] + 1}].time_ns", int(time_ns[late[0] + 1]), "increasing times")
    fixes = [
        (m.message.timestamp.ToNanoseconds(), m.message.latitude, m.message.longitude) for m in recording.of(LOCATION)
    ]
    latitude, longitude = np.full(len(time_ns), np.nan), np.full(len(time_ns), np.nan)
    if fixes:
        t, a, b = np.array(fixes).T
        latitude, longitude = np.interp(time_ns, t, a), np.interp(time_ns, t, b)
    return GpsTrip(
        source=str(path),
        latitude_deg=latitude,
        longitude_deg=longitude,
        speed_mps=np.maximum(data["speed_mps"], 0.0),
        time_ns=time_ns,
    )


def _as_matched(gps: GpsTrip, data: dict[str, Any], start: Stop, end: Stop) -> MatchedTrip:
    """Positions of a recording are on the route already; standing ends are those of the record."""
    s_m = data["s_m"]
    flat = flattened(gps, s_m, cap_m=np.inf)
    check_within(gps, flat, start, end)
    standing = gps.speed_mps < STANDING_MPS
    moving = np.flatnonzero(~standing)
    if not len(moving):
        raise DasError(f"{gps.source}: the train never moves")
    departure, arrival = max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, len(standing) - 1)
    return MatchedTrip(
        source=gps.source,
        time_ns=gps.time_ns,
        s_m=flat,
        speed_mps=gps.speed_mps,
        latitude_deg=gps.latitude_deg,
        longitude_deg=gps.longitude_deg,
        dropout=data["quality"] == das_pb2.Position.QUALITY_DEGRADED,
        invalid=data["quality"] == das_pb2.Position.QUALITY_INVALID,
        uncertainty_m=data["uncertainty_m"],
        departure=departure,
        arrival=arrival,
        starts_standing=bool(standing[0]),
        ends_standing=bool(standing[-1]),
        report=MatchReport(
            offset_m=0.0,
            scale=1.0,
            anchor="recording",
            median_cross_track_m=0.0,
            max_cross_track_m=0.0,
            corrected_points=int(np.count_nonzero(flat != s_m)),
            dropout_points=int(np.count_nonzero(data["quality"] == das_pb2.Position.QUALITY_DEGRADED)),
        ),
    )
