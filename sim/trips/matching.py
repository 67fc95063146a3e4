"""A GPS record on the route: positions that never decrease, speeds without dropouts, and how well it fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.route import Floats, Route, Stop
from das.domain.units import KMH, NS
from sim.trips.gps_csv import GpsTrip, Ints
from sim.trips.line import Line

Bools = NDArray[np.bool_]

STANDING_MPS = 1.0 * KMH
"""A train reported slower than this, and not moving by its positions, stands."""
MAX_CROSS_TRACK_M = 200.0
MAX_BACKWARD_M = 30.0
MAX_BEYOND_M = 300.0
SCALE_TOLERANCE_RATIO = 0.01
"""Matched length and distance of the stops may differ by this for the kilometrage to be scaled to the stops."""
DERIVED_HALF_WINDOW_S = 5.0
"""Speed from positions is their mean slope over this time either side; GPS positions catch up only after seconds."""
DROPOUT_MPS, DROPOUT_RATIO = 4.0, 0.2
"""Reported speed is a dropout where it is below the speed from positions by both; more than delay (3 s at 1 m/s²)."""
DROPOUT_EDGE_MPS, DROPOUT_EDGE_MPS2 = 1.0, 1.5
"""Next to a dropout, a speed still below by the first that jumps faster than the second belongs to it."""


@dataclass(frozen=True, kw_only=True)
class MatchReport:
    """How the record fits: s = offset_m + scale · chainage.

    `anchor` is what fixed them: "route" (nothing had to), "start and end", "start" or "end" (the stops where it stood).
    """

    offset_m: float
    scale: float
    anchor: str
    median_cross_track_m: float
    max_cross_track_m: float
    corrected_points: int
    """Positions moved: backward steps made flat, and standing points put together."""
    dropout_points: int


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedTrip:
    """A record on a route, arrays of shape (points,); `s_m` never decreases, `speed_mps` has no dropouts.

    It stands up to point `departure` and from point `arrival` on; where it does not stand these are the first and last
    point and `starts_standing`, `ends_standing` are False.
    """

    source: str
    time_ns: Ints
    s_m: Floats
    speed_mps: Floats
    latitude_deg: Floats
    longitude_deg: Floats
    dropout: Bools
    invalid: Bools
    uncertainty_m: Floats
    departure: int
    arrival: int
    starts_standing: bool
    ends_standing: bool
    report: MatchReport

    def __post_init__(self) -> None:
        for array in (self.s_m, self.speed_mps, self.dropout):
            array.setflags(write=False)

    def elapsed_s(self) -> Floats:
        """Time since the first point (s)."""
        return np.asarray((self.time_ns - self.time_ns[0]) * NS, dtype=np.float64)


def match_trip(trip: GpsTrip, line: Line, route: Route, start_stop: Stop, end_stop: Stop) -> MatchedTrip:
    """Put a record on a route that is driven from `start_stop` to `end_stop`, positions increasing.

    Kilometre posts have a zero of their own: the standstill at the start is put on the start stop; if the train also
    stands at the end and the lengths agree within 1 %, the kilometrage is scaled so that both fit. Backward steps up to
    30 m are noise and made flat. Raises DasError for a record off the line, backwards, or beyond the section.
    """
    if start_stop.position_m >= end_stop.position_m:
        raise DasError(f"{route.source}: {start_stop.name} does not lie before {end_stop.name} on the route as driven")
    chainage, cross_track = line.match(trip.latitude_deg, trip.longitude_deg)
    _check_on_line(trip, line, cross_track)
    _check_direction(trip, line, chainage)
    time_s = trip.elapsed_s()
    dropout = find_dropouts(time_s, chainage, trip.speed_mps)
    departure, arrival, starts, ends = _standing_ends(trip, (trip.speed_mps < STANDING_MPS) & ~dropout)
    pinned = chainage.copy()
    if starts:  # the last fix before departure has settled best
        pinned[: departure + 1] = chainage[departure]
    if ends:
        pinned[arrival:] = np.median(chainage[arrival:])
    offset_m, scale, anchor = _alignment(trip, line, pinned, (starts, ends), (start_stop, end_stop))
    position = offset_m + scale * pinned
    s_m = flattened(trip, position, cap_m=float(position[-1]) if ends else np.inf)
    check_within(trip, s_m, start_stop, end_stop)
    report = MatchReport(
        offset_m=offset_m,
        scale=scale,
        anchor=anchor,
        median_cross_track_m=float(np.median(cross_track)),
        max_cross_track_m=float(cross_track.max()),
        corrected_points=int(np.count_nonzero(np.abs(s_m - (offset_m + scale * chainage)) > 1e-6)),
        dropout_points=int(np.count_nonzero(dropout)),
    )
    return MatchedTrip(
        source=trip.source,
        time_ns=trip.time_ns,
        s_m=s_m,
        speed_mps=np.where(dropout, derived_speed_mps(time_s, s_m), trip.speed_mps),
        latitude_deg=trip.latitude_deg,
        longitude_deg=trip.longitude_deg,
        dropout=dropout,
        invalid=np.zeros(len(s_m), dtype=bool),
        uncertainty_m=np.full(len(s_m), float(np.median(cross_track))),
        departure=departure,
        arrival=arrival,
        starts_standing=starts,
        ends_standing=ends,
        report=report,
    )


def derived_speed_mps(time_s: Floats, position_m: Floats) -> Floats:
    """Speed from positions: mean slope over 5 s (at least one point) either side, one-sided at the ends."""
    before = np.minimum(time_s - DERIVED_HALF_WINDOW_S, np.append(time_s[0], time_s[:-1]))
    after = np.maximum(time_s + DERIVED_HALF_WINDOW_S, np.append(time_s[1:], time_s[-1]))
    before, after = np.maximum(before, time_s[0]), np.minimum(after, time_s[-1])
    moved_m = np.interp(after, time_s, position_m) - np.interp(before, time_s, position_m)
    return np.asarray(moved_m / (after - before), dtype=np.float64)


def find_dropouts(time_s: Floats, position_m: Floats, speed_mps: Floats) -> Bools:
    """Points whose reported speed falls far below the speed from positions (see the constants above)."""
    derived = derived_speed_mps(time_s, position_m)
    below = derived - speed_mps
    found = (below > DROPOUT_MPS) & (below > DROPOUT_RATIO * derived)
    jump = np.abs(np.diff(speed_mps)) > DROPOUT_EDGE_MPS2 * np.diff(time_s)
    while True:
        edge = np.zeros_like(found)
        edge[1:] |= found[:-1] & jump
        edge[:-1] |= found[1:] & jump
        edge &= ~found & (below > DROPOUT_EDGE_MPS)
        if not edge.any():
            return found
        found |= edge


def _check_on_line(trip: GpsTrip, line: Line, cross_track_m: Floats) -> None:
    far = cross_track_m > MAX_CROSS_TRACK_M
    if 2 * np.count_nonzero(far) > len(far):
        i = int(far.argmax())
        raise DasError(
            f"{trip.source}: trip not on the line {line.source}: line {i + 1} is {cross_track_m[i]:.0f} m away and "
            f"{np.count_nonzero(far)} of {len(far)} points more than {MAX_CROSS_TRACK_M:.0f} m"
        )


def _check_direction(trip: GpsTrip, line: Line, chainage_m: Floats) -> None:
    back = chainage_m[0] - chainage_m[-1]
    if back > MAX_BACKWARD_M:
        raise DasError(
            f"{trip.source}: the trip runs the other way along {line.source}: its last point lies {back:.0f} m before "
            "its first (wrong direction? see --reverse)"
        )


def _standing_ends(trip: GpsTrip, standing: Bools) -> tuple[int, int, bool, bool]:
    """Last point of the standstill at the start, first of that at the end, and whether there are any."""
    moving = np.flatnonzero(~standing)
    if not len(moving):
        raise DasError(f"{trip.source}: the train never moves, every speed is below {STANDING_MPS / KMH:g} km/h")
    first, last = int(moving[0]), int(moving[-1])
    return max(first - 1, 0), min(last + 1, len(standing) - 1), first > 0, last < len(standing) - 1


def _alignment(
    trip: GpsTrip, line: Line, chainage_m: Floats, standing: tuple[bool, bool], stops: tuple[Stop, Stop]
) -> tuple[float, float, str]:
    """Offset, scale and anchor of s = offset + scale·chainage."""
    if line.on_route:
        return 0.0, 1.0, "route"
    if not any(standing):
        raise DasError(
            f"{trip.source}: the train stands neither at the first nor at the last line, so kilometre posts cannot be "
            "aligned with the route's positions"
        )
    first, last = float(chainage_m[0]), float(chainage_m[-1])
    start_m, end_m = stops[0].position_m, stops[1].position_m
    distance = end_m - start_m
    if all(standing) and abs(last - first - distance) <= SCALE_TOLERANCE_RATIO * distance:
        scale = distance / (last - first)
        return start_m - scale * first, scale, "start and end"
    if standing[0]:
        return start_m - first, 1.0, "start"
    return end_m - last, 1.0, "end"


def flattened(trip: GpsTrip, position_m: Floats, cap_m: float) -> Floats:
    """Positions that never decrease nor pass where the train stands at the end; DasError beyond noise."""
    highest = np.maximum.accumulate(position_m)
    back = highest - position_m
    if back.max() > MAX_BACKWARD_M:
        i = int((back > MAX_BACKWARD_M).argmax())
        raise DasError(
            f"{trip.source}: position decreases by {back[i]:.0f} m at line {i + 1} (wrong direction? see --reverse)"
        )
    return np.minimum(highest, cap_m)


def check_within(trip: GpsTrip, s_m: Floats, start_stop: Stop, end_stop: Stop) -> None:
    before, after = start_stop.position_m - s_m[0], s_m[-1] - end_stop.position_m
    for beyond, what in (
        (before, f"starts {before:.0f} m before {start_stop.name}"),
        (after, f"ends {after:.0f} m beyond {end_stop.name}"),
    ):
        if beyond > MAX_BEYOND_M:
            raise DasError(f"{trip.source}: the trip {what}, more than {MAX_BEYOND_M:.0f} m outside the section")
