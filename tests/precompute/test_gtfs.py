"""Trips of GTFS feeds: what real feeds do (folders, platforms, gaps, intervals, midnight), and what is refused."""

from __future__ import annotations

import datetime
import math
import struct
import zipfile
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from precompute.gtfs import TripChoice, parsed_clock_s, read_trip
from tests.support.feeds import ODD, feed_tables, table_text, write_feed


@pytest.fixture(scope="module")
def feed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_feed(tmp_path_factory.mktemp("feed") / "feed.zip")


def by_stops(from_stop: str, to_stop: str, at_s: float, day: str | None = None) -> TripChoice:
    on = None if day is None else datetime.date.fromisoformat(day)
    return TripChoice(from_stop=from_stop, to_stop=to_stop, at_s=at_s, day=on)


def changed(name: str, *changes: tuple[str, str]) -> dict[str, Any]:
    """The rows of a table with texts replaced in every cell."""

    def cell(text: object) -> object:
        for before, after in changes:
            text = after if str(text) == before else text
        return text

    return {name: [[cell(one) for one in row] for row in feed_tables()[name]]}


def test_a_trip_has_its_stops_in_order_with_the_names_of_their_stations(feed: Path) -> None:
    trip = read_trip(feed, TripChoice(trip="101"))
    assert [stop.name for stop in trip.stops] == [
        "Altdorf Station",
        "Bad Über Station",
        "Neu Altdorf Station",
        "Zell Station",
    ]
    assert [(stop.arrival_s, stop.departure_s) for stop in trip.stops] == [
        *((16_080, 16_080), (16_440, 16_440), (16_800, 16_860), (17_160, 17_160)),
    ]
    assert (trip.title, trip.agency, trip.time_zone) == ("S1 n101 Zell", "Made Railway", "Europe/Zurich")
    assert trip.shape_deg.shape == (151, 2)
    assert "runs Mo Tu We Th Fr" in trip.notes[-1]


def test_an_id_with_quotes_commas_and_umlauts_is_found_and_its_times_go_on_after_midnight(feed: Path) -> None:
    trip = read_trip(feed, TripChoice(trip=ODD))
    assert trip.id == ODD
    assert trip.stops[-1].arrival_s == 24 * 3600 + 480
    assert [stop.serves for stop in trip.stops] == [True, True, False, True]


@pytest.mark.parametrize("folder", ["", "deep/er/"])
def test_the_tables_may_lie_in_a_folder_and_be_stored_plainly(tmp_path: Path, folder: str) -> None:
    path = write_feed(tmp_path / "feed.zip", folder=folder)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("__MACOSX/stop_times.txt", "nonsense")
        archive.writestr("older/feed/of/last/year/stop_times.txt", "nonsense")
    assert len(read_trip(path, TripChoice(trip="101")).stops) == 4


def test_a_number_that_one_trip_has_names_it(feed: Path) -> None:
    trip = read_trip(feed, TripChoice(trip="n103"))
    assert (trip.id, trip.notes[0]) == ("103", "trip number n103: trip_id 103")


def test_with_an_id_two_stops_cut_the_trip(feed: Path) -> None:
    trip = read_trip(feed, TripChoice(trip="101", from_stop="bad uber", to_stop="neu altdorf"))
    assert [stop.departure_s for stop in trip.stops] == [16_440, 16_860]


@pytest.mark.parametrize(
    ("choice", "trip", "departs_s"),
    [
        (by_stops("Altdorf", "Zell", 4 * 3600), "101", 16_080),
        (by_stops("Zell", "Altdorf", 4 * 3600), "102", 16_080),
        (by_stops("Altdorf Station", "Neu Altdorf", 16_081), "103", 18_000),
        (by_stops("Bad Über", "Zell", 20_000), "103", 20_760),
        (by_stops("p1", "Zell", 40_000), ODD, 86_160),
        (by_stops("Altdorf", "Zell", 4 * 3600, "2026-11-28"), "101", 16_080),
    ],
)
def test_the_first_train_between_two_stops_leaves_at_a_time_or_later(
    feed: Path, choice: TripChoice, trip: str, departs_s: float
) -> None:
    found = read_trip(feed, choice)
    assert (found.id, found.stops[0].departure_s) == (trip, departs_s)


def test_a_train_that_calls_twice_where_it_is_boarded_leaves_there_when_it_comes_first(tmp_path: Path) -> None:
    path = write_feed(tmp_path / "loop.zip", changed("stop_times", ("p1", "p0")))
    early, late = (
        read_trip(path, by_stops("Altdorf", "Zell", 16_080)),
        read_trip(path, by_stops("Altdorf", "Zell", 16_081)),
    )
    assert (early.id, early.notes[0]) == ("101", "trip_id 101 leaves Altdorf at 04:28:00")
    assert (late.id, late.stops[0].departure_s) == ("103", 18_000)


def test_a_trip_at_intervals_keeps_its_running_times_wherever_it_is_cut(feed: Path) -> None:
    whole, cut = read_trip(feed, TripChoice(trip="103")), read_trip(feed, by_stops("Bad Über", "Zell", 20_000))
    assert [stop.departure_s - 2_400 for stop in cut.stops] == [stop.departure_s for stop in whole.stops[1:]]
    assert any("frequencies.txt" in note for note in cut.notes)


def day(text: str) -> datetime.date:
    return datetime.date.fromisoformat(text)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        (TripChoice(trip="103", at_s=9 * 3600.0), "at 09:00:00 or later: its last run leaves at 08:40:00"),
        (TripChoice(trip="101", at_s=5 * 3600.0), "at 05:00:00 or later: its last run leaves at 04:28:00"),
        (TripChoice(trip="101", day=day("2027-03-04")), "trip 101 does not run on 2027-03-04; it runs Mo Tu We Th Fr,"),
        (TripChoice(trip="n101", day=day("2026-11-26")), "trip 101 does not run on 2026-11-26"),
    ],
)
def test_a_trip_that_does_not_run_then_is_refused_and_not_replaced(feed: Path, choice: TripChoice, said: str) -> None:
    with pytest.raises(DasError, match=said):
        read_trip(feed, choice)


def test_time_and_day_choose_a_run_of_a_trip(feed: Path) -> None:
    late = read_trip(feed, TripChoice(trip="103", at_s=8 * 3600 + 1200.0, day=day("2026-11-25")))
    assert late.stops[0].departure_s == 8 * 3600 + 1200
    assert read_trip(feed, TripChoice(trip="101", at_s=16_080.0)).stops[0].departure_s == 16_080


def test_a_train_after_midnight_is_one_of_the_service_day_before(feed: Path) -> None:
    """Trip ODD leaves its third stop at 24:02; it runs on Wednesday the 25th, not on Thursday the 26th."""
    found = read_trip(feed, by_stops("Neu Altdorf", "Zell", 60.0, "2026-11-26"))
    assert (found.id, found.stops[0].departure_s) == (ODD, 86_520)
    assert "it leaves Neu Altdorf Station at 00:02:00, which is 24:02:00 of the service day 2026-11-25" in found.notes
    assert read_trip(feed, by_stops("Neu Altdorf", "Zell", 60.0)).id == ODD
    on_friday = read_trip(feed, by_stops("Neu Altdorf", "Zell", 60.0, "2026-11-27"))
    assert on_friday.id == "101", "nothing ran on Thursday"


def test_an_interval_after_midnight_is_one_of_the_service_day_before(tmp_path: Path) -> None:
    rows = [["trip_id", "start_time", "end_time", "headway_secs"], ["103", "22:00:00", "26:00:00", "1200"]]
    path = write_feed(tmp_path / "night.zip", {"frequencies": rows})
    assert read_trip(path, TripChoice(trip="103", at_s=1800.0)).stops[0].departure_s == 24 * 3600 + 2400


def test_a_shape_with_an_order_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    rows = feed_tables()["shapes"]
    shapes = [*rows[:3], [*rows[3][:3], "x"], *rows[4:]]
    with pytest.raises(DasError, match=r"shapes\.txt: line 4 shape_pt_sequence = 'x': expected a whole number"):
        read_trip(write_feed(tmp_path / "shape.zip", {"shapes": shapes}), TripChoice(trip="101"))


def without(*names: str) -> dict[str, None]:
    return dict.fromkeys(names)


def test_a_feed_needs_only_trips_stops_and_their_times(tmp_path: Path) -> None:
    few = without("agency", "routes", "shapes", "calendar", "calendar_dates", "frequencies")
    trip = read_trip(write_feed(tmp_path / "few.zip", few), TripChoice(trip="101"))
    assert (len(trip.stops), trip.agency, trip.shape_deg.size) == (4, "", 0)


def test_buses_are_not_trains(tmp_path: Path) -> None:
    path = write_feed(tmp_path / "bus.zip", changed("routes", ("2", "714")))
    with pytest.raises(DasError, match="no train from Altdorf to Zell"):
        read_trip(path, by_stops("Altdorf", "Zell", 0.0))
    assert "route_type 714 is no railway" in read_trip(path, TripChoice(trip="101")).notes


def test_a_stop_between_others_may_lack_its_times_and_its_coordinates(tmp_path: Path) -> None:
    tables = {**changed("stop_times", ("4:34:00", "")), **changed("stops", ("p1", "p1"))}
    trip = read_trip(write_feed(tmp_path / "gaps.zip", tables), TripChoice(trip="101"))
    assert math.isnan(trip.stops[1].departure_s)


@pytest.mark.parametrize(
    ("tables", "choice", "said"),
    [
        (without("stop_times"), TripChoice(trip="101"), r"stop_times.txt is missing: expected the tables of a GTFS"),
        (without("stops"), TripChoice(trip="101"), r"stop_times.txt: line \d+ stop_id = 'p\d': expected a stop of"),
        ({}, TripChoice(trip="7"), r"--trip = '7': expected a trip_id of trips.txt, like 101, 102, 103"),
        ({}, TripChoice(), r"give --trip ID, or --from STOP, --to STOP and --at HH:MM"),
        ({}, by_stops("Nowhere", "Zell", 0.0), r"--from = 'Nowhere': expected a stop of stops.txt, like"),
        ({}, by_stops("", "Zell", 0.0), r"--from = '': expected a stop of stops.txt, like"),
        ({}, by_stops("Altdorf", "?!", 0.0), r"--to = '\?!': expected a stop of stops.txt, like"),
        ({}, by_stops("Altdorf", "Zell", 90_000.0), r"no train from Altdorf to Zell at 25:00:00 or later"),
        ({}, by_stops("Altdorf", "Zell", 0.0, "2026-11-26"), r"no train .* on 2026-11-26"),
        ({}, by_stops("Altdorf", "Zell", 0.0, "2026-11-29"), r"no train .* on 2026-11-29"),
        (
            changed("trips", ("n102", "n101")),
            TripChoice(trip="n101"),
            r"expected a trip_id or --date, because 2 trips have this number: 101, 102",
        ),
        (changed("stop_times", ("4:34:00", "4:20:00")), TripChoice(trip="101"), r"expected times that do not fall"),
        (changed("stop_times", ("4:34:00", "half past")), TripChoice(trip="101"), r"expected a time like 25:10:00"),
        (changed("stop_times", ("15", "-1")), TripChoice(trip="101"), r"stop_sequence = '-1': expected a whole number"),
        (changed("stop_times", ("15", "5")), TripChoice(trip="101"), r"stop_sequence = '5': expected each number once"),
        (
            {"stop_times": [feed_tables()["stop_times"][0], *(["101", "", "", "p0", i] for i in range(1_001))]},
            TripChoice(trip="101"),
            r"rows of trip 101 = 1001: expected 2 to 1000 stops",
        ),
        (
            changed("stop_times", ("4:28:00", "")),
            TripChoice(trip="101"),
            r"time of trip 101 at Altdorf Station is missing",
        ),
        (changed("frequencies", ("1200", "0")), TripChoice(trip="103"), r"headway_secs = '0': expected seconds"),
        ({"stops": "stop_name\nA\n"}, TripChoice(trip="101"), r"stops.txt: column stop_id is missing"),
        (
            {"trips": 'trip_id\n"' + ("x" * 90_000 + "\n") * 2},
            by_stops("Altdorf", "Zell", 0.0),
            r"trips\.txt: cannot be read \(field larger than field limit",
        ),
        (
            {"stops": b"stop_id,stop_name\n\xff,A\n"},
            TripChoice(trip="101"),
            r"stops\.txt: not UTF-8 text \(invalid start",
        ),
        ({"stops": "stop_id,stop_name\n" + "x" * 200_000}, TripChoice(trip="101"), r"expected a shorter line"),
        ({"trips": "trip_id\n" + "\n".join("5" * 8 for _ in range(9))}, TripChoice(trip="101"), r"--trip = '101'"),
    ],
)
def test_what_is_wrong_is_said_with_its_table_its_line_and_what_was_expected(
    tmp_path: Path, tables: dict[str, Any], choice: TripChoice, said: str
) -> None:
    path = write_feed(tmp_path / "feed.zip", tables)
    with pytest.raises(DasError, match=said) as error:
        read_trip(path, choice)
    assert str(error.value).startswith((str(path), "give"))
    assert "\n" not in str(error.value)


def test_a_zip_that_swells_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_feed(tmp_path / "bomb.zip", {"shapes": "0" * 30_000_000})
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("it was opened"))
    with pytest.raises(DasError, match=r"shapes\.txt = '30 MB from 0\.03 MB': expected at most 1000 MB, and 100 times"):
        read_trip(path, TripChoice(trip="101"))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "cannot be unpacked"),
        (b"PK\x03\x04 and no more", "is a zip file, expected a GTFS feed"),
        (b"<gpx></gpx>", "is a GPX track, expected a GTFS feed; to read it: das-sim trip"),
        (b"trip_id,stop_id\n1,2\n", "is one table of a GTFS feed"),
    ],
)
def test_what_is_no_zip_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "feed.zip"
    path.write_bytes(content)
    with pytest.raises(DasError, match=said):
        read_trip(path, TripChoice(trip="101"))


def entry_changed(path: Path, at: int, by: bytes) -> None:
    """Change bytes of the zip's entry for the table of stop times, counted from the entry's begin (APPNOTE 4.3.12)."""
    content = bytearray(path.read_bytes())
    begin = content.rindex(b"PK\x01\x02", 0, content.rindex(b"stop_times.txt"))
    content[begin + at : begin + at + len(by)] = by
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("at", "by", "said"),
    [
        (6, b"\xff", r"feed\.zip: cannot be unpacked \(zip file version 25\.5\), expected the zip of a GTFS feed"),
        (8, b"\x20", r"stop_times\.txt: cannot be unpacked \(compressed patched data \(flag bit 5\)\)"),
        (8, b"\x01", r"stop_times\.txt = 'packed in another way': expected a deflated table without a password"),
        (16, b"\0" * 4, r"stop_times\.txt: cannot be unpacked \(Bad CRC-32 for file 'stop_times\.txt'\)"),
        (42, b"\xff" * 4, r"stop_times\.txt = 'at byte 18446744073709551615': expected a place in the zip"),
    ],
)
def test_a_damaged_zip_is_refused_with_what_is_wrong_in_it(tmp_path: Path, at: int, by: bytes, said: str) -> None:
    path = write_feed(tmp_path / "feed.zip", without("stop_times"), folder="")
    table = zipfile.ZipInfo("stop_times.txt")
    table.extra = struct.pack("<HHQ", 1, 8, 2**64 - 1)  # the place of the table, if the entry itself says 2**32 - 1
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(table, table_text(feed_tables()["stop_times"]), zipfile.ZIP_DEFLATED)
    assert read_trip(path, TripChoice(trip="101")).id == "101"
    entry_changed(path, at, by)
    with pytest.raises(DasError, match=said):
        read_trip(path, TripChoice(trip="101"))


def test_a_folder_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    nowhere = (tmp_path / "no.zip", tmp_path / ("x" * 300))
    for path, said in ((tmp_path, "expected the feed as a zip file"), *((one, "no such file") for one in nowhere)):
        with pytest.raises(DasError, match=said):
            read_trip(path, TripChoice(trip="101"))


def test_times_of_options_are_read_or_refused() -> None:
    assert parsed_clock_s("7:30") == 27_000
    assert parsed_clock_s("25:10:30") == 90_630
    with pytest.raises(DasError, match="--at noon: expected a time like 07:30"):
        parsed_clock_s("noon")
