"""The driver advisory system as a library: lines and trains in, runs of least energy out.

    >>> import das
    >>> route, train = das.load_route("flat-6km"), das.load_vehicle("re460-ic")
    >>> section = das.build_section(route, train, start="A", end="B")
    >>> front = das.solve(section)
    >>> run = front.trajectory(1.07 * front.fastest().time_s)
    >>> print(f"{run.time_s:.0f} s, {run.ledger.input / 3.6e6:.1f} kWh")
    223 s, 61.0 kWh

This module only lists the names and where they live; the functions are explained in `das.front_door`. A name's module
is imported when the name is first used, so that `import das` itself is quick. Values are in SI units, and names carry
their unit. What cannot be done raises `DasError` with one line that says why.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from das.bus.recording import Recording, read_recording
    from das.domain.braking import SiteBraking
    from das.domain.conditions import Conditions
    from das.domain.errors import DasError, InfeasibleError, InputError
    from das.domain.files.load import load_journey, load_route, load_vehicle
    from das.domain.journey import Journey
    from das.domain.losses import Level
    from das.domain.restriction import Restriction
    from das.domain.route import Route
    from das.domain.trajectory import Ledger, Trajectory
    from das.domain.vehicle import Vehicle
    from das.front_door import (
        build_section,
        front_points,
        in_service,
        plan_journey,
        read_table,
        refined,
        solve,
        to_pandas,
    )
    from das.solver.front import Front
    from das.solver.journey.chains import Split
    from das.solver.journey.plan import JourneyPlan
    from das.solver.section import Section
    from das.solver.solution import Solution

__version__ = "0.2.0"

__all__ = [
    "Conditions",
    "DasError",
    "Front",
    "InfeasibleError",
    "InputError",
    "Journey",
    "JourneyPlan",
    "Ledger",
    "Level",
    "Recording",
    "Restriction",
    "Route",
    "Section",
    "SiteBraking",
    "Solution",
    "Split",
    "Trajectory",
    "Vehicle",
    "__version__",
    "build_section",
    "front_points",
    "in_service",
    "load_journey",
    "load_route",
    "load_vehicle",
    "plan_journey",
    "read_recording",
    "read_table",
    "refined",
    "solve",
    "to_pandas",
]

_HOMES = {
    "das.bus.recording": ("Recording", "read_recording"),
    "das.domain.braking": ("SiteBraking",),
    "das.domain.conditions": ("Conditions",),
    "das.domain.errors": ("DasError", "InfeasibleError", "InputError"),
    "das.domain.files.load": ("load_journey", "load_route", "load_vehicle"),
    "das.domain.journey": ("Journey",),
    "das.domain.losses": ("Level",),
    "das.domain.restriction": ("Restriction",),
    "das.domain.route": ("Route",),
    "das.domain.trajectory": ("Ledger", "Trajectory"),
    "das.domain.vehicle": ("Vehicle",),
    "das.front_door": (
        "build_section",
        "front_points",
        "in_service",
        "plan_journey",
        "read_table",
        "refined",
        "solve",
        "to_pandas",
    ),
    "das.solver.front": ("Front", "Solution"),
    "das.solver.journey.chains": ("Split",),
    "das.solver.journey.plan": ("JourneyPlan",),
    "das.solver.section": ("Section",),
}
"""The public names by the module that defines them, as they are imported above for type checkers."""


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used (PEP 562)."""
    for module, names in _HOMES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(module), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, and what is set already."""
    return sorted({*__all__, *globals()})
