"""The files that a run is made from, and their hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from das.domain.files.load import locate_route, locate_vehicle
from das.domain.files.reading import read_toml


def sha256(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal text."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def input_files(route: str, vehicle: str) -> dict[str, Path]:
    """The files of a route and a vehicle, by what they are; raises DasError if one is missing."""
    return {"route": locate_route(route), **vehicle_files(vehicle)}


def vehicle_files(vehicle: str) -> dict[str, Path]:
    """The files of a vehicle, by what they are; raises DasError if one is missing."""
    file = locate_vehicle(vehicle)
    loss_map = _loss_map_of(file)
    return {"vehicle": file} if loss_map is None else {"vehicle": file, "loss_map": loss_map}


def _loss_map_of(vehicle: Path) -> Path | None:
    """The loss map (CSV) a vehicle file refers to."""
    if vehicle.suffix.lower() != ".toml":
        return None
    losses = read_toml(vehicle).data.get("losses")
    levels = losses.values() if isinstance(losses, Mapping) else ()
    paths = (level.get("path") for level in levels if isinstance(level, Mapping))
    return next((vehicle.parent / path for path in paths if isinstance(path, str)), None)
