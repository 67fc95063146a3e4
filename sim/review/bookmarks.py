"""The list of a review that jumps: people's notes, and what is worth a look by itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from sim.drive.events.event import DriveEvent, EventKind
from sim.review.colors import Meaning

ROUTINE: Final = (
    EventKind.ADVICE, EventKind.REPLAN, EventKind.DRIVER, EventKind.DELAY, EventKind.JOURNEY, EventKind.LOG,
)  # fmt: skip
"""Events that happen all the time, or that another event tells as well; `das-sim events` lists them."""
COLORS: Final = {
    EventKind.NOTE: Meaning.NOTE,
    EventKind.WARNING: Meaning.WARNING,
    EventKind.OVERSPEED: Meaning.WARNING,
    EventKind.BEYOND_TRAIN: Meaning.WARNING,
    EventKind.MISSED_STOP: Meaning.WARNING,
    EventKind.SIGNAL: Meaning.DANGER,
    EventKind.RESTRICTION: Meaning.LIMIT,
    EventKind.TARGET: Meaning.OPERATOR,
    EventKind.WITHDRAWAL: Meaning.NO_ADVICE,
    EventKind.LAPSE: Meaning.NO_ADVICE,
}
"""What the colours of bookmarks mean; others are in the colour of the ink."""


def bookmarks(events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
    """The events of a drive that are worth a look, in order of time."""
    return tuple(one for one in events if one.kind not in ROUTINE)
