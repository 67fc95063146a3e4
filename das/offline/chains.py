"""The sections and the timeline of a journey, and its chains of spans with the fronts of their sections.

The passing points of a section are nodes, where the bounds of their speeds are enforced. A *span* lies between two
neighbouring tight times, and it has one price of time λ. Spans that meet at a stop do not depend on each other. Spans
that meet at a tight passing share the speed there and form a *chain*, which is solved by one sweep from its end to its
beginning: the cost of driving a span in its time, as a function of its initial speed, is the end value of the span
before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InfeasibleError
from das.domain.journey import Window
from das.domain.levels import Level
from das.domain.route import Route, Stretches
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.offline.asked_journey import Call, Journey, Passing, clock, held_at
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope, climbing_floor
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import LineArrays
from das.solver.line_profile import LineProfile
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import default_ladder, solve_front
from das.solver.state import fastest, least_time_s

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class JourneySection:
    """A section between two stops of a journey.

    `passings` are the points with enforced windows and speeds; `wishes` are only reported.
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

        The start and end speeds of the whole section still apply; a front answers for any speed at its beginning.
        """
        whole, a, b = self.whole, self.places[first], self.places[last]
        of_intervals = [field.name for field in fields(LineProfile) if field.name != "node_m"]
        of_nodes = ("node_m", "floor_mps", "envelope_mps")
        inside = (whole.decision >= a) & (whole.decision <= b)
        found = replace(
            whole,
            **{name: getattr(whole, name)[a:b] for name in of_intervals},
            **{name: getattr(whole, name)[a : b + 1] for name in of_nodes},
            decision=whole.decision[inside] - a,
        )
        rises = least_end_mps > found.floor_mps[-1]
        return replace(found, floor_mps=_run_up(whole, b, least_end_mps)[a:]) if rises else found


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
    limits = route.limits_mps
    start_m = np.unique(np.concatenate((limits.start_m, [passing.position_m for passing in passings])))
    section = build_section(  # breakpoints, and so decision nodes, at the passings
        replace(route, limits_mps=Stretches(start_m=start_m, value=limits.at(start_m))),
        vehicle,
        level=level,
        start_m=start.position_m,
        end_m=end.position_m,
        options=SectionOptions(point_mass=point_mass),
    )
    nodes = section.node_m
    inner = [int(np.argmin(np.abs(nodes - passing.position_m))) for passing in passings]
    # From the last to the first: the speed at a passing bounds the speeds before it.
    for node, passing in zip(reversed(inner), reversed(passings), strict=True):
        section = _bounded(section, node, passing)
    speeds = np.zeros(len(nodes))
    time_s = fastest_roll_out(section.for_kernels, section.envelope_mps, section.train, speeds)
    if not 0 <= time_s < np.inf:
        raise InfeasibleError(
            f"{section.name}: the train stalls on the way, or the section is too short for it to move"
        )
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
    """The section with a passing's speeds enforced at an integration node, by other envelope and floor before the node.

    At the node, the floor is below the envelope by at least the ratio `PASSING_BAND_RATIO`, so that the speed grid
    there has several speeds.
    """
    possible = float(section.floor_mps[node]), float(section.envelope_mps[node])
    lowest, highest = max(passing.lowest_mps, possible[0]), min(passing.highest_mps, possible[1])
    if lowest > highest:
        raise _speed_error(section, passing, *possible)
    envelope, floor = section.envelope_mps.copy(), section.floor_mps.copy()
    if highest < envelope[node]:
        line, limit = _line_before(section, node), section.limit_mps[:node]
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
    """The slowest speeds on the way to an integration node with which the train still reaches it at `least_mps`."""
    envelope = section.envelope_mps[: node + 1].copy()
    envelope[-1] = least_mps
    run_up: Floats = climbing_floor(_line_before(section, node), envelope, 0.0, section.train)
    return np.maximum(run_up, section.floor_mps[: node + 1])


def _line_before(section: Section, node: int) -> LineArrays:
    return LineArrays(*(array[:node] for array in section.for_kernels))


def _speed_error(section: Section, passing: Passing, lowest_mps: float, highest_mps: float) -> InfeasibleError:
    wanted = f"{passing.lowest_mps / KMH:.1f} … {passing.highest_mps / KMH:.1f} km/h"
    return InfeasibleError(
        f"{section.route.source}: passing {passing.name} at {wanted}: possible there are "
        f"{lowest_mps / KMH:.1f} … {highest_mps / KMH:.1f} km/h"
    )


Tight = tuple[int, float]
"""An event of the timeline and the time (s) at which it is held."""


@dataclass(frozen=True, kw_only=True)
class TimelineEvent:
    """An event of a journey: what happens, and the window in which it may happen."""

    what: str
    window: Window


@dataclass(frozen=True)
class WaitLink:
    """A link in which the train stands between two events, for at least this time (s)."""

    least_s: float


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

    In a link the train waits, or runs from a place of a section to the next place. The first event is the earliest
    departure, the last the latest arrival; the train may wait after the first and before the last. Between them, each
    section has an event for each of its places.
    """

    events: tuple[TimelineEvent, ...]
    links: tuple[WaitLink | Stretch, ...]

    @classmethod
    def of(cls, sections: Sequence[JourneySection]) -> Timeline:
        begin_s, end_s = sections[0].start.departure.earliest_s, sections[-1].end.arrival.latest_s
        events = [TimelineEvent(what="the earliest departure", window=Window.at(begin_s))]
        links: list[WaitLink | Stretch] = []
        for i, section in enumerate(sections):
            links.append(WaitLink(section.start.dwell_s))
            events.append(TimelineEvent(what=f"departure from {section.start.name}", window=section.start.departure))
            events += [TimelineEvent(what=f"passing {x.name}", window=x.window) for x in section.passings]
            events.append(TimelineEvent(what=f"arrival at {section.end.name}", window=section.end.arrival))
            links += [Stretch(i, place, place + 1) for place in range(len(section.places) - 1)]
        links.append(WaitLink(0.0))
        events.append(TimelineEvent(what="the latest arrival", window=Window.at(end_s)))
        return cls(events=tuple(events), links=tuple(links))

    def is_passing(self, event: int) -> bool:
        """Whether the train is under way at an event."""
        return all(isinstance(link, Stretch) for link in self.links[max(event - 1, 0) : event + 1])

    def span(self, begin: Tight, end: Tight) -> TightSpan:
        """The span between two tight events."""
        links = dict(enumerate(self.links[begin[0] : end[0]], begin[0]))
        waits = {i: link.least_s for i, link in links.items() if isinstance(link, WaitLink)}
        driven: dict[int, Stretch] = {}
        for link in links.values():
            if isinstance(link, Stretch):
                driven[link.section] = Stretch(link.section, driven.get(link.section, link).first, link.last)
        return TightSpan(
            begin=begin,
            end=end,
            stretches=tuple(driven.values()),
            least_wait_s=sum(waits.values()),
            last_wait=max(waits, default=-1),
        )

    def describe(self, tight: Tight) -> str:
        """An event and the bound at which it is held, as text; the ends of the timeline are named after their stops."""
        index, time_s = tight
        event = self.events[min(max(index, 1), len(self.events) - 2)]
        return f"{event.what} ({held_at(event.window, time_s, tol.TIME_TOLERANCE_S)} {clock(time_s)})"


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedStretch:
    """A stretch and its time."""

    stretch: Stretch
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenStretch(TimedStretch):
    """A stretch with its trajectory: the speeds at its nodes, and its price of time (W).

    `feasible`: the trajectory is within limits and forces, and on time.
    """

    speeds_mps: Floats
    lambda_w: float
    feasible: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class MultiplierTable:
    """Time and cost of a stretch under each multiplier of the ladder.

    `time_s` (L + 1,) falls to the time of the fastest trajectory. `total_j` (L,) is the least total cost.
    """

    time_s: Floats
    total_j: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Ahead:
    """The cost of the journey after a tight passing (`value_j`, J) by the speed there (`speed_mps`).

    A train that passes slower than `least_mps` is too late for the next tight event.
    """

    speed_mps: Floats
    value_j: Floats
    least_mps: float


class SectionFronts:
    """Solves the fronts of sections and keeps the fronts of whole sections while there is room.

    Tables and trajectories of whole sections are always kept.

    All sections have the same ladder `ladder_w`: that of the section with the largest multipliers, and before it
    negative multipliers, which are shares of the idle loss. `least_energy` is the index of the multiplier 0.
    """

    def __init__(self, sections: Sequence[JourneySection]) -> None:
        self.sections = tuple(sections)
        self.ladder_w = _ladder(sections)
        self.least_energy = int(np.searchsorted(self.ladder_w, 0.0))
        self._fronts: dict[int, Front] = {}
        self._tables: dict[int, MultiplierTable] = {}
        self._runs: dict[tuple[int, float], DrivenStretch] = {}

    def is_whole(self, stretch: Stretch) -> bool:
        """Whether a stretch is a section from stop to stop."""
        return stretch.last - stretch.first == len(self.sections[stretch.section].places) - 1

    def part(self, stretch: Stretch, ahead: Ahead | None) -> Front:
        """The front of a part of a section; `ahead` is the journey after its end (None: a stop)."""
        journey_section = self.sections[stretch.section]
        if ahead is None:
            return solve_front(journey_section.part(stretch.first, stretch.last), lambda_w=self.ladder_w)
        section = journey_section.part(stretch.first, stretch.last, ahead.least_mps)
        speeds = _grid_mps(section, -1)
        value = np.interp(speeds**2, ahead.speed_mps**2, ahead.value_j)
        value[value > tol.UNREACHABLE] = tol.INFEASIBLE
        return solve_front(section, lambda_w=self.ladder_w, end_value_j=value)

    def table(self, stretch: Stretch, part: Front | None, speed_mps: float) -> MultiplierTable:
        """The table of a stretch from a speed: from the front `part`, or from the whole section's if it is None."""
        if part is not None:
            return _table(part, speed_mps)
        if stretch.section not in self._tables:
            self._tables[stretch.section] = _table(self._whole(stretch.section), 0.0)
        return self._tables[stretch.section]

    def drive(self, planned: TimedStretch, part: Front | None = None, speed_mps: float = 0.0) -> DrivenStretch:
        """The trajectory of a stretch: from the front `part`, or from the whole section's if it is None."""
        if isinstance(planned, DrivenStretch):
            return planned
        if part is not None:
            return _driven(planned, part, speed_mps)
        key = (planned.stretch.section, planned.time_s)
        if key not in self._runs:
            self._runs[key] = _driven(planned, self._whole(planned.stretch.section), 0.0)
        return self._runs[key]

    def _whole(self, section: int) -> Front:
        if section in self._fronts:
            return self._fronts[section]
        front = solve_front(self.sections[section].whole, lambda_w=self.ladder_w)
        if sum(map(_size, self._fronts.values())) + _size(front) <= tol.JOURNEY_FRONTS_BYTES:
            self._fronts[section] = front
        return front


def late_s(front: Front, speed_mps: float, left_s: float) -> float:
    """The excess (s) of the fastest trajectory from a speed over the time left; inf if none reaches the end."""
    try:
        quickest = fastest(front.section, front.section.start_m, speed_mps)
    except InfeasibleError:
        return math.inf
    return quickest.time_s - left_s if quickest.feasible else math.inf


def _ladder(sections: Sequence[JourneySection]) -> Floats:
    idle_w = float(sections[0].whole.loss.loss_w(0.0, tol.CREEP_MPS))
    slow = -idle_w * np.array(tol.LADDER_IDLE_RATIOS if idle_w > 0 else ())
    return np.concatenate(
        (slow, max((default_ladder(section.whole) for section in sections), key=lambda ladder: ladder[-1]))
    )


def _size(front: Front) -> int:
    return front.value_j.nbytes * 3 // 2  # the times-to-go take half as much


def _table(front: Front, speed_mps: float) -> MultiplierTable:
    times_s, total_j = front.by_multiplier(front.section.start_m, speed_mps)
    least_s = least_time_s(front.section, front.section.start_m, speed_mps)
    return MultiplierTable(time_s=np.minimum.accumulate(np.append(times_s, least_s)), total_j=total_j)


def _driven(planned: TimedStretch, front: Front, speed_mps: float) -> DrivenStretch:
    start_m, tolerance_s = front.section.start_m, tol.JOURNEY_TIME_TOLERANCE_S
    solution = front.trajectory(planned.time_s, start_m, speed_mps, tolerance_s=tolerance_s)
    return DrivenStretch(
        stretch=planned.stretch,
        time_s=planned.time_s,
        speeds_mps=solution.trajectory.v_mps,
        lambda_w=solution.lambda_w,
        feasible=solution.feasible and solution.fit is Fit.ON_TIME,
    )


Parts = dict[Stretch, Front]
"""Fronts of the stretches of a chain that are not whole sections."""


class Split(StrEnum):
    """The rule by which the time between two tight times is divided."""

    EQUAL_MARGINAL = "equal-marginal"
    """One second less would cost the same energy everywhere, as in the optimum."""
    PROPORTIONAL = "proportional"
    """Equal buffers, in per cent, everywhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """A span with its price of time (W), the time of every event from its beginning to its end, and its stretches.

    Whole sections without passings have no trajectory yet, only a time.
    """

    span: TightSpan
    lambda_w: float
    event_s: Floats
    runs: tuple[TimedStretch, ...]


class Chains:
    """Solves the chains of a journey and remembers them. `source` names the journey in errors."""

    def __init__(self, sections: Sequence[JourneySection], source: str) -> None:
        self.sections, self.source = tuple(sections), source
        self.timeline, self.fronts = Timeline.of(sections), SectionFronts(sections)
        self._solved: dict[tuple[tuple[Tight, ...], Split], tuple[Solved, ...]] = {}

    def solve(self, tight: tuple[Tight, ...], split: Split) -> tuple[Solved, ...]:
        """The spans between neighbouring tight events, of which all but the first and the last are passings.

        Raises InfeasibleError if a span cannot be driven in its time.
        """
        key = (tight, split)
        if key not in self._solved:
            self._solved[key] = self._solve([self.timeline.span(a, b) for a, b in pairwise(tight)], split)
        return self._solved[key]

    def missed(self, begin: Tight, end: Tight, late_s: float) -> InfeasibleError:
        """The error for an end that every run misses by at least `late_s` seconds (early < 0)."""
        run = "the fastest run" if late_s > 0 else "even the slowest run in time for what follows"
        kind = "tight" if late_s > 0 else "late"
        return InfeasibleError(
            f"{self.source}: {self.timeline.describe(end)} is {abs(late_s):.1f} s too {kind}: after "
            f"{self.timeline.describe(begin)} {run} is there at {clock(end[1] + late_s)}"
        )

    def lowest(self, span: TightSpan) -> int:
        """The index of a span's first multiplier: in a span with a wait, multipliers below 0 are not needed."""
        return 0 if span.last_wait < 0 else self.fronts.least_energy

    def _solve(self, spans: Sequence[TightSpan], split: Split) -> tuple[Solved, ...]:
        parts = self._parts(spans)
        solved: list[Solved] = []
        speed_mps = 0.0
        for span in spans:
            solved.append(self._drive(span, parts, speed_mps, split))
            last = solved[-1].runs[-1:]
            speed_mps = float(last[0].speeds_mps[-1]) if last and isinstance(last[0], DrivenStretch) else 0.0
        return tuple(solved)

    def _parts(self, spans: Sequence[TightSpan]) -> Parts:
        """The fronts of a chain's stretches that are not whole, from the last to the first."""
        parts: Parts = {}
        ahead: Ahead | None = None
        for span in reversed(spans):
            for stretch in span.stretches:
                if not self.fronts.is_whole(stretch):
                    parts[stretch] = self.fronts.part(stretch, ahead if stretch is span.stretches[-1] else None)
            if span is not spans[0]:
                ahead = self._ahead(span, parts)
        return parts

    def _ahead(self, span: TightSpan, parts: Parts) -> Ahead:
        """The cost of driving a span in its time, by the speed at the passing before it: the largest dual over λ."""
        first = parts[span.stretches[0]]
        cost_j = self._dual_j(span, parts, first.value_j[0])[:, self.lowest(span) :].max(axis=1)
        return Ahead(speed_mps=_grid_mps(first.section, 0), value_j=cost_j, least_mps=self._least_speed(span, parts))

    def _dual_j(self, span: TightSpan, parts: Parts, first_j: Floats) -> Floats:
        """The least cost of a span minus λ·its time (J), for each λ, if its first stretch costs `first_j` (…, L)."""
        tables = [self.fronts.table(stretch, parts.get(stretch), 0.0) for stretch in span.stretches[1:]]
        fixed_j = self.fronts.ladder_w * (span.least_wait_s - span.time_s)
        total_j = first_j + sum((table.total_j for table in tables), fixed_j)
        return np.where(first_j > tol.UNREACHABLE, tol.INFEASIBLE, total_j)

    def _least_speed(self, span: TightSpan, parts: Parts) -> float:
        """The slowest speed at the beginning of a span with which it can be driven in its time, by bisection."""
        stretch, *others = span.stretches
        front, section = parts[stretch], self.sections[stretch.section]
        others_s = sum(float(self.fronts.table(other, parts.get(other), 0.0).time_s[-1]) for other in others)
        left_s = span.time_s - span.least_wait_s - others_s
        low, high = float(front.section.floor_mps[0]), float(section.fastest_mps[section.places[stretch.first]])
        by_s = late_s(front, high, left_s)
        if by_s > tol.TIME_TOLERANCE_S:
            raise self.missed(span.begin, span.end, by_s)
        if late_s(front, low, left_s) <= 0.0:
            return low
        while high - low > tol.PASSING_SPEED_STEP_MPS:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if late_s(front, middle, left_s) > 0.0 else (low, middle)
        return high

    def _drive(self, span: TightSpan, parts: Parts, speed_mps: float, split: Split) -> Solved:
        speeds = [0.0 if stretch.first == 0 else speed_mps for stretch in span.stretches]
        tables = [
            self.fronts.table(stretch, parts.get(stretch), v) for stretch, v in zip(span.stretches, speeds, strict=True)
        ]
        times_s, price_w, slack_s = self._share(span, tables, split)
        runs: list[TimedStretch] = []
        for stretch, time_s, v in zip(span.stretches, times_s, speeds, strict=True):
            planned = TimedStretch(stretch=stretch, time_s=time_s)
            later = self.fronts.is_whole(stretch) and not self.sections[stretch.section].passings
            runs.append(planned if later else self.fronts.drive(planned, parts.get(stretch), v))
        return Solved(span=span, lambda_w=price_w, event_s=self._event_times(span, runs, slack_s), runs=tuple(runs))

    def _share(
        self, span: TightSpan, tables: Sequence[MultiplierTable], split: Split
    ) -> tuple[list[float], float, float]:
        """Times of a span's stretches (s), its price of time (W), and its waiting time beyond the least (s)."""
        by_column = [table.time_s for table in tables]
        ladder_w, lowest = self.fronts.ladder_w, self.lowest(span)
        total_s = sum(by_column, np.full(len(ladder_w) + 1, span.least_wait_s))
        too_late_s, slack_s = float(total_s[-1]) - span.time_s, span.time_s - float(total_s[lowest])
        if too_late_s > tol.TIME_TOLERANCE_S:
            raise self.missed(span.begin, span.end, too_late_s)
        if slack_s > tol.TIME_TOLERANCE_S and span.last_wait < 0:
            raise self.missed(span.begin, span.end, -slack_s)
        if slack_s >= 0:
            return [float(time_s[lowest]) for time_s in by_column], float(ladder_w[lowest]), slack_s
        if split is Split.PROPORTIONAL:
            return _proportional(span, [(float(x[-1]), float(x[lowest])) for x in by_column]), math.nan, 0.0
        columns = np.arange(len(total_s), dtype=float)
        column = float(np.interp(-span.time_s, -total_s, columns))
        price_w = float(np.interp(column, columns[:-1], ladder_w, right=math.inf))
        return [float(np.interp(column, columns, time_s)) for time_s in by_column], price_w, 0.0

    def _event_times(self, span: TightSpan, runs: Iterable[TimedStretch], slack_s: float) -> Floats:
        """The times of the events of a span; the train spends `slack_s` beyond the least time at the last wait."""
        links, following = self.timeline.links, iter(runs)
        event_s = [span.begin[1]]
        for i in range(span.begin[0], span.end[0]):
            link = links[i]
            if isinstance(link, WaitLink):
                event_s.append(event_s[-1] + link.least_s + (slack_s if i == span.last_wait else 0.0))
            elif i == span.begin[0] or isinstance(links[i - 1], WaitLink):
                begin_s = event_s[-1]
                event_s += [begin_s + x for x in self._place_times(next(following))]
        return np.array(event_s)

    def _place_times(self, run: TimedStretch) -> list[float]:
        """Times (s) from the beginning of a stretch to each place after it."""
        if not isinstance(run, DrivenStretch):
            return [run.time_s]
        stretch, section = run.stretch, self.sections[run.stretch.section]
        first, *inner, _ = section.places[stretch.first : stretch.last + 1]
        times_s = section.part(stretch.first, stretch.last).elapsed_s(run.speeds_mps)
        return [*(float(times_s[node - first]) for node in inner), run.time_s]


def _grid_mps(section: Section, node: int) -> Floats:
    return np.linspace(section.floor_mps[node], section.envelope_mps[node], section.speed_steps + 1)


def _proportional(span: TightSpan, times_s: Sequence[tuple[float, float]]) -> list[float]:
    """Least time × one factor for every stretch, but at most its slowest time; `times_s`: (least, slowest)."""
    factors = np.array(sorted({1.0, *(slowest / least for least, slowest in times_s)}))
    totals = span.least_wait_s + sum(np.minimum(factors * least, slowest) for least, slowest in times_s)
    factor = float(np.interp(span.time_s, totals, factors))
    return [min(factor * least, slowest) for least, slowest in times_s]
