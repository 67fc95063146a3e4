"""Distances between points on the Earth (WGS 84)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

EQUATOR_RADIUS_M: Final = 6_378_137.0
"""Semi-major axis of the ellipsoid WGS 84 (m)."""
ECCENTRICITY_SQUARED: Final = 6.694_379_990_14e-3
"""Square of the first eccentricity of the ellipsoid WGS 84."""
MEAN_RADIUS_M: Final = 6_371_008.8
"""Mean radius of the Earth (m, IUGG)."""


def distances_m(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, to_latitude_deg: ArrayLike, to_longitude_deg: ArrayLike
) -> Floats:
    """Distance (m) between each pair of points, arrays of one shape or numbers.

    Below 60 km, d² = (M Δφ)² + (N cos φ Δλ)² with the radii of curvature M (meridian) and N (prime vertical) at the
    mean latitude φ, which is exact to 10⁻⁵ at mid latitudes; beyond it the great circle on a sphere of radius N
    (haversine), exact to 0.6 %.
    """
    south, north = (np.radians(np.asarray(x, dtype=float)) for x in (latitude_deg, to_latitude_deg))
    turn = np.asarray(to_longitude_deg, dtype=float) - np.asarray(longitude_deg, dtype=float)
    east = np.radians((turn + 180.0) % 360.0 - 180.0)
    middle = 0.5 * (south + north)
    flat = 1.0 - ECCENTRICITY_SQUARED * np.sin(middle) ** 2
    normal_m = EQUATOR_RADIUS_M / np.sqrt(flat)
    meridian_m = normal_m * (1.0 - ECCENTRICITY_SQUARED) / flat
    near_m = np.hypot(meridian_m * (north - south), normal_m * np.cos(middle) * east)
    half = np.sin(0.5 * (north - south)) ** 2 + np.cos(south) * np.cos(north) * np.sin(0.5 * east) ** 2
    far_m = 2.0 * normal_m * np.arcsin(np.sqrt(np.clip(half, 0.0, 1.0)))
    return np.asarray(np.where(far_m < 60e3, near_m, far_m), dtype=float)


def steps_m(latitude_deg: Floats, longitude_deg: Floats) -> Floats:
    """Distance (m) from each point of a polyline to the next: shape (n − 1,) for n points."""
    return distances_m(latitude_deg[:-1], longitude_deg[:-1], latitude_deg[1:], longitude_deg[1:])


def along_m(latitude_deg: Floats, longitude_deg: Floats) -> Floats:
    """Distance (m) of each point of a polyline from its first along it, arrays of shape (n,)."""
    return np.concatenate((np.zeros(min(len(latitude_deg), 1)), np.cumsum(steps_m(latitude_deg, longitude_deg))))


class Projection(NamedTuple):
    """The position (m) of each place on a polyline, and its distance (m) from it; arrays of shape (n,)."""

    position_m: Floats
    off_m: Floats


def projected_in_order(line: tuple[Floats, Floats, Floats], places_deg: Floats, near_m: float) -> Projection:
    """Places (n, 2; deg) projected on a polyline, none before the one before it: a line may pass a place twice.

    `line` is that of `nearest_on_line`. A place farther from it than `near_m` does not hold the others back. A place
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
    the plane that touches the Earth at the place, so that distances of some kilometres and more are only rough.
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
    """Where segments from (x, y) to (x + dx, y + dy) are nearest to the origin of a plane: share and distance.

    The share of a segment's length is kept from `lowest` to `highest`. All arrays broadcast; the distance has the unit
    of the coordinates.
    """
    square = np.maximum(dx**2 + dy**2, 1e-12)  # a doubled vertex has length 0: any share of it is the same point
    share = np.clip(-(x * dx + y * dy) / square, lowest, highest)
    return share, np.hypot(x + share * dx, y + share * dy)
