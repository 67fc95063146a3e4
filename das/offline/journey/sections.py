"""The sections of a journey from stop to stop, and the timeline of all its events.

The passing points of a section are nodes, where the bounds of their speeds are enforced. A *span* of the timeline lies
between two events that are held at a bound of their windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InfeasibleError
from das.domain.journey import Call, Journey, Passing, Window, clock
from das.domain.levels import Level
from das.domain.route import Route, Stretches
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.solver import tolerances as tol
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope, climbing_floor
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import LineArrays
from das.solver.line_profile import LineProfile
from das.solver.section import Section, SectionOptions, build_section

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class JourneySection:
    """A section between two stops of a journey.

    `passings` are those whose windows and speeds are enforced; `wishes` are only reported.
    `places` holds the integration nodes of the start, the passings and the end, `least_s` the times at which the
    fastest trajectory reaches them and `fastest_mps` its speeds at all nodes.
    """

    start: Call
    end: Call
    passings: tuple[Passing, ...]
    wishes: tuple[Passing, ...]
    whole: Section
    places: tuple[int, ...]
    least_s: Floats
    fastest_mps: Floats

    def part(self, first: int, last: int, least_end_mps: float = 0.0) -> Section:
        """The section between two places; if the last is a passing, it may end at any speed >= `least_end_mps`.

        Its start and end speeds remain those of the whole section; a front answers for any speed at its beginning.
        """
        a, b = self.places[first], self.places[last]
        found = _section_between(self.whole, a, b)
        rises = least_end_mps > found.floor_mps[-1]
        return replace(found, floor_mps=_run_up(self.whole, b, least_end_mps)[a:]) if rises else found


def build_journey_sections(
    journey: Journey, route: Route, vehicle: Vehicle, *, level: Level | None = None, point_mass: bool = False
) -> tuple[JourneySection, ...]:
    """The sections of a journey on a route.

    Raises as `build_section` does, and InfeasibleError if a passing's speeds cannot be kept.
    """
    journey.check_on(route)
    sections = []
    for start, end in pairwise(journey.calls):
        inside = (start.position_m, end.position_m)
        passings = tuple(point for point in journey.passings if inside[0] < point.position_m < inside[1])
        sections.append(_journey_section(route, vehicle, start, end, passings, level, point_mass))
    return tuple(sections)


def _journey_section(
    route: Route,
    vehicle: Vehicle,
    start: Call,
    end: Call,
    inside: tuple[Passing, ...],
    level: Level | None,
    point_mass: bool,
) -> JourneySection:
    passings = tuple(passing for passing in inside if not passing.wish)
    section = build_section(
        _with_breakpoints(route, [passing.position_m for passing in passings]),
        vehicle,
        level=level,
        start_m=start.position_m,
        end_m=end.position_m,
        options=SectionOptions(point_mass=point_mass),
    )
    nodes = section.node_m
    inner = [int(np.argmin(np.abs(nodes - passing.position_m))) for passing in passings]
    # From the last to the first: a speed ahead bounds those before it.
    for node, passing in zip(reversed(inner), reversed(passings), strict=True):
        section = _bounded(section, node, passing)
    speeds = _fastest_mps(section)
    for node, passing in zip(inner, passings, strict=True):
        if speeds[node] < section.floor_mps[node] - tol.SPEED_TOLERANCE_MPS:
            raise _speed_error(section, passing, 0.0, float(speeds[node]))
    places = [0, *inner, len(nodes) - 1]
    return JourneySection(
        start=start,
        end=end,
        passings=passings,
        wishes=tuple(passing for passing in inside if passing.wish),
        whole=section,
        places=tuple(places),
        least_s=section.elapsed_s(speeds)[places],
        fastest_mps=speeds,
    )


def _bounded(section: Section, node: int, passing: Passing) -> Section:
    """The section with a passing's speeds enforced at an integration node: envelope and floor before the node change.

    At the node, the floor is below the envelope by at least the ratio `PASSING_BAND_RATIO`, so that the speed grid
    there has several speeds.
    """
    possible = float(section.floor_mps[node]), float(section.envelope_mps[node])
    lowest, highest = max(passing.lowest_mps, possible[0]), min(passing.highest_mps, possible[1])
    if lowest > highest:
        raise _speed_error(section, passing, *possible)
    envelope, floor = section.envelope_mps.copy(), section.floor_mps.copy()
    if highest < envelope[node]:
        before = slice(None, node)
        line = LineArrays(*(array[before] for array in section.for_kernels))
        limit = section.limit_mps[before]
        envelope[: node + 1], stuck = braking_envelope(line, limit, highest, section.train, FULL_BRAKES)
        if stuck >= 0:
            raise InfeasibleError(
                f"{section.route.source}: passing {passing.name} at {highest / KMH:.1f} km/h: the train cannot brake "
                f"to it on the descent at {section.node_m[stuck]:.0f} m"
            )
    section = replace(section, envelope_mps=envelope)
    if passing.lowest_mps > floor[node]:
        floor[: node + 1] = _run_up(section, node, min(lowest, highest * (1.0 - tol.PASSING_BAND_RATIO)))
    return replace(section, floor_mps=np.minimum(floor, envelope))


def _run_up(section: Section, node: int, least_mps: float) -> Floats:
    """The slowest speeds up to an integration node from which the train still reaches it at `least_mps`."""
    before = slice(None, node)
    envelope = section.envelope_mps[: node + 1].copy()
    envelope[-1] = least_mps
    line = LineArrays(*(array[before] for array in section.for_kernels))
    run_up: Floats = climbing_floor(line, envelope, 0.0, section.train)
    return np.maximum(run_up, section.floor_mps[: node + 1])


def _fastest_mps(section: Section) -> Floats:
    speeds = np.zeros(len(section.node_m))
    time_s = fastest_roll_out(section.for_kernels, section.envelope_mps, section.train, speeds)
    if not 0 <= time_s < np.inf:
        raise InfeasibleError(f"{section.name}: the train stalls on the way, or the section is too short to move")
    return speeds


def _speed_error(section: Section, passing: Passing, lowest_mps: float, highest_mps: float) -> InfeasibleError:
    wanted = f"{passing.lowest_mps / KMH:.1f} … {passing.highest_mps / KMH:.1f} km/h"
    return InfeasibleError(
        f"{section.route.source}: passing {passing.name} at {wanted}: possible there are "
        f"{lowest_mps / KMH:.1f} … {highest_mps / KMH:.1f} km/h"
    )


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
    """The part of a journey between two tight events: stretches and waits.

    `last_wait` is the index of the link of the last wait, or -1 if there is no wait.
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
    """All events of a journey in order, with the links between them: `links[i]` from event i to event i + 1.

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
        """The span between two tight events."""
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


def _with_breakpoints(route: Route, position_m: Sequence[float]) -> Route:
    """The same route with breakpoints, and so decision nodes, at the given positions."""
    limits = route.limits_mps
    start_m = np.unique(np.concatenate((limits.start_m, position_m)))
    return replace(route, limits_mps=Stretches(start_m=start_m, value=limits.at(start_m)))


def _section_between(section: Section, first: int, last: int) -> Section:
    """The part of a section between two integration nodes; it may end at any speed that the section has there.

    Its start and end speeds remain those of the whole section; a front answers for any speed at its beginning.
    """
    of_intervals = [field.name for field in fields(LineProfile) if field.name != "node_m"]
    of_nodes = ("node_m", "floor_mps", "envelope_mps")
    inside = (section.decision >= first) & (section.decision <= last)
    return replace(
        section,
        **{name: getattr(section, name)[first:last] for name in of_intervals},
        **{name: getattr(section, name)[first : last + 1] for name in of_nodes},
        decision=section.decision[inside] - first,
    )
