"""A record written as public recorders write the answers of Wi-Fi portals; all values are made up."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

from das.domain.units import KMH, NS

PRAGUE = ZoneInfo("Europe/Prague")


class Fix(NamedTuple):
    """A point of a record; `speed_mps` None: not stated. `lost`: the position is an old one, and the portal says so."""

    time_ns: int
    latitude_deg: float
    longitude_deg: float
    speed_mps: float | None
    lost: bool = False


def _kmh(fix: Fix, digits: int = 1) -> float | None:
    return None if fix.speed_mps is None else round(fix.speed_mps / KMH, digits)


def local(fix: Fix, zone: ZoneInfo = PRAGUE) -> str:
    """The time of a point on the clock of a country, without its zone, as a recorder's `datetime.now()` gives it."""
    moment = datetime.fromtimestamp(fix.time_ns // 10**9, zone).replace(tzinfo=None)
    return (moment + timedelta(microseconds=fix.time_ns % 10**9 // 1000)).isoformat(" ")


def germany(fix: Fix) -> dict[str, Any]:
    """The answer of iceportal.de/api1/rs/status."""
    return {
        "connection": True, "serviceLevel": "AVAILABLE_SERVICE", "internet": "HIGH",
        "gpsStatus": "LAST_KNOWN_POSITION" if fix.lost else "VALID", "tileY": 303, "series": "011",
        "latitude": fix.latitude_deg, "longitude": fix.longitude_deg, "serverTime": fix.time_ns // 10**6,
        "speed": _kmh(fix), "trainType": "ICE", "tzn": "Tz9999", "wagonClass": "SECOND",
        "connectivity": {"currentState": "HIGH", "nextState": None, "remainingTimeSeconds": 58},
    }  # fmt: skip


def germany_logged(fix: Fix) -> dict[str, Any]:
    """A line of a recorder that keeps both answers of the portal and its own time, in whole minutes."""
    stops = [{"station": {"name": "A", "geocoordinates": {"latitude": 1.0, "longitude": 2.0}}}]
    trip = {"vzn": "1", "actualPosition": 7, "stopInfo": {"finalStationName": "B"}, "stops": stops}
    return {"trip": {"trip": trip}, "status": germany(fix), "time": local(fix, ZoneInfo("Europe/Berlin"))[:16]}


def austria(fix: Fix) -> dict[str, Any]:
    """The answer combined.json of railnet.oebb.at; its time is in whole seconds."""
    place = None if fix.lost else fix.latitude_deg, None if fix.lost else fix.longitude_deg
    moment = datetime.fromtimestamp(round(fix.time_ns * NS), ZoneInfo("Europe/Vienna"))
    return {
        "lineNumber": "1", "trainType": "RJ", "nextStationProgress": 40,
        "currentStation": {"id": 1, "station": {"geocoordinates": {"latitude": 48.1, "longitude": 16.3}}},
        "latestStatus": {
            "dateTime": moment.strftime("%Y-%m-%dT%H:%M:%S%z"), "situation": {"type": "drive-to", "station": "1"},
            "gpsPosition": {"latitude": place[0], "longitude": place[1], "orientation": 90.0},
            "speed": _kmh(fix), "distance": {"meters": 7, "fromStation": "1"}, "totalDelay": 0,
        },
    }  # fmt: skip


def austria_older(fix: Fix) -> dict[str, Any]:
    """The older answer of railnet.oebb.at, in which numbers are texts."""
    return {
        "operationalMessagesInfo": {"time": str(round(fix.time_ns * NS)), "speed": str(_kmh(fix)), "delay": "0"},
        "mapInfo": {"latitude": str(fix.latitude_deg), "longitude": str(fix.longitude_deg), "orientation": "90"},
        "currentJourney": {"trainType": "RJ"},
    }


def austria_apart(fix: Fix) -> dict[str, Any]:
    """A line of a recorder of railnet.oebb.at/api/gps and /api/speed, with its own time."""
    place = {"Latitude": fix.latitude_deg, "Longitude": fix.longitude_deg}
    return {"t": fix.time_ns * NS, "gps": place, "speed": _kmh(fix)}


def czechia(fix: Fix) -> dict[str, Any]:
    """A line of a recorder of cdwifi.cz, whose answer states no time."""
    answer = {
        "gpsLat": fix.latitude_deg, "gpsLng": fix.longitude_deg, "prevGpsLat": 50.0, "prevGpsLng": 14.0,
        "speed": _kmh(fix), "delay": 3, "altitude": 200, "temperature": None,
    }  # fmt: skip
    return {"time": local(fix), "data": answer}


def sweden(fix: Fix) -> dict[str, Any]:
    """The answer of ombord.info/api/jsonp/position, in which all values are texts."""
    speed = "" if fix.speed_mps is None else f"{fix.speed_mps:.3f}"
    return {
        "version": "1.7", "time": f"{fix.time_ns * NS:.0f}", "age": "0", "latitude": f"{fix.latitude_deg:.7f}",
        "longitude": f"{fix.longitude_deg:.7f}", "altitude": "50.400", "speed": speed, "cmg": "270.0",
        "satellites": "0" if fix.lost else "8", "mode": "1" if fix.lost else "3",
    }  # fmt: skip


def france(fix: Fix) -> dict[str, Any]:
    """The answer of wifi.sncf/router/api/train/gps; its time is in whole seconds."""
    return {
        "success": not fix.lost, "fix": 0 if fix.lost else 10, "timestamp": round(fix.time_ns * NS),
        "latitude": fix.latitude_deg, "longitude": fix.longitude_deg, "altitude": 103.315,
        "speed": fix.speed_mps, "heading": 271.4288,
    }  # fmt: skip


FORMS: dict[str, Callable[[Fix], dict[str, Any]]] = {
    one.__name__: one
    for one in (germany, germany_logged, austria, austria_older, austria_apart, czechia, sweden, france)
}
WHOLE_SECONDS = ("austria", "austria_older", "sweden", "france")
"""Forms whose times are in whole seconds."""


def lines(fixes: Iterable[Fix], form: str) -> list[str]:
    """The answers of a portal, one a line; Icomera's as JSONP."""
    texts = [json.dumps(FORMS[form](fix), ensure_ascii=False) for fix in fixes]
    return [f"({text});" for text in texts] if form == "sweden" else texts


def write(path: Path, fixes: Sequence[Fix], form: str) -> Path:
    """Write the answers of a portal as JSON lines."""
    path.write_text("\n".join(lines(fixes, form)) + "\n", encoding="utf-8")
    return path
