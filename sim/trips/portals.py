"""Wi-Fi portals of trains: answers that people recorded, as JSON or CSV, become rows of cells.

`PORTALS` declares the fields and the units of each portal. Sources: microG/GmsCore (moving Wi-Fi), KDE's
kpublictransport (on-board scripts), felix-zenk/onboardapis, liclac/ambient, lightsprint09/ICEOnboardAPI; and the
recorders hija/iceportal-status-logger, MelliTiger/trackbash.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from das.domain.errors import MISSING, InputError

Answer = dict[str, str]
"""The fields of an answer as text, without lists; the name `.status.latitude` is the field latitude of status."""


@dataclass(frozen=True, kw_only=True)
class Portal:
    """A portal: the names of its fields, its unit of speed, and the zone of times that state none (empty: unknown).

    "a.b" is the field b of an object a; "b" is one of any object, or a column. Of several names in a text, the first
    that occurs in a file counts. All fields in one of the texts `marks` show that an answer is this portal's, if it is
    none of a portal before it; a mark that begins with a capital letter is compared as written. `lost` are patterns of
    values that say that the position is not the present one.
    """

    name: str
    marks: tuple[str, ...]
    latitude: str = "latitude"
    longitude: str = "longitude"
    speed: str = "speed"
    speed_unit: str = "speed_kmh"
    time: str = ""
    zone: str
    lost: dict[str, str] = field(default_factory=dict)


PORTALS: Final = (
    Portal(
        name="České dráhy (cdwifi.cz)", zone="Europe/Prague",
        marks=("gpsLat gpsLng",), latitude="gpsLat", longitude="gpsLng",
    ),
    Portal(
        name="Deutsche Bahn (iceportal.de)", zone="Europe/Berlin",
        marks=("latitude serverTime", "latitude gpsStatus", "latitude tzn"),
        time="serverTime", lost={"gpsStatus": r"(?!valid$).*"},
    ),
    Portal(
        name="SJ and others with Icomera (ombord.info)", zone="", speed_unit="speed_mps",
        marks=("latitude speed satellites", "latitude speed cmg", "latitude speed mode"),
        time="time", lost={"satellites": r"0*(\.0*)?", "mode": r"[01](\.0*)?"},
    ),
    Portal(
        name="SNCF (wifi.sncf)", zone="Europe/Paris", speed_unit="speed_mps",
        marks=("latitude speed fix", "latitude speed success", "latitude speed heading",
               "latitude speed altitude timestamp"),
        time="timestamp", lost={"success": r"false|0", "fix": r"false|0(\.0*)?"},
    ),
    Portal(
        name="ÖBB (railnet.oebb.at)", zone="Europe/Vienna",
        marks=("gpsPosition.latitude", "mapInfo.latitude", "Latitude Longitude speed",
               "gps.latitude gps.longitude speed"),
        latitude="gpsPosition.latitude mapInfo.latitude latitude",
        longitude="gpsPosition.longitude mapInfo.longitude longitude",
        speed="latestStatus.speed operationalMessagesInfo.speed speed",
        time="latestStatus.dateTime operationalMessagesInfo.time",
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
"""Punctuation between the parts of a name."""
LOCAL_TIME: Final = re.compile(r"\d{4}-\d\d-\d\d[T ][\d:.,]+")
"""A time without its zone."""
_DECODER: Final = json.JSONDecoder(parse_float=str, parse_int=str, parse_constant=str)
_SHOWN: Final = 6
_DEEPEST: Final = 30


def dotted(name: str) -> str:
    """The name of a field or of a column with a point before each part."""
    return f".{_PARTS.sub('.', name)}"


def names_of(answers: Iterable[Answer]) -> tuple[str, ...]:
    """The names of all fields in answers."""
    return tuple(dict.fromkeys(name for answer in answers for name in answer))


def field_of(names: Sequence[str], wanted: str, beside: str = "") -> str:
    """The field with the first of the wanted names that occurs, without regard to case; empty if there is none.

    Of several such fields it is the one in the object `beside`, else the one in the fewest objects.
    """
    for one in wanted.split():
        fits = [name for name in names if name.casefold().endswith(dotted(one).casefold())]
        if fits:
            return min(fits, key=lambda name: (name.rpartition(".")[0] != beside, name.count(".")))
    return ""


def _shows(names: Sequence[str], mark: str) -> bool:
    """Whether the fields of a mark occur."""
    if mark[0].isupper():
        return {name.rpartition(".")[2] for name in names} >= set(mark.split())
    return all(field_of(names, one) for one in mark.split())


def portal_of(names: Sequence[str]) -> Portal | None:
    """The portal whose answers have these fields; None if none is known."""
    return next((one for one in PORTALS if any(_shows(names, mark) for mark in one.marks)), None)


def json_values(text: str) -> Iterator[tuple[Any, int]]:
    """The objects in a text, and the line in which each begins: JSON lines, an array, JSONP, or one after the other.

    Numbers are left as text. What cannot be read, like the end of a file whose recorder was killed, is one object {}.
    """
    at, line, readable = 0, 1, True
    while (start := next(_BETWEEN.finditer(text, at)).end()) < len(text):
        line += text.count("\n", at, start)
        was_readable = readable
        try:
            value, at = _DECODER.raw_decode(text, start)
            readable = isinstance(value, dict)
        except (ValueError, RecursionError):
            readable = False
        if not readable:
            value, at = {}, text.find("\n", start) % (len(text) + 1)
        if readable or was_readable:
            yield value, line
        line += text.count("\n", start, at)


def flat(value: Any, at: str = "") -> Iterator[tuple[str, str]]:
    """The fields of an object and of the objects in it, without lists."""
    if isinstance(value, dict) and at.count(".") < _DEEPEST:
        for key, one in value.items():
            yield from flat(one, at + dotted(key))
    elif not isinstance(value, dict | list):
        yield at, "" if value is None else str(value).strip()


def portal_rows(path: Path, answers: Sequence[Answer]) -> tuple[Portal, list[list[str]]]:
    """The portal that gave answers, and their cells: latitude, longitude, speed, time.

    Raises InputError if they are of no known portal, or state no time.
    """
    names = names_of(answers)
    portal = portal_of(names)
    if portal is None:
        shown = ",".join(name[1:] for name in names[:_SHOWN]) + "…" * (len(names) > _SHOWN)
        known = "; ".join(f"{one.name}: {one.marks[0].replace(' ', ', ')}" for one in PORTALS)
        raise InputError(path, "the fields", shown, f"answers of a train's Wi-Fi portal ({known})")
    latitude = field_of(names, portal.latitude)
    beside = latitude.rpartition(".")[0]
    time = field_of(names, portal.time, beside) or field_of(names, RECORDED)
    if not time:
        raise InputError(path, portal.name, MISSING, f"a field with the time of each answer: {RECORDED}")
    used = [latitude, *(field_of(names, one, beside) for one in (portal.longitude, portal.speed)), time]
    lost = {field_of(names, one, beside): re.compile(said, re.IGNORECASE) for one, said in portal.lost.items()}
    return portal, [_cells(answer, used, lost) for answer in answers]


def _cells(answer: Answer, used: Iterable[str], lost: dict[str, re.Pattern[str]]) -> list[str]:
    """The cells of an answer, with points as decimal signs; no place if the portal has lost it, or it is 0, 0."""
    latitude, longitude, *others = (re.sub(r"^(-?\d+),(\d+)$", r"\1.\2", answer.get(name, "")) for name in used)
    nowhere = not any(digit in latitude + longitude for digit in "123456789")
    if nowhere or any(answer.get(name) and pattern.fullmatch(answer[name]) for name, pattern in lost.items()):
        latitude = longitude = ""
    return [latitude, longitude, *others]
