"""The opening of recordings for all commands, the metadata on their origin, and the files attached to them.

Damaged parts are left out with a warning. If a recording holds several trains, the user must name one. Line, train and
loss level of a recorded drive come from the attached files, which are read from a folder.

A recording is data: files that are attached to it are read, files that it only names are not opened. Bundled files are
ours and may be opened if the recording names them.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Final, TypeVar

from mcap import records

from das.bus import topics
from das.bus.recording import Contents, Recording, read_contents, recording_of
from das.command_line.printing import warn
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_route, load_vehicle, locate_route, locate_vehicle
from das.domain.files.reading import read_toml
from das.domain.files.vehicles import read_loss_map
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.vehicle import Vehicle

NODE_ARGUMENTS: Final = "node_arguments"
"""Key of the arguments with which the node was started (JSON list)."""
WHAT_IF: Final = "what_if"
"""Key of the kind of a what-if (`sim.options.WhatIfKind`)."""
OF, OF_SHA256, CHANGED = "what_if_of", "what_if_of_sha256", "what_if_changed"
"""Keys of a what-if: the recording that it starts from, that file's hash, and the changes in words."""
NOTHING: Final = "nothing"
"""Text for a run without disturbances, and for a what-if without changes."""
_warned: set[str] = set()
"""Warnings that the process has printed."""


def open_recording(path: Path, train: str | None = None) -> Recording:
    """Read a recording without its damaged parts; each fault is reported in a line on standard error.

    `train` names the train of a recording that holds several. Raises DasError if the file cannot be used, or if it
    holds several trains and none is named.
    """
    return recording_of(open_contents(path), train)


def open_contents(path: Path) -> Contents:
    """The contents of a file, of all trains, without its damaged parts; warns as `open_recording` does."""
    contents = read_contents(path)
    for text in contents.health.warnings():
        line = f"{path}: {text}"
        if line not in _warned:
            _warned.add(line)
            warn(line)
    return contents


def notes_path(recording: Path) -> Path:
    """The file of the notes on a recording, next to it; a pattern for drives, like `run*.mcap`, does not match it."""
    return recording.with_name(f"{recording.stem}.notes")


def is_session(recording: Recording) -> bool:
    """Whether a node was active, so that its messages must be there."""
    return any(recording.of(topic) for topic in (topics.ADVICE, topics.STATUS, topics.CONTROL))


def versions(recording: Recording) -> dict[str, str]:
    """The versions of the programs that took part, by their roles."""
    nodes = sorted({one.message.version for one in recording.of(topics.STATUS) if one.message.version})
    found = {"node" if len(nodes) == 1 else f"node {i}": version for i, version in enumerate(nodes, 1)}
    run = recording.metadata.get("run", {})
    who = "recorder" if run.get("kind") == "session" else "simulator"
    return {**({who: run["version"]} if "version" in run else {}), **found}


def sha256(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal text; DasError if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error


def input_files(route: str, vehicle: str) -> dict[str, Path]:
    """The files of a route and a vehicle by their kinds; raises DasError if one is missing."""
    return {"route": locate_route(route), **vehicle_files(vehicle)}


def vehicle_files(vehicle: str) -> dict[str, Path]:
    """The files of a vehicle by their kinds; raises DasError if one is missing."""
    file = locate_vehicle(vehicle)
    loss_maps = [file.parent / name for _, name in _named_in(file, LOSS_MAPS)]
    curves = {f"effort_curve_{i}": file.parent / name for i, (_, name) in enumerate(_named_in(file, CURVES), 1)}
    return {"vehicle": file, **({LOSS_MAP: loss_maps[0]} if loss_maps else {}), **curves}


DEEP: Final = PurePosixPath("a/b/c/d")
"""Folders above the files, so that a loss map in a folder above its vehicle file is still in the private folder."""
LOSS_MAP: Final = "loss_map"
LOSS_MAPS, CURVES = "path", "curve"
"""Keys under which a vehicle file names its loss map and the CSV files of its effort curves."""
HASH: Final = "_sha256"
"""Ending of the metadata keys that hold the hash of an input file."""

_Input = TypeVar("_Input", Route, Vehicle)


class AttachedFiles:
    """The attached files of a recording by the kinds in its metadata; each is written when it is requested."""

    def __init__(self, recording: Contents | Recording, folder: Path) -> None:
        """`folder` is private: the files are put there under their bare names, each in its own folder."""
        files = recording.attachments if isinstance(recording, Contents) else recording.attached
        self._path = recording.path
        self._run = recording.metadata.get("run", {})
        self._attached = {hashlib.sha256(one.data).hexdigest(): one for one in files}
        self._folder = folder

    def has(self, kind: str) -> bool:
        """Whether a kind of file is attached: "route", "vehicle", "loss_map", "scenario", "true_vehicle" …"""
        return self.sha256(kind) in self._attached

    def sha256(self, kind: str) -> str:
        """The hash of a kind of file in the metadata; empty if they do not name such a file."""
        return self._run.get(f"{kind}{HASH}", "")

    def others(self, but: Collection[str] = ()) -> list[records.Attachment]:
        """All attached files except those with the hashes `but` (SHA-256), in the order of the recording."""
        return [one for hashed, one in self._attached.items() if hashed not in but]

    def place(self, kind: str) -> Path:
        """Write a kind of file now, and return its path; DasError if it cannot be written."""
        return self._put(self.sha256(kind))

    def place_vehicle(self, kind: str = "vehicle", loss_map: str = LOSS_MAP) -> Path:
        """Write a vehicle file now, with its loss map at the path that it names, and return the vehicle file's path.

        Raises DasError if a file cannot be written, or if the named path is outside the private folder.
        """
        return self._put(self.sha256(kind), loss_map)

    def find(self, kind: str, identity: str, load: Callable[[Path], _Input]) -> tuple[_Input, str, str]:
        """The route or vehicle (`kind`: "routes", "vehicles") that has an id, with its name or path and its origin in
        words.

        It is read from the attached file with that id, else from the bundled file. Raises DasError if there is neither.
        """
        bundled, tried = catalogue(kind).get(identity), []
        for hashed, one in self._attached.items():
            if PurePosixPath(one.name).suffix.lower() not in (".toml", ".json"):
                continue
            if bundled is not None and hashed == sha256(bundled):
                break  # the bundled file is read instead: its loss map is at the path that it names
            try:
                path = self._put(hashed, LOSS_MAP)
                found = load(path)
            except DasError as error:
                tried.append(str(error))
                continue
            if found.id == identity:
                return found, str(path), "from the recording"
        if bundled is not None:
            return load(bundled), identity, "bundled"
        why = f" ({tried[-1]})" if tried else ""
        raise DasError(f"{self._path}: its {kind[:-1]} {identity!r} is neither attached nor bundled{why}")

    def _put(self, hashed: str, loss_map: str = "") -> Path:
        """Write an attached file and, at the paths that it names, the attached loss maps and effort curves."""
        one, root = self._attached[hashed], self._folder / hashed
        path = put(root / DEEP / Path(one.name).name, one.data)
        for key, name in _named_in(path, LOSS_MAPS, CURVES):
            target = (path.parent / name).resolve()
            if not target.is_relative_to(root.resolve()):
                raise DasError(f"{self._path}: its {path.name} names {name}, expected a file in the recording")
            brought = self._attached.get(self.sha256(loss_map)) if key == LOSS_MAPS else None
            named = (other for other in self._attached.values() if Path(other.name).name == target.name)
            brought = brought or next(named, None)
            if brought is not None:
                put(target, brought.data)
        return path


ELSEWHERE: Final = ("trip", "what_if_of", "driver")
"""Kinds of files that the metadata name by their hash, but that are not attached to a recording."""


def missing_files(recording: Recording) -> list[str]:
    """The kinds, as in the metadata, of the run's input files that are not attached; files are compared by hash."""
    brought = {hashlib.sha256(one.data).hexdigest() for one in recording.attached}
    named = {
        key[: -len(HASH)]: hashed for key, hashed in recording.metadata.get("run", {}).items() if key.endswith(HASH)
    }
    return [kind for kind, hashed in named.items() if kind not in ELSEWHERE and hashed not in brought]


def put(path: Path, content: bytes) -> Path:
    """Write a file and the folders above it; DasError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise DasError(f"attached file {path.name!r}: cannot be written ({error})") from None
    return path


def _named_in(path: Path, *keys: str) -> list[tuple[str, str]]:
    return list(_paths_in(read_toml(path).data, keys)) if path.suffix.lower() == ".toml" else []


def _paths_in(table: Mapping[str, Any], keys: Collection[str]) -> Iterator[tuple[str, str]]:
    for key, value in table.items():
        if key in keys and isinstance(value, str):
            yield key, value
        elif isinstance(value, Mapping):
            yield from _paths_in(value, keys)


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveInputs:
    """Line as driven, train as planned and loss level of a drive, and their origin (`source`)."""

    route: Route
    vehicle: Vehicle
    level: Level
    source: str


def inputs_of(recording: Recording) -> DriveInputs:
    """Line, train and loss level with which a recorded drive was planned; DasError if the recording lacks them."""
    journeys = [entry.message for entry in recording.of(topics.JOURNEY)]
    if not journeys:
        raise DasError(f"{recording.path}: holds no journey: line and train are not known")
    journey, run = journeys[-1], recording.metadata.get("run", {})
    vehicle_id, _, load = journey.vehicle_id.partition("/")
    with tempfile.TemporaryDirectory(prefix="das-inputs-") as folder:
        files = AttachedFiles(recording, Path(folder))
        route, _, from_route = files.find("routes", journey.route_id, load_route)
        vehicle, _, from_vehicle = files.find("vehicles", vehicle_id, load_vehicle)
        load = load or journey.load
        vehicle = vehicle.loaded(load) if load else vehicle
        words = node_words(run)
        if "--loss-map" in words:
            if not files.has("loss_map"):
                raise DasError(f"{recording.path}: its node was given a loss map (--loss-map), which is not attached")
            vehicle = vehicle.with_loss_map(read_loss_map(files.place("loss_map")))
    if "--point-mass" in words:
        vehicle = replace(vehicle, train_length_m=0.0)
    level = run.get("level") or journey.level or str(vehicle.default_level)
    if level not in list(Level):
        raise DasError(f"{recording.path}: level {level!r}: expected one of {', '.join(Level)}")
    return DriveInputs(
        route=route.reversed() if journey.reversed else route,
        vehicle=vehicle,
        level=Level(level),
        source=f"route {from_route}, vehicle {from_vehicle}",
    )


def node_words(run: Mapping[str, str]) -> list[str]:
    """The arguments of the recording's node; empty if the metadata do not give them."""
    try:
        words = json.loads(run.get(NODE_ARGUMENTS, "[]"))
    except ValueError:
        return []
    return [word for word in words if isinstance(word, str)] if isinstance(words, list) else []
