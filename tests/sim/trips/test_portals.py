"""Records of Wi-Fi portals: the forms that recorders write, what is wrong in them, and what they lead to."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.units import KMH
from sim.options import TripOptions
from sim.trips.cleaning import FindingKind
from sim.trips.portals import flat
from sim.trips.record import Record, read_trip
from sim.trips.trip import Trip, load_trip
from tests.das.domain.files.refusing import refused
from tests.support.dirt import EPOCH_S, Points, changed, clean, counts, truth_of_run
from tests.support.made_line import north, route
from tests.support.portals import FORMS, WHOLE_SECONDS, Fix, france, germany, lines, local, sweden, write

FIXES = [
    Fix(1_469_780_350_227_000_000 + i * 10**9, 59.5 + i * 1e-4, 16.2 + i * 1e-4, v)
    for i, v in enumerate((0.0, 10 * KMH, 20.5 * KMH, 31.2 * KMH))
]


def fixes(points: Points, lost: range = range(0)) -> list[Fix]:
    """The points of a made-up trip; those of `lost` keep the last position before them."""
    made = []
    for i, p in enumerate(points):
        latitude, longitude = north(np.array([points[lost.start - 1].s_m if i in lost else p.s_m]), p.east_m)
        made.append(Fix(round((EPOCH_S + p.t) * 1e9), float(latitude[0]), float(longitude[0]), p.v, i in lost))
    return made


def written(folder: Path, text: str, name: str = "record.txt") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return path


def check(record: Record, form: str) -> None:
    """The record has the points of FIXES."""
    step_ns = 10**9 if form in WHOLE_SECONDS else 10**6
    assert np.abs(record.time_ns - [fix.time_ns for fix in FIXES]).max() <= step_ns / 2
    assert record.latitude_deg == pytest.approx([fix.latitude_deg for fix in FIXES], abs=1e-9)
    assert record.longitude_deg == pytest.approx([fix.longitude_deg for fix in FIXES], abs=1e-9)
    assert record.speed_mps == pytest.approx([fix.speed_mps for fix in FIXES], abs=0.05 * KMH)
    assert not record.untimed.any()


@pytest.mark.parametrize("form", FORMS)
def test_the_answers_of_each_portal_are_read_with_its_names_and_units(tmp_path: Path, form: str) -> None:
    reading = read_trip(write(tmp_path / "record.jsonl", FIXES, form))
    check(reading.record, form)
    assert reading.record.number.tolist() == [1, 2, 3, 4]
    assert reading.format.startswith("Wi-Fi portal of ")
    assert reading.record.zone == ("Europe/Prague" if form == "czechia" else "")


def as_array(form: str) -> str:
    return "[" + ",\n ".join(text.strip("();") for text in lines(FIXES, form)) + "]\n"


def as_objects(form: str) -> str:
    """Objects over several lines, one after the other, as `curl … | jq . >> FILE` leaves them."""
    return "\n".join(json.dumps(FORMS[form](fix), indent=2) for fix in FIXES)


def as_csv(form: str, separator: str = ",", joint: str = "_", comma: bool = False) -> str:
    """A table with the fields of all objects, their names joined."""
    rows = [{name[1:].replace(".", joint): text for name, text in flat(FORMS[form](fix))} for fix in FIXES]
    out = io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]), delimiter=separator)
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().replace(".", ",") if comma else out.getvalue()


def turned(value: Any) -> Any:
    """An object with its fields, and those of the objects in it, in the other order."""
    return {key: turned(value[key]) for key in reversed(value)} if isinstance(value, dict) else value


SHAPES: dict[str, Callable[[str], str]] = {
    "array": as_array,
    "objects": as_objects,
    "callback": lambda form: "".join(f"callback( {text.strip('();')} );\n" for text in lines(FIXES, form)),
    "csv": as_csv,
    "csv with dots": lambda form: as_csv(form, joint="."),
    "semicolons": lambda form: as_csv(form, ";"),
    "blank lines": lambda form: as_csv(form).replace("\n", "\n\n"),
    "other order": lambda form: "\n".join(json.dumps(turned(FORMS[form](fix))) for fix in FIXES),
    "wrapped": lambda form: "\n".join(
        json.dumps({"timestamp": local(fix), "url": "https://x/", "data": {"answer": FORMS[form](fix)}})
        for fix in FIXES
    ),
    "mark and CRLF": lambda form: "\ufeff" + "\r\n".join(lines(FIXES, form)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("form", FORMS)
def test_every_shape_of_a_record_gives_the_same_points(tmp_path: Path, form: str, shape: str) -> None:
    check(read_trip(written(tmp_path, SHAPES[shape](form))).record, form)


@pytest.mark.parametrize("form", ["germany", "czechia", "sweden"])
def test_numbers_may_have_a_decimal_comma(tmp_path: Path, form: str) -> None:
    check(read_trip(written(tmp_path, as_csv(form, ";", comma=True))).record, form)


MINIMAL: dict[str, str] = {
    "germany": '{{"serverTime": {ms}, "latitude": {lat}, "longitude": {lon}, "speed": {kmh}}}',
    "germany as text": '{{"serverTime": "{ms}", "latitude": "{lat}", "longitude": "{lon}", "speed": "{kmh}"}}',
    "germany, recorder's time": '{{"t": {s}, "tzn": "x", "latitude": {lat}, "longitude": {lon}, "speed": {kmh}}}',
    "austria, small letters": '{{"t": {s}, "gps": {{"latitude": {lat}, "longitude": {lon}}}, "speed": {kmh}}}',
    "austria": '{{"ts": "{iso}", "Latitude": {lat}, "Longitude": {lon}, "speed": {kmh}}}',
    "czechia": '{{"timestamp": {s}, "gpsLat": {lat}, "gpsLng": {lon}, "speed": {kmh}}}',
    "czechia, small letters": '{{"timestamp": {ms}, "gpslat": {lat}, "gpslng": {lon}, "speed": {kmh}}}',
    "france": '{{"timestamp": {s}, "latitude": {lat}, "longitude": {lon}, "altitude": 7, "speed": {mps}}}',
    "france in ms": '{{"timestamp": {ms}, "fix": true, "latitude": {lat}, "longitude": {lon}, "speed": {mps}}}',
    "france, ISO": '{{"timestamp": "{iso}", "heading": 1, "latitude": {lat}, "longitude": {lon}, "speed": {mps}}}',
    "sweden, satellites": '{{"time": {s}, "satellites": 7, "latitude": {lat}, "longitude": {lon}, "speed": {mps}}}',
}


@pytest.mark.parametrize("text", MINIMAL.values(), ids=MINIMAL)
def test_fields_that_are_not_needed_may_be_missing(tmp_path: Path, text: str) -> None:
    made = []
    for fix in FIXES:
        assert fix.speed_mps is not None
        place = {"lat": fix.latitude_deg, "lon": fix.longitude_deg}
        speed = {"kmh": fix.speed_mps / KMH, "mps": fix.speed_mps}
        time = {"ms": fix.time_ns // 10**6, "s": fix.time_ns / 1e9, "iso": f"{local(fix)}+02:00"}
        made.append(text.format(**place, **speed, **time))
    check(read_trip(written(tmp_path, "\n".join(made))).record, "")


def test_positions_without_speeds_are_read(tmp_path: Path) -> None:
    texts = [
        f'{{"time": {fix.time_ns / 1e9}, "gpsLat": {fix.latitude_deg}, "gpsLng": {fix.longitude_deg}}}' for fix in FIXES
    ]
    assert np.isnan(read_trip(written(tmp_path, "\n".join(texts))).record.speed_mps).all()


@pytest.mark.parametrize("cut", [1, 90])
@pytest.mark.parametrize("shape", ["lines", "array", "objects", "csv"])
def test_a_record_is_kept_up_to_where_its_recorder_was_killed(tmp_path: Path, shape: str, cut: int) -> None:
    text = "\n".join(lines(FIXES, "germany")) if shape == "lines" else SHAPES[shape]("germany")
    record = read_trip(written(tmp_path, text.rstrip("\n]")[:-cut])).record
    assert record.untimed.tolist() == [False, False, False, shape != "csv" or cut > 1]
    assert record.latitude_deg[:3] == pytest.approx([fix.latitude_deg for fix in FIXES[:3]])
    assert record.speed_mps[:3] == pytest.approx([fix.speed_mps for fix in FIXES[:3]], abs=0.02)


def test_answers_that_cannot_be_read_are_counted(tmp_path: Path) -> None:
    made = lines(FIXES * 3, "germany")
    made[4:6] = ["<html><body>Willkommen</body></html>", '{"error": "timeout"}']
    record = read_trip(written(tmp_path, "\n".join(made))).record
    assert np.flatnonzero(record.untimed).tolist() == [4, 5]
    assert record.number[6] == 7


LOST = ("germany", "austria", "sweden", "france")


@pytest.mark.parametrize("form", LOST)
def test_a_position_that_the_portal_calls_old_is_not_used(tmp_path: Path, form: str) -> None:
    some = [fix._replace(lost=i == 2) for i, fix in enumerate(FIXES)]
    record = read_trip(write(tmp_path / "r", some, form)).record
    assert np.isnan(record.latitude_deg).tolist() == [False, False, True, False]
    assert record.speed_mps[2] == pytest.approx(20.5 * KMH, abs=0.02)


def test_the_place_0_0_is_no_place(tmp_path: Path) -> None:
    some = [fix._replace(latitude_deg=0.0, longitude_deg=0.0) if i == 1 else fix for i, fix in enumerate(FIXES)]
    record = read_trip(write(tmp_path / "r", some, "czechia")).record
    assert np.isnan(record.longitude_deg).tolist() == [False, True, False, False]


def of_portal(folder: Path, made: list[Fix], form: str = "germany") -> Trip:
    path = write(folder / "record.jsonl", made, form)
    return load_trip(path, read_trip(path), route(geometry=True), TripOptions())


@pytest.mark.parametrize("form", ["germany", "czechia"])
def test_a_tunnel_is_crossed_by_the_speeds(tmp_path: Path, form: str) -> None:
    """For 60 s the portal repeats its last position; only one of the two portals says so."""
    points = clean()
    trip = of_portal(tmp_path, fixes(points, range(60, 120)), form)
    assert counts(trip)[FindingKind.SPEED_ALONE] == 60
    assert FindingKind.POSITION_FROZEN not in counts(trip)
    true_m, true_mps = truth_of_run(trip, points)
    assert np.abs(trip.run.s_m - true_m).max() < 6
    assert np.abs(trip.run.speed_mps - true_mps).max() < 0.9
    assert not trip.run.inferred.any()
    inside = slice(60, 120)
    assert (trip.matched.uncertainty_m[inside] == 50).all()


def test_a_tunnel_is_not_crossed_by_speeds_that_do_not_lead_through_it(tmp_path: Path) -> None:
    points = changed(clean(), range(60, 120), v=lambda p: 0.6 * p.v)  # type: ignore[operator]
    trip = of_portal(tmp_path, fixes(points, range(60, 120)))
    assert counts(trip)[FindingKind.NO_POSITION] == 60
    assert FindingKind.SPEED_ALONE not in counts(trip)


def test_zero_speeds_of_a_moving_train_are_dropouts(tmp_path: Path) -> None:
    points = clean()
    dirty = changed(points, (150, 151, 152, 200), v=0.0)
    trip = of_portal(tmp_path, fixes(dirty))
    assert counts(trip) == {FindingKind.SPEED_DROPOUT: 4}
    _, true_mps = truth_of_run(trip, points)
    assert np.abs(trip.run.speed_mps - true_mps).max() < 0.9
    trip = of_portal(tmp_path, fixes(changed(points, (80, 81, 82), v=0.0), range(60, 120)))
    assert counts(trip) == {FindingKind.SPEED_ALONE: 60, FindingKind.SPEED_DROPOUT: 3}


def test_a_portal_that_stands_still_while_the_train_runs_is_no_stop(tmp_path: Path) -> None:
    """For 20 s it repeats the last position with a speed of 0, at 108 km/h."""
    points = clean()
    stuck = changed(points, range(150, 170), s_m=points[149].s_m, v=0.0)
    trip = of_portal(tmp_path, fixes(stuck))
    assert counts(trip) == {FindingKind.POSITION_FROZEN: 20}
    assert trip.stops_on_the_way == ()
    assert len(trip.stands) == 2
    _, true_mps = truth_of_run(trip, points)
    assert np.abs(trip.run.speed_mps - true_mps).max() < 1.0


def test_answers_that_repeat_the_fix_and_its_time_count_once(tmp_path: Path) -> None:
    made = fixes(clean())
    again = [fix for fix in made for _ in range(2)]
    assert counts(of_portal(tmp_path, again)) == {FindingKind.DUPLICATE_TIME: len(made)}


def test_a_recorder_that_asks_more_often_than_the_receiver_measures(tmp_path: Path) -> None:
    """Position and speed are new every third second, the portal's clock every second."""
    points = clean()
    made = fixes([replace(points[i - i % 3], t=p.t) for i, p in enumerate(points)])
    trip = of_portal(tmp_path, made)
    true_m, true_mps = truth_of_run(trip, points)
    assert np.abs(trip.run.speed_mps - true_mps).max() < 2.0
    assert np.abs(trip.run.s_m - true_m).max() < 30


@pytest.mark.parametrize("form", FORMS)
def test_the_trip_of_each_portal_is_the_trip(tmp_path: Path, form: str) -> None:
    trip = of_portal(tmp_path, fixes(clean()), form)
    true_m, true_mps = truth_of_run(trip, clean())
    assert trip.whole
    assert np.abs(trip.run.speed_mps - true_mps).max() < 0.6
    assert np.abs(trip.run.s_m - true_m).max() < 6
    assert set(counts(trip)) <= {FindingKind.NO_ZONE}


def test_local_times_are_those_of_the_portals_country(tmp_path: Path) -> None:
    summer, winter = (
        read_trip(write(tmp_path / "r", [fix._replace(time_ns=fix.time_ns + later) for fix in FIXES], "czechia")).record
        for later in (0, 180 * 86_400 * 10**9)
    )
    assert summer.time_ns[0] == FIXES[0].time_ns
    assert winter.time_ns[0] == FIXES[0].time_ns + 180 * 86_400 * 10**9
    trip = of_portal(tmp_path, fixes(clean()), "czechia")
    (finding,) = trip.matched.report.cleaning.findings
    assert (finding.kind, finding.count, finding.detail) == (FindingKind.NO_ZONE, len(clean()), "that of Europe/Prague")


def answers(**changed_fields: Any) -> str:
    return "\n".join(json.dumps({**sweden(fix), **changed_fields}) for fix in FIXES)


BAD = {
    "unknown form": (
        '{"lat": 1, "lon": 2, "v": 3}\n' * 3,
        "the fields = 'lat,lon,v': expected answers of a train's Wi-Fi",
    ),
    "no answers": (
        "[]",
        "the fields = '': expected answers of a train's Wi-Fi portal (České dráhy (cdwifi.cz): gpsLat",
    ),
    "broken": ("{{{{", "the fields = '': expected answers of a train's Wi-Fi portal"),
    "deep": ('{"a":' * 5000 + "1" + "}" * 5000, "the fields = '': expected answers of a train's Wi-Fi portal"),
    "one answer": (json.dumps(germany(FIXES[0])), "1 answer of a Wi-Fi portal, expected at least 2"),
    "no time": (
        '{"gpsLat": 1, "gpsLng": 2, "speed": 3}\n' * 3,
        "České dráhy (cdwifi.cz) is missing: expected a field with the time of each answer: time timestamp datetime",
    ),
    "zone not known": (
        answers(time="2026-01-05 10:00:00"),
        "line 1 time = '2026-01-05 10:00:00': expected an ISO 8601",
    ),
    "hour that came twice": (
        '{"time": "2025-10-26 02:30:00", "gpsLat": 50, "gpsLng": 14}\n' * 3,
        "line 1 time = '2025-10-26 02:30:00': expected an ISO 8601 time like 2026-11-21T08:04:00Z with its time zone",
    ),
    "time of day": (answers(time="10:00"), "line 1 time = '10:00': expected an ISO 8601 time"),
    "latitude": (answers(latitude="95"), "line 1 latitude = 95.0: expected -90 to 90 deg"),
    "speed": (answers(speed="-7"), "line 1 speed = -7.0: expected a speed >= 0"),
    "infinity": (answers(speed="Infinity"), "line 1 speed = 'Infinity': expected a finite number"),
    "capital letters of someone": (
        "Time,Latitude,Longitude,Speed\n" + "2026-01-05T10:00:00Z,1,2,3\n" * 3,
        "line 1 = 'speed': expected speed as speed_kmh or speed_mps",
    ),
}


@pytest.mark.parametrize(("text", "expected"), BAD.values(), ids=BAD)
def test_a_bad_record_is_refused_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    refused(read_trip, written(tmp_path, text), re.escape(expected))


def test_a_table_of_this_project_stays_one(tmp_path: Path) -> None:
    """Columns that a portal has as well do not matter if the unit of the speed is stated, or there is no speed."""
    head, row = "time,latitude,longitude,altitude,{}\n", "2026-01-05T10:00:{:02d},59.5,16.2,3,{}\n"
    for last, value in (("speed_kmh", 36), ("heading", 90), ("satellites", 8), ("gpsStatus", "VALID")):
        text = head.format(last) + "".join(row.format(i, value) for i in range(3))
        reading = read_trip(written(tmp_path, text))
        assert reading.format == "CSV"
        assert reading.record.time_ns[0] == round(datetime.fromisoformat("2026-01-05T10:00:00Z").timestamp()) * 10**9


def test_the_names_of_portals_are_told_apart(tmp_path: Path) -> None:
    """A recorder of Icomera adds a timestamp, one of SNCF a time."""
    for form, other in ((sweden, "timestamp"), (france, "time")):
        made = [{other: local(fix), "data": form(fix)} for fix in FIXES]
        check(read_trip(written(tmp_path, json.dumps(made))).record, form.__name__)
