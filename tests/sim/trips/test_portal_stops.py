"""Stops of Wi-Fi portals as the journey of a trip."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from das.domain.files.load import catalogue, load_route
from das.domain.route import Route, Stop
from sim.trips.portal_stops import journey_file, trip_journey
from tests.das.domain.files.refusing import refused
from tests.support.made_line import north, route

ZONE = ZoneInfo("Europe/Berlin")
DAY = datetime(2026, 3, 2, tzinfo=ZONE)
DUE = (("Anfang", 0.0, None, "10:00"), ("Mitte", 3000.0, "10:05", "10:07"), ("Ende", 8000.0, "10:12", None))
"""Made-up stops: name, position (m), due arrival, due departure."""
BEFORE = ("Vorher", -60_000.0, None, "09:30")
NEAR_NS = round((DAY.timestamp() + 10 * 3600) * 1e9)


def line(zone: str = "Europe/Berlin") -> Route:
    stops = tuple(Stop(name=name, position_m=at_m) for name, at_m, _, _ in DUE)
    return replace(route(geometry=True), stops=stops, time_zone=zone)


def place(at_m: float) -> tuple[float, float]:
    latitude, longitude = north(np.array([at_m]))
    return float(latitude[0]), float(longitude[0])


def coordinates(at_m: float) -> dict[str, float]:
    return dict(zip(("latitude", "longitude"), place(at_m), strict=True))


def moment(clock: str | None) -> datetime | None:
    return None if clock is None else DAY.replace(hour=int(clock[:2]), minute=int(clock[3:]))


def ms(clock: str | None) -> int | None:
    at = moment(clock)
    return None if at is None else round(at.timestamp() * 1000)


def germany(stops: Any) -> dict[str, Any]:
    return {
        "trip": {
            "vzn": "1",
            "stops": [
                {
                    "station": {"name": name, "geocoordinates": coordinates(at_m)},
                    "timetable": {
                        "scheduledArrivalTime": ms(arrival), "actualArrivalTime": 1,
                        "scheduledDepartureTime": ms(leaves),
                    },
                    "track": {"scheduled": "1"},
                }
                for name, at_m, arrival, leaves in stops
            ],
        }
    }  # fmt: skip


def france(stops: Any) -> dict[str, Any]:
    made = []
    for name, at_m, arrival, leaves in stops:
        first = moment(arrival or leaves)
        assert first is not None
        stands = 0 if None in (arrival, leaves) else (ms(leaves) - ms(arrival)) // 60_000  # type: ignore[operator]
        made.append(
            {
                "label": name, "coordinates": coordinates(at_m),
                "theoricDate": first.astimezone(ZoneInfo("UTC")).strftime("%Y-%m-%dT%H:%M:%S.000Z"), "realDate": "soon",
                "duration": stands, "isRemoved": False,
            }
        )  # fmt: skip
    gone = {**made[1], "label": "Fort", "isRemoved": True}
    return {"number": "1", "stops": [made[0], gone, *made[1:]]}


def austria(stops: Any, day: bool = True) -> dict[str, Any]:
    listed = [
        {
            "name": {"de": name}, "arrival": {"scheduled": arrival, "forecast": "10:59"},
            "departure": {"scheduled": leaves, "forecast": None},
        }
        for name, _, arrival, leaves in stops
    ]  # fmt: skip
    return {"stations": listed, "latestStatus": {"dateTime": "2026-03-02T10:06:00+0100"} if day else {}}


def czechia(stops: Any) -> dict[str, Any]:
    listed = []
    for name, at_m, arrival, leaves in stops:
        latitude, longitude = place(at_m)
        both = (("timeArrival", moment(arrival)), ("timeDeparture", moment(leaves)))
        times = {key: None if at is None else at.isoformat() for key, at in both}
        listed.append({"station": {"name": name, "gpsLat": latitude, "gpsLng": longitude}, **times})
    return {"id": 1, "name": "rj 1", "connexionTimes": listed}


FORMS = {"germany": germany, "france": france, "austria": austria, "czechia": czechia}


def written(folder: Path, value: Any, name: str = "stops.json") -> str:
    path = folder / name
    path.write_text(value if isinstance(value, str) else json.dumps(value), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("zone", ["Europe/Berlin", "UTC"])
@pytest.mark.parametrize("form", FORMS)
def test_the_stops_of_each_portal_are_the_journey(tmp_path: Path, form: str, zone: str) -> None:
    """Stops beyond the route are left out, and so are those at which the train does not call."""
    made = FORMS[form]((BEFORE, *DUE))
    journey = trip_journey(written(tmp_path, made), line(zone), NEAR_NS)
    assert [call.name for call in journey.calls] == ["Anfang", "Mitte", "Ende"]
    assert [call.position_m for call in journey.calls] == [0.0, 3000.0, 8000.0]
    hour = 10 if zone == "Europe/Berlin" else 9
    start, middle, end = journey.calls
    assert start.departure.earliest_s == hour * 3600
    assert (middle.arrival.latest_s, middle.departure.earliest_s) == (hour * 3600 + 300, hour * 3600 + 420)
    assert end.arrival.latest_s == hour * 3600 + 720


def test_the_last_answer_of_a_record_counts(tmp_path: Path) -> None:
    """A recorder may keep the stops with every position, and an hour later the portal may know of other times."""
    later = tuple((n, at, a and a.replace("10:", "11:"), b and b.replace("10:", "11:")) for n, at, a, b in DUE)
    rows = [{"trip": germany(one), "status": {"speed": 1}, "time": "2026-03-02 10:00"} for one in (DUE, later)]
    text = "\n".join(map(json.dumps, rows)) + '\n{"trip": {"tri'
    path = written(tmp_path, text, "record.jsonl")
    assert trip_journey(path, line(), NEAR_NS).calls[-1].arrival.latest_s == 11 * 3600 + 720
    assert journey_file(path) == Path(path)


def test_times_of_day_are_those_nearest_to_the_trip(tmp_path: Path) -> None:
    night = (("Anfang", 0.0, None, "23:58"), ("Mitte", 3000.0, "00:03", "00:04"), ("Ende", 8000.0, "00:10", None))
    journey = trip_journey(written(tmp_path, austria(night, day=False)), line(), round((DAY.timestamp() - 60) * 1e9))
    start, _, end = journey.calls
    assert start.departure.earliest_s == 23 * 3600 + 58 * 60
    assert end.arrival.latest_s == 24 * 3600 + 600


def test_journey_files_and_bundled_journeys_are_read_as_before() -> None:
    there = load_route("zurich-luzern")
    journey = trip_journey("zurich-luzern", there, NEAR_NS)
    assert journey == trip_journey(str(catalogue("journeys")["zurich-luzern"]), there, NEAR_NS)
    assert journey_file("zurich-luzern") == catalogue("journeys")["zurich-luzern"]


BAD = {
    "no stops": (
        "record.jsonl",
        '{"speed": 1}\n',
        "stops is missing: expected those of a train's Wi-Fi portal (stops wi",
    ),
    "elsewhere": ("stops.json", germany([BEFORE]), "fewer than two stops of trip of the portal are on test.toml"),
    "no time": ("stops.json", germany([(*one[:2], None, None) for one in DUE]), "fewer than two stops of trip"),
    "time": (
        "stops.json",
        austria([(*one[:2], "soon", "soon") for one in DUE]),
        "stations[0] departure.scheduled = 'soon'",
    ),
    "place": (
        "stops.json",
        json.dumps(germany(DUE))
        .replace('"latitude": 5', '"latitude": "x5', 1)
        .replace(', "longitude"', '", "longitude"', 1),
        "stops latitude = 'x59",
    ),
}


@pytest.mark.parametrize(("name", "value", "expected"), BAD.values(), ids=BAD)
def test_bad_stops_are_refused_in_one_line(tmp_path: Path, name: str, value: Any, expected: str) -> None:
    path = Path(written(tmp_path, value, name))
    refused(lambda file: trip_journey(str(file), line(), NEAR_NS), path, re.escape(expected))
