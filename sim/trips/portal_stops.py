"""Stops that the Wi-Fi portal of a train states, as a journey on the route of a trip.

`STOPS` declares the fields of each portal; sources as in `sim.trips.portals`. Only due times are used: the times at
which the train arrived and departed come from the record.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from das.domain.errors import MISSING, InputError
from das.domain.files.load import load_journey, locate_journey
from das.domain.files.reading import read_text
from das.domain.journey import ANY_TIME as ALWAYS
from das.domain.journey import Window
from das.domain.route import Route
from das.domain.units import NS
from das.offline.asked_journey import Call, Journey
from precompute.gtfs import FeedTrip, TripStop
from precompute.journey_import import placed
from sim.trips import portals
from sim.trips.portals import Answer, field_of, names_of
from sim.trips.record import ANY_TIME, number, read_time


class StopFields(NamedTuple):
    """The fields of the stops of a portal (see `Portal`), and the zone of times that state none.

    `stops` is the list of stops; those with `isRemoved` are left out. `dwell_min` (min) is the time from arrival to
    departure.
    """

    zone: str
    stops: str
    name: str
    arrival: str
    departure: str
    latitude: str = "latitude"
    longitude: str = "longitude"
    dwell_min: str = ""


STOPS: Final = (
    StopFields("Europe/Berlin", "stops", "station.name", "scheduledArrivalTime", "scheduledDepartureTime"),
    StopFields("Europe/Paris", "stops", "label name", "theoricDate", "theoricDate", dwell_min="duration"),
    StopFields("Europe/Vienna", "stations", "name.de", "arrival.scheduled", "departure.scheduled"),
    StopFields(
        "Europe/Prague", "connexionTimes", "station.name", "timeArrival", "timeDeparture", "station.gpsLat",
        "station.gpsLng",
    ),
)  # fmt: skip
CLOCK: Final = re.compile(r"(\d{1,2}):(\d\d)(?::(\d\d))?")
DEEPEST: Final = 4
"""Most objects around the list of stops in an answer."""


def trip_journey(name_or_path: str, route: Route, departed_ns: int) -> Journey:
    """The journey of a trip: a bundled journey, a journey file, or the stops that a portal states.

    `departed_ns` is a time of the trip (ns since 1970); a time of day is the one nearest to it. Raises DasError or
    InputError (file, key, value, expectation) for anything unusable.
    """
    path, found, last = Path(name_or_path), None, None
    if path.is_file() and path.suffix.lower() not in (".toml", ".zip"):
        for value, _ in portals.json_values(read_text(path)):
            last = value if any(_lists(value)) else last
        found = next(_stated(last), None)
        if found is None and path.suffix.lower() != ".json":
            known = "; ".join(f"{one.stops} with {one.departure}" for one in STOPS)
            raise InputError(path, "stops", MISSING, f"those of a train's Wi-Fi portal ({known})")
    return load_journey(name_or_path, route) if found is None else _journey(path, route, *found, departed_ns)


def journey_file(name_or_path: str) -> Path:
    """The file of a journey that `trip_journey` reads."""
    return Path(name_or_path) if Path(name_or_path).is_file() else locate_journey(name_or_path)


def _lists(value: Any, depth: int = 0) -> Iterator[tuple[StopFields, list[Any]]]:
    """The lists in an answer that may be stops, with their fields."""
    for key, one in value.items() if isinstance(value, dict) else ():
        if isinstance(one, list) and one:
            yield from ((form, one) for form in STOPS if form.stops == key)
        if depth < DEEPEST:
            yield from _lists(one, depth + 1)


def _stated(answer: Any) -> Iterator[tuple[StopFields, list[Answer]]]:
    """The fields and the stops in an answer."""
    for form, entries in _lists(answer):
        stops = [dict(portals.flat(entry)) for entry in entries]
        if all(field_of(names_of(stops), one) for one in (form.name, form.departure)):
            yield form, stops


def _journey(path: Path, route: Route, form: StopFields, stops: list[Answer], near_ns: int) -> Journey:
    """The journey over the stops of a portal that are on a route; times in s from the midnight before the first."""
    names, zone = names_of(stops), ZoneInfo(form.zone)

    def text(stop: Answer, wanted: str) -> str:
        return stop.get(field_of(names, wanted), "")

    def degrees(stop: Answer, wanted: str) -> float:
        return number(path, f"{form.stops} {wanted}", text(stop, wanted)) if text(stop, wanted) else np.nan

    read: list[TripStop] = []
    zero_ns = 0
    for i, stop in enumerate(stops):
        key, due = f"{form.stops}[{i}]", [text(stop, form.arrival), text(stop, form.departure)]
        times_ns = [_time_ns(path, f"{key} {form.departure}", one, zone, near_ns) for one in due if one]
        if times_ns and text(stop, "isRemoved") != "True":
            dwell_s = 60 * number(path, f"{key} {form.dwell_min}", text(stop, form.dwell_min) or "0")
            zero_ns = zero_ns or route.midnight_ns(times_ns[0])
            arrival_s, departure_s = ((one - zero_ns) / 10**9 for one in (times_ns[0], times_ns[-1]))
            place = degrees(stop, form.latitude), degrees(stop, form.longitude)
            read.append(TripStop(str(i), text(stop, form.name), *place, arrival_s, departure_s + dwell_s))
    trip = FeedTrip(
        feed=path, id="of the portal", title="", agency="", time_zone="", stops=tuple(read), shape_deg=np.empty((0, 2))
    )
    on_route = placed(trip, route).stops
    calls = tuple(
        Call(
            name=one.route_stop or one.stop.name,
            position_m=one.position_m,
            arrival=ALWAYS if one == on_route[0] else Window(latest_s=one.stop.arrival_s),
            departure=ALWAYS if one == on_route[-1] else Window(earliest_s=one.stop.departure_s),
        )
        for one in on_route
    )
    return Journey(id="portal", name=f"{calls[0].name} – {calls[-1].name}", source=str(path), points=calls)


def _time_ns(path: Path, key: str, text: str, zone: ZoneInfo, near_ns: int) -> int:
    """A due time (ns since 1970); a time of day is the one nearest to `near_ns`."""
    clock = CLOCK.fullmatch(text)
    if clock is None:
        return read_time(path, key, text, ANY_TIME, zone)
    hours, minutes, seconds = (int(part or 0) for part in clock.groups())
    midnight = datetime.fromtimestamp(near_ns * NS, zone).replace(hour=0, minute=0, second=0, microsecond=0)
    days = (midnight + timedelta(day, seconds, minutes=minutes, hours=hours) for day in (-1, 0, 1))
    return min((round(one.timestamp() / NS) for one in days), key=lambda one_ns: abs(one_ns - near_ns))
