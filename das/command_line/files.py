"""The files that commands read and write: warnings of unusual values, and refusals before long work starts."""

from __future__ import annotations

import importlib.util
import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from das.command_line.application import refuse_given
from das.command_line.printing import warn
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole

if TYPE_CHECKING:
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle

PICTURES = (".png", ".pdf", ".svg")
NO_MATPLOTLIB = "pictures need matplotlib: install the extra, pip install '.[view]' in the checkout"
_warned: set[str] = set()
"""Warnings that the process has printed."""


def load_route(name_or_path: str) -> Route:
    """A route by its bundled name or file; raises DasError for anything unusable."""
    from das.domain.files import load

    route = load.load_route(name_or_path)
    warn_unusual(route)
    return route


def load_vehicle(name_or_path: str) -> Vehicle:
    """A vehicle by its bundled name or file; raises DasError for anything unusable."""
    from das.domain.files import load

    vehicle = load.load_vehicle(name_or_path)
    warn_unusual(vehicle)
    return vehicle


def warn_of_braking(vehicle: Vehicle) -> None:
    """Print a warning about a train with friction brakes whose file does not state `max_deceleration`.

    Plans then assume that all brakes act immediately with full force. But a friction brake takes some seconds to build
    up (4 s in position P, UIC 540), so a driver who follows such advice runs past the stop.
    """
    from das.domain.vehicle import BrakePolicy

    rubs = vehicle.brake_policy is not BrakePolicy.ELECTRIC and vehicle.friction_brake_force_n > 0
    line = (
        f"{vehicle.source}: max_deceleration is missing: plans use the full friction brake without its build-up of "
        "some seconds; state the deceleration that drivers use"
    )
    if rubs and math.isinf(vehicle.max_deceleration_mps2):
        warn_once(line)


def warn_unusual(*read: Vehicle | Route) -> None:
    """Print a line for each unusual value of vehicles and routes; a process prints each line once."""
    from das.domain.plausibility import warnings_of

    warn_once(*(line for thing in read for line in warnings_of(thing)))


def warn_once(*lines: str) -> None:
    """Print lines as warnings; a process prints each line once."""
    for line in lines:
        if line not in _warned:
            _warned.add(line)
            warn(line)


def check_outputs(*outputs: Path | None, inputs: Iterable[str | Path | None] = (), overwrite: bool = False) -> None:
    """Refuse outputs that cannot be written, exist already, are the same file, or are an input.

    None stands for an output or input that was not given. `inputs` may also hold names of bundled files. `overwrite`
    allows existing files to be replaced. Raises DasError. Commands call it before long work starts.
    """
    if all(path is None for path in outputs):
        refuse_given("no file to write is named", "--overwrite")
    read = {Path(path).resolve() for path in inputs if path is not None}
    seen: set[Path] = set()
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in read:
            raise DasError(f"{path}: the output file is also an input")
        if path.resolve() in seen:
            raise DasError(f"{path}: two outputs name the same file")
        seen.add(path.resolve())
        check_writable(path, overwrite=overwrite)


def check_picture(path: Path | None) -> None:
    """Refuse a picture whose suffix is not one of `PICTURES`, or any picture without matplotlib; None is no picture."""
    if path is not None and importlib.util.find_spec("matplotlib") is None:
        raise DasError(NO_MATPLOTLIB)
    if path is not None and path.suffix.lower() not in PICTURES:
        raise DasError(f"{path}: expected a file name that ends in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}")


def save_figure(path: Path, figure: Any) -> None:
    """Write a matplotlib figure in the format that the suffix of `path` names.

    The same figure gives the same bytes. Raises DasError for another suffix, or if the file cannot be written.
    """
    check_picture(path)
    kind = path.suffix.lower()[1:]
    dated = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[kind]
    content = io.BytesIO()
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "das"}):  # names the parts of an SVG, which have random names otherwise
        figure.savefig(content, format=kind, dpi=120, metadata=dated)
    write_whole(path, content.getvalue())
