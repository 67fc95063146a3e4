"""What goes between the simulated world and the advice, whatever carries it."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from das.cab.trip import Target
from das.estimate.calibration import Effort
from das.estimate.localisation import PositionFix
from sim.drivers.cab import CabView, PostedRestriction
from sim.plant.plant import Command, PlantState


class Heard(NamedTuple):
    """What goes to the node at a tick; None: nothing is said of it now."""

    tick: int
    now_ns: int
    measured: PositionFix | None
    delay_s: float | None
    restrictions: tuple[PostedRestriction, ...] | None
    """All that are in force, whenever they change."""
    effort: Effort | None
    targets: tuple[Target, ...] | None
    """Likewise."""


class Told(NamedTuple):
    """What is recorded beside: the truth, the cab with what it shows, what the driver last asked for, what happened."""

    state: PlantState
    cab: CabView
    command: Command
    events: tuple[str, ...]


class Link(Protocol):
    """The way to the advice and to the recording."""

    def exchange(self, heard: Heard) -> Any:
        """The advice for a tick (`das.advice.advisor.Advice` or the bus's message)."""

    def tell(self, now_ns: int, told: Told) -> None:
        """Record what nobody advises on."""

    def restart(self) -> None:
        """Kill the node and start it anew."""
