"""The commands below `das-precompute journey`: from a feed to a file, its checks, its picture, the driver's sheet."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from das.domain.files.load import load_journey
from precompute.sheet import half_minutes, span_words
from tests.support.feeds import NAMES, PLACES_M, write_feed
from tests.support.making import das_precompute, in_a_process, printed, refused

ROUTE = """
schema_version = 1
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0, 120], [10, 90]]}
gradients = {columns = ["position_km", "gradient_permil"], rows = [[0, 0.0], [9, 1.0]]}
tunnels = {columns = ["position_km", "length_km", "cross_section_m2"], rows = [[6.0, 0.4, 40.0]]}
route = {id = "made", name = "Made line", length_km = 15.0}
""" + "".join(f'[[stops]]\nname = "{n}"\nposition_m = {x}\n' for n, x in zip(NAMES, PLACES_M, strict=True))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a feed and the line that it runs on."""
    write_feed(tmp_path / "feed.zip")
    (tmp_path / "line.toml").write_text(ROUTE, encoding="utf-8")
    return tmp_path


def test_a_trip_of_a_feed_becomes_a_journey_without_a_route(folder: Path) -> None:
    done = in_a_process("precompute.cli", "journey", "import", "feed.zip", "--trip", "101", "-o", "j.toml", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "note: 1 of 2 stops on the way have arrival = departure: assumed dwell 30 s" in done.stdout
    assert "written: j.toml: S1 n101 Zell: Altdorf Station – Zell Station, 04:28, 4 stops, 15.0 km" in done.stdout
    assert "das-precompute journey j.toml ROUTE VEHICLE" in done.stdout
    assert len(load_journey(folder / "j.toml", None).calls) == 4


def test_an_imported_journey_is_checked_planned_and_printed_as_a_sheet(folder: Path) -> None:
    assert "More commands: journey import (-h" in printed(folder, "journey", "-h")
    imported = ("journey", "import", "feed.zip", "--trip", "101", "--route", "line.toml", "-o", "j.toml")
    printed(folder, *imported)
    assert refused(folder, *imported).startswith("error: j.toml: exists already; --overwrite replaces it")
    out = printed(folder, "show", "j.toml", "--route", "line.toml", "--vehicle", "re460-ic")
    assert re.search(r"Altdorf – Bad Über +\d+ +389 +\d+\.\d", out)
    train = ("line.toml", "re460-ic")
    out = printed(folder, "journey", "j.toml", *train, "--sheet", "sheet.html", "--json")
    plan = json.loads(out)
    page = (folder / "sheet.html").read_text(encoding="utf-8")
    assert page.count("<section>") == 3
    for hop in plan["hops"]:
        assert f"<b>{hop['from']}</b><time>{half_minutes(hop['departure']['time_s'])}</time>" in page
        assert span_words(hop["time_s"]) in page
    assert "<b>brake</b> for the stop" in page
    assert str(folder) not in page
    assert refused(folder, "journey", "j.toml", *train, "--sheet", "sheet.txt").endswith("in .html or .pdf\n")
    assert "exists already" in refused(folder, "journey", "j.toml", *train, "--sheet", "sheet.html")


def test_a_journey_is_shown_as_a_table_as_json_and_as_a_picture(folder: Path) -> None:
    out = printed(folder, "show", "zurich-luzern", "--route", "zurich-luzern", "--plot", "j.png")
    assert re.search(r"Thalwil +12\.000 +7:20:00 – 7:20:40 +45", out)
    assert (folder / "j.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads(printed(folder, "show", "zurich-luzern", "--route", "zurich-luzern", "--json"))
    assert [point["kind"] for point in told["points"]] == ["stop", "stop", "passing", "stop", "stop"]
    assert told["points"][2]["window"] == [26_760.0, 26_820.0]


def test_check_warns_of_what_no_train_can_do_and_of_stops_beside_their_places(folder: Path) -> None:
    (folder / "odd.toml").write_text(
        'schema_version = 1\n[journey]\nid = "odd"\nname = "odd"\n'
        '[[stops]]\nname = "Altdorf"\nposition_km = 0\ndeparture = "08:00:00"\n'
        '[[stops]]\nname = "Bad Über"\nposition_km = 4.2\n'
        '[[stops]]\nstop = "Zell"\narrival = "08:05:00"\n',
        encoding="utf-8",
    )
    done = das_precompute(folder, "show", "odd.toml", "--route", "line.toml")
    assert done.returncode == 1
    assert "warning: no dwell_s at Bad Über: plans assume stops of 0 s there" in done.stderr
    assert "warning: no intermediate stop has a time" in done.stderr
    assert 'warning: Bad Über: the stop of this name is at km 4.000 of made, not at km 4.200; stop = "Bad Über"' in (
        done.stderr
    )
    told = das_precompute(folder, "show", "odd.toml", "--route", "line.toml", "--json")
    assert len(json.loads(told.stdout)["warnings"]) == 3
    late = refused(folder, "show", "odd.toml", "--route", "line.toml", "--vehicle", "re460-ic")
    assert re.search(r"odd\.toml: arrival at Zell .* is \d+\.\d s too tight", late)
    assert "needs --route" in refused(folder, "show", "odd.toml", "--vehicle", "re460-ic")


def test_two_stops_with_too_little_time_between_them_are_named(folder: Path) -> None:
    text = 'schema_version = 1\n[journey]\nid = "x"\nname = "x"\n'
    text += '[[stops]]\nname = "A"\nposition_km = 0\ndeparture_s = 0\n'
    text += '[[stops]]\nname = "B"\nposition_km = 9\narrival_s = 60\n'
    (folder / "fast.toml").write_text(text, encoding="utf-8")
    done = das_precompute(folder, "show", "fast.toml")
    assert "A – B: 60 s for 9.0 km: 540 km/h on average, more than a train runs" in done.stderr
    done = das_precompute(folder, "show", "fast.toml", "--route", "line.toml")
    assert "more than the limits allow" in done.stderr


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--trip", "101", "--dwell", "-1"), "--dwell -1: expected seconds from 0 to 3600"),
        (("--trip", "101", "--tolerance", "1e9"), "--tolerance 1e+09: expected seconds from 0 to 3600"),
        (("--trip", "101", "--date", "tomorrow"), "--date tomorrow: expected a day like 2026-11-26"),
        (("--trip", "101", "--reverse"), "--reverse: needs --route"),
        (("--from", "A", "--to", "B", "--at", "soon"), "--at soon: expected a time like 07:30"),
        (("--trip", "101", "--route", "flat-6km"), "fewer than two stops of trip 101 are on"),
    ],
)
def test_import_refuses_what_makes_no_sense_and_writes_nothing(folder: Path, args: tuple[str, ...], said: str) -> None:
    assert said in refused(folder, "journey", "import", "feed.zip", *args, "-o", "j.toml")
    assert not (folder / "j.toml").exists()
