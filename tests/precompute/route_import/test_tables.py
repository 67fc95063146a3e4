"""Lines from tables: CSV files with units in their columns, and running paths of railtoolkit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.route import Route
from precompute.route_import import imported
from precompute.route_import.altitudes import climb_and_fall_m
from precompute.route_import.line import ImportOrder, Words

LIMITS = "position_km,limit_kmh\n0,80\n1.5,120\n4,100\n"
GRADIENTS = "position_m;gradient_permille\n0;0\n1000;5,5\n3000;-2\n"
STOPS = "name,position_km,latitude_deg,longitude_deg\nAdorf,0,48,8\nBestadt,2.5,48,8.0335\nCe,6,48,8.0804\n"
PATH = """%YAML 1.2
---
schema: https://railtoolkit.org/schema/running-path.json
schema_version: "2022.05"
paths:
  - name: made up
    id: p
    characteristic_sections:
      - [   0.0,  40, 2.0 ]
      - [ 500.0,  40, 5.0 ]
      - [ 900.0, 110, 5.0 ]
      - [2000.0, 110, 0.0 ]
"""


def line(folder: Path, files: Mapping[str, str], *, flat: bool = False, **order: object) -> Route:
    paths = []
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
        paths.append(folder / name)
    return imported(paths, ImportOrder(flat=flat, **order), Words()).route  # type: ignore[arg-type]


def test_limits_gradients_and_stops_in_files_of_their_own(tmp_path: Path) -> None:
    route = line(tmp_path, {"l.csv": LIMITS, "g.csv": GRADIENTS, "s.csv": STOPS})
    assert (route.id, route.name, route.length_m) == ("adorf-ce", "Adorf – Ce", 6000)
    assert route.limits_mps.start_m.tolist() == [0, 1500, 4000]
    assert route.limits_mps.value * 3.6 == pytest.approx([80, 120, 100])
    assert route.gradients_ratio.value == pytest.approx([0, 0.0055, -0.002])
    assert climb_and_fall_m(route) == pytest.approx((11.0, 6.0))
    assert [(x.name, x.position_m, x.longitude_deg) for x in route.stops][1] == ("Bestadt", 2500, 8.0335)
    assert (route.one_way, route.altitudes) == (True, None)


def test_all_in_one_file_with_other_names_of_columns_and_empty_cells(tmp_path: Path) -> None:
    rows = "0\t80\t0\tbegin\tA\n\n# pause\n1\t\t4,5\t\t\n2\t60\t\t\t\n3\t\t\t\tB\n"
    text = f"km\tv_kmh\tslope [permille]\tnote\tstation\n{rows}"
    route = line(tmp_path, {"all.tsv": text})
    assert route.limits_mps.start_m.tolist() == [0, 2000]
    assert route.gradients_ratio.value == pytest.approx([0, 0.0045])
    assert [x.name for x in route.stops] == ["A", "B"]


def test_altitudes_beside_limits_become_gradients_unless_the_line_is_to_be_flat(tmp_path: Path) -> None:
    text = "position_km,limit_kmh,altitude_m\n0,80,400\n3,120,430\n6,,415\n"
    route = line(tmp_path, {"all.csv": text}, start="A", end="B")
    assert route.gradients_ratio.value == pytest.approx([0.01, -0.005])
    assert (route.altitudes, route.altitude_at_start_m) == ("points", pytest.approx(400))
    flat = line(tmp_path, {"all.csv": text}, start="A", end="B", flat=True)
    assert (flat.altitudes, flat.gradients_ratio.value.tolist()) == ("none", [0.0])


def test_curves_tunnels_and_neutral_sections(tmp_path: Path) -> None:
    files = {
        "limits.csv": LIMITS,
        "stops.csv": STOPS,
        "curves.csv": "position_m,radius_m\n500,-800\n900,inf\n",
        "tunnels.csv": "position_km,length_m,cross_section_m2\n2,300,45\n",
        "neutral_sections.csv": "position_km,length_m\n3,80\n",
        "no_regeneration.csv": "position_km,length_m\n5,500\n",
    }
    route = line(tmp_path, files, flat=True)
    assert route.curvature_per_m.at([0, 600, 1000]) == pytest.approx([0, 1 / 800, 0])
    assert [(x.start_m, x.length_m, x.area_m2) for x in route.tunnels] == [(2000, 300, 45)]
    assert [(x.start_m, x.length_m) for x in (*route.neutral_sections, *route.no_regeneration)] == [
        (3000, 80), (5000, 500)
    ]  # fmt: skip
    with pytest.raises(DasError, match="positions with lengths, expected cross_section_m2 as well"):
        line(tmp_path, {"limits.csv": LIMITS, "zones.csv": "position_km,length_m\n3,80\n"}, flat=True)
    for again, message in (("curves.csv", "both have curves"), ("tunnels.csv", "a second table of tunnels")):
        with pytest.raises(DasError, match=message):
            line(tmp_path, {**files, f"more-{again}": files[again]}, flat=True)
    half = "position_km,radius_start_m\n1,500\n"
    with pytest.raises(DasError, match="a curve has radius_start_m and radius_end_m, or radius_m"):
        line(tmp_path, {"limits.csv": LIMITS, "curves.csv": half}, flat=True)


def test_a_polyline_alone_gives_the_length_and_places(tmp_path: Path) -> None:
    """At 45° N a degree of latitude has 111 132 m (from 44.5° to 45.5°, published length of the meridian)."""
    course = "lat,lon\n44.5,8\n45,8\n45.5,8\n"
    route = line(tmp_path, {"l.csv": LIMITS, "course.csv": course}, flat=True, start="A", end="B")
    assert route.length_m == pytest.approx(111_132, abs=2)
    assert [x.name for x in route.stops] == ["A", "B"]
    empty = "position_km,lat,lon\n1,,\n"
    assert not len(line(tmp_path, {"l.csv": LIMITS, "course.csv": empty}, flat=True).geometry_position_m)
    scaled = line(tmp_path, {"l.csv": LIMITS, "course.csv": course}, flat=True, length_km=110.0)
    assert scaled.geometry_position_m == pytest.approx([0, 55_000, 110_000], abs=5)


def half_circle(count: int = 181) -> str:
    """A course with a radius of 5 km, from its western end over its northern point to its eastern end."""
    angle = np.linspace(np.pi, 0.0, count)
    north_m, east_m = 5000 * np.sin(angle), 5000 * np.cos(angle)
    latitude, longitude = 47 + north_m / 111_177, 8 + east_m / 76_060
    rows = "".join(f"{a:.7f},{b:.7f}\n" for a, b in zip(latitude, longitude, strict=True))
    return f"lat,lon\n{rows}"


ON_THE_CIRCLE = "name,lat,lon\nWest,47,7.934262\nTop,47.044973,8\nEast,47,8.065738\n"


def test_stops_by_coordinates_lie_on_the_course_and_not_on_straight_lines_between_them(tmp_path: Path) -> None:
    """Half a circle of 5 km has 15.708 km; straight lines between the three stops have 14.14 km."""
    files = {"l.csv": LIMITS, "course.csv": half_circle(), "stops.csv": ON_THE_CIRCLE}
    for order in (list(files), list(files)[::-1]):
        route = line(tmp_path, {name: files[name] for name in order}, flat=True)
        assert [stop.position_m for stop in route.stops] == pytest.approx([0, 7854, 15_708], abs=10)
        assert route.length_m == pytest.approx(15_708, abs=10)
        assert len(route.geometry_position_m) >= 180
    scaled = line(tmp_path, files, flat=True, length_km=16.0)
    assert scaled.stops[1].position_m == pytest.approx(8000, abs=5)
    measured = "position_km,lat,lon,name\n0,47,7.934262,West\n,47.044973,8,Top\n15.7,47,8.065738,East\n"
    route = line(tmp_path, {**files, "stops.csv": measured}, flat=True)
    assert [stop.position_m for stop in route.stops] == pytest.approx([0, 7854, 15_700], abs=5)


def test_limits_by_coordinates_share_the_frame_of_the_course(tmp_path: Path) -> None:
    limits = "lat,lon,limit_kmh\n47,7.934262,100\n47.044973,8,60\n"
    route = line(tmp_path, {"l.csv": limits, "course.csv": half_circle()}, flat=True)
    assert route.limits_mps.start_m.tolist() == pytest.approx([0, 7854], abs=5)
    assert route.length_m == pytest.approx(15_708, abs=10)


def test_a_stop_in_the_middle_of_a_segment_ends_the_geometry_there(tmp_path: Path) -> None:
    stops = "position_km,name\n0,A\n7,B\n"
    course = "position_km,lat,lon\n0,47,8\n10,47,8.1\n"
    route = line(tmp_path, {"l.csv": LIMITS, "s.csv": stops, "c.csv": course}, flat=True)
    assert route.geometry_position_m.tolist() == [0, 7000]
    assert route.geometry_longitude_deg.tolist() == pytest.approx([8, 8.07])


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"s.csv": ON_THE_CIRCLE}, r"s\.csv: line 2 position is missing: expected a position, or a table of lat"),
        ({"c.csv": half_circle(), "d.csv": half_circle()}, r"c\.csv, .*d\.csv: each may be the course, expected"),
        (
            {"c.csv": half_circle(), "s.csv": "name,lat,lon\nWest,47,7.934262\nFar,47.1,8\n"},
            r"line 3 latitude, longitude = '\d+ m from the course .*expected at most 500 m",
        ),
        (
            {"c.csv": half_circle(), "s.csv": "name,lat,lon\nEast,47,8.065738\nTop,47.044973,8\n"},
            "line 3 latitude, longitude = '7.* m from the course after the previous row",
        ),
        ({"c.csv": half_circle(), "s.csv": "position_km,name\n0,A\n,B\n9,C\n"}, "line 3 position is missing"),
    ],
)
def test_coordinates_that_no_course_places_are_refused(tmp_path: Path, files: dict[str, str], message: str) -> None:
    with pytest.raises(DasError, match=message):
        line(tmp_path, {"l.csv": LIMITS, **files}, flat=True)


def test_gradients_may_be_in_per_cent(tmp_path: Path) -> None:
    route = line(tmp_path, {"one.csv": "position_km,limit_kmh,gradient_percent\n0,100,1.2\n5,,-0.8\n10,,\n"})
    assert route.gradients_ratio.value == pytest.approx([0.012, -0.008])


def test_a_running_path_of_railtoolkit(tmp_path: Path) -> None:
    route = line(tmp_path, {"path.yaml": PATH}, start="Görlitz", end="Dresden")
    assert (route.length_m, route.id) == (2000, "gorlitz-dresden")
    assert route.limits_mps.start_m.tolist() == [0, 900]
    assert route.gradients_ratio.value == pytest.approx([0.002, 0.005])


def test_a_part_of_the_line_between_two_stops(tmp_path: Path) -> None:
    files = {"l.csv": LIMITS, "g.csv": GRADIENTS, "s.csv": STOPS}
    whole = line(tmp_path, files)
    part = line(tmp_path, files, start="bestadt", end="CE")
    assert (part.name, part.length_m) == ("Bestadt – Ce", 3500)
    assert [(x.name, x.position_m) for x in part.stops] == [("Bestadt", 0), ("Ce", 3500)]
    at_m = np.array([0.0, 400.0, 600.0, 1600.0, 3400.0])
    for (_, one), (_, other) in zip(part.quantities(), whole.quantities(), strict=True):
        assert one.at(at_m) == pytest.approx(other.at(at_m + 2500))
    assert part.altitude_m(1000.0) == pytest.approx(whole.altitude_m(3500.0))
    with pytest.raises(DasError, match="Adorf does not come after Ce"):
        line(tmp_path, files, start="Ce", end="Adorf")
    with pytest.raises(DasError, match="no stop 'Deburg'"):
        line(tmp_path, files, start="Deburg")


def test_a_part_has_the_altitudes_of_its_own_positions_and_an_id_of_its_own(tmp_path: Path) -> None:
    """Positions of altitudes count from the beginning of the tables, not of the part."""
    rows = "0,80,100,A\n5,100,150,B\n10,90,100,C\n"
    files = {"all.csv": f"position_km,limit_kmh,altitude_m,name\n{rows}"}
    part = line(tmp_path, files, start="B")
    assert (part.id, part.name, part.altitude_at_start_m) == ("b-c", "B – C", 150)
    assert part.gradients_ratio.value == pytest.approx([-0.01])
    (tmp_path / "heights.csv").write_text("name,altitude_m\nA,100\nB,150\nC,100\n")
    by_name = line(tmp_path, files, start="B", altitudes=tmp_path / "heights.csv")
    assert by_name.gradients_ratio.value == pytest.approx([-0.01])


def test_a_part_may_begin_before_its_geometry_and_end_where_the_line_began(tmp_path: Path) -> None:
    files = {
        "l.csv": "position_km,limit_kmh\n0,80\n",
        "s.csv": "name,position_km\nA,0\nB,0.5\nA,10\n",
        "course.csv": "position_km,lat,lon\n1,48,8\n5,48,8.0537\n10,48,8.1208\n",
    }
    part = line(tmp_path, files, start="B", flat=True)
    assert part.geometry_position_m.tolist() == [500, 4500, 9500]
    assert line(tmp_path, files, start="A", end="A", flat=True).length_m == 10_000


BAD_TABLES = [
    ("", "empty, expected a line of column names"),
    ("position_km,limit_kmh\n", "number of rows = 0"),
    ("position,limit_kmh\n0,80\n", "column = 'position': expected a quantity with its unit"),
    ("position_km,limit_kn\n0,80\n", "column = 'limit_kn'"),
    ("position_km,position_m,limit_kmh\n0,0,80\n1,1,80\n", "each quantity once"),
    ("limit_kmh\n80\n", "no column of positions"),
    ("position_km,limit_kmh\n0,80\n1\n", "line 3 = '1': expected 2 cells"),
    ("position_km,limit_kmh\n0,fast\n", "line 2 limit = 'fast': expected a number"),
    ("position_km,limit_kmh\n0,nan\n", "line 2 limit = 'nan': expected a number"),
    ("position_km,limit_kmh\n0,1e999\n", "line 2 limit = inf: expected a finite number"),
    ("position_km,limit_kmh\n0,80\n2,90\n1,80\n", "line 4 position = '1000 m': expected more than 2000 m"),
    ("position_km,limit_kmh\n-1,80\n2,90\n", "line 2 position = '-1000 m': expected a position >= 0 m"),
    ("position_km,limit_kmh\n1,80\n2,90\n", "first position of limit = '1 km': expected 0 km"),
    ("position_km,limit_kmh\n0,0\n2,90\n", "expected a speed > 0"),
    ("position_km,limit_kmh\n0,800\n2,90\n", "speed_limits[0] (km/h) = 800"),
    ("position_km,gradient_permille\n0,3\n2,0\n", "no column of limits"),
    ("position_km,limit_kmh,gradient_permille\n0,80,300\n2,80,0\n", "gradients[0] (‰) = 300"),
    ('position_km,limit_kmh\n0,"80\n', "not a usable CSV file"),
    ("position_km,limit_kmh,lat,lon\n0,80,98,8\n1,80,48,8\n", "line 2 latitude = 98.0: expected -90 to 90 degrees"),
    ("position_km,limit_kmh,lat,lon\n0,80,0,0\n1,80,48,8\n", "geometry: map distance to the next point"),
    ("position_km,limit_kmh\n,80\n", "line 2 position is missing: expected a position"),
    ("position_km,limit_kmh\n0,80\n2.5e-12,90\n", "length of the line = '2.5e-09 m': expected 1 m or more"),
    ("lat,lon,limit_kmh\n48,8,80\n48,8,90\n", "and at least two different places"),
]
BAD_PATHS = [
    ("a: [", "not valid YAML"),
    ("[" * 1200 + "]" * 1200, "YAML"),
    ("trains: []", "not a running path of railtoolkit"),
    (
        "schema: https://railtoolkit.org/schema/rolling-stock.json\npaths: []",
        "is rolling stock of railtoolkit, expected a map",
    ),
    (PATH + "  - {id: q}\n", "paths = 2: expected one path"),
    (PATH.replace("[ 500.0,  40, 5.0 ]", "[ 500.0, 40 ]"), "characteristic_sections[1] = [500.0, 40]"),
    (PATH.replace("500.0,  40", "500.0, .nan"), "characteristic_sections[1] = nan: expected a number"),
    (PATH.replace("500.0", "5000.0"), "line 2 position = '900 m': expected more than 5000 m"),
]


@pytest.mark.parametrize(
    ("name", "bad"), [*(("t.csv", one) for one in BAD_TABLES), *(("p.yaml", one) for one in BAD_PATHS)]
)
def test_a_table_or_path_that_cannot_be_meant_is_refused(tmp_path: Path, name: str, bad: tuple[str, str]) -> None:
    text, message = bad
    with pytest.raises(DasError) as caught:
        line(tmp_path, {name: text}, flat="gradient" not in text)
    assert message in str(caught.value)


def test_two_tables_of_one_quantity_and_options_of_maps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DasError, match="both have limits"):
        line(tmp_path, {"a.csv": LIMITS, "b.csv": LIMITS}, flat=True)
    with pytest.raises(DasError, match="no altitudes: give --altitudes FILE"):
        line(tmp_path, {"a.csv": LIMITS})
    with pytest.raises(DasError, match=r"a\.toml: is a route file of this program, expected a map or table of a line"):
        line(tmp_path, {"a.toml": "[route]\n"}, flat=True)
    with pytest.raises(
        DasError, match=r"a\.csv: is a GPX track, expected a map or table of a line; to read it: das-sim"
    ):
        line(tmp_path, {"a.csv": '<gpx version="1.1"/>'}, flat=True)
    for name, content in (("stops.txt", "stop_id,stop_name\n1,A\n"), ("o.json", '{"effort_curves": {}}')):
        with pytest.raises(DasError, match=r"is (one table of a GTFS feed|OSRD rolling stock)"):
            line(tmp_path, {name: content}, flat=True)
    with pytest.raises(DasError, match="belong to lines without gradients"):
        line(tmp_path, {"a.csv": LIMITS, "g.csv": GRADIENTS}, flat=True)
    for unused in ({"smooth_m": 500.0}, {"cap_permille": 30.0}):
        for flat in (True, False):
            with pytest.raises(DasError, match="--smooth-m and --cap-permille belong to"):
                line(tmp_path, {"a.csv": LIMITS, **({} if flat else {"g.csv": GRADIENTS})}, flat=flat, **unused)
    with pytest.raises(DasError, match=r"a\.pbf: export it as Overpass JSON"):
        line(tmp_path, {"a.pbf": ""}, flat=True)
    with pytest.raises(DasError, match="expected a map"):
        line(tmp_path, {"a.docx": ""}, flat=True)
    for of_map in ({"via": ["Bestadt"]}, {"only_named_stops": True}, {"limit_kmh": 60.0}):
        with pytest.raises(DasError, match="belong to maps, not to tables"):
            line(tmp_path, {"a.csv": LIMITS}, flat=True, **of_map)
