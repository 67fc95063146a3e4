"""An event of a recorded drive, the kinds of events, how a list is filtered, and which events are bookmarks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final

import numpy as np

from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import NS
from sim.recording.course import DrivenCourse


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
    `mark` says why the program made the event a bookmark; it is empty for all others.
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


def place_m(trip: DrivenCourse, time_ns: int) -> float:
    """Where the train's head was at a moment (m)."""
    return float(trip.at(np.array([time_ns]), trip.s_m)[0])


def lateness_text(late_s: float) -> str:
    """How late a train is in words: "12 s late", "3 s early" or "on time"."""
    return "on time" if abs(late_s) < 0.5 else f"{abs(late_s):.0f} s {'late' if late_s > 0 else 'early'}"


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Which events are wanted; what is empty or None lets everything through."""

    kinds: Collection[EventKind] = ()
    text: str = ""
    """Words that the text holds, whatever their case."""
    from_ns: int | None = None
    to_ns: int | None = None
    bookmarks: bool = False
    """Only bookmarks: those that the program made, and notes."""

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


MUCH_OVER_KMH: Final = 3.0
"""A train this much (km/h) above the limit was too fast by more than the error of a speedometer and of the sampling."""
LONG_OVER_S: Final = 5.0
"""A train that is above the limit for this long (s) did not only touch it."""
LONG_SILENT_S: Final = 3.0
"""A silence that is shorter than this (s) is not seen, because the display keeps its advice for so long."""
LONG_AWAY_S: Final = 10.0
"""Attention that is away for this long (s) is more than a look at something else."""
LARGE_DEVIATION_S: Final = 60.0
"""A train that is, or is expected to arrive, this much (s) off the timetable is an event."""


def with_marks(events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
    """The events in order of time; those that are bookmarks say so in `mark`."""
    found = sorted(events, key=lambda one: one.time_ns)
    # Only the first refusal of each leg is marked, and only under way: a driver who refuses once usually does so again.
    may_refuse = not any(one.kind is EventKind.DEPARTURE for one in found)
    marked = []
    for one in found:
        if one.kind in (EventKind.DEPARTURE, EventKind.ARRIVAL):
            may_refuse = one.kind is EventKind.DEPARTURE
        mark = _mark(one)
        if mark == REFUSED:
            mark, may_refuse = (mark if may_refuse else ""), False
        marked.append(replace(one, mark=mark) if mark else one)
    return tuple(marked)


REFUSED: Final = "advice not followed"


def _mark(one: DriveEvent) -> str:
    """Why an event is a bookmark; empty for an event that is none."""
    from sim.drivers.cab import AT_STOP_M  # imports the compiler, for which no help of a command should wait

    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.MISSED_STOP:
            return "stop missed"
        case EventKind.ARRIVAL if one.facts["missed_m"] > AT_STOP_M:
            return "beyond the stop"
        case EventKind.STAND:
            return "unplanned stop"
        case EventKind.SIGNAL:
            return "signal at danger"
        case EventKind.OVERSPEED if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "too fast"
        case EventKind.BEYOND_TRAIN if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "another train?"
        case EventKind.WITHDRAWAL if lasted_s >= LONG_SILENT_S:
            return "advice withdrawn"
        case EventKind.LAPSE if lasted_s >= LONG_SILENT_S:
            return "nothing heard"
        case EventKind.DRIVER if one.facts.get("followed") is False:
            return REFUSED
        case EventKind.DRIVER if one.facts.get("away_s", 0.0) >= LONG_AWAY_S:
            return "attention away"
        case EventKind.DEVIATION:
            return "a minute off the timetable"
        case _:
            return ""


def deviation_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """The first moment at which the train was, or would arrive, a minute from its time; nothing if there was none.

    The operator says how late the train is, the node how late it expects to arrive.
    """
    told = recording.columns(topics.DELAY, "time_ns", "delay_s")
    said = recording.columns(topics.ADVICE, "time_ns", "mode", "predicted_deviation_s")
    expected = np.where(said["mode"] > 0, said["predicted_deviation_s"], 0.0)
    firsts = [
        (int(time_ns[at]), float(late_s[at]), words)
        for time_ns, late_s, words in (
            (told["time_ns"], told["delay_s"], "the operator says"),
            (said["time_ns"], expected, "the next arrival is expected"),
        )
        for at in np.flatnonzero(np.abs(late_s) >= LARGE_DEVIATION_S)[:1]
    ]
    for time_ns, late_s, words in sorted(firsts)[:1]:
        yield DriveEvent(
            time_ns=time_ns,
            kind=EventKind.DEVIATION,
            text=f"{words} {lateness_text(late_s)}",
            s_m=place_m(trip, time_ns),
            facts={"deviation_s": late_s},
        )


def bookmarks(events: Sequence[DriveEvent]) -> tuple[DriveEvent, ...]:
    """All bookmarks in order of time: those that the program made, and the notes of people."""
    return tuple(one for one in events if one.mark or one.kind is EventKind.NOTE)
