"""Gradients from altitudes: noise, tunnels, caps, and places by position, coordinates and names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.route import Route, Stop, Stretches, Zone
from precompute.route_import.altitudes import climb_and_fall_m, with_altitudes
from precompute.route_import.line import ImportedLine, ImportOrder, Words, made_route
from precompute.route_import.tables import read_table

LENGTH_M = 60_000.0
AT_M = np.arange(0.0, LENGTH_M + 1, 100.0)


def hill_m(at_m: np.ndarray) -> np.ndarray:
    """Altitude of a hill of 120 m with its summit in the middle, up and down in one wave."""
    return 400.0 + 60.0 * (1.0 - np.cos(2 * np.pi * at_m / LENGTH_M))


def line(*structures: Zone, stops: tuple[Stop, ...] | None = None) -> ImportedLine:
    ends = stops or (Stop(name="Adorf", position_m=0.0), Stop(name="Bestadt", position_m=LENGTH_M))
    return ImportedLine(route=made_route(Words(), ends, LENGTH_M, "line", one_way=True), structures=structures)


def with_heights(folder: Path, rows: str, of: ImportedLine | None = None, **order: Any) -> ImportedLine:
    path = folder / "heights.csv"
    path.write_text(rows, encoding="utf-8")
    return with_altitudes(of or line(), read_table(path), ImportOrder(**order))


def table(at_m: np.ndarray, altitude_m: np.ndarray) -> str:
    rows = [f"{x:.1f},{z:.3f}" for x, z in zip(at_m, altitude_m, strict=True)]
    return "\n".join(["position_m,altitude_m", *rows]) + "\n"


def climb_m(route: Route) -> float:
    return climb_and_fall_m(route)[0]


def test_noise_of_4_m_vanishes_when_smoothed_over_2_km_and_stays_when_not(tmp_path: Path) -> None:
    noise_m = 4.0 * np.random.default_rng(1).standard_normal(len(AT_M))
    rows = table(AT_M, hill_m(AT_M) + noise_m)
    raw = with_heights(tmp_path, rows, smooth_m=0.0, cap_permille=200.0).route
    smooth = with_heights(tmp_path, rows).route
    assert climb_m(raw) > 1000
    assert climb_m(smooth) == pytest.approx(120, abs=12)
    assert (raw.altitudes, smooth.altitudes) == ("raw", "smoothed")
    assert np.abs(smooth.altitude_m(AT_M) - hill_m(AT_M)).max() < 4.0


def test_smoothing_leaves_a_gentle_hill_as_it_is_also_at_the_ends(tmp_path: Path) -> None:
    route = with_heights(tmp_path, table(AT_M, hill_m(AT_M))).route
    assert np.abs(route.altitude_m(AT_M) - hill_m(AT_M)).max() < 0.4
    assert route.altitude_at_start_m == pytest.approx(400, abs=0.2)
    slope = with_heights(tmp_path, table(AT_M, 0.01 * AT_M)).route
    assert slope.gradients_ratio.value == pytest.approx([0.01])


def test_the_ground_over_a_tunnel_and_under_a_bridge_is_not_the_track(tmp_path: Path) -> None:
    over = np.where((AT_M > 20_000) & (AT_M < 23_000), 300.0, 0.0) - np.where(
        (AT_M > 40_000) & (AT_M < 40_500), 80.0, 0
    )
    rows = table(AT_M, hill_m(AT_M) + over)
    structures = Zone(start_m=20_000.0, length_m=3000.0), Zone(start_m=40_000.0, length_m=500.0)
    found = with_heights(tmp_path, rows, line(*structures))
    assert np.abs(found.route.altitude_m(AT_M) - hill_m(AT_M)).max() < 4
    assert "33 in tunnels and on bridges left out" in found.remarks[0]
    assert np.abs(with_heights(tmp_path, rows).route.altitude_m(AT_M) - hill_m(AT_M)).max() > 50


def test_gradients_are_capped_and_it_is_said(tmp_path: Path) -> None:
    spike = np.where(AT_M == 30_000, 50.0, 0.0)
    found = with_heights(tmp_path, table(AT_M, hill_m(AT_M) + spike), smooth_m=0.0, cap_permille=50.0)
    assert np.abs(found.route.gradients_ratio.value).max() == pytest.approx(0.05)
    assert "Gradients above 50 ‰ were cut to it on 200 m" in found.remarks[-1]


def test_stations_and_summits_are_joined_by_straight_lines(tmp_path: Path) -> None:
    stops = tuple(Stop(name=name, position_m=x) for name, x in (("Adorf", 0.0), ("Mitte", 20e3), ("Bestadt", LENGTH_M)))
    rows = "name,position_km,altitude_m\nadorf,,400\nMITTE,,420\n,30,600\nBestadt,,390\n"
    found = with_heights(tmp_path, rows, line(stops=stops))
    assert found.route.altitudes == "points"
    assert found.route.altitude_m([0, 20e3, 30e3, LENGTH_M]) == pytest.approx([400, 420, 600, 390], abs=0.01)
    assert len(found.route.gradients_ratio.value) == 3
    assert "include summits" in found.remarks[0]


def test_altitudes_by_coordinates_fall_on_the_line(tmp_path: Path) -> None:
    base = line()
    at_m = np.array([0.0, LENGTH_M])
    places = {"geometry_position_m": at_m, "geometry_latitude_deg": np.array([48.0, 48.0])}
    route = Route(**{**vars(base.route), **places, "geometry_longitude_deg": np.array([8.0, 8.8043])})
    rows = "lat,lon,altitude_m\n48.0,8.0,100\n48.001,8.40215,200\n48.0,8.8043,100\n48.2,8.5,900\n"
    found = with_heights(tmp_path, rows, ImportedLine(route=route)).route
    assert found.altitude_m([0, 30_000, LENGTH_M]) == pytest.approx([100, 200, 100], abs=0.5)


def test_points_at_one_place_are_averaged_and_the_line_is_level_beyond_the_last(tmp_path: Path) -> None:
    rows = "position_km,altitude_m\n5,100\n5,110\n25,125\n"
    route = with_heights(tmp_path, rows).route
    assert route.altitude_m([0, 5000, 25_000, LENGTH_M]) == pytest.approx([105, 105, 125, 125], abs=0.01)
    near = with_heights(tmp_path, "position_km,altitude_m\n5,100\n5.005,100.2\n").route
    assert near.altitude_m([LENGTH_M]) == pytest.approx([100.2], abs=0.01), "5 m apart are two places"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("position_km,limit_kmh\n0,80\n", "no altitudes, expected a column altitude_m"),
        ("position_km,altitude_m\n0,80\n", "1 of 1 altitudes are on the line"),
        ("position_km,altitude_m\n0,80\n900,80\n", "1 of 2 altitudes are on the line"),
        ("position_km,altitude_m\n0,80\n0.0001,80\n", "all altitudes are at one place"),
        ("position_km,altitude_m\n0,80\n1,8e5\n", "line 3 altitude = '800000 m': expected -500 to 9000 m"),
        ("name,altitude_m\nAdorf,80\nCedorf,90\n", "line 3 name = 'Cedorf': expected a stop of the line (Adorf, Best"),
        ("lat,lon,altitude_m\n48,8,90\n", "the line has no geometry"),
        ("lat,lon,altitude_m\n98,8,90\n", "line 2 latitude = 98.0"),
    ],
)
def test_altitudes_that_are_not_of_the_line_are_refused(tmp_path: Path, rows: str, message: str) -> None:
    with pytest.raises(DasError) as caught:
        with_heights(tmp_path, rows)
    assert message in str(caught.value)


def test_climb_and_fall_of_a_hand_made_line() -> None:
    route = line().route
    steps = Stretches(start_m=np.array([0.0, 1000.0, 3000.0]), value=np.array([0.01, -0.002, 0.0]))
    assert climb_and_fall_m(Route(**{**vars(route), "gradients_ratio": steps})) == pytest.approx((10.0, 4.0))
