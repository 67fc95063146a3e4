"""The record of a trip, and reading it from its file: CSV, GPX, answers of a Wi-Fi portal, or a recording of das-sim.

Text files become rows of cells under the names of `COLUMNS`, whatever their format; the cells are read in one place.
Times are whole ns since 1970, without the rounding of a double.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime, timedelta, tzinfo
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypeVar
from xml.parsers import expat
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from das.bus.recording import Recording
from das.bus.sealing import MAGIC
from das.bus.topics import DELAY, JOURNEY, LOCATION, POSITION
from das.domain.errors import DasError, InputError
from das.domain.files.load import TRIPS, refuse_foreign
from das.domain.files.reading import read_text
from das.domain.route import Floats
from das.domain.units import KM, KMH, MS, NS
from das.estimate.estimate import Quality
from sim.recording.opening import open_recording
from sim.trips import portals

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Read = TypeVar("Read")
Columns = dict[str, tuple[int, str]]
"""Index and name of the column of each quantity in a table."""
Zone = tzinfo | None
"""Time zone of times that state none; None if it is not known."""

LATITUDE_NAMES = ("latitude", "latitude_deg", "lat")
LONGITUDE_NAMES = ("longitude", "longitude_deg", "lon", "lng")
"""Possible names of a column of latitudes or of longitudes."""
COLUMNS: Final = {
    "latitude": dict.fromkeys(LATITUDE_NAMES, 1.0),
    "longitude": dict.fromkeys(LONGITUDE_NAMES, 1.0),
    "position": {"position_m": 1.0, "position_km": KM},
    "speed": {"speed_kmh": KMH, "speed_mps": 1.0},
    "speed_from_positions": {"speed_from_positions": 1.0},
    "time": {"time_ms": 0.0, "time_s": 0.0, "time": 0.0, "timestamp": 0.0},
}
"""Quantities, possible names of their columns, and factors to SI (times are read digit by digit instead)."""
WITHOUT_HEADER = ("latitude_deg", "longitude_deg", "speed_kmh", "time_ms")
"""Columns of a CSV file without a header."""
GPX_COLUMNS = ("latitude", "longitude", "speed_mps", "time")
PER_UNIT_NS = {"time_ms": round(MS / NS), "time_s": round(1 / NS)}
"""Nanoseconds in the unit of each column of times that are numbers; the others are ISO 8601."""
ANY_TIME = "any_time"
"""Unit of times that are numbers in s or in ms (see `portals.LEAST_MS`), or ISO 8601."""
LARGEST_DEG = {"latitude": 90.0, "longitude": 180.0}
LATEST_NS = round(9e9 / NS)
"""The latest time (ns since 1970, year 2255) that fits in integer nanoseconds."""
NO_VALUE = frozenset(("", "-", "n/a", "na", "nan", "none", "null"))
"""Texts of a cell, in small letters, for an unknown value."""
NO_SPEED = -1.0
"""Speed that iOS writes if the speed is unknown."""
ROUNDING = 1e-6
"""Distance from 0 (in its file's unit) at which a negative speed comes from rounding."""
BACKWARD_NOISE_MPS = 0.3
"""Magnitude (m/s) up to which a negative recorded speed counts as noise of the sensor at a standstill."""
_BEFORE_XML = b"\xef\xbb\xbf\xff\xfe \t\r\n"
_SHOWN_NAMES = 6
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NS_PER_MICROSECOND = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """The points of a trip in the order of its file; arrays of shape (points,), NaN if unknown.

    `number` is the number of a point's `place` (line, position) in its file. Positions are either on the map or on the
    route; on the route, `position_m` counts as in the route's file, or in the direction driven if `as_driven`. In a
    recording of ours, a point may be `degraded` (its speed was not measured) or `invalid` (nothing was measured).
    `untimed` points have no usable time; `time_ns` then is that of a neighbour. `unread` are the names of columns that
    were not used. `zone` is the time zone by which times without one were read, if there were any; empty: UTC.
    """

    source: str
    place: str = "line"
    number: Ints
    time_ns: Ints
    latitude_deg: Floats
    longitude_deg: Floats
    position_m: Floats
    speed_mps: Floats
    uncertainty_m: Floats
    degraded: Bools
    invalid: Bools
    as_driven: bool = False
    untimed: Bools
    unread: tuple[str, ...] = ()
    zone: str = ""

    def __post_init__(self) -> None:
        for name in self._arrays():
            getattr(self, name).setflags(write=False)

    @classmethod
    def of(cls, source: str, number: Ints, time_ns: Ints, **known: Any) -> Self:
        """Make a record from the known columns; values of the others are NaN or False."""
        count = len(time_ns)
        for name in ("latitude_deg", "longitude_deg", "position_m", "speed_mps", "uncertainty_m"):
            known.setdefault(name, np.full(count, np.nan))
        for name in ("degraded", "invalid", "untimed"):
            known.setdefault(name, np.zeros(count, dtype=bool))
        return cls(source=source, number=number, time_ns=time_ns, **known)

    @property
    def on_route(self) -> bool:
        """Whether the record has positions on the route, so that no line is needed."""
        return bool(np.isfinite(self.position_m).any())

    def __len__(self) -> int:
        return len(self.time_ns)

    def elapsed_s(self) -> Floats:
        """Time since the first point (s)."""
        return np.asarray((self.time_ns - self.time_ns[0]) * NS, dtype=np.float64)

    def take(self, which: Any) -> Self:
        """Some of the record's points, by mask, slice or indices."""
        return replace(self, **{name: getattr(self, name)[which].copy() for name in self._arrays()})

    def driven(self, reverse: bool, route_length_m: float) -> Self:
        """The record with positions in the direction of travel."""
        if self.as_driven or not reverse:
            return replace(self, as_driven=True)
        return replace(self, position_m=route_length_m - self.position_m, as_driven=True)

    def where(self, point: int) -> str:
        """The place of a point in its file: "line 3"."""
        return f"{self.place} {self.number[point]}"

    def _arrays(self) -> list[str]:
        return [f.name for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """A record, the format of its file and, for an MCAP recording, its journey and its delays.

    `delays` are pairs of a time (ns) and a delay (s). `recording` is None for a record of another format.
    """

    record: Record
    format: str
    journey: Any | None = None
    delays: tuple[tuple[int, float], ...] = ()
    recording: Recording | None = None

    @property
    def ends(self) -> tuple[str, str] | None:
        """The first and the last stop of the journey; None for a GPS record, or without a journey of two stops."""
        stops = [] if self.journey is None else self.journey.stops
        return (stops[0].name, stops[-1].name) if len(stops) > 1 else None


def read_trip(path: Path, train: str | None = None) -> Reading:
    """Read a trip's file; its format is recognised by its first bytes (MCAP and GPX also by their suffix).

    `train` names the train if a recording holds several. Damaged parts of a recording are left out with a warning.
    Raises DasError or InputError (file, line, value, expectation) for anything unusable.
    """
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    suffix = path.suffix.lower()
    if head.startswith(MAGIC) or suffix == ".mcap":
        return reading_of(open_recording(path, train))
    if train is not None:
        raise DasError(f"--of-train {train}: {path} is no recording (.mcap), and holds one trip")
    refuse_foreign(path, "trip", reads=TRIPS)
    if head.lstrip(_BEFORE_XML).startswith(b"<") or suffix == ".gpx":
        return Reading(record=read_gpx(path), format="GPX")
    if portals.JSON_START.match(head):
        return _of_portal(path, portals.json_values(read_text(path)))
    return _read_csv(path)


def reading_of(recording: Recording) -> Reading:
    """The record of a recording: positions are on the route as driven; journey and delays give the timetable.

    Raises DasError or InputError for positions that cannot be used.
    """
    path = recording.path
    data = recording.columns(POSITION, "time_ns", "s_m", "speed_mps", "quality", "uncertainty_m")
    time_ns = data["time_ns"]
    if len(time_ns) < 2:
        raise DasError(f"{path}: the recording has {len(time_ns)} positions, expected at least 2")
    invalid = data["quality"] == Quality.INVALID
    wrong = ~np.isfinite(data["s_m"]) & ~invalid
    _refuse(path, "s_m", data["s_m"], wrong, "a finite number")
    backward = (data["speed_mps"] < -BACKWARD_NOISE_MPS) & ~invalid
    _refuse(path, "speed_mps", data["speed_mps"], backward, "a speed >= 0")
    unmeasured = invalid | backward | ~np.isfinite(data["speed_mps"])
    latitude, longitude = _locations(recording, time_ns)
    delays = recording.columns(DELAY, "time_ns", "delay_s")
    journeys = recording.of(JOURNEY)
    return Reading(
        record=Record.of(
            str(path),
            np.arange(len(time_ns)),
            time_ns,
            place="position",
            latitude_deg=latitude,
            longitude_deg=longitude,
            position_m=np.where(invalid | wrong, np.nan, data["s_m"]),
            speed_mps=np.maximum(np.where(unmeasured, np.nan, data["speed_mps"]), 0.0),
            uncertainty_m=data["uncertainty_m"],
            degraded=data["quality"] == Quality.DEGRADED,
            invalid=invalid,
            as_driven=True,
        ),
        format="MCAP",
        journey=journeys[0].message if journeys else None,
        delays=tuple(zip(delays["time_ns"].tolist(), delays["delay_s"].tolist(), strict=True)),
        recording=recording,
    )


def _refuse(path: Path, name: str, values: Floats, bad: Any, expected: str) -> None:
    """Raise InputError for the first bad value if at least half of them are bad."""
    if bad.any() and 2 * np.count_nonzero(bad) >= len(bad):
        i = int(bad.argmax())
        raise InputError(path, f"position[{i}].{name}", float(values[i]), expected)


def _locations(recording: Recording, time_ns: Any) -> tuple[Floats, Floats]:
    """Latitude and longitude at the times of the positions; NaN where the recording has none."""
    fixes = [
        (m.message.timestamp.ToNanoseconds(), m.message.latitude, m.message.longitude) for m in recording.of(LOCATION)
    ]
    if not fixes:
        return np.full(len(time_ns), np.nan), np.full(len(time_ns), np.nan)
    t, latitude, longitude = (np.array(column) for column in zip(*sorted(fixes), strict=True))
    return np.interp(time_ns, t, latitude), np.interp(time_ns, t, longitude)


def _read_csv(path: Path) -> Reading:
    """Read a CSV file with columns of this project or of a portal; an empty cell is an unknown value.

    Raises DasError or InputError (file, line, value, expectation).
    """
    table = CellTable.read(path, "trip", WITHOUT_HEADER)
    try:
        columns = _columns(path, table.names)
    except InputError:
        titles = table.titles
        if portals.portal_of([portals.dotted(title) for title in titles]) is None:
            raise
        # A row that was cut lacks its last fields; one with too many says nothing.
        kept = [(row if len(row) <= len(titles) else (), line) for line, row in enumerate(table.rows, 2) if any(row)]
        return _of_portal(path, [(dict(zip(titles, row, strict=False)), line) for row, line in kept])
    rows = table.body()
    used = {index for index, _ in columns.values()}
    unread = tuple(name for i, name in enumerate(table.names) if i not in used)
    record = replace(_record(path, columns, rows, np.arange(len(rows)) + table.first), unread=unread)
    return Reading(record=record, format="CSV")


def _of_portal(path: Path, values: Iterable[tuple[Any, int]]) -> Reading:
    """The record in the answers of a Wi-Fi portal, with their lines; raises InputError if no known portal gave them."""
    given = [(dict(portals.flat(value)), line) for value, line in values]
    portal, rows = portals.portal_rows(path, [answer for answer, _ in given])
    if len(rows) < 2:
        raise DasError(f"{path}: {len(rows)} answer of a Wi-Fi portal, expected at least 2")
    names = {"latitude": "latitude", "longitude": "longitude", "speed": portal.speed_unit, "time": ANY_TIME}
    columns = {quantity: (i, name) for i, (quantity, name) in enumerate(names.items())}
    zone = ZoneInfo(portal.zone) if portal.zone else None
    record = _record(path, columns, rows, np.array([line for _, line in given]), zone=zone)
    local = portal.zone if any(portals.LOCAL_TIME.fullmatch(row[-1]) for row in rows) else ""
    return Reading(record=replace(record, zone=local), format=f"Wi-Fi portal of {portal.name}")


def _record(
    path: Path, columns: Columns, rows: list[list[str]], number: Ints, *, located: bool = False, zone: Zone = UTC
) -> Record:
    """The record in rows of cells, with row i at line `number[i]`; `located` rows must have a place."""

    def cells(quantity: str, read: Callable[[str, str], Read], *, needed: bool) -> list[Read | None]:
        index, _ = columns[quantity]
        return usable(
            [row[index] for row in rows], lambda i, cell: read(f"line {number[i]} {quantity}", cell), needed=needed
        )

    def values(quantity: str) -> Floats:
        if quantity not in columns:
            return np.full(len(rows), np.nan)
        found = cells(
            quantity, lambda key, cell: _value(path, key, quantity, cell), needed=located and quantity in LARGEST_DEG
        )
        return known(found) * COLUMNS[quantity][columns[quantity][1]]

    latitude, longitude, position, speed, derived = (values(quantity) for quantity in COLUMNS if quantity != "time")
    wrong = ~np.isin(derived, (0, 1)) & ~np.isnan(derived)
    check_column(path, "speed_from_positions", derived, wrong, "0 or 1", int(number[0]))
    clock = columns["time"][1]
    times = cells("time", lambda key, cell: read_time(path, key, cell, clock, zone), needed=True)
    time_ns, untimed = _with_neighbours(times)
    return Record.of(
        str(path), number, time_ns, untimed=untimed, latitude_deg=latitude, longitude_deg=longitude,
        position_m=position, speed_mps=speed, degraded=derived == 1,
    )  # fmt: skip


def _columns(path: Path, names: tuple[str, ...]) -> Columns:
    """Index and name of the column of each quantity in the file; raises InputError if time or place is missing."""
    found: Columns = {}
    for index, name in enumerate(names):
        for quantity, accepted in COLUMNS.items():
            if name in accepted and quantity in found:
                raise InputError(path, "line 1", name, f"only one column of {quantity}, like {found[quantity][1]}")
            if name in accepted:
                found[quantity] = (index, name)
    unknown = [name for name in names if not any(name in accepted for accepted in COLUMNS.values())]
    for quantity in ("time", "speed"):
        unclear = [name for name in unknown if quantity not in found and name.startswith(quantity)]
        if unclear:
            raise InputError(path, "line 1", unclear[0], f"{quantity} as {' or '.join(COLUMNS[quantity])}")
    if "time" not in found or not ("position" in found or {"latitude", "longitude"} <= found.keys()):
        shown = ",".join(names[:_SHOWN_NAMES]) + ("…" if len(names) > _SHOWN_NAMES else "")
        expected = f"columns of time ({', '.join(COLUMNS['time'])}) and latitude_deg, longitude_deg or position_m"
        raise InputError(path, "line 1", shown, expected)
    return found


def _value(path: Path, key: str, quantity: str, cell: str) -> float:
    """A value in the unit of its column; raises InputError for an invalid text or number."""
    value, largest = number(path, key, cell), LARGEST_DEG.get(quantity)
    if largest is not None and abs(value) > largest:
        raise InputError(path, key, value, f"-{largest:g} to {largest:g} deg")
    if quantity != "speed":
        return value
    if value == NO_SPEED:
        return math.nan
    if value < -ROUNDING:
        raise InputError(path, key, value, "a speed >= 0")
    return max(value, 0.0)


def _with_neighbours(time_ns: list[int | None]) -> tuple[Ints, Bools]:
    """Times, with unknown ones replaced by the time of the point before (or the first known), and a mask of them."""
    last = next(one for one in time_ns if one is not None)
    filled = [last := one if one is not None else last for one in time_ns]
    return np.array(filled, dtype=np.int64), np.array([one is None for one in time_ns])


def read_time(path: Path, key: str, text: str, column: str, zone: Zone = UTC) -> int:
    """A time (ns since 1970): a number in the unit of its column, or ISO 8601; a time that names no zone is of `zone`.

    Raises InputError (file, key, value) for any other text, and for a time without a zone if that is not known or if
    the clocks were changed at that time.
    """
    if column == ANY_TIME and is_number(text):
        column = "time_ms" if float(text.replace(",", ".")) >= portals.LEAST_MS else "time_s"
    per_unit_ns = PER_UNIT_NS.get(column)
    if per_unit_ns is None:
        expected = "an ISO 8601 time like 2026-11-21T08:04:00Z"
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise InputError(path, key, text, expected) from None
        if moment.tzinfo is None:
            known = [] if zone is None else [moment.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1)]
            if len(set(known)) != 1:
                raise InputError(path, key, text, f"{expected} with its time zone, which is not certain here")
            moment = moment.replace(tzinfo=zone)
        ns = (moment - _EPOCH) // timedelta(microseconds=1) * _NS_PER_MICROSECOND
        if not 0 <= ns <= LATEST_NS:
            raise InputError(path, key, text, f"{expected}, 1970 to 2255")
        return ns
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise InputError(path, key, text, "a number") from None
    if not value.is_finite():
        raise InputError(path, key, text, "a finite number")
    # Guard against a huge exponent like 1e999999999 becoming an integer.
    if not 0 <= value <= LATEST_NS or not 0 <= value * per_unit_ns <= LATEST_NS:
        raise InputError(path, key, text, f"an epoch time in {column.rpartition('_')[2]}")
    return round(value * per_unit_ns)


def read_gpx(path: Path) -> Record:
    """Read the track points of all segments of a GPX file in their order; `number` is the line at which each begins.

    A speed is the element of that name in a point or its extensions. Raises DasError or InputError (file, line, value).
    A file that declares entities is rejected: they can grow without bound and reach other files.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    points = _TrackPoints(path)
    try:
        points.parser.Parse(content, True)
    except (expat.ExpatError, LookupError) as error:  # LookupError: an unknown encoding
        raise DasError(f"{path}: not usable XML ({error})") from error
    if len(points.rows) < 2:
        raise DasError(f"{path}: GPX with {len(points.rows)} track points, expected at least 2")
    return _record(path, _columns(path, GPX_COLUMNS), points.rows, np.array(points.lines), located=True)


@dataclass
class _TrackPoints:
    """Collects track points from the events of the XML parser: the line of each, and its cells (`GPX_COLUMNS`)."""

    path: Path
    lines: list[int] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    _line: int = 0
    _texts: dict[str, str] | None = None
    """Texts of the track point that is being read."""
    _open: str = ""

    def __post_init__(self) -> None:
        self.parser = expat.ParserCreate(namespace_separator=" ")
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.EntityDeclHandler = self._refuse_entity
        self._root = True

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(" ")[2]
        if self._root and name != "gpx":
            raise DasError(f"{self.path}: XML of {name!r}, expected GPX")
        self._root = False
        if name == "trkpt":
            self._line = self.parser.CurrentLineNumber
            self._texts = {"latitude": attributes.get("lat", ""), "longitude": attributes.get("lon", "")}
        # the point's own value wins over an extension's
        self._open = name if self._texts is not None and name not in self._texts else ""

    def _text(self, text: str) -> None:
        if self._texts is not None and self._open in ("time", "speed"):
            self._texts[self._open] = self._texts.get(self._open, "") + text

    def _end(self, tag: str) -> None:
        self._open = ""
        if tag.rpartition(" ")[2] == "trkpt" and self._texts is not None:
            self.lines.append(self._line)
            self.rows.append([self._texts.get(one, "").strip() for one in ("latitude", "longitude", "speed", "time")])
            self._texts = None

    def _refuse_entity(self, name: str, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise DasError(f"{self.path}: line {line} declares the entity {name!r}, expected a GPX file without entities")


class CellTable(NamedTuple):
    """A CSV file: its content, columns in small letters, rows, line of the first row, separator, columns as written."""

    path: Path
    what: str
    names: tuple[str, ...]
    rows: list[list[str]]
    first: int
    separator: str
    titles: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path, what: str, names: tuple[str, ...]) -> CellTable:
        """Read a file with or without a header; `names` are the columns of a file without one.

        Cells are separated by semicolons or tabs if line 1 has one, else by commas. Raises DasError for a missing or
        empty file, or one with a line break inside quotes.
        """
        lines = read_text(path).rstrip().splitlines()
        if not lines:
            raise DasError(f"{path}: empty {what}, expected a header, or lines of {', '.join(names)}")
        separator = next((mark for mark in ";\t" if mark in lines[0]), ",")
        try:
            rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True))
        except csv.Error as error:
            raise DasError(f"{path}: not a usable CSV file ({error})") from error
        if len(rows) != len(lines):
            raise DasError(f"{path}: a quoted cell spans several lines, expected one line per row")
        rows = [[cell.strip() for cell in row] for row in rows]
        if any(is_number(cell) for cell in rows[0]):
            return cls(path, what, names, rows, 1, separator)
        titles = tuple(rows[0])
        return cls(path, what, tuple(cell.casefold() for cell in titles), rows[1:], 2, separator, titles)

    def body(self) -> list[list[str]]:
        """The rows with points as decimal signs; if cells are not separated by commas, a comma is a decimal sign.

        Raises DasError for fewer than two rows, and InputError for a row with another number of columns.
        """
        count, width = len(self.rows), f"{len(self.names)} columns: {', '.join(self.names)}"
        if count < 2:
            lines = f"{count} line{'s' * (not count)}"
            raise DasError(f"{self.path}: {self.what} of {lines}, expected at least 2 lines of points")
        for line, cells in enumerate(self.rows, self.first):
            if len(cells) != len(self.names):
                raise InputError(self.path, f"line {line}", self.separator.join(cells), width)
        return self.rows if self.separator == "," else [[cell.replace(",", ".") for cell in row] for row in self.rows]


def number(path: Path, key: str, cell: str) -> float:
    """Read a cell as a finite number; raises InputError for anything else."""
    try:
        value = float(cell)
    except ValueError:
        raise InputError(path, key, cell, "a number") from None
    if not np.isfinite(value):
        raise InputError(path, key, cell, "a finite number")
    return value


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a point or a comma as the decimal sign."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def usable(cells: Sequence[str], read: Callable[[int, str], Read], *, needed: bool = False) -> list[Read | None]:
    """The values of a column's cells; None for a cell without a value, or with one that `read` rejects.

    `read` is given the index and the text of a cell. Raises the first InputError if at least half of the stated cells
    are rejected: then the column holds something else. If a value is `needed`, an empty cell is rejected as well.
    """
    found: list[Read | None] = []
    refused, stated = [], 0
    for i, cell in enumerate(cells):
        value = None
        if needed or cell.casefold() not in NO_VALUE:
            stated += 1
            try:
                value = read(i, cell)
            except InputError as error:
                refused.append(error)
        found.append(value)
    if refused and 2 * len(refused) >= stated:
        raise refused[0]
    return found


def known(values: Sequence[float | None]) -> Floats:
    """Values as an array; NaN for None."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def check_column(path: Path, name: str, values: Floats, bad: NDArray[np.bool_], expected: str, first: int = 1) -> None:
    """Raise InputError for the first row that is marked in `bad`; row 0 is line `first`."""
    if bad.any():
        i = int(bad.argmax())
        raise InputError(path, f"line {i + first} {name}", float(values[i]), expected)
