"""Reading files of trips: CSV with and without a header, GPX, recordings of ours; and files that are refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from das.bus import das_pb2
from das.bus.recorder import RecordingFile
from das.bus.topics import POSITION
from das.domain.errors import DasError
from sim.trips.cleaning import FindingKind, FindingLog, in_order
from sim.trips.record import Record, read_trip
from tests.das.domain.files.refusing import refused

START_NS = 1_469_780_350_227_000_000
PLAIN = "59.5,16.2,0,1469780350227\n59.5001,16.2001,10,1469780351227\n59.5002,16.2002,20.5,1469780352227\n"
HEADERS = {
    "degrees, km/h, ms": (
        "latitude_deg,longitude_deg,speed_kmh,time_ms\n59.5,16.2,0,1469780350227\n"
        "59.5001,16.2001,10,1469780351227\n59.5002,16.2002,20.5,1469780352227\n"
    ),
    "another order, m/s, s, other columns": (
        "time_s,Altitude,LON,Lat,speed_mps\n1469780350.227,3,16.2,59.5,0\n"
        "1469780351.227,,16.2001,59.5001,2.7777777777777777\n1469780352.227,4,16.2002,59.5002,5.694444444444445\n"
    ),
    "ISO 8601 with a zone, spaces, quotes": (
        '"time", "lat", "lng", "speed_kmh"\n2016-07-29T10:19:10.227+02:00,59.5,16.2,0\n'
        "2016-07-29T08:19:11.227Z, 59.5001, 16.2001, 10\n2016-07-29 08:19:12.227,59.5002,16.2002,20.5\n"
    ),
    "semicolons and decimal commas": (
        "lat;lon;speed_kmh;time_s\n59,5;16,2;0;1469780350,227\n"
        "59,5001;16,2001;10;1469780351,227\n59,5002;16,2002;20,5;1469780352,227\n"
    ),
    "timestamp, ISO 8601": (
        "timestamp,lat,lon,speed_kmh\n2016-07-29T08:19:10.227Z,59.5,16.2,0\n"
        "2016-07-29T08:19:11.227Z,59.5001,16.2001,10\n2016-07-29T08:19:12.227,59.5002,16.2002,20.5\n"
    ),
    "tabs": PLAIN.replace(",", "\t"),
    "a byte order mark, CRLF": "\ufeff" + PLAIN.replace("\n", "\r\n"),
}


def gpx(points: str, head: str = '<?xml version="1.0"?>\n', version: str = "1/1") -> str:
    return f'{head}<gpx xmlns="http://www.topografix.com/GPX/{version}"><trk><trkseg>\n{points}</trkseg></trk></gpx>\n'


def track_point(i: int, extra: str = "") -> str:
    place = f'lat="{59.5 + i * 1e-4:.4f}" lon="{16.2 + i * 1e-4:.4f}"'
    return f"<trkpt {place}><time>2016-07-29T08:19:{10 + i}.227Z</time>{extra}</trkpt>\n"


def check(record: Record, *, speeds: bool = True) -> None:
    """The three points of every good file here."""
    assert record.latitude_deg == pytest.approx([59.5, 59.5001, 59.5002], abs=1e-12)
    assert record.longitude_deg == pytest.approx([16.2, 16.2001, 16.2002], abs=1e-12)
    assert record.time_ns.tolist() == [START_NS, START_NS + 10**9, START_NS + 2 * 10**9]
    assert record.time_ns.dtype == np.int64
    if speeds:
        assert record.speed_mps == pytest.approx([0, 10 / 3.6, 20.5 / 3.6], abs=1e-12)
    else:
        assert np.isnan(record.speed_mps).all()
    assert not record.on_route


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return path


def test_a_file_without_a_header_is_read_in_si(tmp_path: Path) -> None:
    reading = read_trip(written(tmp_path, "trip.csv", PLAIN + "\n\n"))
    check(reading.record)
    assert (reading.format, reading.record.number.tolist(), reading.record.unread) == ("CSV", [1, 2, 3], ())


@pytest.mark.parametrize("text", HEADERS.values(), ids=HEADERS)
def test_a_header_names_columns_and_units(tmp_path: Path, text: str) -> None:
    record = read_trip(written(tmp_path, "trip.txt", text)).record
    check(record)
    assert record.unread == (("altitude",) if "Altitude" in text else ())


def test_positions_may_be_on_the_route_and_speeds_unknown(tmp_path: Path) -> None:
    text = "time_s,position_km,speed_kmh\n0,1.25,\n1,1.26,36\n2,,36\n"
    record = read_trip(written(tmp_path, "trip.csv", text)).record
    assert record.on_route
    assert record.position_m == pytest.approx([1250, 1260, np.nan], nan_ok=True)
    assert record.speed_mps == pytest.approx([np.nan, 10, 10], nan_ok=True)
    assert np.isnan(record.latitude_deg).all()
    assert record.time_ns.tolist() == [0, 10**9, 2 * 10**9]


def test_times_keep_every_digit(tmp_path: Path) -> None:
    """An epoch time in ns has more digits than a double."""
    text = "time_ms,lat,lon\n1469780350227.123457,59,16\n1469780350228.000001,59,16\n"
    assert read_trip(written(tmp_path, "t.csv", text)).record.time_ns.tolist() == [
        1469780350227123457,
        1469780350228000001,
    ]


@pytest.mark.parametrize("version", ["1/0", "1/1"])
@pytest.mark.parametrize("speeds", ["", "element", "extension"])
def test_gpx_is_read(tmp_path: Path, version: str, speeds: str) -> None:
    wrap = {
        "": "",
        "element": "<speed>{}</speed>",
        "extension": '<extensions><x:TrackPointExtension xmlns:x="x"><x:speed>{}</x:speed>'
        "</x:TrackPointExtension></extensions>",
    }[speeds]
    points = [track_point(i, wrap.format(v / 3.6)) for i, v in enumerate((0, 10, 20.5))]
    text = gpx("".join([*points[:2], "</trkseg><trkseg>", points[2]]), version=version)
    reading = read_trip(written(tmp_path, "trip.xml", text))
    check(reading.record, speeds=bool(speeds))
    assert reading.format == "GPX"
    assert reading.record.number.tolist() == [3, 4, 5]


def test_a_recording_is_read_with_its_qualities(tmp_path: Path) -> None:
    path = tmp_path / "run.bin"  # the format is told by the content
    file = RecordingFile(path)
    invalid, degraded, good = (
        das_pb2.Position.QUALITY_INVALID,
        das_pb2.Position.QUALITY_DEGRADED,
        das_pb2.Position.QUALITY_GOOD,
    )
    for i, (s_m, v, quality) in enumerate([(1, -0.1, good), (np.nan, np.nan, invalid), (9, 4, degraded)]):
        position = das_pb2.Position(time_ns=START_NS + i, s_m=s_m, speed_mps=v, quality=quality, uncertainty_m=2.0)
        file.add(POSITION, POSITION.key("t"), position, START_NS + i)
    file.close()
    reading = read_trip(path)
    record = reading.record
    assert (reading.format, reading.journey, reading.delays) == ("MCAP", None, ())
    assert record.as_driven
    assert record.position_m == pytest.approx([1, np.nan, 9], nan_ok=True)
    assert record.speed_mps == pytest.approx([0, np.nan, 4], nan_ok=True)
    assert record.invalid.tolist() == [False, True, False]
    assert record.degraded.tolist() == [False, False, True]


LAUGHS = '<?xml version="1.0"?>\n<!DOCTYPE gpx [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>\n'
OUTSIDE = '<?xml version="1.0"?>\n<!DOCTYPE gpx [\n<!ENTITY a SYSTEM "file:///etc/hostname">]>\n'
TWO = track_point(0) + track_point(1)
HEAD = "lat,lon,speed_kmh,time_ms\n"


def every(column: int, cell: str) -> str:
    """The lines of PLAIN with one text in all cells of a column."""
    rows = [line.split(",") for line in PLAIN.splitlines()]
    return "\n".join(",".join(cell if i == column else x for i, x in enumerate(row)) for row in rows) + "\n"


BAD_FILES = {
    "empty": ("", "empty trip, expected a header, or lines of latitude_deg, longitude_deg, speed_kmh, time_ms"),
    "one point": (PLAIN.splitlines()[0], "trip of 1 line, expected at least 2 lines of points"),
    "header alone": (HEAD, "trip of 0 lines, expected at least 2 lines"),
    "too few columns": (PLAIN + "59.5,16.2,0", "line 4 = '59.5,16.2,0': expected 4 columns"),
    "blank line": (PLAIN + "\n" + PLAIN, "line 4 = '': expected 4 columns"),
    "quoted line break": (PLAIN + '59,16,"1\n",5\n', "a quoted cell spans several lines"),
    "open quote": (PLAIN + '59,16,"1,5', "not a usable CSV file (unexpected end of data)"),
    "text after a header": (HEAD + every(1, "east"), "line 2 longitude = 'east': expected a number"),
    "nan": (every(2, "inf"), "line 1 speed = 'inf': expected a finite number"),
    "latitude": (every(0, "95"), "line 1 latitude = 95.0: expected -90 to 90 deg"),
    "longitude": (HEAD + every(1, "-181"), "line 2 longitude = -181.0: expected -180 to 180 deg"),
    "negative speed": (every(2, "-2"), "line 1 speed = -2.0: expected a speed >= 0"),
    "negative time": (every(3, "-5"), "line 1 time = '-5': expected an epoch time in ms"),
    "huge time": (every(3, "1e19"), "line 1 time = '1e19': expected an epoch time in ms"),
    "endless time": (every(3, "1e999999999"), "line 1 time = '1e999999999': expected an epoch"),
    "no time": (every(3, ""), "line 1 time = '': expected a number"),
    "time of day": ("time,lat,lon\n08:04,59,16\n08:05,59,16\n", "line 2 time = '08:04': expected an ISO 8601 time"),
    "timestamp that is a number": (
        "timestamp,lat,lon\n1469780350227,59,16\n1469780351227,59,16\n",
        "line 2 time = '1469780350227': expected an ISO 8601 time",
    ),
    "time before 1970": ("time,lat,lon\n1969-01-01,59,16\n1970-02-01,59,16", "line 2 time = '1969-01-01': expected an"),
    "no time column": ("lat,lon,speed_kmh\n1,2,3\n1,2,3\n", "line 1 = 'lat,lon,speed_kmh': expected columns of time"),
    "no place": (
        "lat,time_ms\n1,2\n1,3\n",
        "line 1 = 'lat,time_ms': expected columns of time (time_ms, time_s, time, timestamp) and",
    ),
    "speed without unit": (
        "lat,lon,speed,time_ms\n1,2,3,4\n",
        "line 1 = 'speed': expected speed as speed_kmh or speed_mps",
    ),
    "time without unit": (
        "lat,lon,time_utc\n1,2,3\n",
        "line 1 = 'time_utc': expected time as time_ms or time_s or time or timestamp",
    ),
    "two of a kind": (
        "lat,latitude_deg,lon,time_s\n1,1,2,3\n",
        "line 1 = 'latitude_deg': expected only one column of latitude",
    ),
    "mark": (
        "position_m,time_s,speed_from_positions\n1,2,3\n2,3,0\n",
        "line 2 speed_from_positions = 3.0: expected 0 or 1",
    ),
    "not GPX": ("<html/>", "XML of 'html', expected GPX"),
    "broken GPX": (gpx(TWO)[:-9], "not usable XML (unclosed token: line 5"),
    "GPX of one point": (gpx(track_point(0)), "GPX with 1 track points, expected at least 2"),
    "GPX without times": (gpx(2 * '<trkpt lat="1" lon="2"/>\n'), "line 3 time = '': expected an ISO 8601 time"),
    "GPX time": (gpx(TWO.replace("08:19:11.227Z", "soon")), "line 4 time = '2016-07-29Tsoon': expected an ISO 8601"),
    "GPX without lon": (gpx(TWO.replace("lon", "x", 1)), "line 3 longitude = '': expected a number"),
    "GPX latitude": (gpx(TWO.replace("59.5001", "-91")), "line 4 latitude = -91.0: expected -90 to 90 deg"),
    "GPX speed": (gpx(TWO + track_point(2, "<speed>-2</speed>")), "line 5 speed = -2.0: expected a speed >= 0"),
    "GPX of entities": (gpx(TWO, LAUGHS), "line 2 declares the entity 'a', expected a GPX file without entities"),
    "GPX encoding": (gpx(TWO, '<?xml version="1.0" encoding="foo-1"?>'), "not usable XML (unknown encoding"),
    "GPX of a file": (gpx(TWO, OUTSIDE), "line 3 declares the entity 'a', expected a GPX file without entities"),
}


@pytest.mark.parametrize("cell", ["", "null", "NaN", "inf", "east", "1e999"])
@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_one_bad_cell_costs_its_own_value_alone(tmp_path: Path, column: int, cell: str) -> None:
    """A position or speed becomes unknown; a point without a time is marked. The other points stay as they are."""
    rows = [line.split(",") for line in PLAIN.splitlines()]
    rows[1][column] = cell
    record = read_trip(written(tmp_path, "trip", HEAD + "\n".join(map(",".join, rows)))).record
    sound = read_trip(written(tmp_path, "sound", PLAIN)).record
    for i, name in enumerate(("latitude_deg", "longitude_deg", "speed_mps")):
        expected = np.where((np.arange(3) == 1) & (i == column), np.nan, getattr(sound, name))
        np.testing.assert_array_equal(getattr(record, name), expected)
    assert record.untimed.tolist() == [False, column == 3, False]


@pytest.mark.parametrize("speed", ["-1", "-1.0"])
def test_the_speed_of_a_phone_that_knows_none_is_not_known(tmp_path: Path, speed: str) -> None:
    """iOS writes −1, in a whole trip if need be."""
    points = "".join(track_point(i, f"<speed>{speed}</speed>") for i in range(3))
    assert np.isnan(read_trip(written(tmp_path, "phone", gpx(points))).record.speed_mps).all()
    assert np.isnan(read_trip(written(tmp_path, "trip", every(2, speed))).record.speed_mps).all()


def test_points_without_a_time_are_dropped_and_counted(tmp_path: Path) -> None:
    bare = '<trkpt lat="59.5" lon="16.2"/>\n'
    record = read_trip(written(tmp_path, "trip", gpx(bare + TWO + bare + track_point(2) + track_point(3)))).record
    log = FindingLog(read=len(record))
    kept = in_order(record, log)
    assert len(kept) == 4
    assert [(one.kind, one.count, one.first) for one in log.found] == [(FindingKind.NO_TIME, 2, "line 3")]


@pytest.mark.parametrize(("text", "expected"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    refused(read_trip, written(tmp_path, "trip", text), re.escape(expected))


def test_a_missing_file_and_a_binary_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"nowhere\.csv: cannot be read"):
        read_trip(tmp_path / "nowhere.csv")
    (tmp_path / "x.csv").write_bytes(bytes(range(256)))
    with pytest.raises(DasError, match=r"x\.csv: not a UTF-8 text file"):
        read_trip(tmp_path / "x.csv")
    (tmp_path / "x.mcap").write_bytes(bytes(range(256)))
    with pytest.raises(DasError, match=r"x\.mcap: not an MCAP recording"):
        read_trip(tmp_path / "x.mcap")


def test_the_time_of_a_point_is_its_own(tmp_path: Path) -> None:
    inside = "<extensions><made><time>2001-01-01T00:00:00Z</time></made></extensions>"
    text = gpx("".join(track_point(i, inside) for i in range(3)))
    check(read_trip(written(tmp_path, "trip.gpx", text)).record, speeds=False)
