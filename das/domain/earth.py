"""Distances between points on the Earth (WGS 84)."""

from __future__ import annotations

from typing import Final

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
    mean latitude φ, which is exact to 10⁻⁵ at mid latitudes; from 60 km on, the great circle on a sphere of
    radius N (haversine), exact to 0.6 %.
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
