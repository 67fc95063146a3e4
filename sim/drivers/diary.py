"""What a driver did and felt, kept for whoever studies him."""

from __future__ import annotations

from typing import NamedTuple


class DriverEvent(NamedTuple):
    """Something that the driver did or felt, at a time (s on the cab's clock), and a number that goes with it.

    What it is, and the number: `reaction` (its length in s), `followed` and `refused` (mode of the advice), `lapse`
    (its length as drawn, in s), `lever` (the new setting of a controller that had stood still).
    """

    time_s: float
    what: str
    value: float


class Diary:
    """The events of one driver, in the order of time."""

    def __init__(self) -> None:
        self.events: list[DriverEvent] = []

    def note(self, time_s: float, what: str, value: float) -> None:
        """Add an event."""
        self.events.append(DriverEvent(time_s, what, value))
