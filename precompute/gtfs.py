"""GTFS feeds: one trip of a public timetable, read from the published zip (gtfs.org, Schedule Reference)."""

from __future__ import annotations

import csv
import datetime
import math
import os
import re
import unicodedata
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path, PurePosixPath
from typing import IO, Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.load import UNZIP_ERRORS, refuse_foreign
from das.domain.files.routes import MOST_STOPS
from das.domain.units import MEGABYTE
from das.offline.asked_journey import file_clock

CLOCK = re.compile(r"\s*(\d{1,3}):([0-5]?\d):([0-5]?\d)\s*")
"""A time of the service day, which continues after 24:00:00."""


def clock_s(match: re.Match[str]) -> float:
    """The time (s) of a match of `CLOCK`."""
    hours, minutes, seconds = (int(part) for part in match.groups())
    return 3600.0 * hours + 60.0 * minutes + seconds


def parsed_clock_s(text: str) -> float:
    """The time of the service day (s) that `--at` names, like 07:30; DasError for anything else."""
    match = CLOCK.fullmatch(text if text.count(":") > 1 else f"{text}:00")
    if match is None:
        raise DasError(f"--at {text}: expected a time like 07:30")
    return clock_s(match)


def parsed_day(text: str) -> datetime.date:
    """The day that `--date` names; DasError for anything else."""
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise DasError(f"--date {text}: expected a day like 2026-11-26") from None


@dataclass(frozen=True, kw_only=True)
class TripChoice:
    """The choice of a trip: by id, or by two stops and the earliest departure (s after midnight); `day` must be served.

    With an id, the two stops select a part of the trip; a trip that does not run at that time or day is rejected.
    """

    trip: Annotated[str | None, typer.Option(metavar="ID", help="The trip_id, or a number that only one trip has.")] = (
        None
    )
    from_stop: Annotated[
        str | None, typer.Option("--from", metavar="STOP", help="Where the journey begins: name or stop_id.")
    ] = None
    to_stop: Annotated[
        str | None, typer.Option("--to", metavar="STOP", help="Where the journey ends: name or stop_id.")
    ] = None
    at_s: Annotated[
        float | None,
        typer.Option(
            "--at",
            parser=parsed_clock_s,
            metavar="HH:MM",
            help="The first train from then on; with --trip, its first run from then on.",
        ),
    ] = None
    day: Annotated[
        datetime.date | None,
        typer.Option(
            "--date",
            parser=parsed_day,
            metavar="YYYY-MM-DD",
            help="Only trips that run on this day, after midnight also those of the day before [default: on any day].",
        ),
    ] = None


Row = dict[str, str]

MOST_BYTES = {"stop_times.txt": 3_000_000_000, "shapes.txt": 1_000_000_000}
"""Largest unpacked size (bytes) of the tables that are read row by row; a whole country has 1 GB of stop times."""
MOST_BYTES_OF_TABLE = 100_000_000
"""Largest unpacked size (bytes) of every other table."""
SWELLING, SWELLS_FROM_BYTES = 100.0, 1_000_000
"""Largest compression factor of a table of at least `SWELLS_FROM_BYTES`; beyond it the table is rejected."""
LONGEST_LINE = 100_000
"""Longest row of a table (bytes)."""


@contextmanager
def refused(where: str | Path) -> Iterator[None]:
    """Turn the errors of reading a damaged zip or table into a DasError that names the place."""
    try:
        yield
    except UNZIP_ERRORS as error:
        why = str(error) or "it ends too early"
        raise DasError(f"{where}: cannot be unpacked ({why}), expected the zip of a GTFS feed") from None
    except UnicodeDecodeError as error:
        raise DasError(f"{where}: not UTF-8 text ({error.reason})") from None
    except csv.Error as error:
        raise DasError(f"{where}: cannot be read ({error})") from None


def _lines(file: IO[bytes], where: str, needles: Sequence[bytes], numbers: list[int]) -> Iterator[str]:
    """The lines of a table with one of the needles, and the first line; `numbers` gets the number of each."""
    number = 0
    while line := file.readline(LONGEST_LINE + 1):
        number += 1
        if len(line) > LONGEST_LINE:
            raise InputError(where, f"line {number}", f"more than {LONGEST_LINE} bytes", "a shorter line")
        if number == 1 or not needles or any(needle in line for needle in needles):
            numbers[:] = [number]
            yield line.decode("utf-8-sig" if number == 1 else "utf-8").replace("\r", "")


def coordinates(latitude: str, longitude: str) -> tuple[float, float]:
    """Two coordinates (deg) of a table; NaN if one is missing or impossible, and for 0, 0 (an unknown place)."""
    try:
        found = float(latitude), float(longitude)
    except ValueError:
        return math.nan, math.nan
    possible = abs(found[0]) <= 90.0 and abs(found[1]) <= 180.0 and found != (0.0, 0.0)
    return found if possible else (math.nan, math.nan)


def tidy(text: str) -> str:
    """A text of the feed on one line, without control characters."""
    kept = "".join(" " if unicodedata.category(one)[0] in "CZ" else one for one in text)
    return " ".join(kept.split())[:150]


def key_of(name: str) -> str:
    """A name for comparison: lower case, without accents and punctuation."""
    bare = "".join(x for x in unicodedata.normalize("NFKD", name.casefold()) if not unicodedata.combining(x))
    return " ".join(re.findall(r"\w+", bare))


def whole_number(text: str) -> int | None:
    """The number >= 0 in a text of at most nine digits; None for any other text."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else None


DAY_S = 86_400.0
MOST_DAYS = 7
"""Number of service days whose trains may still run on a day: some trains run for five days (139 h)."""
MOST_NAMED = 6
"""Largest number of trips or stops that an error names."""
NO_RAIL = (*range(3, 5), *range(6, 8), 11, *range(200, 300), *range(700, 900), *range(1000, 1400))
"""Route types of buses, ferries, cable cars, coaches and aircraft (basic and extended types)."""
WEEKDAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")


class TripStop(NamedTuple):
    """A row of a trip: the stop's id and name, its coordinates (deg, NaN: none), and its times (NaN: none).

    Times are in s after the midnight that begins the service day. `serves` is False if passengers cannot get on or off.
    """

    stop_id: str
    name: str
    latitude_deg: float
    longitude_deg: float
    arrival_s: float
    departure_s: float
    serves: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedTrip:
    """A trip of a feed; `shape_deg` (points, 2) holds latitudes and longitudes of its path, empty if there is none.

    `notes` are remarks for the user on the choice of the trip.
    """

    feed: Path
    id: str
    title: str
    agency: str
    time_zone: str
    stops: tuple[TripStop, ...]
    shape_deg: NDArray[np.float64]
    notes: tuple[str, ...] = ()


def read_trip(path: Path, wanted: TripChoice) -> FeedTrip:
    """Read one trip; raises DasError or InputError (table, key, value, expectation) if it is missing or damaged."""
    if not os.path.exists(path):  # unlike Path.exists, false for a name that no file can have
        raise DasError(f"{path}: no such file")
    if not path.is_file():
        raise DasError(f"{path}: expected the feed as a zip file")
    if not zipfile.is_zipfile(path):
        refuse_foreign(path, "GTFS feed")
    with refused(path):
        archive = zipfile.ZipFile(path)
    with archive:
        return _Feed(path, archive).trip(wanted)


class _Run(NamedTuple):
    """A run of a trip; runs compare by the time at which they leave the requested stop.

    `leaves_s` counts from midnight of the wanted day, which begins `days_before` days after its service day. The run is
    `later_s` later than in stop_times.txt.
    """

    leaves_s: float
    days_before: int
    later_s: float
    at_intervals: bool


class _Feed:
    """A feed whose tables are read row by row."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self.path, self.archive = path, archive
        self.members: dict[str, zipfile.ZipInfo] = {}
        for member in archive.infolist():
            place = PurePosixPath(member.filename.replace("\\", "/"))
            if place.suffix == ".txt" and "__MACOSX" not in place.parts:
                kept = self.members.get(place.name)
                # A feed may be in a folder of the zip; of two tables with one name, the one nearer to the root counts.
                if kept is None or len(place.parts) < len(PurePosixPath(kept.filename).parts):
                    self.members[place.name] = member
        if "stop_times.txt" not in self.members:
            raise InputError(path, "stop_times.txt", MISSING, "the tables of a GTFS feed in the zip")
        for name, member in self.members.items():
            self._check_member(name, member)

    def _check_member(self, name: str, member: zipfile.ZipInfo) -> None:
        """Check a table by its entry in the zip before unpacking; raises InputError."""
        most = MOST_BYTES.get(name, MOST_BYTES_OF_TABLE)
        swells = member.file_size > max(SWELLS_FROM_BYTES, SWELLING * max(member.compress_size, 1))
        if member.file_size > most or swells:
            size = f"{member.file_size / MEGABYTE:.0f} MB from {member.compress_size / MEGABYTE:.2f} MB"
            raise InputError(self.path, name, size, f"at most {most / MEGABYTE:g} MB, and {SWELLING:g} times the zip")
        if member.header_offset >= self.path.stat().st_size:
            raise InputError(self.path, name, f"at byte {member.header_offset}", "a place in the zip")
        if member.flag_bits & 1 or member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise InputError(self.path, name, "packed in another way", "a deflated table without a password")

    def rows(self, name: str, needed: Sequence[str], containing: Sequence[str] = ()) -> Iterator[tuple[int, Row]]:
        """The rows of a table with their line numbers; only rows that contain one of the texts, if any are given.

        Yields nothing if the feed has no such table. Raises InputError for a missing column.
        """
        if name not in self.members:
            return
        where = f"{self.path}: {name}"
        with refused(where), self.archive.open(self.members[name]) as file:
            numbers: list[int] = []
            needles = tuple(one.replace('"', '""').encode() for one in containing)
            reader = csv.reader(_lines(file, where, needles, numbers))
            header = [one.strip() for one in next(reader, [])]
            for column in needed:
                if column not in header:
                    raise InputError(where, f"column {column}", MISSING, f"the columns {', '.join(needed)}")
            for cells in reader:
                if any(cells):
                    yield numbers[-1], {key: cell.strip() for key, cell in zip_longest(header, cells, fillvalue="")}

    def trip(self, wanted: TripChoice) -> FeedTrip:
        """The requested trip; raises DasError if there is none or the choice is not clear."""
        stops = _Stops({row["stop_id"]: row for _, row in self.rows("stops.txt", ("stop_id",))})
        trip, notes = self._by_id(wanted) if wanted.trip is not None else self._by_stops(wanted, stops)
        whole = self._stops_of(trip["trip_id"], stops)
        made = _cut(self.path, whole, wanted, stops)
        check_ends(self.path, trip["trip_id"], made)
        departs_s = whole[0].departure_s, made[0].departure_s
        run = self._run(trip, departs_s, wanted, self._services_before(wanted.day))
        if run is None:
            raise DasError(self._no_run(trip, made[0].name, departs_s, wanted))
        made = [x._replace(arrival_s=x.arrival_s + run.later_s, departure_s=x.departure_s + run.later_s) for x in made]
        if run.at_intervals:
            taken = f"taken: the one at {file_clock(made[0].departure_s)}"
            notes = (*notes, f"the trip runs at intervals (frequencies.txt); {taken}")
        if run.days_before:
            leaves = f"leaves {made[0].name} at {file_clock(run.leaves_s)}, which is {file_clock(made[0].departure_s)}"
            day = "before" if run.days_before == 1 else f"{run.days_before} days before"
            if wanted.day is not None:
                day = f"{wanted.day - datetime.timedelta(days=run.days_before)}"
            notes = (*notes, f"it {leaves} of the service day {day}")
        route, agency = self._line_of(trip)
        words = [route.get("route_short_name", ""), trip.get("trip_short_name", ""), trip.get("trip_headsign", "")]
        if _is_no_train(route):
            notes = (*notes, f"route_type {route['route_type']} is no railway")
        return FeedTrip(
            feed=self.path,
            id=trip["trip_id"],
            title=" ".join(dict.fromkeys(word for word in words if word)),
            agency=agency.get("agency_name", ""),
            time_zone=agency.get("agency_timezone", ""),
            stops=tuple(made),
            shape_deg=self._shape(trip.get("shape_id", "")),
            notes=(*notes, *self._days(trip)),
        )

    def _by_id(self, wanted: TripChoice) -> tuple[Row, tuple[str, ...]]:
        """The trip with an id; else the one with this number (trip_short_name) if that is clear."""
        assert wanted.trip is not None
        numbered = []
        for _, row in self.rows("trips.txt", ("trip_id",), (wanted.trip,)):
            if row["trip_id"] == wanted.trip:
                return row, ()
            if row.get("trip_short_name") == wanted.trip:
                numbered.append(row)
        days = self._services_before(wanted.day)
        served = next((rows for on in days if (rows := [row for row in numbered if _runs(row, on)])), numbered)
        if len(served) == 1:
            return served[0], (f"trip number {wanted.trip}: trip_id {served[0]['trip_id']}",)
        if not served:
            every = self.rows("trips.txt", ("trip_id",))
            known = [row["trip_id"] for _, (_, row) in zip(range(MOST_NAMED), every, strict=False)]
            raise InputError(self.path, "--trip", wanted.trip, f"a trip_id of trips.txt, like {', '.join(known)} …")
        ids = ", ".join(row["trip_id"] for row in served[:MOST_NAMED])
        expected = f"a trip_id or --date, because {len(served)} trips have this number: {ids}"
        raise InputError(self.path, "--trip", wanted.trip, expected)

    def _by_stops(self, wanted: TripChoice, stops: _Stops) -> tuple[Row, tuple[str, ...]]:
        """The first trip from one stop to another that departs at a time or later."""
        if wanted.from_stop is None or wanted.to_stop is None or wanted.at_s is None:
            raise DasError("give --trip ID, or --from STOP, --to STOP and --at HH:MM")
        starts = stops.named(self.path, "--from", wanted.from_stop)
        ends = stops.named(self.path, "--to", wanted.to_stop)
        at_intervals = {row["trip_id"] for _, row in self.rows("frequencies.txt", ("trip_id",))}
        days = self._services_before(wanted.day)
        found: list[tuple[float, str, Row]] = []
        for row, here_s in self._trains_between(starts, ends):
            first_s = here_s
            if row["trip_id"] in at_intervals:
                first_s = self._stops_of(row["trip_id"], stops)[0].departure_s
            run = self._run(row, (first_s, here_s), wanted, days, at_intervals=row["trip_id"] in at_intervals)
            if run is not None:
                found.append((run.leaves_s, row["trip_id"], row))
        if not found:
            on = "" if wanted.day is None else f" on {wanted.day}"
            trains = f"no train from {wanted.from_stop} to {wanted.to_stop}"
            raise DasError(f"{self.path}: {trains} at {file_clock(wanted.at_s)} or later{on}")
        first_s, trip_id, row = min(found, key=lambda one: one[:2])
        others = [one[1] for one in found if one[0] == first_s and one[1] != trip_id]
        same = f", like {len(others)} others ({', '.join(others[:MOST_NAMED])}); --date chooses" if others else ""
        return row, (f"trip_id {trip_id} leaves {wanted.from_stop} at {file_clock(first_s)}{same}",)

    def _trains_between(self, starts: set[str], ends: set[str]) -> Iterator[tuple[Row, float]]:
        """The trips of trains from some stops to others, with the departure (s) that stop_times.txt gives."""
        departs: dict[str, tuple[int, float]] = {}
        arrives: dict[str, int] = {}
        for number, row in self.rows("stop_times.txt", ("trip_id", "stop_id", "stop_sequence"), (*starts, *ends)):
            trip_id, sequence = row["trip_id"], _sequence(self.path, number, row)
            place = sequence, self._time_s(number, row, "departure_time")
            if row["stop_id"] in starts:
                departs[trip_id] = min(departs.get(trip_id, place), place)
            if row["stop_id"] in ends:
                arrives[trip_id] = max(arrives.get(trip_id, sequence), sequence)
        leaves_s = {trip: at_s for trip, (sequence, at_s) in departs.items() if sequence < arrives.get(trip, -1)}
        buses = {row["route_id"] for _, row in self.rows("routes.txt", ("route_id",)) if _is_no_train(row)}
        for _, row in self.rows("trips.txt", ("trip_id",)):
            if row["trip_id"] in leaves_s and row.get("route_id") not in buses:
                yield row, leaves_s[row["trip_id"]]

    def _stops_of(self, trip_id: str, stops: _Stops) -> list[TripStop]:
        """The stops of a trip in the order of their sequence, which may have gaps and any order in the table."""
        where = f"{self.path}: stop_times.txt"
        found: dict[int, tuple[int, Row]] = {}
        for number, row in self.rows("stop_times.txt", ("trip_id", "stop_id", "stop_sequence"), (trip_id,)):
            if row["trip_id"] != trip_id:
                continue
            sequence = _sequence(self.path, number, row)
            if sequence in found:
                key = f"line {number} stop_sequence"
                raise InputError(where, key, row["stop_sequence"], "each number once in a trip")
            found[sequence] = number, row
            if len(found) > MOST_STOPS:
                break
        if not 2 <= len(found) <= MOST_STOPS:
            raise InputError(where, f"rows of trip {trip_id}", len(found), f"2 to {MOST_STOPS} stops")
        made: list[TripStop] = []
        before_s = -math.inf
        for _, (number, row) in sorted(found.items()):
            arrival_s, departure_s = (self._time_s(number, row, f"{one}_time") for one in ("arrival", "departure"))
            arrival_s = departure_s if math.isnan(arrival_s) else arrival_s
            departure_s = arrival_s if math.isnan(departure_s) else departure_s
            if arrival_s < before_s or departure_s < arrival_s:
                key = f"line {number} arrival_time"
                raise InputError(where, key, row.get("arrival_time"), "times that do not fall")
            before_s = before_s if math.isnan(departure_s) else departure_s
            name, latitude, longitude = stops.place(where, number, row["stop_id"])
            serves = not (row.get("pickup_type") == "1" and row.get("drop_off_type") == "1")
            made.append(TripStop(row["stop_id"], name, latitude, longitude, arrival_s, departure_s, serves))
        return made

    def _time_s(self, number: int, row: Row, key: str, table: str = "stop_times.txt") -> float:
        """A time of the service day (s); NaN for an empty one. Times after midnight are beyond 24:00:00."""
        text = row.get(key, "")
        match = CLOCK.fullmatch(text)
        if match is None and text:
            raise InputError(f"{self.path}: {table}", f"line {number} {key}", text, "a time like 25:10:00")
        return math.nan if match is None else clock_s(match)

    def _run(
        self,
        trip: Row,
        departs_s: tuple[float, float],
        wanted: TripChoice,
        days: Sequence[set[str] | None],
        *,
        at_intervals: bool = True,
    ) -> _Run | None:
        """The first run of a trip that leaves a stop on the wanted day, at the wanted time or later; None if none does.

        `departs_s` are the departures from the first stop and from this one in stop_times.txt. A train after midnight
        belongs to an earlier service day: `days` are the services of the day, of the day before it, and so on. Without
        a wanted time, the first run of the service day is returned.
        """
        first_s, here_s = departs_s
        ways_s = [(here_s, math.inf, math.inf)]
        intervals = self._intervals(trip["trip_id"]) if at_intervals else []
        if intervals:
            ways_s = [(begin + here_s - first_s, end + here_s - first_s, step) for begin, end, step in intervals]
        found: list[_Run] = []
        for before, services in enumerate(days if wanted.at_s is not None else days[:1]):
            at_s = -math.inf if wanted.at_s is None else wanted.at_s + before * DAY_S
            for begin_s, end_s, step_s in ways_s if _runs(trip, services) else ():
                steps = math.ceil((at_s - begin_s) / step_s) if at_s > begin_s else 0
                leaves_s = begin_s + steps * step_s if steps else begin_s
                if at_s <= leaves_s < end_s:
                    found.append(_Run(leaves_s - before * DAY_S, before, leaves_s - here_s, bool(intervals)))
        return min(found, default=None)

    def _no_run(self, trip: Row, stop: str, departs_s: tuple[float, float], wanted: TripChoice) -> str:
        name, on = f"{self.path}: trip {trip['trip_id']}", "" if wanted.day is None else f" on {wanted.day}"
        if not _runs(trip, self._services(wanted.day)):
            known = "; ".join(self._days(trip)) or "no row of calendar.txt has its service_id"
            return f"{name} does not run{on}; it {known}"
        assert wanted.at_s is not None
        first_s, here_s = departs_s
        intervals = self._intervals(trip["trip_id"])
        starts_s = [begin + (math.ceil((end - begin) / step) - 1) * step for begin, end, step in intervals]
        last = f"its last run leaves at {file_clock(max(starts_s, default=first_s) + here_s - first_s)}"
        return f"{name} does not leave {stop} at {file_clock(wanted.at_s)} or later{on}: {last}"

    def _intervals(self, trip_id: str) -> list[tuple[float, float, float]]:
        """Begin, end and interval (s) at the first stop of a trip that runs at intervals; empty for any other trip."""
        found = []
        columns = ("trip_id", "start_time", "end_time", "headway_secs")
        for number, row in self.rows("frequencies.txt", columns, (trip_id,)):
            if row["trip_id"] != trip_id:
                continue
            begin_s, end_s = (self._time_s(number, row, f"{one}_time", "frequencies.txt") for one in ("start", "end"))
            step_s = whole_number(row["headway_secs"])
            if not step_s or math.isnan(begin_s + end_s):
                key = f"line {number} headway_secs"
                raise InputError(f"{self.path}: frequencies.txt", key, row["headway_secs"], "seconds > 0, both times")
            if begin_s < end_s:
                found.append((begin_s, end_s, float(step_s)))
        return found

    def _line_of(self, trip: Row) -> tuple[Row, Row]:
        routes = (row for _, row in self.rows("routes.txt", ("route_id",)) if row["route_id"] == trip.get("route_id"))
        route = next(routes, {})
        agencies = [row for _, row in self.rows("agency.txt", ())]
        own = (row for row in agencies if row.get("agency_id", "") == route.get("agency_id", ""))
        return route, next(own, agencies[0] if agencies else {})

    def _shape(self, shape_id: str) -> NDArray[np.float64]:
        """The points (deg) of a shape in order; empty if there are none or a coordinate is invalid."""
        columns = ("shape_id", "shape_pt_lat", "shape_pt_lon", "shape_pt_sequence")
        points = []
        for number, row in self.rows("shapes.txt", columns, (shape_id,)) if shape_id else ():
            if row["shape_id"] == shape_id:
                order = _sequence(self.path, number, row, "shapes.txt", "shape_pt_sequence")
                latitude, longitude = coordinates(row["shape_pt_lat"], row["shape_pt_lon"])
                points.append((order, latitude, longitude))
        shape = np.array(sorted(points)).reshape(-1, 3)[:, 1:]
        return shape if len(shape) > 1 and not np.isnan(shape).any() else np.empty((0, 2))

    def _services_before(self, day: datetime.date | None) -> list[set[str] | None]:
        """The services that run on a day, on the day before it, and so on, as far back as trains may still run."""
        earlier = (datetime.timedelta(days=before) for before in range(MOST_DAYS))
        return [self._services(None if day is None else day - one) for one in earlier]

    def _services(self, day: datetime.date | None) -> set[str] | None:
        """The services that run on a day, by calendar and exceptions; None if no day is given."""
        if day is None:
            return None
        text, weekday = f"{day:%Y%m%d}", WEEKDAYS[day.weekday()]
        found = {
            row["service_id"]
            for _, row in self.rows("calendar.txt", ("service_id",))
            if row.get(weekday) == "1" and row.get("start_date", "") <= text <= row.get("end_date", "")
        }
        for _, row in self.rows("calendar_dates.txt", ("service_id", "date", "exception_type"), (text,)):
            if row["date"] == text:
                (found.add if row["exception_type"] == "1" else found.discard)(row["service_id"])
        return found

    def _days(self, trip: Row) -> Iterator[str]:
        for _, row in self.rows("calendar.txt", ("service_id",)):
            if row["service_id"] == trip.get("service_id"):
                days = [name[:2].title() for name in WEEKDAYS if row.get(name) == "1"]
                between = f"{row.get('start_date', '')} to {row.get('end_date', '')}"
                yield f"runs {' '.join(days) or 'on single days'}, {between} (calendar.txt)"


class _Stops:
    """The stops of a feed; a platform has the name of its station."""

    def __init__(self, rows: dict[str, Row]) -> None:
        self._rows = rows

    def place(self, where: str, number: int, stop_id: str) -> tuple[str, float, float]:
        """Name and coordinates (deg) of a stop."""
        if stop_id not in self._rows:
            raise InputError(where, f"line {number} stop_id", stop_id, "a stop of stops.txt")
        own = self._rows[stop_id]
        station = self._rows.get(own.get("parent_station", ""), own)
        for row in (own, station):
            latitude, longitude = coordinates(row.get("stop_lat", ""), row.get("stop_lon", ""))
            if not math.isnan(latitude):
                break
        return tidy(station.get("stop_name", "") or own.get("stop_name", "")) or stop_id, latitude, longitude

    def named(self, path: Path, option: str, wanted: str) -> set[str]:
        """The ids of the stops and platforms with a name or id, or else of those whose name begins with it."""
        key = key_of(wanted)
        ids = {x for x, row in self._rows.items() if wanted and wanted in (x, row.get("parent_station"))}
        tests: tuple[Callable[[str], bool], ...] = (lambda name: name == key, lambda name: name.startswith(key))
        for fits in tests if key else ():
            ids = ids or {x for x, row in self._rows.items() if fits(key_of(row.get("stop_name", "")))}
        ids |= {x for x, row in self._rows.items() if row.get("parent_station") in ids}
        if not ids:
            known = sorted({row.get("stop_name", "") for row in self._rows.values()})
            near = [name for name in known if key[:3] in key_of(name)] or known
            raise InputError(path, option, wanted, f"a stop of stops.txt, like {', '.join(near[:MOST_NAMED])}")
        return ids


def _cut(path: Path, stops: list[TripStop], wanted: TripChoice, known: _Stops) -> list[TripStop]:
    """The stops of a trip from one to another, out of all stops of the feed."""
    for option, name, first in (("--from", wanted.from_stop, True), ("--to", wanted.to_stop, False)):
        if name is None:
            continue
        ids = known.named(path, option, name)
        places = [i for i, stop in enumerate(stops) if stop.stop_id in ids]
        if not places:
            raise InputError(path, option, name, f"a stop of the trip: {', '.join(stop.name for stop in stops)}")
        place = places[0 if first else -1]
        stops = stops[place:] if first else stops[: place + 1]
    if len(stops) < 2:
        raise DasError(f"{path}: --to {wanted.to_stop} does not come after --from {wanted.from_stop} in this trip")
    return stops


def check_ends(path: Path, trip_id: str, stops: Sequence[TripStop]) -> None:
    """Raise InputError for an end of a trip, or of a part of one, that has no time."""
    for stop in (stops[0], stops[-1]):
        if math.isnan(stop.departure_s):
            key = f"time of trip {trip_id} at {stop.name}"
            raise InputError(f"{path}: stop_times.txt", key, MISSING, "one: an end")


def _runs(trip: Row, services: set[str] | None) -> bool:
    """Whether a trip is of one of the services that run on a day; True for any trip if no day is wanted (None)."""
    return services is None or trip.get("service_id") in services


def _is_no_train(route: Row) -> bool:
    """Whether a row of routes.txt is the line of a bus, ferry, cable car or aircraft."""
    return whole_number(route.get("route_type", "")) in NO_RAIL


def _sequence(path: Path, number: int, row: Row, table: str = "stop_times.txt", column: str = "stop_sequence") -> int:
    """The place of a row of a table in its trip or shape; InputError for anything but a whole number."""
    found = whole_number(row[column])
    if found is None:
        raise InputError(f"{path}: {table}", f"line {number} {column}", row[column], "a whole number >= 0")
    return found
