"""Vehicles, routes and journeys are loaded by the name of a bundled file, or by the path of any file."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from das.domain.errors import DasError, InputError
from das.domain.files import journey_toml, native, ttobench
from das.domain.journey import Journey
from das.domain.route import Route
from das.domain.vehicle import Vehicle


def catalogue(kind: str) -> dict[str, Path]:
    """Bundled files of a kind ("vehicles", "routes" or "journeys") by name."""
    folder = Path(str(files("das.domain") / "catalogue" / kind))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """The train of a bundled name ("re460-ic"), a TOML file of ours or a JSON train of TTOBench.

    Raises DasError for a name or file that there is not, InputError (file, key, value, what was expected) for anything
    unusable in it.

        >>> import das
        >>> das.load_vehicle("re460-ic").max_speed_mps * 3.6
        200.0
    """
    path = locate_vehicle(name_or_path)
    return ttobench.read_train(path) if path.suffix.lower() == ".json" else native.read_vehicle(path)


def load_route(name_or_path: str | Path) -> Route:
    """The line of a bundled name ("zurich-luzern"), a TOML file of ours or a JSON track of TTOBench.

    Raises DasError for a name or file that there is not, InputError (file, key, value, what was expected) for anything
    unusable in it.

        >>> import das
        >>> [stop.name for stop in das.load_route("zurich-luzern").stops]
        ['Zürich HB', 'Thalwil', 'Zug', 'Luzern']
    """
    path = locate_route(name_or_path)
    return ttobench.read_track(path) if path.suffix.lower() == ".json" else native.read_route(path)


def load_journey(name_or_path: str | Path, route: Route) -> Journey:
    """The journey of a bundled name ("zurich-luzern"), a TOML file of ours or a JSON journey of TTOBench, on a route.

    Raises DasError for a name or file that there is not, InputError (file, key, value, what was expected) for anything
    unusable in it, and where a point of the journey is not on the route.
    """
    path = _locate(name_or_path, "journeys")
    json = path.suffix.lower() == ".json"
    journey = ttobench.read_journey(path) if json else journey_toml.read_journey(path, route)
    journey.check_on(route)
    return journey


def locate_vehicle(name_or_path: str | Path) -> Path:
    """The file of a vehicle; DasError where there is none."""
    return _locate(name_or_path, "vehicles")


def locate_route(name_or_path: str | Path) -> Path:
    """The file of a route; DasError where there is none."""
    return _locate(name_or_path, "routes")


def _locate(name_or_path: str | Path, kind: str) -> Path:
    bundled = catalogue(kind)
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            f"load_{kind[:-1]}", "name_or_path", name_or_path, f"the name of a bundled {kind[:-1]}, or a path"
        )
    if isinstance(name_or_path, str) and name_or_path in bundled:
        return bundled[name_or_path]
    path = Path(name_or_path)
    if path.suffix.lower() not in (".toml", ".json"):
        names = ", ".join(bundled)
        raise DasError(f"{name_or_path}: not a bundled {kind[:-1]} ({names}) and not a .toml or .json file")
    if path.is_dir():
        raise DasError(f"{name_or_path}: is a folder, expected a file")
    if not path.exists():
        raise DasError(f"{name_or_path}: no such file")
    if not path.is_file():
        raise DasError(f"{name_or_path}: not a regular file")
    return path
