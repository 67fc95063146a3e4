"""Distances on the Earth against published lengths of degrees on WGS 84, and the nearest point against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.earth import distances_m, steps_m
from precompute.polylines import nearest_on_line


@pytest.mark.parametrize(
    ("latitude_deg", "north_m", "east_m"),
    [
        (0.0, 110_574.3, 111_319.5),
        (15.0, 110_649.4, 107_550.5),
        (45.0, 111_131.8, 78_846.8),
        (75.0, 111_618.4, 28_902.2),
    ],
)
def test_a_hundredth_of_a_degree_is_that_of_the_published_table(
    latitude_deg: float, north_m: float, east_m: float
) -> None:
    """Length of a degree of latitude and of longitude on WGS 84 (Wikipedia, Latitude and Longitude)."""
    lat, lon = latitude_deg, 179.995  # the step to the east crosses the date line
    assert distances_m(lat - 0.005, lon, lat + 0.005, lon) == pytest.approx(north_m / 100, rel=2e-5)
    assert distances_m(lat, lon, lat, -179.995) == pytest.approx(east_m / 100, rel=2e-5)


def test_a_long_way_is_that_of_the_great_circle() -> None:
    """Paris (48.8566, 2.3522) to New York (40.7128, −74.0060): 5837 km on the sphere of 6371 km."""
    assert distances_m(48.8566, 2.3522, 40.7128, -74.006) == pytest.approx(5_837e3, rel=0.006)


def test_steps_are_the_distances_of_neighbours() -> None:
    latitude, longitude = np.array([48.0, 48.1, 48.1]), np.array([8.0, 8.0, 8.2])
    assert steps_m(latitude, longitude) == pytest.approx([11_120, 14_907], rel=1e-3)


def test_the_nearest_point_of_a_line_is_that_of_brute_force() -> None:
    latitude, longitude = np.array([48.0, 48.02, 48.02, 48.03]), np.array([8.0, 8.0, 8.05, 8.05])
    at_m = np.concatenate(([0.0], np.cumsum(steps_m(latitude, longitude))))
    fine_m = np.arange(0.0, at_m[-1], 1.0)
    fine = np.interp(fine_m, at_m, latitude), np.interp(fine_m, at_m, longitude)
    for place in ((48.01, 8.01), (48.03, 8.0), (47.9, 8.0), (48.0201, 8.0501)):
        away_m = distances_m(*fine, *place)
        found_m, found_away_m = nearest_on_line((at_m, latitude, longitude), *place)
        assert found_away_m == pytest.approx(away_m.min(), abs=3.0)
        assert found_m == pytest.approx(fine_m[away_m.argmin()], abs=30.0)
