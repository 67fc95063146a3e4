"""An event of a recorded drive, the kinds of events, and how a list of them is filtered."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class EventKind(StrEnum):
    """What an event is about; `das-sim events --kind` takes these words."""

    DEPARTURE = "departure"
    ARRIVAL = "arrival"
    MISSED_STOP = "missed-stop"
    STAND = "stand"
    """The train came to stand where it has no stop."""
    SIGNAL = "signal"
    RESTRICTION = "restriction"
    TARGET = "target"
    JOURNEY = "journey"
    DELAY = "delay"
    ADVICE = "advice"
    """The advised mode changed."""
    REPLAN = "replan"
    """The node made a new plan that differs from the one before."""
    WITHDRAWAL = "withdrawal"
    OVERSPEED = "overspeed"
    """The train was above the limit of the line, or above a temporary restriction."""
    BEYOND_TRAIN = "beyond-train"
    """The train was faster than its vehicle file says that it can go: it may be another train."""
    DRIVER = "driver"
    """How the driver answered a change of the advice."""
    LAPSE = "lapse"
    """A message stream paused: positions or advice were not heard for a while."""
    DEVIATION = "deviation"
    """For the first time the train was, or was expected to arrive, far from the timetable's time."""
    LOG = "log"
    WARNING = "warning"
    NOTE = "note"
    """A bookmark that somebody made."""


@dataclass(frozen=True, kw_only=True)
class DriveEvent:
    """Something that happened: when (ns since 1970), where (m, NaN where unknown), what, and figures that go with it.

    `end_ns` is when it was over; it equals `time_ns` for what has no duration. The names in `facts` carry their units.
    `mark` says why the event is a bookmark that made itself; it is empty for all others.
    """

    time_ns: int
    kind: EventKind
    text: str
    s_m: float
    end_ns: int = 0
    facts: Mapping[str, Any] = field(default_factory=dict)
    mark: str = ""

    @property
    def last_ns(self) -> int:
        """When the event was over (ns since 1970)."""
        return max(self.time_ns, self.end_ns)


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Which events are wanted; what is empty or None lets everything through."""

    kinds: Collection[EventKind] = ()
    text: str = ""
    """Words that the text holds, whatever their case."""
    from_ns: int | None = None
    to_ns: int | None = None
    bookmarks: bool = False
    """Only bookmarks: those that made themselves, and notes."""

    def choose(self, events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
        """The events that pass, in their order."""
        return tuple(one for one in events if self._passes(one))

    def _passes(self, one: DriveEvent) -> bool:
        return (
            (not self.kinds or one.kind in self.kinds)
            and (not self.bookmarks or bool(one.mark) or one.kind is EventKind.NOTE)
            and self.text.casefold() in one.text.casefold()
            and (self.from_ns is None or one.last_ns >= self.from_ns)
            and (self.to_ns is None or one.time_ns <= self.to_ns)
        )
