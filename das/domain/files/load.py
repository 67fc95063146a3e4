"""Loading of vehicles, routes and journeys by the name of a bundled file or the path of any file."""

from __future__ import annotations

import os
import re
import shlex
import zipfile
import zlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from das.domain.errors import DasError, InputError
from das.domain.files import routes, vehicles
from das.domain.files.reading import read_toml
from das.domain.route import Route
from das.domain.vehicle import Vehicle

if TYPE_CHECKING:
    from das.offline.asked_journey import Journey

MOST_BYTES: Final = 1_000_000
"""Number of bytes at the beginning of a file that are searched for the marks of other formats."""
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


_XML: Final = {
    r"<gpx\b": ForeignFormat("a GPX track", TRIPS),
    r"<(\w+:)?(SFERA_|JourneyProfile|SegmentProfile|TrainCharacteristics)|SFERA": ForeignFormat("a SFERA message"),
    r"<(\w+:)?railml\b|railml\.org": ForeignFormat("a railML file"),
    r"<osm\b": ForeignFormat("OpenStreetMap XML (ask Overpass for [out:json])"),
    r"<kml\b": ForeignFormat("a KML file"),
}
_JSON: Final = {
    r'"(effort_curves|rolling_resistance)"\s*:': ForeignFormat("OSRD rolling stock", VEHICLES),
    r'"osm3s"|"elements"\s*:\s*\[': ForeignFormat("an Overpass answer", ROUTES),
    r'"(track_sections|extended_switch_types|operational_points|switch_type)"': ForeignFormat("railjson of OSRD"),
    r'"type"\s*:\s*"(FeatureCollection|Feature|(Multi)?LineString)"': ForeignFormat("a GeoJSON file", ROUTES),
}
_OF_GTFS: Final = ForeignFormat("one table of a GTFS feed (import the zip)")
_TEXT: Final = {
    r"\A\"?(trip_id|stop_id|route_id|shape_id|service_id)\"?,": _OF_GTFS,
    r"railtoolkit\.org/schema/rolling-stock": ForeignFormat("rolling stock of railtoolkit", VEHICLES),
    r"railtoolkit\.org/schema/running-path": ForeignFormat("a running path of railtoolkit", ROUTES),
    r"railtoolkit\.org/schema/": ForeignFormat("a railtoolkit file"),
}
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
    found = next((found for pattern, found in known.items() if re.search(pattern, text)), None)
    ours = _OURS.search(text)
    return found if found is not None or ours is None else ForeignFormat(f"a {ours[1]} file of this program")


def _zipped(path: Path) -> ForeignFormat:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (*UNZIP_ERRORS, UnicodeDecodeError):
        names = []
    is_feed = any(name.endswith("stop_times.txt") for name in names)
    return ForeignFormat("a GTFS feed", _JOURNEYS) if is_feed else ForeignFormat("a zip file")


def refuse_foreign(path: Path, kind: str, reads: str | None = None) -> None:
    """Raise DasError if a file belongs to another program, or is a file of this program of another kind.

    The message names the command that imports the file. `reads` is the running command if it can import some formats.
    """
    found = foreign_format(path)
    if found is None or (reads and found.command == reads) or found.name == f"a {kind} file of this program":
        return
    expected = f"{path}: is {found.name}, expected a {kind}"
    if found.command:
        raise DasError(f"{expected}; to read it: {found.command.format(path=shlex.quote(str(path)))}")
    raise DasError(expected if found.name.endswith("this program") else f"{expected}; no command imports it")


def bundled_files(package: str, folder: str) -> dict[str, Path]:
    """The bundled TOML files in a folder of a package, by name."""
    return {path.stem: path for path in sorted(Path(str(files(package) / folder)).glob("*.toml"))}


def catalogue(kind: str) -> dict[str, Path]:
    """Bundled files of a kind ("vehicles", "routes" or "journeys") by name."""
    return bundled_files("das.domain", f"catalogue/{kind}")


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """The train with a bundled name ("re460-ic"), or from a TOML file of this project or a JSON train of TTOBench.

    Raises DasError for an unknown name or file, InputError (file, key, value, expectation) for anything unusable in it.

        >>> import das
        >>> das.load_vehicle("re460-ic").max_speed_mps * 3.6
        200.0
    """
    path = locate_vehicle(name_or_path)
    return _ttobench().read_train(path) if path.suffix.lower() == ".json" else vehicles.read_vehicle(path)


def load_route(name_or_path: str | Path) -> Route:
    """The line with a bundled name ("zurich-luzern"), or from a TOML file of this project or a JSON track of TTOBench.

    Raises DasError for an unknown name or file, InputError (file, key, value, expectation) for anything unusable in it.

        >>> import das
        >>> [stop.name for stop in das.load_route("zurich-luzern").stops]
        ['Zürich HB', 'Thalwil', 'Zug', 'Luzern']
    """
    path = locate_route(name_or_path)
    return _ttobench().read_track(path) if path.suffix.lower() == ".json" else routes.read_route(path)


def load_journey(name_or_path: str | Path, route: Route | None) -> Journey:
    """The journey on a route, with a bundled name ("zurich-luzern") or from a file (TOML of this project, or JSON of
    TTOBench).

    Raises DasError for an unknown name or file, InputError (file, key, value, expectation) for anything unusable in it,
    and for a point of the journey that is not on the route. Without a route, every point must have a position.
    """
    from das.offline import asked_journey  # a cab receives its journeys

    path = locate_journey(name_or_path)
    json = path.suffix.lower() == ".json"
    journey = _ttobench().read_journey(path) if json else asked_journey.journey_of(read_toml(path), route)
    if route is not None:
        journey.check_on(route)
    return journey


def _ttobench() -> Any:
    """The reader of TTOBench files, imported only if needed: a cab's own files do not use it."""
    from das.offline import ttobench

    return ttobench


def locate_vehicle(name_or_path: str | Path) -> Path:
    """The file of a vehicle; DasError if there is none."""
    return _locate(name_or_path, "vehicles")


def locate_journey(name_or_path: str | Path) -> Path:
    """The file of a journey; DasError if there is none."""
    return _locate(name_or_path, "journeys")


def locate_route(name_or_path: str | Path) -> Path:
    """The file of a route; DasError if there is none."""
    return _locate(name_or_path, "routes")


def _locate(name_or_path: str | Path, kind: str) -> Path:
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            f"load_{kind[:-1]}", "name_or_path", name_or_path, f"the name of a bundled {kind[:-1]}, or a path"
        )
    return locate(name_or_path, kind[:-1], catalogue(kind), (".toml", ".json"))


def locate(
    name_or_path: str | Path, kind: str, bundled: Mapping[str, Path], suffixes: tuple[str, ...] = (".toml",)
) -> Path:
    """The file with a bundled name, or at a path; a DasError that names the kind of file if there is none."""
    if isinstance(name_or_path, str) and name_or_path in bundled:
        return bundled[name_or_path]
    path = Path(name_or_path)
    refuse_foreign(path, kind)
    if path.suffix.lower() not in suffixes:
        names, expected = ", ".join(bundled), " or ".join(suffixes)
        raise DasError(f"{name_or_path}: not a bundled {kind} ({names}) and not a {expected} file")
    if os.path.isdir(path):  # unlike Path.is_dir, false for an invalid file name
        raise DasError(f"{name_or_path}: is a folder, expected a file")
    if not os.path.exists(path):
        raise DasError(f"{name_or_path}: no such file")
    if not os.path.isfile(path):
        raise DasError(f"{name_or_path}: not a regular file")
    return path
