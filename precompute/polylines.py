"""Places near polylines on the Earth: their positions along the line, and distances from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from das.domain.earth import Floats, distances_m, steps_m


def along_m(latitude_deg: Floats, longitude_deg: Floats) -> Floats:
    """Distance (m) of each point of a polyline from its first along it, arrays of shape (n,)."""
    return np.concatenate((np.zeros(min(len(latitude_deg), 1)), np.cumsum(steps_m(latitude_deg, longitude_deg))))


class Projection(NamedTuple):
    """The position (m) of each place on a polyline, and its distance (m) from it; arrays of shape (n,)."""

    position_m: Floats
    off_m: Floats


def projected_in_order(line: tuple[Floats, Floats, Floats], places_deg: Floats, near_m: float) -> Projection:
    """Places (n, 2; deg) projected on a polyline in rising order, because a line may pass a place twice.

    `line` is that of `nearest_on_line`. A place farther from the line than `near_m` does not affect the others. A place
    that is NaN gets the position NaN and the distance inf.
    """
    position_m, off_m = np.full(len(places_deg), np.nan), np.full(len(places_deg), np.inf)
    at_m, latitude, longitude = line
    reached = 0
    for i, place in enumerate(places_deg):
        if np.isnan(place).any():
            continue
        position_m[i], off_m[i] = nearest_on_line((at_m[reached:], latitude[reached:], longitude[reached:]), *place)
        if off_m[i] <= near_m:
            reached = min(int(np.searchsorted(at_m, position_m[i], side="right")) - 1, len(at_m) - 2)
    return Projection(position_m, off_m)


def nearest_on_line(
    line: tuple[Floats, Floats, Floats], latitude_deg: float, longitude_deg: float
) -> tuple[float, float]:
    """Position (m) of the point of a polyline nearest to a place, and its distance (m) from the place.

    `line` has position (m), latitude and longitude (deg) of each vertex, arrays of shape (n,) with n ≥ 2. Computed in
    the plane that touches the Earth at the place; distances of several kilometres are therefore only rough.
    """
    at_m, latitude, longitude = line
    x, y = plane_m(latitude, longitude, (latitude_deg, longitude_deg))
    share, away_m = nearest_on_segments(x[:-1], y[:-1], np.diff(x), np.diff(y))
    i = int(away_m.argmin())
    return float(at_m[i] + share[i] * (at_m[i + 1] - at_m[i])), float(away_m[i])


def plane_m(latitude_deg: Floats, longitude_deg: Floats, place: tuple[float, float]) -> tuple[Floats, Floats]:
    """East and north (m) of a place (latitude, longitude; deg) in the plane that touches the Earth there."""
    latitude, longitude = place
    north_m = float(distances_m(latitude - 0.005, longitude, latitude + 0.005, longitude)) / 0.01
    east_m = float(distances_m(latitude, longitude - 0.005, latitude, longitude + 0.005)) / 0.01
    return (longitude_deg - longitude) * east_m, (latitude_deg - latitude) * north_m


def nearest_on_segments(
    x: Floats, y: Floats, dx: Floats, dy: Floats, lowest: ArrayLike = 0.0, highest: ArrayLike = 1.0
) -> tuple[Floats, Floats]:
    """The points of segments from (x, y) to (x + dx, y + dy) nearest to the origin of a plane: share and distance.

    The share of a segment's length is limited to `lowest` … `highest`. All arrays broadcast; the distance has the unit
    of the coordinates.
    """
    square = np.maximum(dx**2 + dy**2, 1e-12)  # a doubled vertex has length 0: any share of it is the same point
    share = np.clip(-(x * dx + y * dy) / square, lowest, highest)
    return share, np.hypot(x + share * dx, y + share * dy)
