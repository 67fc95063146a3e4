"""Wi-Fi portals of trains: answers that people recorded, as JSON or CSV, become rows of cells.

`PORTALS` declares the fields and the units of each portal. Sources: microG/GmsCore (moving Wi-Fi), KDE's
kpublictransport (on-board scripts), felix-zenk/onboardapis, liclac/ambient, lightsprint09/ICEOnboardAPI; and the
recorders hija/iceportal-status-logger, MelliTiger/trackbash, maehw/oebb-train-localizer-speedometer.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING, InputError

Name = tuple[str, ...]
"""The name of a field in parts: ("status", "latitude") is the field latitude of the object status."""
Answer = dict[Name, str]
"""The fields of an answer as text, without lists."""


@dataclass(frozen=True, kw_only=True)
class Portal:
    """A portal: the names of its fields, its unit of speed, and the time zone of times that state none (None: unknown).

    "a.b" is the field b of an object a; "b" is one of any object, or a column. Of several names in a text, the first
    that occurs in a file counts. All fields in one of the texts `marks` (or `weak_marks`, if there are no marks of any
    portal) show that an answer is this portal's; a name that begins with a capital letter is compared as written, "!"
    means absent. `lost` are patterns of values that say that the position is not the present one. `without_header` are
    the columns of a recorder that writes no header.
    """

    name: str
    marks: tuple[str, ...]
    weak_marks: tuple[str, ...] = ()
    latitude: str = "latitude"
    longitude: str = "longitude"
    speed: str = "speed"
    speed_unit: str = "speed_kmh"
    time: str = ""
    zone: str | None
    lost: dict[str, str] = field(default_factory=dict)
    without_header: str = ""


PORTALS: Final = (
    Portal(
        name="České dráhy (cdwifi.cz)", zone="Europe/Prague",
        marks=("gpsLat gpsLng",), latitude="gpsLat", longitude="gpsLng",
    ),
    Portal(
        name="Deutsche Bahn (iceportal.de)", zone="Europe/Berlin",
        marks=("latitude serverTime", "latitude gpsStatus", "latitude tzn"),
        time="serverTime", lost={"gpsStatus": r"(?!valid$).*"},
        without_header="serverTime latitude longitude speed",
    ),
    Portal(
        name="ÖBB (railnet.oebb.at)", zone="Europe/Vienna",
        marks=("gpsPosition.latitude", "mapInfo.latitude", "latitude velocity", "Latitude Longitude !Speed"),
        latitude="gpsPosition.latitude mapInfo.latitude latitude",
        longitude="gpsPosition.longitude mapInfo.longitude longitude",
        weak_marks=("gps.latitude gps.longitude speed !altitude",),
        speed="latestStatus.speed operationalMessagesInfo.speed velocity speed",
        time="latestStatus.dateTime operationalMessagesInfo.time",
        without_header="datetime velocity latitude longitude",
    ),
    Portal(  # The sources disagree on the unit of the speed in this answer, so it is not used.
        name="ÖBB (railnet.oebb.at/api/gps)", zone="Europe/Vienna",
        marks=("JSON.lat JSON.lon",), latitude="JSON.lat", longitude="JSON.lon", speed="",
    ),
    Portal(
        name="SJ and others with Icomera (ombord.info)", zone=None, speed_unit="speed_mps",
        marks=("latitude speed satellites", "latitude speed cmg", "latitude speed mode"),
        weak_marks=("latitude speed altitude time !timestamp",),
        time="time", lost={"satellites": r"0*(\.0*)?", "mode": r"[01](\.0*)?"},
    ),
    Portal(
        name="SNCF (wifi.sncf)", zone="Europe/Paris", speed_unit="speed_mps",
        marks=("latitude speed fix", "latitude speed success", "latitude speed heading"),
        weak_marks=("latitude speed altitude timestamp",),
        time="timestamp", lost={"success": r"false|0", "fix": r"false|0(\.0*)?"},
    ),
)  # fmt: skip
RECORDED: Final = (
    "time timestamp datetime t ts utc epoch recorded_at recordedAt received_at receivedAt fetched_at created_at"
)
"""Names under which recorders write the time of an answer; the portal's own time is preferred."""
LEAST_MS: Final = 1e11
"""Least time (since 1970) that is in ms, not in s: in the year 1973; in s it would be in the year 5138."""
JSON_START: Final = re.compile(rb"[\xef\xbb\xbf\s]*([\w$.]*\s*\(\s*)?[{\[]")
"""Beginning of a file of JSON, or of JSONP: "callback({"."""
_BETWEEN: Final = re.compile(r"[\s,\[\]();]*(?:[A-Za-z_$][\w.$]*\s*\(\s*)?")
"""Punctuation between two answers: that of JSON lines, of an array and of JSONP."""
_PARTS: Final = re.compile(r"[._/ ]+")
_DAY: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]")
LOCAL_TIME: Final = re.compile(_DAY.pattern + r"[\d:.,]+")
"""A time without its zone."""
_DECODER: Final = json.JSONDecoder(parse_float=str, parse_int=str, parse_constant=str)
_SHOWN: Final = 6
_DEEPEST: Final = 30


def names_of(answers: Iterable[Answer]) -> tuple[Name, ...]:
    """The names of all fields in answers."""
    return tuple(dict.fromkeys(name for answer in answers for name in answer))


def field_of(names: Sequence[Name], wanted: str, beside: Name = ()) -> Name | None:
    """The field with the first of the wanted names that occurs, without regard to case; None if there is none.

    Of several such fields it is the one in the object `beside`, else the one in the fewest objects.
    """
    for one in wanted.split():
        parts = _PARTS.split(one.casefold())
        fits = [name for name in names if [part.casefold() for part in name[-len(parts) :]] == parts]
        if fits:
            return min(fits, key=lambda name: (name[:-1] != beside, len(name)))
    return None


def _occurs(names: Sequence[Name], one: str) -> bool:
    """Whether a field of a mark occurs, or for "!" does not."""
    if one.startswith("!"):
        return not _occurs(names, one[1:])
    return any(".".join(name).endswith(one) for name in names) if one[0].isupper() else field_of(names, one) is not None


def portal_of(names: Sequence[Name]) -> Portal | None:
    """The portal whose answers have these fields; None if none is known."""
    ranked = [(mark, one) for one in PORTALS for mark in one.marks]
    ranked += [(mark, one) for one in PORTALS for mark in one.weak_marks]
    return next((one for mark, one in ranked if all(_occurs(names, field) for field in mark.split())), None)


def json_values(text: str) -> Iterator[tuple[Any, int]]:
    """The objects in a text, and the line in which each begins: JSON lines, an array, JSONP, or one after the other.

    Numbers are left as text. What cannot be read, like the end of a file whose recorder was killed, is one object {}.
    """
    at, line, readable = 0, 1, True
    while True:
        between = _BETWEEN.match(text, at)
        start = at if between is None else between.end()
        line += text.count("\n", at, start)
        if start == len(text):
            return
        value = None
        if text[start] == "{":
            try:
                value, at = _DECODER.raw_decode(text, start)
            except (ValueError, RecursionError):
                value = None
        if value is None:
            at = text.find("\n", start) % (len(text) + 1)
        if readable or value is not None:
            yield value or {}, line
        line += text.count("\n", start, at)
        readable = value is not None


def flat(value: Any, at: Name = ()) -> Iterator[tuple[Name, str]]:
    """The fields of an object and of the objects in it, without lists."""
    if isinstance(value, dict) and len(at) < _DEEPEST:
        for key, one in value.items():
            yield from flat(one, (*at, *_PARTS.split(key)))
    elif not isinstance(value, dict | list):
        yield at, "" if value is None else str(value).strip()


def csv_answers(titles: Sequence[str], rows: Sequence[Sequence[str]], first: int) -> list[tuple[Answer, int]]:
    """The answers in the rows of a table from line `first` on, and their lines, without blank ones.

    A row that was cut lacks its last fields; one with too many is empty.
    """
    names, kept = (
        [tuple(_PARTS.split(title)) for title in titles],
        [(row, line) for line, row in enumerate(rows, first) if any(row)],
    )
    return [(dict(zip(names, row, strict=False)) if len(row) <= len(names) else {}, line) for row, line in kept]


def without_header(cells: Sequence[str]) -> list[str]:
    """The columns of a file without a header, by its first cell, a time; empty if no portal's recorder fits."""
    is_ms = cells[0].isdecimal() and float(cells[0]) >= LEAST_MS
    for columns in (one.without_header.split() for one in PORTALS):
        if len(columns) == len(cells) and (is_ms if columns[0] == "serverTime" else _DAY.match(cells[0])):
            return columns
    return []


def portal_rows(path: Path, answers: Sequence[Answer]) -> tuple[Portal, list[list[str]]]:
    """The portal that gave answers, and their cells: latitude, longitude, speed, time.

    Raises InputError if they are of no known portal, or state no time.
    """
    names = names_of(answers)
    portal = portal_of(names)
    if portal is None:
        shown = ",".join(".".join(name) for name in names[:_SHOWN]) + "…" * (len(names) > _SHOWN)
        known = "; ".join(f"{one.name}: {one.marks[0].replace(' ', ', ')}" for one in PORTALS)
        raise InputError(path, "the fields", shown, f"answers of a train's Wi-Fi portal ({known})")
    latitude = field_of(names, portal.latitude) or ()
    beside = latitude[:-1]
    time = field_of(names, portal.time, beside) or field_of(names, RECORDED)
    if time is None:
        raise InputError(path, portal.name, MISSING, f"a field with the time of each answer: {RECORDED}")
    used = [latitude, *(field_of(names, one, beside) for one in (portal.longitude, portal.speed)), time]
    lost = {field_of(names, one, beside): re.compile(said, re.IGNORECASE) for one, said in portal.lost.items()}
    return portal, [_cells(answer, used, lost) for answer in answers]


def _cells(answer: Answer, used: list[Name | None], lost: dict[Name | None, re.Pattern[str]]) -> list[str]:
    """The cells of an answer, with points as decimal signs; no place if the portal has lost it, or it is 0, 0."""
    cells = ["" if name is None else answer.get(name, "") for name in used]
    latitude, longitude, *others = [re.sub(r"^(-?\d+),(\d+)$", r"\1.\2", cell) for cell in cells]
    said = [(pattern, answer.get(name, "")) for name, pattern in lost.items() if name is not None]
    nowhere = not any(digit in latitude + longitude for digit in "123456789")
    if nowhere or any(value and pattern.fullmatch(value) for pattern, value in said):
        latitude = longitude = ""
    return [latitude, longitude, *others]
