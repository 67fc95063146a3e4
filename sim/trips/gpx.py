"""Records as GPX 1.0 or 1.1: the track points with their times, and speeds (m/s) where the file has them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from das.domain.errors import MISSING, DasError, InputError
from sim.trips import moments
from sim.trips.record import Record
from sim.trips.rows import not_negative, number


def read_gpx(path: Path) -> Record:
    """Read the track points of all segments in the order of the file; `number` is the line each begins at.

    A speed is the element of that name in a point or its extensions. Raises DasError or InputError (file, line, value);
    a file that declares entities is refused: they can grow without bound and reach other files.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    points = _Points(path)
    try:
        points.parser.Parse(content, True)
    except (expat.ExpatError, LookupError) as error:  # the latter: an unknown encoding
        raise DasError(f"{path}: not usable XML ({error})") from error
    if len(points.found) < 2:
        raise DasError(f"{path}: GPX with {len(points.found)} track points, expected at least 2")
    line, time_ns, latitude, longitude, speed = zip(*points.found, strict=True)
    return Record.of(
        str(path),
        np.array(line),
        np.array(time_ns, dtype=np.int64),
        latitude_deg=np.array(latitude),
        longitude_deg=np.array(longitude),
        speed_mps=np.array(speed),
    )


@dataclass
class _Points:
    """Takes track points from the parser's events: (line, time_ns, latitude, longitude, speed)."""

    path: Path
    found: list[tuple[int, int, float, float, float]] = field(default_factory=list)
    _line: int = 0
    _attributes: dict[str, str] | None = None
    """What is known of the track point that is being read."""
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
        self._open = name if name not in self._texts else ""  # the point's own comes before that of an extension

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
        if not texts.get("time"):
            raise InputError(self.path, f"line {self._line} time", MISSING, "a time for every track point")
        time_ns = moments.from_iso(self.path, f"line {self._line} time", texts["time"])
        speed = np.nan
        if texts.get("speed"):
            speed = not_negative(self.path, self._line, number(self.path, self._line, "speed", texts["speed"]))
        latitude = self._number("latitude", attributes.get("lat"), 90.0)
        longitude = self._number("longitude", attributes.get("lon"), 180.0)
        self.found.append((self._line, time_ns, latitude, longitude, speed))

    def _number(self, name: str, text: str | None, largest: float) -> float:
        if text is None:
            raise InputError(self.path, f"line {self._line} {name}", MISSING, "a number")
        value = number(self.path, self._line, name, text)
        if abs(value) > largest:
            raise InputError(self.path, f"line {self._line} {name}", value, f"-{largest:g} to {largest:g} deg")
        return value

    def _refuse_entity(self, name: str, *_: object) -> None:
        line = self.parser.CurrentLineNumber
        raise DasError(f"{self.path}: line {line} declares the entity {name!r}, expected a GPX file without entities")
