"""Line, train and level of a recorded drive, from the files that its recording holds."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from das.bus import topics
from das.bus.recording import Recording, extract_attachments
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_route, load_vehicle
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.vehicle import Vehicle
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
    level = run.get("level") or journey.level or str(vehicle.default_level)
    if level not in list(Level):
        raise DasError(f"{recording.path}: level {level!r}: expected one of {', '.join(Level)}")
    return DriveInputs(
        route=route.reversed() if journey.reversed else route,
        vehicle=vehicle,
        level=Level(level),
        source=f"route {from_route}, vehicle {from_vehicle}",
    )


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
