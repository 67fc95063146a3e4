"""A file of another program is recognised by its content; the error names the command that reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from das.domain.errors import DasError
from das.domain.files.load import catalogue, foreign_format, load_journey, load_route, load_vehicle
from sim.trips.record import read_trip
from sim.world.scenario import bundled_scenarios, load_scenario
from tests.support.feeds import write_feed
from tests.support.making import REPOSITORY

ROUTES, VEHICLES = "das-precompute route import", "das-precompute vehicle import"
NOBODY = "no command imports it"
SAMPLES = {
    "gpx": ('<?xml version="1.0"?><gpx version="1.1"></gpx>', "a GPX track", "das-sim trip"),
    "sfera": ("<SFERA_B2G_RequestMessage/>", "a SFERA message", NOBODY),
    "sfera profile": ('<?xml version="1.0"?>\n<!-- a --><JourneyProfile JP_Version="1"/>', "a SFERA message", NOBODY),
    "railml": ('<railML xmlns="https://www.railml.org/schemas/3.2"/>', "a railML file", NOBODY),
    "osm": ('\ufeff<osm version="0.6"/>', "OpenStreetMap XML", NOBODY),
    "overpass": ('{"version": 0.6, "osm3s": {}, "elements": []}', "an Overpass answer", ROUTES),
    "geojson": ('{"type": "FeatureCollection", "features": []}', "a GeoJSON file", ROUTES),
    "railjson": (
        '{"version": "3.4.12", "track_sections": [{"geo": {"type": "LineString"}}]}',
        "railjson of OSRD",
        NOBODY,
    ),
    "stock": ('{"name": "x", "effort_curves": {}}', "OSRD rolling stock", VEHICLES),
    "railtoolkit": ("schema: https://railtoolkit.org/schema/rolling-stock.json", "rolling stock of rail", VEHICLES),
    "path": ("schema: https://railtoolkit.org/schema/running-path.json", "a running path of railtoolkit", ROUTES),
    "table": ('"stop_id","stop_name"\n', "one table of a GTFS feed (import the zip)", NOBODY),
}


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("suffix", ["toml", "json", "dat"])
def test_every_reader_says_what_a_foreign_file_is_and_which_command_reads_it(
    tmp_path: Path, name: str, suffix: str
) -> None:
    content, said, command = SAMPLES[name]
    path = tmp_path / f"a file.{suffix}"
    path.write_text(content, encoding="utf-8")
    readers = {"route": load_route, "vehicle": load_vehicle, "scenario": lambda one: load_scenario(str(one))}
    for kind, read in readers.items():
        with pytest.raises(DasError) as error:
            read(path)
        assert f"is {said}" in str(error.value)
        assert f"expected a {kind}" in str(error.value)
        assert command in str(error.value)
        assert command == NOBODY or f"'{path}'" in str(error.value), "the path is quoted for the shell"
    with pytest.raises(DasError, match="expected a journey"):
        load_journey(path, None)


def test_a_feed_names_the_command_that_imports_it(tmp_path: Path) -> None:
    path = write_feed(tmp_path / "feed.zip")
    with pytest.raises(DasError, match="is a GTFS feed, expected a journey; to read it: das-precompute journey import"):
        load_journey(path, None)


def test_a_file_of_ours_of_another_kind_is_named(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"is a route file of this program, expected a vehicle$"):
        load_vehicle(catalogue("routes")["flat-6km"])
    with pytest.raises(DasError, match=r"is a journey file of this program, expected a route$"):
        load_route(catalogue("journeys")["zurich-luzern"])


def test_a_trip_may_be_a_gpx_track_and_nothing_else_of_these(tmp_path: Path) -> None:
    for name, (content, said, _) in SAMPLES.items():
        path = tmp_path / "trip.xml"
        path.write_text(content, encoding="utf-8")
        with pytest.raises(DasError) as error:
            read_trip(path)
        assert (f"is {said}" in str(error.value)) is (name != "gpx"), name


def test_files_that_are_read_here_are_never_foreign(tmp_path: Path) -> None:
    ours = [path for kind in ("routes", "vehicles", "journeys") for path in catalogue(kind).values()]
    named = {foreign_format(path) for path in (*ours, *bundled_scenarios().values())}
    assert all(one is not None and one.name.endswith("file of this program") for one in named)
    benchmark = tmp_path / "track.json"
    benchmark.write_text(json.dumps({"metadata": {"id": "x"}, "stops": {"unit": "m", "values": [0, 1]}}))
    loss_maps = list((REPOSITORY / "das" / "domain" / "catalogue").rglob("*.csv"))
    assert all(foreign_format(path) is None for path in (benchmark, *loss_maps, tmp_path, tmp_path / "missing"))
