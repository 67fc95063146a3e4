"""Reading maps of tracks: the formats of OpenStreetMap and of infrastructure managers, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from precompute.route_import.track_map import TrackLine, read_map
from tests.support.made_maps import as_overpass, collection, feature, made_map, written

LINE = [[8.0, 48.0], [8.01, 48.0]]


def read(folder: Path, content: Any, name: str = "map.json") -> Any:
    return read_map([written(folder / name, content)])


def test_all_formats_of_one_map_have_the_same_tracks_and_places(tmp_path: Path) -> None:
    found = made_map()
    maps = [read(tmp_path, one) for one in (found, as_overpass(found), as_overpass(found, geometry=True))]
    assert len(maps[0].tracks) == 57
    for other in maps[1:]:
        assert [x.vertices for x in other.tracks] == [x.vertices for x in maps[0].tracks]
        assert [dict(x.tags) for x in other.tracks] == [dict(x.tags) for x in maps[0].tracks]
        assert sorted((x.name, x.rank) for x in other.places) == sorted((x.name, x.rank) for x in maps[0].places)
    assert [one.is_osm for one in maps] == [False, True, True]


@pytest.mark.parametrize(
    ("properties", "limit_kmh"),
    [
        ({"railway": "rail", "maxspeed": "120"}, 120.0),
        ({"railway": "rail", "maxspeed": 120}, 120.0),
        ({"railway": "rail", "maxspeed": "75 mph"}, 120.7008),
        ({"railway": "rail", "maxspeed": "120;80"}, 80.0),
        ({"railway": "rail", "maxspeed": "none"}, None),
        ({"railway": "rail", "maxspeed": "120,80"}, 80.0),
        ({"railway": "rail", "maxspeed": "80 (trains: 40)"}, 80.0),
        ({"railway": "rail", "maxspeed": "DE:zone:30"}, 30.0),
        ({"railway": "rail", "maxspeed": "DE:urban"}, None),
        ({"railway": "rail", "maxspeed": "100", "maxspeed:forward": "60"}, 60.0),
        ({"railway": "rail", "maxspeed": "100", "maxspeed:backward": "60"}, 100.0),
        ({"railway": "rail", "maxspeed:backward": "60"}, None),
        ({"tags": {"railway": "rail", "maxspeed": "90"}, "type": "way"}, 90.0),
        ({"railway": "rail", "other_tags": '"electrified"=>"no","maxspeed"=>"70"'}, 70.0),
        ({"fclass": "rail", "maxspeed": 50}, 50.0),
        ({"code_ligne": "830000", "v_max": 140}, 140.0),
    ],
)
def test_the_limit_of_a_track(tmp_path: Path, properties: dict[str, Any], limit_kmh: float | None) -> None:
    one = {"type": "Feature", "properties": properties, "geometry": {"type": "LineString", "coordinates": LINE}}
    (track,) = read(tmp_path, collection(one)).tracks
    limit_mps = track.limit_mps(forward=True)
    assert limit_mps is None if limit_kmh is None else limit_mps == pytest.approx(limit_kmh / 3.6)


def test_shapes_of_geojson(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        collection(
            feature([LINE, [[8.02, 48.0], [8.03, 48.0]]], "MultiLineString"),
            feature([[8.0, 48.0, 412.0], [8.0, 48.0, 412.0], [8.01, 48.01, 413.0]]),
            feature([8.0, 48.0], "Point", railway="station", name="Adorf;Other"),
            feature([[[8.0, 48.0], [8.2, 48.0], [8.2, 48.2]]], "Polygon", public_transport="station", name="Bedorf"),
            feature([8.1, 48.0], "Point", name="Plain"),
            feature([8.1, 48.0], "Point", building="yes", name="House"),
            feature([8.1, 48.0], "Point", RAILWAY="rail", LABEL="Labelled"),
            feature([8.1, 48.0], "Point", railway="signal", name="A 12"),
            {"type": "Feature", "properties": None, "geometry": None},
            feature(LINE, railway="abandoned"),
            feature(LINE, disused="yes"),
            feature([8.1, 48.0], "Point", railway="station", disused="yes", name="Old station"),
        ),
    )
    assert [len(track.vertices) for track in found.tracks] == [2, 2, 2]
    assert [(one.names, one.rank) for one in found.places] == [
        (("Adorf", "Other"), 0), (("Bedorf",), 0), (("Plain",), 4), (("Labelled",), 4)
    ]  # fmt: skip
    assert found.places[1].longitude_deg == pytest.approx(8.1333333)


def test_an_extract_that_misses_nodes_cuts_the_way_there(tmp_path: Path) -> None:
    nodes = [{"type": "node", "id": i, "lat": 48.0, "lon": 8.0 + i / 100} for i in (1, 2, 4, 5)]
    way = {"type": "way", "id": 7, "nodes": [1, 2, 3, 4, 5], "tags": {"railway": "rail"}}
    odd = {"type": "node", "id": [1], "lat": 48.0, "lon": 8.0, "tags": {"railway": "station"}}  # no id: left out
    assert [len(x.vertices) for x in read(tmp_path, {"elements": [way, odd, *nodes]}).tracks] == [2, 2]


def test_a_track_lies_in_a_tunnel_unless_it_says_no() -> None:
    told = {"yes": True, "building_passage": True, "T": True, "no": False, "F": False}
    for text, inside in told.items():
        assert TrackLine(name="", vertices=(), tags={"tunnel": text}).lies_in("tunnel") is inside


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"type": "Topology"}, "neither an answer of Overpass"),
        ([1, 2], "expected"),
        (collection(), "no track in it"),
        (collection(feature([8.0, 48.0], "Point", railway="station", name="A")), "no track in it"),
        (
            collection(feature([[8.0, 98.0], [8.1, 48.0]])),
            "latitude = 98.0: expected a number of degrees from -90 to 90",
        ),
        (collection(feature([[888.0, 48.0], [8.1, 48.0]])), "longitude = 888.0"),
        (collection(feature([["8", 48.0], [8.1, 48.0]])), "longitude = '8'"),
        (collection(feature([[8.0], [8.1, 48.0]])), "expected those of a LineString"),
        (collection(feature("here")), "expected those of a LineString"),
        (collection(feature(LINE), crs={"properties": {"name": "EPSG:3857"}}), "expected WGS 84"),
        ({"type": "FeatureCollection", "features": [3]}, "features[0] = 3"),
        ({"type": "FeatureCollection", "features": {}}, "a list of features"),
        ({"elements": [{"type": "node", "id": 1, "lat": 10**400, "lon": 1}]}, "latitude"),
    ],
)
def test_what_is_no_map_is_refused_in_one_line(tmp_path: Path, content: Any, message: str) -> None:
    with pytest.raises(DasError, match=r".") as caught:
        read(tmp_path, content)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"type": "FeatureCollection", "features": [], "features": []}', "duplicate key 'features'"),
        ('{"elements": [{"type": "node", "id": 1, "lat": NaN, "lon": 1}]}', "latitude = nan"),
        ('{"elements": [{"type": "node", "id": 1, "lat": 1e999, "lon": 1}]}', "latitude = inf"),
        ('{"elements": ' + "[" * 100_000, "not valid JSON"),
        ('{"elements": [' + "9" * 5000 + "]}", "not valid JSON"),
        ('{"elements": [', "not valid JSON"),
        ("", "not valid JSON"),
    ],
)
def test_hostile_json_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "map.geojson"
    path.write_text(text)
    with pytest.raises(DasError) as caught:
        read_map([path])
    assert message in str(caught.value)


def test_a_file_above_100_mb_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    with path.open("wb") as file:
        file.truncate(100_000_001)
    with pytest.raises(DasError, match="more than 100 MB"):
        read_map([path])


def test_a_table_of_features_with_empty_cells_is_known_as_openstreetmap(tmp_path: Path) -> None:
    """As GeoPandas writes it: every feature has every key, most of them null, and a number of its own."""
    properties = {"@id": "way/12718284", "bridge": None, "tunnel": None, "maxspeed": "160", "railway": "rail"}
    one = {"id": "0", "type": "Feature", "properties": properties}
    found = read(tmp_path, collection({**one, "geometry": {"type": "LineString", "coordinates": LINE}}))
    assert (found.is_osm, found.tracks[0].name) == (True, "way/12718284")
    assert not found.tracks[0].lies_in("bridge")


def test_a_place_has_all_its_names_and_no_control_characters(tmp_path: Path) -> None:
    names = {"name": "Sankt\x1b[31m Pölten", "name:en": "Saint Poelten", "alt_name": "St. Pölten"}
    place = {"type": "Feature", "properties": {"railway": "station", **names}}
    place["geometry"] = {"type": "Point", "coordinates": [8.0, 48.0]}
    (found,) = read(tmp_path, collection(feature(LINE), place)).places
    assert found.names == ("Sankt\\x1b[31m Pölten", "St. Pölten", "Saint Poelten")
    json.dumps(found.names)
