"""The timeline of a journey: all its events in order, and the spans between those that are tight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from das.domain.journey import Window, clock
from das.solver import tolerances as tol
from das.solver.journey.sections import JourneySection

Tight = tuple[int, float]
"""An event of the timeline and the time (s) it is held at."""


@dataclass(frozen=True, kw_only=True)
class TimelineEvent:
    """An event of a journey: what happens, and the window in which it may happen."""

    what: str
    window: Window


@dataclass(frozen=True)
class WaitLink:
    """The train stands between two events, for at least this time (s)."""

    least_s: float


@dataclass(frozen=True)
class DriveLink:
    """The train runs between two events, from a place of a section to the next place."""

    section: int
    place: int


@dataclass(frozen=True)
class Stretch:
    """Part of a section, from one of its places to another."""

    section: int
    first: int
    last: int


@dataclass(frozen=True, kw_only=True)
class TightSpan:
    """What lies between two tight events: stretches and waits.

    `last_wait` is the index of the link of the last wait, or -1 where there is no wait.
    """

    begin: Tight
    end: Tight
    stretches: tuple[Stretch, ...]
    least_wait_s: float
    last_wait: int

    @property
    def time_s(self) -> float:
        """Time (s) between the two events."""
        return self.end[1] - self.begin[1]


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """All events of a journey in order, and what is between them: `links[i]` from event i to event i + 1.

    The first event is the earliest departure, the last the latest arrival; the train may wait after the one and
    before the other. `departures[i]` is the event with which section i begins.
    """

    events: tuple[TimelineEvent, ...]
    links: tuple[WaitLink | DriveLink, ...]
    departures: tuple[int, ...]

    @classmethod
    def of(cls, sections: Sequence[JourneySection]) -> Timeline:
        begin_s, end_s = sections[0].start.departure.earliest_s, sections[-1].end.arrival.latest_s
        events = [TimelineEvent(what="the earliest departure", window=Window(earliest_s=begin_s, latest_s=begin_s))]
        links: list[WaitLink | DriveLink] = []
        departures = []
        for i, section in enumerate(sections):
            links.append(WaitLink(section.start.dwell_s))
            departures.append(len(events))
            events.append(TimelineEvent(what=f"departure from {section.start.name}", window=section.start.departure))
            events += [TimelineEvent(what=f"passing {x.name}", window=x.window) for x in section.passings]
            events.append(TimelineEvent(what=f"arrival at {section.end.name}", window=section.end.arrival))
            links += [DriveLink(i, place) for place in range(len(section.places) - 1)]
        links.append(WaitLink(0.0))
        events.append(TimelineEvent(what="the latest arrival", window=Window(earliest_s=end_s, latest_s=end_s)))
        return cls(events=tuple(events), links=tuple(links), departures=tuple(departures))

    def is_passing(self, event: int) -> bool:
        """Whether the train is under way at an event."""
        return all(isinstance(link, DriveLink) for link in self.links[max(event - 1, 0) : event + 1])

    def span(self, begin: Tight, end: Tight) -> TightSpan:
        """What lies between two tight events."""
        links = dict(enumerate(self.links[begin[0] : end[0]], begin[0]))
        waits = {i: link.least_s for i, link in links.items() if isinstance(link, WaitLink)}
        places: dict[int, list[int]] = {}
        for link in links.values():
            if isinstance(link, DriveLink):
                places.setdefault(link.section, []).append(link.place)
        return TightSpan(
            begin=begin,
            end=end,
            stretches=tuple(Stretch(section, inside[0], inside[-1] + 1) for section, inside in places.items()),
            least_wait_s=sum(waits.values()),
            last_wait=max(waits, default=-1),
        )

    def describe(self, tight: Tight) -> str:
        """An event and the bound it is held at; the ends of the timeline are named by the stops there."""
        index, time_s = tight
        event = self.events[min(max(index, 1), len(self.events) - 2)]
        return f"{event.what} ({event.window.held_at(time_s, tol.TIME_TOLERANCE_S)} {clock(time_s)})"
