"""Vehicles, routes and journeys by bundled name or by file."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from das.domain.errors import DasError
from das.domain.files import journey_toml, native, ttobench
from das.domain.journey import Journey
from das.domain.route import Route
from das.domain.vehicle import Vehicle


def catalogue(kind: str) -> dict[str, Path]:
    """Bundled files of a kind ("vehicles", "routes" or "journeys") by name."""
    folder = Path(str(files("das.domain") / "catalogue" / kind))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_vehicle(name_or_path: str) -> Vehicle:
    """A bundled vehicle, a native TOML file or a TTOBench JSON train; raises DasError for anything unusable."""
    path = locate_vehicle(name_or_path)
    return ttobench.read_train(path) if path.suffix.lower() == ".json" else native.read_vehicle(path)


def load_route(name_or_path: str) -> Route:
    """A bundled route, a native TOML file or a TTOBench JSON track; raises DasError for anything unusable."""
    path = locate_route(name_or_path)
    return ttobench.read_track(path) if path.suffix.lower() == ".json" else native.read_route(path)


def load_journey(name_or_path: str, route: Route) -> Journey:
    """A bundled journey, a native TOML file or a TTOBench JSON journey, on a route.

    Raises DasError for anything unusable, and where a point of the journey is not on the route.
    """
    path = _locate(name_or_path, "journeys")
    json = path.suffix.lower() == ".json"
    journey = ttobench.read_journey(path) if json else journey_toml.read_journey(path, route)
    journey.check_on(route)
    return journey


def locate_vehicle(name_or_path: str) -> Path:
    """The file of a vehicle; DasError where there is none."""
    return _locate(name_or_path, "vehicles")


def locate_route(name_or_path: str) -> Path:
    """The file of a route; DasError where there is none."""
    return _locate(name_or_path, "routes")


def _locate(name_or_path: str, kind: str) -> Path:
    bundled = catalogue(kind)
    if name_or_path in bundled:
        return bundled[name_or_path]
    path = Path(name_or_path)
    if path.suffix.lower() not in (".toml", ".json"):
        names = ", ".join(bundled)
        raise DasError(f"{name_or_path}: not a bundled {kind[:-1]} ({names}) and not a .toml or .json file")
    if not path.is_file():
        raise DasError(f"{name_or_path}: no such file")
    return path
