"""Loading of vehicles, routes and journeys by the name of a bundled file or the path of any file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from das.domain.errors import DasError, InputError
from das.domain.files import routes, vehicles
from das.domain.files.foreign import refuse_foreign
from das.domain.journey import Journey
from das.domain.route import Route
from das.domain.vehicle import Vehicle


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
    path = locate_journey(name_or_path)
    json = path.suffix.lower() == ".json"
    journey = _ttobench().read_journey(path) if json else routes.read_journey(path, route)
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
