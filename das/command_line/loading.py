"""How commands load a route or a vehicle: what is unusual about it is said once, on standard error."""

from __future__ import annotations

from typing import TYPE_CHECKING

from das.command_line.printing import warn

if TYPE_CHECKING:
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle

_warned: set[str] = set()
"""Warnings that this process has printed."""


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


def warn_unusual(*read: Vehicle | Route) -> None:
    """Print a line for every unusual value of vehicles and routes that were read, each line once in a process."""
    from das.domain.plausibility import warnings_of

    for line in (line for thing in read for line in warnings_of(thing)):
        if line not in _warned:
            _warned.add(line)
            warn(line)
