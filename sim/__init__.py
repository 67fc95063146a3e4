"""The simulator as a library: days driven in closed loop by a simulated train, driver and adviser.

    >>> import sim
    >>> day = sim.run_day("clear-day", seed=1, driver="perfect")
    >>> round(day.outcome["over_limit_s"]), len(day.outcome["stops"])
    (0, 4)

This module only lists the names; the function is explained in `sim.front_door`. As in `das`, a name's module is
imported when the name is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.front_door import SimulatedDay, run_day

__all__ = ["SimulatedDay", "run_day"]


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used (PEP 562)."""
    if name in __all__:
        value = globals()[name] = getattr(import_module("sim.front_door"), name)
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, and what is set already."""
    return sorted({*__all__, *globals()})
