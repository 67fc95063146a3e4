"""The files a run is made from, and their hashes."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path

from das.domain.files.load import locate_route, locate_vehicle


def sha256(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal text."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def input_files(route: str, vehicle: str) -> dict[str, Path]:
    """The files of a route and a vehicle, by what they are; DasError where there is none."""
    files = {"route": locate_route(route), "vehicle": locate_vehicle(vehicle)}
    loss_map = _loss_map_of(files["vehicle"])
    return files if loss_map is None else {**files, "loss_map": loss_map}


def _loss_map_of(vehicle: Path) -> Path | None:
    """The loss map (CSV) a vehicle file refers to."""
    if vehicle.suffix.lower() != ".toml":
        return None
    levels = tomllib.loads(vehicle.read_text(encoding="utf-8")).get("losses", {})
    paths = [vehicle.parent / level["path"] for level in levels.values() if isinstance(level, dict) and "path" in level]
    return paths[0] if paths else None
