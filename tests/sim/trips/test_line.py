"""Lines of kilometre posts or of a route's geometry: read or refused, and positions found on them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.errors import DasError
from das.domain.route import Route, Stop
from sim.trips.line import Line, read_kilometre_posts
from tests.das.domain.files.refusing import refused
from tests.support.made_line import arc, north, posts, posts_file, route


def test_posts_may_rise_or_fall(tmp_path: Path) -> None:
    points = north(np.arange(4) * 1000.0)
    falling = read_kilometre_posts(posts_file(tmp_path, *points))
    rising = read_kilometre_posts(posts_file(tmp_path, *points, first=120034, step=1))
    assert falling.chainage_m.tolist() == rising.chainage_m.tolist() == [0, 1000, 2000, 3000]


A, B, C = (f"{a:.7f},16.2" for a in north(np.array([0.0, 1000.0, 2000.0]))[0])
POSTS = "lon;km;lat\n8,0;12,0;47,0\n8,0;13,1;47,01\n8,0;14,2;47,02\n"
POST_FILES = {
    "empty": ("", "empty list of posts"),
    "one": (f"{A},3490130", "list of posts of 1 line, expected at least 2 lines"),
    "columns": (f"{A}\n{B},2", "line 1 = '59.5000000,16.2': expected 3 columns"),
    "nan": (f"{A},1\n{B},nan", "line 2 kilometre = 'nan': expected a finite number"),
    "equal": (f"{A},1\n{B},2\n{C},2", "line 3 kilometre = 2.0: expected kilometres that only rise or only fall"),
    "turning": (f"{A},1\n{B},2\n{C},1", "line 3 kilometre = 1.0: expected kilometres that only rise or only fall"),
    "first equal": (f"{A},1\n{B},1\n{C},2", "line 2 kilometre = 1.0: expected kilometres that only rise"),
    "distance": (
        f"{A},1\n{C},2",
        "line 2 distance from the post before = '2000 m': expected 1000 m by the kilometres, within 30%",
    ),
    "latitude": (f"{A},1\n91,16.2,2", "line 2 latitude = 91.0: expected -90 to 90 deg"),
    "no latitude": (POSTS.replace("lat\n", "height\n"), "line 1 = 'lon,km,height': expected one column of latitude"),
    "two of a kind": (POSTS.replace("km", "km;km"), "line 1 = 'lon,km,km,lat': expected one column of kilometre"),
    "text": (POSTS.replace("13,1", "x"), "line 3 kilometre = 'x': expected a number"),
}


@pytest.mark.parametrize(("text", "expected"), POST_FILES.values(), ids=POST_FILES)
def test_bad_posts_are_refused_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "posts.csv"
    path.write_text(text)
    refused(read_kilometre_posts, path, re.escape(expected))


@given(s=st.lists(st.floats(-800, 10_800), min_size=1, max_size=20), side=st.floats(-150, 150))
def test_a_straight_line_gives_back_chainage_and_distance(
    tmp_path_factory: pytest.TempPathFactory, s: list[float], side: float
) -> None:
    line = posts(tmp_path_factory.mktemp("posts"))
    chainage, distance = line.match(*north(np.array(s), side))
    assert chainage == pytest.approx(s, abs=0.01)  # beyond the ends too
    assert distance == pytest.approx(abs(side), abs=0.003 * abs(side) + 1e-6)


def test_a_curve_between_posts_stays_near_its_arc_length(tmp_path: Path) -> None:
    """Chord against arc at R = 2000 m: 62 m of sagitta, at most 4 m of chainage, none at the posts."""
    line = read_kilometre_posts(posts_file(tmp_path, *arc(np.arange(5) * 1000.0, 2000.0)))
    s = np.arange(0, 4001, 50.0)
    chainage, distance = line.match(*arc(s, 2000.0))
    assert chainage[::20] == pytest.approx(s[::20], abs=1.0)
    assert np.abs(chainage - s).max() < 5.0
    assert distance.max() == pytest.approx(2000 * (1 - np.cos(0.25)), abs=1.0)


def test_a_dense_curve_is_matched_to_a_metre() -> None:
    s = np.arange(0, 4001, 20.0)
    latitude, longitude = arc(s, 800.0)
    line = Line(source="x", chainage_m=s, latitude_deg=latitude, longitude_deg=longitude, on_route=True)
    wanted = np.arange(5, 2300, 7.0)  # the circle comes round to its start later
    chainage, distance = line.match(*arc(wanted, 800.0))
    assert chainage == pytest.approx(wanted, abs=0.1)
    assert distance.max() < 0.1


def test_a_doubled_vertex_does_no_harm() -> None:
    latitude, longitude = north(np.array([0.0, 500.0, 500.0, 1000.0]))
    chainage_m = np.array([0.0, 500.0, 500.1, 1000.0])
    line = Line(source="x", chainage_m=chainage_m, latitude_deg=latitude, longitude_deg=longitude, on_route=True)
    chainage, _ = line.match(*north(np.array([250.0, 750.0])))
    assert chainage == pytest.approx([250, 750.05], abs=0.1)


def test_a_route_without_geometry_needs_posts() -> None:
    with pytest.raises(
        DasError, match=r"test\.toml: route 'test' has no geometry to match GPS to; give kilometre posts with --posts"
    ):
        Line.from_route(route())


def test_columns_of_posts_may_stand_in_any_order_with_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "posts.csv").write_text(POSTS)
    line = read_kilometre_posts(tmp_path / "posts.csv")
    assert line.chainage_m == pytest.approx([0.0, 1100.0, 2200.0])
    assert line.latitude_deg == pytest.approx([47.0, 47.01, 47.02])
    assert not line.on_route


def with_stops(*stops: tuple[float, float], aside_m: float = 0.0) -> Route:
    """The route with stops at positions (m), whose coordinates are at distances (m) north of the first post."""
    at = [(position_m, *(float(x[0]) for x in north(np.array([north_m]), aside_m))) for position_m, north_m in stops]
    named = (Stop(name=f"S{i}", position_m=p, latitude_deg=a, longitude_deg=b) for i, (p, a, b) in enumerate(at))
    return replace(route(), stops=tuple(named))


def test_coordinates_of_stops_put_posts_on_the_route_whichever_way_they_are_listed(tmp_path: Path) -> None:
    """Stop 0 is 1500 m after the first post, or, driven the other way, 1500 m before the last one."""
    line = posts(tmp_path)
    along = line.placed(with_stops((0.0, 1500.0), (8000.0, 9500.0)))
    against = line.placed(with_stops((0.0, 9500.0), (8000.0, 1500.0)))
    for placed, at_m in ((along, np.array([1500.0, 4000.0])), (against, np.array([9500.0, 7000.0]))):
        assert placed.on_route
        assert placed.by_stops
        assert (np.diff(placed.chainage_m) > 0).all()
        assert placed.match(*north(at_m))[0] == pytest.approx([0.0, 2500.0], abs=0.1)


@pytest.mark.parametrize(
    "on",
    [
        route(),  # no coordinates
        with_stops((0.0, 1500.0), (8000.0, 1500.0)),  # of one place only
        with_stops((0.0, 1500.0), (8000.0, 9800.0)),  # 4 % too far apart
        with_stops((0.0, 1500.0), (8000.0, 9500.0), aside_m=300.0),  # beside another line
    ],
)
def test_coordinates_that_do_not_tell_change_nothing(tmp_path: Path, on: Route) -> None:
    line = posts(tmp_path)
    assert line.placed(on) is line
