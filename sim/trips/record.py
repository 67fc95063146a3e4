"""The record of a trip, and reading it from its file: a GPS record as CSV or GPX, or a recording of das-sim."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from das.bus.recording import Recording
from das.bus.sealing import MAGIC
from das.bus.topics import DELAY, JOURNEY, LOCATION, POSITION
from das.domain.errors import DasError, InputError
from das.domain.files.load import TRIPS, refuse_foreign
from das.domain.route import Floats
from das.domain.units import KM, KMH, NS
from das.estimate.estimate import Quality
from sim.recording.opening import open_recording
from sim.trips.cells import (
    LATITUDE_NAMES,
    LONGITUDE_NAMES,
    CellTable,
    check_column,
    degrees,
    known,
    not_negative,
    number,
    time_from_iso,
    time_from_number,
    usable,
)

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_BEFORE_XML = b"\xef\xbb\xbf\xff\xfe \t\r\n"
BACKWARD_NOISE_MPS = 0.3
"""Speed below 0 (m/s) up to which a recorded one is taken for noise of the sensor at a standstill."""
WITHOUT_HEADER = ("latitude_deg", "longitude_deg", "speed_kmh", "time_ms")
COLUMNS = {
    "latitude": dict.fromkeys(LATITUDE_NAMES, 1.0),
    "longitude": dict.fromkeys(LONGITUDE_NAMES, 1.0),
    "position": {"position_m": 1.0, "position_km": KM},
    "speed": {"speed_kmh": KMH, "speed_mps": 1.0},
    "speed_from_positions": {"speed_from_positions": 1.0},
    "time": {"time_ms": 0.0, "time_s": 0.0, "time": 0.0, "timestamp": 0.0},
}
"""Quantities, the names that their columns may have, and factors to SI (times are read digit by digit instead)."""
ISO_TIMES = ("time", "timestamp")
"""Columns of times in ISO 8601; the others are numbers."""
LARGEST_DEG = {"latitude": 90.0, "longitude": 180.0}
_SHOWN_NAMES = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """The points of a trip as its file gives them, in the order of the file; arrays of shape (points,), NaN if unknown.

    `number` is the number of a point's `place` (line, position) in its file. Positions are either on the map or on the
    route; on the route, `position_m` counts as in the route's file, or in the direction driven if `as_driven`. In a
    recording of ours, a point may be `degraded` (its speed was not measured) or `invalid` (nothing was measured).
    `untimed` points have no usable time; `time_ns` then is that of a neighbour. `unread` are the names of columns that
    were not used.
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

    def __post_init__(self) -> None:
        for name in self._arrays():
            getattr(self, name).setflags(write=False)

    @classmethod
    def of(cls, source: str, number: Ints, time_ns: Ints, **known: Any) -> Self:
        """Make a record from the columns that are known; values of the others are NaN or False."""
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
        """The same record with positions in the direction driven."""
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
    return Reading(record=read_csv(path), format="CSV")


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


@dataclass(frozen=True)
class _Column:
    """The column of a quantity: its index, its name, and the factor to SI."""

    index: int
    name: str
    factor: float


def read_csv(path: Path) -> Record:
    """Read a record from a CSV file; an empty cell is an unknown value.

    Raises DasError or InputError (file, line, value, expectation).
    """
    table = CellTable.read(path, "trip", WITHOUT_HEADER)
    names, first = table.names, table.first
    columns, body = _columns(path, names), table.body()
    latitude, longitude, position, speed, derived = (
        _values(path, quantity, columns.get(quantity), body, first) for quantity in COLUMNS if quantity != "time"
    )
    check_column(path, "speed_from_positions", derived, ~np.isin(derived, (0, 1)) & ~np.isnan(derived), "0 or 1", first)
    time_ns, untimed = _times(path, columns["time"], body, first)
    used = {column.index for column in columns.values()}
    return Record.of(
        str(path),
        np.arange(len(body)) + first,
        time_ns,
        untimed=untimed,
        latitude_deg=latitude,
        longitude_deg=longitude,
        position_m=position,
        speed_mps=speed,
        degraded=derived == 1,
        unread=tuple(name for i, name in enumerate(names) if i not in used),
    )


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, _Column]:
    """The column of each quantity that the file has; raises InputError if time or place is missing."""
    found: dict[str, _Column] = {}
    for index, name in enumerate(names):
        for quantity, accepted in COLUMNS.items():
            if name not in accepted:
                continue
            if quantity in found:
                raise InputError(
                    path, "line 1", name, f"one column of {quantity} only, there is {found[quantity].name}"
                )
            found[quantity] = _Column(index, name, accepted[name])
    unknown = [name for name in names if not any(name in accepted for accepted in COLUMNS.values())]
    for quantity in ("time", "speed"):
        unclear = [name for name in unknown if quantity not in found and name.startswith(quantity)]
        if unclear:
            raise InputError(path, "line 1", unclear[0], f"{quantity} as {' or '.join(COLUMNS[quantity])}")
    located = "position" in found or {"latitude", "longitude"} <= found.keys()
    if "time" not in found or not located:
        shown = ",".join(names[:_SHOWN_NAMES]) + ("…" if len(names) > _SHOWN_NAMES else "")
        expected = f"columns of time ({', '.join(COLUMNS['time'])}) and latitude_deg, longitude_deg or position_m"
        raise InputError(path, "line 1", shown, expected)
    return found


def _values(path: Path, quantity: str, column: _Column | None, rows: list[list[str]], first: int) -> Floats:
    """The values of a column in SI; NaN where its cell has none, or everywhere if there is no such column."""
    if column is None:
        return np.full(len(rows), np.nan)
    cells = [row[column.index] for row in rows]
    return known(usable(cells, lambda i, cell: _value(path, i + first, quantity, cell))) * column.factor


def _value(path: Path, line: int, quantity: str, cell: str) -> float:
    """A value in the unit of its column; raises InputError for a text or a number that it cannot be."""
    if quantity in LARGEST_DEG:
        return degrees(path, line, quantity, cell, LARGEST_DEG[quantity])
    value = number(path, line, quantity, cell)
    return not_negative(path, line, value) if quantity == "speed" else value


def _times(path: Path, column: _Column, rows: list[list[str]], first: int) -> tuple[Ints, Bools]:
    def read(i: int, cell: str) -> int:
        key = f"line {i + first} time"
        if column.name in ISO_TIMES:
            return time_from_iso(path, key, cell)
        return time_from_number(path, key, cell, column.name)

    return _with_neighbours(usable([row[column.index] for row in rows], read, needed=True))


def _with_neighbours(time_ns: list[int | None]) -> tuple[Ints, Bools]:
    """Times, each unknown one that of the point before (or of the first with a time), and which are unknown."""
    last = next(one for one in time_ns if one is not None)
    filled = [last := one if one is not None else last for one in time_ns]
    return np.array(filled, dtype=np.int64), np.array([one is None for one in time_ns])


def read_gpx(path: Path) -> Record:
    """Read the track points of all segments of a GPX file in their order; `number` is the line at which each begins.

    A speed is the element of that name in a point or its extensions. Raises DasError or InputError (file, line, value).
    A file that declares entities is refused: they can grow without bound and reach other files.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    points = _TrackPoints(path)
    try:
        points.parser.Parse(content, True)
    except (expat.ExpatError, LookupError) as error:  # the latter: an unknown encoding
        raise DasError(f"{path}: not usable XML ({error})") from error
    if len(points.found) < 2:
        raise DasError(f"{path}: GPX with {len(points.found)} track points, expected at least 2")
    lines = [line for line, _ in points.found]

    def column(quantity: str) -> Floats:
        cells = [texts.get(quantity, "") for _, texts in points.found]
        needed = quantity in LARGEST_DEG
        return known(usable(cells, lambda i, cell: _value(path, lines[i], quantity, cell), needed=needed))

    times = [texts.get("time", "") for _, texts in points.found]
    read = usable(times, lambda i, cell: time_from_iso(path, f"line {lines[i]} time", cell), needed=True)
    time_ns, untimed = _with_neighbours(read)
    return Record.of(
        str(path),
        np.array(lines),
        time_ns,
        untimed=untimed,
        latitude_deg=column("latitude"),
        longitude_deg=column("longitude"),
        speed_mps=column("speed"),
    )


@dataclass
class _TrackPoints:
    """Collects track points from the events of the XML parser: the line of each, and its texts by quantity."""

    path: Path
    found: list[tuple[int, dict[str, str]]] = field(default_factory=list)
    _line: int = 0
    _attributes: dict[str, str] | None = None
    """XML attributes of the track point that is being read."""
    _texts: dict[str, str] = field(default_factory=dict)
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
            self._line, self._attributes, self._texts = self.parser.CurrentLineNumber, attributes, {}
        self._open = name if name not in self._texts else ""  # the point's own value wins over an extension's

    def _text(self, text: str) -> None:
        if self._attributes is not None and self._open in ("time", "speed"):
            self._texts[self._open] = self._texts.get(self._open, "") + text

    def _end(self, tag: str) -> None:
        self._open = ""
        if tag.rpartition(" ")[2] == "trkpt" and self._attributes is not None:
            self._take(self._attributes)
            self._attributes = None

    def _take(self, attributes: dict[str, str]) -> None:
        texts = {name: text.strip() for name, text in self._texts.items()}
        places = {"latitude": attributes.get("lat", ""), "longitude": attributes.get("lon", "")}
        self.found.append((self._line, {**texts, **places}))

    def _refuse_entity(self, name: str, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise DasError(f"{self.path}: line {line} declares the entity {name!r}, expected a GPX file without entities")
