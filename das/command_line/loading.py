"""How commands load a route or a vehicle: what is unusual about it is said once, on standard error."""

from __future__ import annotations

import math
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


def warn_of_braking(vehicle: Vehicle) -> None:
    """Print a line about a train whose plans may brake with friction and whose file does not say how hard.

    All brakes at full force at once are planned then, but a friction brake takes some seconds to build up (4 s in
    position P, UIC 540): a driver who follows such advice runs past his stop.
    """
    from das.domain.vehicle import BrakePolicy

    rubs = vehicle.brake_policy is not BrakePolicy.ELECTRIC and vehicle.friction_brake_force_n > 0
    line = (
        f"{vehicle.source}: max_deceleration is missing: plans brake with all of the friction brake at once, which "
        "takes some seconds to build up; state the deceleration that drivers use"
    )
    if rubs and math.isinf(vehicle.max_deceleration_mps2) and line not in _warned:
        _warned.add(line)
        warn(line)


def warn_unusual(*read: Vehicle | Route) -> None:
    """Print a line for every unusual value of vehicles and routes that were read, each line once in a process."""
    from das.domain.plausibility import warnings_of

    for line in (line for thing in read for line in warnings_of(thing)):
        if line not in _warned:
            _warned.add(line)
            warn(line)
