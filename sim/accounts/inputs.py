"""Line, train and level of a recorded drive, from the files that its recording holds."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from das.bus import topics
from das.bus.recording import Recording, extract_attachments
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_route, load_vehicle
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.levels import Level
from das.domain.losses import LossMap
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from sim.processes.crew import NODE_ARGUMENTS
from sim.recording.inputs import sha256

_Input = TypeVar("_Input", Route, Vehicle)


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveInputs:
    """The line as driven, the train as planned, the level of its losses, and where the three come from."""

    route: Route
    vehicle: Vehicle
    level: Level
    source: str


def inputs_of(recording: Recording) -> DriveInputs:
    """What a recorded drive was planned with; DasError where the recording does not say or holds it."""
    journeys = [entry.message for entry in recording.of(topics.JOURNEY)]
    if not journeys:
        raise DasError(f"{recording.path}: holds no journey, so that nobody knows its line and train")
    journey, run = journeys[-1], recording.metadata.get("run", {})
    vehicle_id, _, load = journey.vehicle_id.partition("/")
    with tempfile.TemporaryDirectory(prefix="das-inputs-") as folder:
        attached = extract_attachments(recording.path, Path(folder))
        route, from_route = _found(recording, "routes", journey.route_id, attached, load_route)
        vehicle, from_vehicle = _found(recording, "vehicles", vehicle_id, attached, load_vehicle)
        load = load or journey.load
        vehicle = vehicle.loaded(load) if load else vehicle
        words = node_words(run)
        if "--loss-map" in words:
            vehicle = vehicle.with_loss_map(_loss_map(recording, attached))
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
    """The command line of the recording's node, where its metadata say it; else nothing."""
    try:
        words = json.loads(run.get(NODE_ARGUMENTS, "[]"))
    except ValueError:
        return []
    return [word for word in words if isinstance(word, str)] if isinstance(words, list) else []


def _loss_map(recording: Recording, attached: list[Path]) -> LossMap:
    """The losses that the node was given beside the vehicle; DasError where the recording does not bring them."""
    wanted = recording.metadata["run"].get("loss_map_sha256", "")
    for path in attached:
        if sha256(path) == wanted:
            return read_loss_map(path)
    raise DasError(f"{recording.path}: its node was given a loss map (--loss-map), which is not in it")


def _found(
    recording: Recording, kind: str, identity: str, attached: list[Path], load: Callable[[Path], _Input]
) -> tuple[_Input, str]:
    """The input of an identity: the file that the recording holds, else the bundled one; and which it is."""
    bundled = catalogue(kind).get(identity)
    tried: list[str] = []
    for path in attached:
        if path.suffix.lower() not in (".toml", ".json"):
            continue
        if bundled is not None and sha256(path) == sha256(bundled):
            break  # the bundled file has its loss map where the file says
        try:
            found = load(path)
        except DasError as error:
            tried.append(str(error))
            continue
        if found.id == identity:
            return found, "from the recording"
    if bundled is not None:
        return load(bundled), "bundled"
    why = f" ({tried[-1]})" if tried else ""
    raise DasError(f"{recording.path}: its {kind[:-1]} {identity!r} is neither in it nor bundled{why}")
