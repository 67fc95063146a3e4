"""The way of a train through a map: which tracks, which limits, which stations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.route import Route
from precompute.route_import.from_map import line_from_map
from precompute.route_import.line import ImportOrder, Words
from precompute.route_import.track_map import read_map
from tests.support.crossing import numbered
from tests.support.made_maps import (
    ROUTE,
    as_overpass,
    collection,
    drawn_otherwise,
    feature,
    made_map,
    same_line,
    written,
)

STATIONS = (
    feature([8.0, 48.0001], "Point", railway="station", name="A"),
    feature([8.06, 48.0001], "Point", railway="station", name="B"),
)


def imported(folder: Path, content: Any, ends: tuple[str, str] = ("A", "B"), **options: Any) -> Route:
    the_map = read_map([written(folder / "map.json", content)])
    return line_from_map(the_map, ends, ImportOrder(**options), Words()).route


def east(*degrees: float, north: float = 48.0) -> list[list[float]]:
    """Points on a circle of latitude, at longitudes of 8° and so many hundredths."""
    return [[round(8 + one / 100, 7), north] for one in degrees]


def test_the_map_of_the_example_gives_the_limits_of_its_route(tmp_path: Path) -> None:
    """The route file is the second witness; its geometry is 0.2 % longer on the ellipsoid than its kilometres."""
    found = imported(tmp_path, made_map(), ("adorf", "CEDORF"))
    scale = found.length_m / ROUTE.length_m
    assert scale == pytest.approx(1.0022, abs=2e-4)
    assert found.limits_mps.value == pytest.approx(ROUTE.limits_mps.value)
    assert found.limits_mps.start_m == pytest.approx(ROUTE.limits_mps.start_m * scale, abs=5.0)
    assert [stop.name for stop in found.stops] == ["Adorf", "Bedorf", "Cedorf"]
    assert found.stops[1].position_m == pytest.approx(6200 * scale, abs=5.0)
    assert [(round(x.start_m, -2), round(x.length_m, -2), x.area_m2) for x in found.tunnels] == [(8200, 800, 50)]
    assert (found.one_way, found.altitudes, found.credit) == (True, "none", "")


def test_the_other_direction_takes_the_other_track_and_its_limits(tmp_path: Path) -> None:
    there, back = (imported(tmp_path, made_map(), ends) for ends in (("Adorf", "Cedorf"), ("Cedorf", "Adorf")))
    assert back.limits_mps.value.tolist() == there.limits_mps.value.tolist()[::-1]
    apart = np.abs(np.interp(8.03, there.geometry_longitude_deg, there.geometry_latitude_deg)
                   - np.interp(8.03, back.geometry_longitude_deg[::-1], back.geometry_latitude_deg[::-1]))  # fmt: skip
    assert apart * 111_200 == pytest.approx(4.5, abs=0.5)
    assert 60 / 3.6 not in back.limits_mps.value  # the limit of the tunnel for trains of the wrong track


@pytest.mark.parametrize("seeds", numbered("DAS_MAPS_DRAWN", 100))
def test_how_a_map_is_drawn_changes_nothing(tmp_path: Path, seeds: range) -> None:
    plain = imported(tmp_path, made_map(), ("Adorf", "Cedorf"))
    different = [
        seed
        for seed in seeds
        if not same_line(plain, imported(tmp_path, drawn_otherwise(made_map(), seed), ("Adorf", "Cedorf")))
    ]
    assert different == []


def test_overpass_and_geojson_give_the_same_line_and_overpass_names_its_licence(tmp_path: Path) -> None:
    plain = imported(tmp_path, made_map(), ("Adorf", "Cedorf"))
    osm = imported(tmp_path, as_overpass(made_map()), ("Adorf", "Cedorf"))
    assert same_line(plain, osm)
    assert osm.credit == "© OpenStreetMap contributors, ODbL 1.0"


def test_a_train_never_turns_sharply(tmp_path: Path) -> None:
    """The short way would need a turn of 60°; the long way is gentle."""
    short = feature([[8.03, 48.0], [8.035, 48.005795], [8.06, 48.0]])
    gentle = feature([*east(0, 3), [8.04, 48.001], [8.05, 48.001], [8.06, 48.0]])
    assert 4470 < imported(tmp_path, collection(short, gentle, *STATIONS)).length_m < 4560
    with pytest.raises(DasError, match=r"no way from A to B without reversing .* end 2.2. km from it"):
        imported(tmp_path, collection(short, feature(east(0, 3)), *STATIONS))


def test_a_short_piece_without_a_branch_may_turn_more(tmp_path: Path) -> None:
    """Maps have steps of some metres that no track has; a switch has none of them."""
    step = [[8.03, 48.0], [8.03003, 48.00003], [8.06, 48.0]]
    assert imported(tmp_path, collection(feature(east(0, 3)), feature(step), *STATIONS)).length_m > 4000


def test_the_preferred_direction_counts_and_sidings_are_dear(tmp_path: Path) -> None:
    def way(north: float, **tags: str) -> dict[str, Any]:
        return feature([[8.0, 48.0], [8.01, north], [8.05, north], [8.06, 48.0]], **tags)

    for tags in ({"railway__preferred_direction": "backward"}, {"service": "siding"}, {"oneway": "-1"}):
        content = collection(way(48.0, **tags), way(48.001, maxspeed="77"), *STATIONS)
        assert imported(tmp_path, content).limits_mps.value * 3.6 == pytest.approx([77.0])
    content = collection(way(48.0, usage="main"), way(48.001, maxspeed="77"), *STATIONS)
    assert imported(tmp_path, content).limits_mps.value * 3.6 == pytest.approx([100.0])


def test_the_way_leads_over_a_station_that_is_named(tmp_path: Path) -> None:
    north = feature([[8.01, 48.0], [8.02, 48.004], [8.04, 48.004], [8.05, 48.0]])
    place = feature([8.03, 48.0041], "Point", railway="halt", name="Over")
    content = collection(feature(east(0, 1, 5, 6)), north, place, *STATIONS)
    assert [x.name for x in imported(tmp_path, content).stops] == ["A", "B"]
    over = imported(tmp_path, content, via=("over",))
    assert [x.name for x in over.stops] == ["A", "Over", "B"]
    by_place = imported(tmp_path, content, via=("48.0041,8.03",), only_named_stops=True)
    assert [x.name for x in by_place.stops] == ["A", "B"]
    assert by_place.length_m == over.length_m


def test_a_train_does_not_reverse_at_a_station_on_the_way(tmp_path: Path) -> None:
    stub = feature([[8.03, 48.0], [8.02, 48.002], [8.01, 48.004]])
    place = feature([8.01, 48.004], "Point", railway="halt", name="Stub")
    with pytest.raises(DasError, match="no way from"):
        imported(tmp_path, collection(feature(east(0, 3, 6)), stub, place, *STATIONS), via=("Stub",))


def test_tracks_that_cross_on_the_level_are_not_joined(tmp_path: Path) -> None:
    """Both branches leave the crossing at 10°: without the tag there could be a switch."""
    across = feature([[8.02, 47.998], [8.03, 48.0], [8.04, 48.002], [8.06, 48.0003]], maxspeed="30")
    ends = east(0, 3, 4)
    crossing = feature([8.03, 48.0], "Point", railway="railway_crossing")
    assert imported(tmp_path, collection(feature(ends), across, *STATIONS)).length_m > 4000
    with pytest.raises(DasError, match="no way from A to B"):
        imported(tmp_path, collection(feature(ends), across, crossing, *STATIONS))


def test_ends_that_join_an_inner_vertex_or_lie_within_3_m_are_joined(tmp_path: Path) -> None:
    inner = collection(feature(east(0, 2, 3)), feature(east(2, 4, 6), maxspeed="50"), *STATIONS)
    assert len(imported(tmp_path, inner).limits_mps.value) == 2
    near = [[8.0200300, 48.0], [8.06, 48.0]]  # 2.2 m from the end of the other one
    assert imported(tmp_path, collection(feature(east(0, 2)), feature(near), *STATIONS)).length_m > 4000
    far = collection(feature(east(0, 2)), feature([[8.0202, 48.0], [8.06, 48.0]]), *STATIONS)
    with pytest.raises(DasError, match="no way from A to B"):
        imported(tmp_path, far)


def test_the_line_begins_abreast_of_the_station_on_a_track_that_leads_on(tmp_path: Path) -> None:
    """The nearest track, at the platform, has no way out; vertices are far from the station."""
    platform_track = feature([[7.998, 48.00008], [8.002, 48.00008]], service="siding")
    content = collection(platform_track, feature([[7.9, 48.0], [8.1, 48.0]]), *STATIONS)
    found = imported(tmp_path, content)
    assert found.geometry_longitude_deg[[0, -1]] == pytest.approx([8.0, 8.06], abs=1e-6)


def test_limits_that_are_missing_are_those_of_the_slower_neighbour_or_as_asked(tmp_path: Path) -> None:
    tracks = (feature(east(0, 2), maxspeed="120"), feature(east(2, 4), maxspeed="signals"), feature(east(4, 6)))
    the_map = read_map([written(tmp_path / "map.json", collection(*tracks, *STATIONS))])
    line = line_from_map(the_map, ("A", "B"), ImportOrder(), Words())
    assert line.route.limits_mps.value * 3.6 == pytest.approx([120.0, 100.0])
    assert any("Limits on 66.7 % of the length; the other 149" in remark for remark in line.remarks)
    asked = line_from_map(the_map, ("A", "B"), ImportOrder(limit_kmh=40.0), Words())
    assert asked.route.limits_mps.value * 3.6 == pytest.approx([120.0, 40.0, 100.0])
    nothing = replace(the_map, tracks=tuple(replace(one, tags={"railway": "rail"}) for one in the_map.tracks))
    with pytest.raises(DasError, match="no limit on the whole way"):
        line_from_map(nothing, ("A", "B"), ImportOrder(), Words())


@pytest.mark.parametrize(
    ("maxspeed", "limit_kmh", "said"),
    [
        ("60|80", 60.0, "maxspeed = '60|80' of {} (km 1.493): 60 km/h"),
        ("120,5", 120.5, "maxspeed = '120,5' of {} (km 1.493): 120.5 km/h"),
        ("signals", 150.0, "maxspeed = 'signals' of {} (km 1.493): no speed"),
        ("9999", 150.0, "maxspeed = '9999' of {} (km 1.493): no speed"),
        ("80; 60 mph", 80.0, None),
        ("80", 80.0, None),
    ],
)
def test_a_limit_of_an_unusual_form_is_its_least_number_and_is_said_with_its_track(
    tmp_path: Path, maxspeed: str, limit_kmh: float, said: str | None
) -> None:
    ends = (feature(east(0, 2), maxspeed="180"), feature(east(4, 6), maxspeed="150"))
    the_map = read_map(
        [written(tmp_path / "m.json", collection(ends[0], feature(east(2, 4), maxspeed=maxspeed), ends[1], *STATIONS))]
    )
    found = line_from_map(the_map, ("A", "B"), ImportOrder(), Words())
    assert limit_kmh in (found.route.limits_mps.value * 3.6).round(3).tolist()
    remarks = [remark for remark in found.remarks if "no plain speeds" in remark]
    assert len(remarks) == (said is not None)
    name = the_map.tracks[1].name
    assert said is None or said.format(name) in remarks[0], remarks


def test_stations_beside_the_way_become_stops_once(tmp_path: Path) -> None:
    more = (
        feature([8.03, 48.0002], "Point", railway="halt", name="Middle"),
        feature([8.0305, 48.0], "Point", public_transport="stop_position", name="Middle"),
        feature([8.04, 48.01], "Point", railway="station", name="Far away"),
        feature([8.05, 48.0], "Point", railway="junction", name="Junction"),
        feature([8.0002, 48.0], "Point", railway="stop", name="a"),
    )
    content = collection(feature(east(0, 3, 6)), *more, *STATIONS)
    assert [stop.name for stop in imported(tmp_path, content).stops] == ["A", "Middle", "B"]
    assert [stop.name for stop in imported(tmp_path, content, only_named_stops=True).stops] == ["A", "B"]


def test_a_ring_and_a_loose_heap_of_tracks_end(tmp_path: Path) -> None:
    """A ring without an exit is searched once; a map of pieces that touch nothing says so."""
    angles = np.linspace(0, 2 * np.pi, 60)
    ring = [[8.02 + 0.01 * float(np.sin(x)), 48.0 + 0.007 * (1 - float(np.cos(x)))] for x in angles]
    content = collection(feature(east(0, 2)), feature(ring), feature(east(5, 6)), *STATIONS)
    with pytest.raises(DasError, match="no way from A to B"):
        imported(tmp_path, content)
    pieces = [feature(east(x, x + 0.005)) for x in np.arange(0.0, 6.0, 0.01)]
    with pytest.raises(DasError, match="no way from A to B"):
        imported(tmp_path, collection(*pieces, *STATIONS))


def test_a_stop_on_the_track_stands_for_a_station_that_is_far_from_it(tmp_path: Path) -> None:
    house = feature([8.06, 48.01], "Point", railway="station", name="Far")
    stop = feature([8.05, 48.0], "Point", railway="stop", name="Far")
    content = collection(feature(east(0, 7)), house, stop, *STATIONS)
    assert imported(tmp_path, content, ("A", "far")).geometry_longitude_deg[-1] == pytest.approx(8.05)


def test_a_track_with_the_name_of_a_station_stands_for_it_and_it_is_said(tmp_path: Path) -> None:
    content = collection(feature(east(0, 1, 2), label="Uno"), feature(east(2, 6)), feature(east(6, 8), name="Due"))
    the_map = read_map([written(tmp_path / "map.json", content)])
    line = line_from_map(the_map, ("uno", "Due"), ImportOrder(), Words())
    assert line.route.geometry_longitude_deg[[0, -1]] == pytest.approx([8.01, 8.08])
    assert "uno" not in line.remarks[1]
    assert "Uno is no station of the map but the name of a track" in line.remarks[1]
    with pytest.raises(DasError, match="no station 'Tre'"):
        line_from_map(the_map, ("uno", "Tre"), ImportOrder(), Words())


def test_no_track_near_a_station_and_the_same_station_twice(tmp_path: Path) -> None:
    content = collection(feature(east(0, 6)), *STATIONS)
    with pytest.raises(DasError, match=r"no track within 400 m of Up: the nearest is 1\d\.\d km away"):
        imported(tmp_path, content, ("Up=48.1,8.0", "B"))
    with pytest.raises(DasError, match="are the same place on the tracks"):
        imported(tmp_path, content, ("A", "a"))
