"""Line, train and level of a recorded drive, from the files that its recording holds."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.vehicle import Vehicle
from sim.recording.inputs import AttachedFiles
from sim.recording.metadata import NODE_ARGUMENTS


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
        files = AttachedFiles(recording, Path(folder))
        route, _, from_route = files.find("routes", journey.route_id, load_route)
        vehicle, _, from_vehicle = files.find("vehicles", vehicle_id, load_vehicle)
        load = load or journey.load
        vehicle = vehicle.loaded(load) if load else vehicle
        words = node_words(run)
        if "--loss-map" in words:
            if not files.has("loss_map"):
                raise DasError(f"{recording.path}: its node was given a loss map (--loss-map), which is not in it")
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
    """The command line of the recording's node, where its metadata say it; else nothing."""
    try:
        words = json.loads(run.get(NODE_ARGUMENTS, "[]"))
    except ValueError:
        return []
    return [word for word in words if isinstance(word, str)] if isinstance(words, list) else []
