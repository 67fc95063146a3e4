"""Finding stations by names as users type them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from das.domain.errors import DasError
from precompute.route_import.track_map import MapPlace, TrackMap, stations_named


def map_with(*names: str, rank: int = 0) -> TrackMap:
    places = [MapPlace(names=(name,), latitude_deg=48.0, longitude_deg=8.0, rank=rank) for name in names]
    return TrackMap(
        sources=(Path("map.json"),), tracks=(), places=tuple(places), crossings=frozenset(), is_osm=True
    )  # fmt: skip


@pytest.mark.parametrize(
    ("wanted", "name"),
    [
        ("Sanremo", "Sanremo"),
        ("SANREMO", "Sanremo"),
        ("San Remo", "Sanremo"),
        ("Sanremo", "San Remo"),
        ("sanremo", "Stazione di Sanremo"),
        ("Albenga", "Albenga FS"),
        ("St. Pölten", "Sankt Pölten Hauptbahnhof"),
        ("st polten", "St. Pölten Hbf"),
        ("Saint-Étienne", "St-Etienne"),
        ("zurich hb", "Zürich HB"),
        ("Oneglia", "Imperia Oneglia"),
        ("L'Aquila", "L’Aquila"),
        ("Østerport", "Osterport"),
    ],
)
def test_spelling_does_not_matter(wanted: str, name: str) -> None:
    (found,) = stations_named(map_with(name, "Elsewhere", "Other"), wanted)
    assert found.name == name


def test_an_exact_name_comes_before_one_that_contains_it() -> None:
    (found,) = stations_named(map_with("Melk Altstadt", "Melk"), "melk")
    assert found.name == "Melk"


def test_a_station_comes_before_its_platforms_and_all_of_one_rank_are_offered() -> None:
    the_map = map_with("Melk", "Melk")
    platform = map_with("Melk", rank=2).places
    found = stations_named(TrackMap(**{**vars(the_map), "places": (*platform, *the_map.places)}), "Melk")
    assert [place.rank for place in found] == [0, 0, 2]


def test_two_stations_of_one_name_20_km_apart_are_asked_about() -> None:
    near, far = (replace(map_with("Melk").places[0], latitude_deg=48.0 + x) for x in (0.01, 0.19))
    the_map = replace(map_with("Melk"), places=(near, far))
    with pytest.raises(
        DasError, match=r"'melk' names places 20\.0 km apart: give melk=48\.01000,.* and melk=48\.19000,"
    ):
        stations_named(the_map, "melk")
    beside = replace(near, latitude_deg=48.02)
    assert len(stations_named(replace(the_map, places=(near, beside)), "Melk")) == 2


def test_places_are_taken_as_they_are() -> None:
    (plain,) = stations_named(map_with(), "48.2, 15.35")
    (named,) = stations_named(map_with(), "Melk=48.2,15.35")
    assert (plain.name, plain.latitude_deg, plain.longitude_deg) == ("48.2,15.35", 48.2, 15.35)
    assert (named.name, named.rank) == ("Melk", 0)
    assert plain.rank > 4


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ("Melck", "no station 'Melck'; near: Melk; it has Linz, Melk, Wien Nord, Wien Süd"),
        ("Wien", "'Wien' may be Wien Süd, Wien Nord: give one of these names"),
        ("98,15", "expected a latitude from -90 to 90"),
        ("di", "no station 'di'"),
    ],
)
def test_what_is_not_found_is_said_with_the_names_there_are(wanted: str, message: str) -> None:
    with pytest.raises(DasError) as caught:
        stations_named(map_with("Wien Süd", "Melk", "Linz", "Wien Nord"), wanted)
    assert message in str(caught.value)


def test_a_map_without_stations_says_what_to_do() -> None:
    with pytest.raises(DasError, match="the file has no stations: give Melk=LATITUDE,LONGITUDE, or add a file"):
        stations_named(map_with(), "Melk")
