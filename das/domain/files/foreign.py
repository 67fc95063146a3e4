"""Detection of files of other programs by their content; errors name the command that imports such a file."""

from __future__ import annotations

import os
import re
import shlex
import zipfile
import zlib
from pathlib import Path
from typing import Final, NamedTuple

from das.domain.errors import DasError

MOST_BYTES: Final = 1_000_000
"""Number of bytes of a file that are searched."""
UNZIP_ERRORS: Final = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError)
"""Errors that `zipfile` raises for a damaged zip, in addition to `UnicodeDecodeError` for a name that is not UTF-8.
`BadZipFile`: wrong headers or checksums; `zlib.error` and `EOFError`: damaged or missing content; `OSError`: an offset
before the beginning of the file; `RuntimeError`: a zip of a later version or with a password."""
_JOURNEYS: Final = "das-precompute journey import {path} --trip ID -o journey.toml"
ROUTES: Final = "das-precompute route import {path} -o route.toml"
VEHICLES: Final = "das-precompute vehicle import {path} -o vehicle.toml"
TRIPS: Final = "das-sim trip {path} --route ROUTE --vehicle VEHICLE"


class ForeignFormat(NamedTuple):
    """A format of another program: its name with an article, and the command that reads it (empty if there is none)."""

    name: str
    command: str = ""


GPX: Final = ForeignFormat("a GPX track", TRIPS)
GTFS: Final = ForeignFormat("a GTFS feed", _JOURNEYS)
_XML: Final = (
    (r"<gpx\b", GPX),
    (r"<(\w+:)?(SFERA_|JourneyProfile|SegmentProfile|TrainCharacteristics)|SFERA", ForeignFormat("a SFERA message")),
    (r"<(\w+:)?railml\b|railml\.org", ForeignFormat("a railML file")),
    (r"<osm\b", ForeignFormat("OpenStreetMap XML (ask Overpass for [out:json])")),
    (r"<kml\b", ForeignFormat("a KML file")),
)
_JSON: Final = (
    (r'"(effort_curves|rolling_resistance)"\s*:', ForeignFormat("OSRD rolling stock", VEHICLES)),
    (r'"osm3s"|"elements"\s*:\s*\[', ForeignFormat("an Overpass answer", ROUTES)),
    (r'"(track_sections|extended_switch_types|operational_points|switch_type)"', ForeignFormat("railjson of OSRD")),
    (r'"type"\s*:\s*"(FeatureCollection|Feature|(Multi)?LineString)"', ForeignFormat("a GeoJSON file", ROUTES)),
)
_TEXT: Final = (
    (
        r"\A\"?(trip_id|stop_id|route_id|shape_id|service_id)\"?,",
        ForeignFormat("one table of a GTFS feed (import the zip)"),
    ),
    (r"railtoolkit\.org/schema/rolling-stock", ForeignFormat("rolling stock of railtoolkit", VEHICLES)),
    (r"railtoolkit\.org/schema/running-path", ForeignFormat("a running path of railtoolkit", ROUTES)),
    (r"railtoolkit\.org/schema/", ForeignFormat("a railtoolkit file")),
)
_OURS: Final = re.compile(r"^\[(route|vehicle|journey|scenario)\]\s*(?:#.*)?$", re.MULTILINE)


def foreign_format(path: Path) -> ForeignFormat | None:
    """The format of a file if known (of another program or of this one); None for anything else."""
    if not os.path.isfile(path):  # unlike Path.is_file, false for an invalid file name; opening a pipe would block
        return None
    try:
        with path.open("rb") as file:
            head = file.read(MOST_BYTES)
    except (OSError, ValueError):
        return None
    if head.startswith(b"PK\x03\x04"):
        return _zipped(path)
    if head.startswith(b"\x89MCAP"):
        return ForeignFormat("a recording", "das-sim report {path}")
    text = head.decode("utf-8-sig", errors="replace").lstrip()
    known = _XML if text.startswith("<") else _JSON if text.startswith("{") else _TEXT
    found = next((found for pattern, found in known if re.search(pattern, text)), None)
    ours = _OURS.search(text)
    return found if found is not None or ours is None else ForeignFormat(f"a {ours[1]} file of this program")


def _zipped(path: Path) -> ForeignFormat:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (*UNZIP_ERRORS, UnicodeDecodeError):
        names = []
    return GTFS if any(name.endswith("stop_times.txt") for name in names) else ForeignFormat("a zip file")


def refuse_foreign(path: Path, kind: str, reads: str | None = None) -> None:
    """Raise DasError if a file belongs to another program, or is a file of this program of another kind.

    The message names the command that imports it. `reads` is the running command if it imports some formats itself.
    """
    found = foreign_format(path)
    if found is None or (reads and found.command == reads) or found.name == f"a {kind} file of this program":
        return
    expected = f"{path}: is {found.name}, expected a {kind}"
    if found.command:
        raise DasError(f"{expected}; to read it: {found.command.format(path=shlex.quote(str(path)))}")
    raise DasError(expected if found.name.endswith("this program") else f"{expected}; no command imports it")
