"""What a driver did and felt, kept for whoever studies him."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

KINDS: Final = (
    *("glance", "noticed", "reaction", "followed", "refused"),
    *("acted", "lapse", "lever", "changed", "expected"),
)
"""What is kept, in the order of the numbers of `Decision.Kind` on the bus, which says what each means."""


class DriverEvent(NamedTuple):
    """Something that the driver did or felt, at a time (s on the cab's clock), and a number that goes with it.

    What it is (one of `KINDS`), and the number: `glance`, `noticed`, `followed`, `refused` and `changed` (mode of the
    advice, 0 for none), `reaction` (its length in s), `acted` (1: follows the advice), `lapse` (its length as drawn, in
    s), `lever` (the new setting of a controller that had stood still), `expected` (before `reaction`: what was noticed
    had been announced, and the share of a reaction that it takes therefore).
    """

    time_s: float
    what: str
    value: float


class Diary:
    """The events of one driver, in the order in which they were noticed."""

    def __init__(self) -> None:
        self.events: list[DriverEvent] = []

    def note(self, time_s: float, what: str, value: float) -> None:
        """Add an event."""
        self.events.append(DriverEvent(time_s, what, value))


def kept_by(driver: object) -> Sequence[DriverEvent]:
    """The events of a driver so far; none of a driver who keeps no diary."""
    return getattr(driver, "events", ())
