"""Routes as a user imports and shows them, and what other commands then do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from das.command_line import files
from das.domain.files.load import load_route
from tests.support.made_maps import FILES, as_overpass, collection, feature, made_map, written
from tests.support.making import das_precompute, printed, refused

ENDS = ("--from", "Adorf", "--to", "Cedorf")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the map of the example and its altitudes."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def test_an_import_says_what_it_found_and_writes_a_route_that_other_commands_use(folder: Path) -> None:
    words = ("route", "import", "tracks.geojson", *ENDS, "--altitudes", "heights.csv", "-o", "my.toml")
    stated = ("--source", "a friend", "--licence", "CC0", "--time-zone", "Europe/Zurich", "--id", "mine")
    out = printed(folder, *words, *stated)
    for text in ("mine: Adorf – Cedorf", "14.031 km, one way", "a friend, CC0", "Limits on 100 %", "written: my.toml"):
        assert text in out
    route = load_route(folder / "my.toml")
    assert (route.credit, route.time_zone, route.one_way) == ("a friend, CC0", "Europe/Zurich", True)
    shown = json.loads(printed(folder, "show", "my.toml", "--json"))
    assert (shown["limits"], shown["tunnels"], shown["altitudes"]) == (5, 1, "smoothed")
    assert shown["climb_m"] == pytest.approx(23, abs=4)
    solve = ("solve", "my.toml", "re460-ic", "--strategy", "fastest")
    assert "one_way = true" in refused(folder, *solve, "--reverse")


def test_a_flat_line_needs_the_word_and_says_its_range_wherever_energies_are_computed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_warned", set())
    words = ("route", "import", "tracks.geojson", *ENDS, "-o", "my.toml")
    assert "no altitudes: give --altitudes FILE (stations and summits are enough), or say --flat" in refused(
        folder, *words
    )
    assert not (folder / "my.toml").exists()
    assert "give one of them" in refused(folder, *words, "--flat", "--altitudes", "heights.csv")
    assert das_precompute(folder, *words, "--flat").returncode == 0
    files._warned.clear()  # as a new process
    done = das_precompute(folder, "solve", "my.toml", "re460-ic", "--strategy", "fastest", "--json")
    assert done.returncode == 0
    assert done.stderr.startswith("warning: my.toml: no altitudes: energies are those of a flat line; on four real sec")


def test_show_has_a_code_for_warnings_and_one_for_what_cannot_be_used(folder: Path) -> None:
    assert das_precompute(folder, "route", "import", "tracks.geojson", *ENDS, "--flat", "-o", "my.toml").returncode == 0
    done = das_precompute(folder, "show", "my.toml", "--json")
    found = json.loads(done.stdout)
    assert (done.returncode, found["warnings"]) == (0, [])
    assert [note.split(":")[0] for note in found["notes"]] == ["no altitudes", "no source", "no licence", "one_way"]
    text = (folder / "my.toml").read_text(encoding="utf-8")
    unusual = text.replace("80.0], ", "80.0], [0.5, 60.0], [0.51, 80.0], ", 1)
    unusual = unusual.replace("latitude_deg = 48", "latitude_deg = 49", 1).replace('name = "Bedorf"', 'name = "adorf"')
    unusual = unusual.replace("rows = [\n    [0.0, 0.0],", "rows = [\n    [0.0, 35.0], [4.0, -35.0],", 1)
    unusual += '\n[curves]\ncolumns = ["position_km", "radius_start_m", "radius_end_m"]\nrows = [[0.0, 200.0, 200.0]]\n'
    (folder / "my.toml").write_text(unusual, encoding="utf-8")
    done = das_precompute(folder, "show", "my.toml")
    assert done.returncode == 1
    said = " ".join(done.stderr.split())
    for words in (
        "2 are called 'adorf'",
        "adorf is at km 6.216, its coordinates 1",
        "1 shorter than 20 m, the first at km 0.500: 60 km/h on 10 m",
        "140 km/h at km 7.019 in a radius of 200 m gives 7.6 m/s² sideways",
        "1 kinks above 30 ‰, the largest at km 4.000: 70.0 ‰",
    ):
        assert words in said
    (folder / "my.toml").write_text(text.replace("one_way = true", "one_way = 1"), encoding="utf-8")
    assert "route.one_way = 1: expected true or false" in refused(folder, "show", "my.toml")


def test_the_picture_of_an_import_is_that_of_its_route(folder: Path) -> None:
    written(folder / "map.json", as_overpass(made_map()))
    words = ("route", "import", "map.json", *ENDS, "--altitudes", "heights.csv", "-o", "my.toml", "--plot", "a.png")
    assert das_precompute(folder, *words).returncode == 0
    assert das_precompute(folder, "show", "my.toml", "--plot", "b.png").returncode == 0
    assert (folder / "a.png").read_bytes() == (folder / "b.png").read_bytes()


def test_nothing_is_replaced_unasked_and_wrong_options_are_one_line(folder: Path) -> None:
    (folder / "my.toml").write_text("mine", encoding="utf-8")
    words = ("route", "import", "tracks.geojson", *ENDS, "--flat", "-o")
    assert "exists already" in refused(folder, *words, "my.toml")
    assert "output file is also an input" in refused(folder, "route", "import", "my.toml", "-o", "my.toml")
    assert "needs --from and --to" in refused(folder, "route", "import", "tracks.geojson", "--flat", "-o", "x.toml")
    assert "no station 'Zedorf'; near: Cedorf, Bedorf" in refused(
        folder, "route", "import", "tracks.geojson", "--from", "Zedorf", "--to", "Adorf", "--flat", "-o", "x.toml"
    )
    for option, value, message in (
        ("--time-zone", "Mars", "expected a zone"),
        ("--name", "\x1b[31m", "without control characters"),
        ("--source", "x" * 3000, "at most 2000 characters"),
        ("--length-km", "3", "belongs to tables"),
    ):
        assert message in refused(folder, *words, "x.toml", option, value)
    assert sorted(path.name for path in folder.iterdir()) == ["heights.csv", "my.toml", "tracks.geojson"]


def test_stations_may_come_from_a_table_beside_the_map(folder: Path) -> None:
    tracks = [one for one in made_map()["features"] if one["geometry"]["type"] == "LineString"]
    written(folder / "bare.geojson", collection(*tracks))
    words = ("route", "import", "bare.geojson", "--from", "Anfang", "--to", "ende", "--flat", "-o", "my.toml")
    assert "the file has no stations: give Anfang=LATITUDE,LONGITUDE" in refused(folder, *words)
    (folder / "stations.csv").write_text(
        "name;lat;lon\nAnfang;48,0001;8,0001\n;48,002942;8,051239\nEnde;48.035068;8.168777\n", encoding="utf-8"
    )
    assert das_precompute(folder, words[0], words[1], "stations.csv", *words[2:]).returncode == 0
    assert [stop.name for stop in load_route(folder / "my.toml").stops] == ["Anfang", "Ende"]


def test_a_limit_of_every_step_and_a_heap_of_stations_are_written_and_read(folder: Path) -> None:
    """Many short tracks, each with its limit: nothing is lost between map and file."""
    tracks = [feature([[8 + i / 1000, 48.0], [8 + (i + 1) / 1000, 48.0]], maxspeed=str(60 + i % 7)) for i in range(300)]
    places = [feature([8 + i / 100, 48.0], "Point", railway="halt", name=f"Halt {i}") for i in range(31)]
    written(folder / "map.json", collection(*tracks, *places))
    done = das_precompute(
        folder, "route", "import", "map.json", "--from", "Halt 0", "--to", "halt 30", "--flat", "-o", "m.toml"
    )
    assert done.returncode == 0
    route = load_route(folder / "m.toml")
    assert (len(route.limits_mps.value), len(route.stops)) == (300, 31)
