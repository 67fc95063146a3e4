"""What goes between the simulated world and the advice, whatever carries it."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from das.cab.heard import Heard
from sim.drivers.cab import CabView
from sim.drivers.diary import DriverEvent
from sim.plant.plant import Command, PlantState


class Tick(NamedTuple):
    """A tick of the simulation: its number, its time (ns since 1970), and what the on-board system is told at it.

    All restrictions in force are told at the first tick that gets through, even if there are none, and whenever they
    change; all targets in force whenever they change.
    """

    number: int
    now_ns: int
    told: tuple[Heard, ...]


class Told(NamedTuple):
    """What is recorded although the on-board system does not hear it.

    That is the truth, the cab with what it shows, what the driver last asked for, what happened, and what the driver
    did or decided since the tick before.
    """

    state: PlantState
    cab: CabView
    command: Command
    events: tuple[str, ...]
    decisions: tuple[DriverEvent, ...] = ()


class Link(Protocol):
    """The way to the advice and to the recording."""

    def exchange(self, tick: Tick) -> Any:
        """The advice for a tick (`das.advice.advice.Advice` or the bus's message)."""

    def tell(self, now_ns: int, told: Told) -> None:
        """Record what the on-board system does not hear."""

    def restart(self) -> None:
        """Kill the on-board system and start it anew."""
