"""Plan of a journey: the times at all points, and a trajectory for every section, with the least total energy.

The energy of a stretch is (nearly) a convex function of its time. So between two tight times one price of time λ holds
(equal marginal energy), and λ changes only at tight times (proof: docs/explanation/journeys.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.journey import ANY_TIME, Window
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.summary import Summary, needs
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.vehicle import Vehicle
from das.drawing.plotted import PlottedRun, PlottedWindow, plotted_on
from das.offline.asked_journey import Call, Held, Journey, Passing, clock, held_at
from das.offline.bound import NOT_FOUND, Certificate, Task, bound_of
from das.offline.chains import (
    Chains,
    DrivenStretch,
    JourneySection,
    Solved,
    Split,
    Stretch,
    Tight,
    Timeline,
    WaitLink,
    build_journey_sections,
)
from das.solver import tolerances as tol
from das.solver.section import Section
from das.solver.solution import trajectory_on

Floats = NDArray[np.float64]

NO_PRICE: Final = (
    "a part of the journey has no price of time: it is run as fast as possible, or its time is not split optimally"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PricedTimeline:
    """A timeline with a price of time (W) for each of its links.

    Any prices prove a bound; the optimum's prices prove a high one.
    """

    sections: tuple[JourneySection, ...]
    timeline: Timeline
    price_w: Floats

    def certificate(self, runs: Sequence[Trajectory]) -> Certificate:
        """The certificate of a journey whose sections are driven by `runs`.

        The bound is the least of energy + price·time of every section, minus the prices times the longest times that
        the windows allow (`docs/explanation/bounds.md`). Windows count with the tolerance to which a plan keeps them.
        """
        allowed_s = self._allowed_s
        if not np.isfinite(self.price_w).all():
            return Certificate(bound_j=math.nan, allowed_s=allowed_s, reason=NO_PRICE)
        total_j = -self._most_for_time_j()
        if math.isfinite(total_j):
            total_j += sum(self._section_j(index, run) for index, run in enumerate(runs))
        reason = "" if math.isfinite(total_j) else NOT_FOUND
        return Certificate(bound_j=total_j if not reason else math.nan, allowed_s=allowed_s, reason=reason)

    @property
    def _allowed_s(self) -> float:
        return self.timeline.events[-1].window.latest_s - self.timeline.events[0].window.earliest_s

    def _most_for_time_j(self) -> float:
        """The largest sum of prices times the times between events that the windows allow (J)."""
        events, links = self.timeline.events, self.timeline.links
        # A train may wait longer than necessary, so waiting must not be rewarded.
        is_wait = np.array([isinstance(link, WaitLink) for link in links])
        price_w = np.where(is_wait, np.maximum(self.price_w, 0.0), self.price_w)
        dwell_s = np.array([link.least_s if isinstance(link, WaitLink) else 0.0 for link in links])
        # Σ price·(t after − t before) by events: each takes the more expensive end of its window.
        weight_w = np.append(price_w, 0.0) - np.append(0.0, price_w)
        total_j = -float(price_w @ dwell_s)
        for event, weight in zip(events, weight_w, strict=True):
            if weight != 0.0:
                earliest_s = event.window.earliest_s - tol.TIME_TOLERANCE_S
                latest_s = event.window.latest_s + tol.TIME_TOLERANCE_S
                total_j -= float(weight) * (earliest_s if weight > 0 else latest_s)
        return total_j

    def _section_j(self, index: int, run: Trajectory) -> float:
        """A lower bound of energy + price·time (J) over a section."""
        journey_section = self.sections[index]
        section = journey_section.whole
        price_w = np.empty(len(section.step_m))
        for link, price in zip(self.timeline.links, self.price_w, strict=True):
            if isinstance(link, Stretch) and link.section == index:
                price_w[journey_section.places[link.first] : journey_section.places[link.last]] = price
        wholes = (other.whole for other in self.sections if other is not journey_section)  # none is faster than this:
        others_s = sum(float(one.elapsed_s(one.envelope_mps + tol.SPEED_TOLERANCE_MPS)[-1]) for one in wholes)
        waits_s = sum(link.least_s for link in self.timeline.links if isinstance(link, WaitLink))
        task = Task(
            section=section,
            line=section,
            envelope_mps=section.envelope_mps,
            speeds_mps=run.v_mps,
            allowed_s=self._allowed_s - others_s - waits_s + 2 * tol.TIME_TOLERANCE_S,
            price_w=price_w,
        )
        return bound_of(task, run.force_el_n, 0.0)


@dataclass(frozen=True, kw_only=True)
class PlannedTime:
    """A planned time (s on the journey's clock) and the bound at which it is held."""

    time_s: float
    held: Held


@dataclass(frozen=True, kw_only=True)
class PassedAt:
    """A passing with its planned time and speed."""

    passing: Passing
    timing: PlannedTime
    speed_mps: float

    @property
    def missed_s(self) -> float:
        """The deviation (s; late > 0) from a wish in excess of its tolerance; 0 for a passing that is enforced."""
        return self.passing.missed_s(self.timing.time_s) if self.passing.wish else 0.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SectionPlan(Summary):
    """The plan of a section.

    `lambda_w` holds the price of time (W) of each stretch between tight passings (inf: the fastest run). `feasible`
    is True if the runs keep to the limits, to the forces that the train has, and to the times.
    """

    start: Call
    end: Call
    departure: PlannedTime
    arrival: PlannedTime
    passings: tuple[PassedAt, ...]
    trajectory: Trajectory
    balance: EnergyBalance
    least_time_s: float
    lambda_w: tuple[float, ...]
    feasible: bool

    def facts(self) -> dict[str, str]:
        """Both stops with their planned times, and time and energy of the run."""
        return {
            "departs": f"{self.start.name} {clock(self.departure.time_s)}",
            "arrives": f"{self.end.name} {clock(self.arrival.time_s)}",
            "needs": needs(self.trajectory.time_s, self.balance.input),
            "buffer": f"{100.0 * self.buffer_ratio:.1f} %",
        }

    @property
    def buffer_ratio(self) -> float:
        """Running time above the least possible, as a share of it."""
        return self.trajectory.time_s / self.least_time_s - 1.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JourneyPlan(Summary):
    """A planned journey, one part for each section."""

    journey: Journey
    split: Split
    sections: tuple[SectionPlan, ...]
    priced: PricedTimeline

    def facts(self) -> dict[str, str]:
        """The journey, its train, the planned departures and arrivals, and time and energy of the plan."""
        calls = {}
        for one in self.sections:
            calls[f"{one.start.name} departs"] = clock(one.departure.time_s)
            calls[f"{one.end.name} arrives"] = clock(one.arrival.time_s)
        return {
            "journey": self.journey.name,
            "train": self._whole.vehicle.name,
            **calls,
            "needs": needs(self.time_s, self.input_j),
        }

    @property
    def _whole(self) -> Section:
        """The first section, which has the line, the train and the losses of all."""
        return self.priced.sections[0].whole

    def plotted(self) -> PlottedRun:
        """The plan for a picture, on the journey's clock, with the windows of its times."""
        windows = [
            window
            for one in self.sections
            for window in (
                PlottedWindow(position_m=one.start.position_m, window=one.start.departure, of="departure"),
                *(
                    PlottedWindow(position_m=x.passing.position_m, window=x.passing.window, of="passing")
                    for x in one.passings
                ),
                PlottedWindow(position_m=one.end.position_m, window=one.end.arrival, of="arrival"),
            )
        ]
        names = (self.journey.name, *self._whole.titles[1:])
        return replace(plotted_on(self._whole, self.trajectory()), names=names, windows=tuple(windows))

    @property
    def input_j(self) -> float:
        """Net energy at the current collector, without comfort systems."""
        return sum(section.balance.input for section in self.sections)

    @property
    def comfort_j(self) -> float:
        """Energy of the comfort systems, dwells included."""
        running_s = sum(section.trajectory.time_s for section in self.sections)
        return sum(section.balance.comfort for section in self.sections) * self.time_s / running_s

    @cached_property
    def certificate(self) -> Certificate:
        """The proven lower bound of the energy, or the reason why there is none."""
        if not all(section.feasible for section in self.sections):
            return Certificate(
                bound_j=math.nan, allowed_s=math.nan, reason="a section does not keep its limits or times"
            )
        return self.priced.certificate([section.trajectory for section in self.sections])

    @property
    def bound_j(self) -> float:
        """Proven lower bound (J) of the energy of every run that keeps the windows; NaN if none is proven."""
        return self.certificate.bound_j

    @property
    def gap_ratio(self) -> float:
        """(input − bound)/|input|, never negative; NaN if no bound is proven (see `gap_reason`)."""
        return (self.input_j - self.bound_j) / max(abs(self.input_j), 1.0)

    @property
    def gap_reason(self) -> str:
        """Why no bound is proven; empty if one is."""
        return self.certificate.reason

    @property
    def time_s(self) -> float:
        """The time (s) from the first departure to the last arrival."""
        return self.sections[-1].arrival.time_s - self.sections[0].departure.time_s

    def trajectory(self) -> Trajectory:
        """The whole journey as one trajectory on the journey's clock; a dwell is an interval without length."""
        return _joined([(section.departure.time_s, section.trajectory) for section in self.sections])


class JourneyPlanner:
    """Plans a journey of a train on a route, with one split of the time or with several.

    `level` is the level of losses (default: the vehicle's). `point_mass` takes the train's length as 0. Raises what
    `build_section` raises, and InfeasibleError if no run can keep a time or the speeds of a passing.
    """

    def __init__(
        self,
        journey: Journey,
        route: Route,
        vehicle: Vehicle,
        *,
        level: Level | None = None,
        point_mass: bool = False,
    ) -> None:
        self.journey = journey
        self._on = (route, vehicle, level, point_mass)
        self.sections = build_journey_sections(journey, route, vehicle, level=level, point_mass=point_mass)
        self.chains = Chains(self.sections, journey.source)
        self._check_reachable()

    def plan(self, split: Split = Split.EQUAL_MARGINAL) -> JourneyPlan:
        """Plan the journey: every time lies in its window, and `split` divides the time between two tight times (only
        the default is the optimum).

        Runs take their times to within `JOURNEY_TIME_TOLERANCE_S`; windows are kept to within `TIME_TOLERANCE_S`.
        Raises InfeasibleError if the windows cannot be kept, with the window and the seconds by which it is missed.
        """
        solved, timeline = self._solve(split), self.chains.timeline
        price_w = np.full(len(timeline.links), math.nan)
        for part in solved:
            price_w[part.span.begin[0] : part.span.end[0]] = part.lambda_w
        return JourneyPlan(
            journey=self.journey,
            split=split,
            sections=self._section_plans(solved),
            priced=PricedTimeline(sections=self.sections, timeline=timeline, price_w=price_w),
        )

    def fastest_j(self) -> float:
        """Energy of the journey if every section is driven as fast as possible and the train waits at stops; windows of
        passings are not kept."""
        return sum(_driven(section, section.fastest_mps)[1].input for section in self.sections)

    def wish_costs_j(self, section: SectionPlan, wish: PassedAt) -> float:
        """Energy (J) that keeping a missed wish within its tolerance would cost, with the same times at both stops.

        Raises InputError or InfeasibleError if the wish cannot be kept.
        """
        route, vehicle, level, point_mass = self._on
        kept = replace(wish.passing, window=wish.passing.tolerated, wish=False)
        enforced = [one.passing for one in section.passings if not one.passing.wish]
        journey = replace(
            self.journey,
            points=(
                replace(section.start, arrival=ANY_TIME, dwell_s=0.0, departure=Window.at(section.departure.time_s)),
                *sorted((*enforced, kept), key=lambda passing: passing.position_m),
                replace(section.end, departure=ANY_TIME, dwell_s=0.0, arrival=Window.at(section.arrival.time_s)),
            ),
        )
        planner = JourneyPlanner(journey, route, vehicle, level=level, point_mass=point_mass)
        return planner.plan().input_j - section.balance.input

    def _check_reachable(self) -> None:
        """Raise InfeasibleError if the train is late at an event even when it drives every section as fast as possible.

        A journey that passes this check may still be infeasible.
        """
        timeline = self.chains.timeline
        reached_s, since = -math.inf, (0, -math.inf)
        for i, event in enumerate(timeline.events):
            if i:
                link = timeline.links[i - 1]
                if isinstance(link, WaitLink):
                    reached_s += link.least_s
                else:
                    least_s = self.sections[link.section].least_s
                    reached_s += float(least_s[link.last] - least_s[link.first])
            if reached_s > event.window.latest_s + tol.TIME_TOLERANCE_S:
                latest = (i, event.window.latest_s)
                raise self.chains.missed(since, latest, reached_s - event.window.latest_s)
            if event.window.earliest_s > reached_s:
                reached_s = event.window.earliest_s
                since = (i, reached_s)

    def _solve(self, split: Split) -> tuple[Solved, ...]:
        """Solve all spans; in each, hold the time that is furthest outside its window at the bound it violates; repeat.

        In a span with one λ, the bound that is violated most is tight at the optimum (docs/explanation/journeys.md).
        """
        events = self.chains.timeline.events
        earliest_s = np.array([event.window.earliest_s for event in events])
        latest_s = np.array([event.window.latest_s for event in events])
        tight = {i: float(earliest_s[i]) for i in (0, len(events) - 1)}
        while True:
            solved = self._solve_chains(tight, split)
            known = len(tight)
            for part in solved:
                inner = slice(part.span.begin[0] + 1, part.span.end[0])
                late_s, early_s = part.event_s[1:-1] - latest_s[inner], earliest_s[inner] - part.event_s[1:-1]
                missed_s = np.maximum(late_s, early_s)
                if missed_s.max(initial=0.0) > tol.TIME_TOLERANCE_S:
                    worst = int(missed_s.argmax())
                    bound_s = latest_s if late_s[worst] > early_s[worst] else earliest_s
                    tight[inner.start + worst] = float(bound_s[inner.start + worst])
            if len(tight) == known:
                return solved

    def _solve_chains(self, tight: dict[int, float], split: Split) -> tuple[Solved, ...]:
        """Solve all spans and return them in order; spans that meet at a passing are solved together."""
        solved: list[Solved] = []
        chain: list[Tight] = []
        for event in sorted(tight.items()):
            chain.append(event)
            if len(chain) > 1 and not self.chains.timeline.is_passing(event[0]):
                solved += self.chains.solve(tuple(chain), split)
                chain = [event]
        return tuple(solved)

    def _section_plans(self, solved: Sequence[Solved]) -> tuple[SectionPlan, ...]:
        event_s = np.concatenate([span.event_s[:-1] for span in solved] + [solved[-1].event_s[-1:]])
        runs = [(self.chains.fronts.drive(run), span.lambda_w) for span in solved for run in span.runs]
        plans, first = [], 1
        for index, section in enumerate(self.sections):
            windows = [event.window for event in self.chains.timeline.events[first : first + len(section.places)]]
            own = [(run, price_w) for run, price_w in runs if run.stretch.section == index]
            plans.append(_section_plan(section, windows, float(event_s[first]), own))
            first += len(section.places)
        return tuple(plans)


def _section_plan(
    section: JourneySection, windows: Sequence[Window], departure_s: float, runs: Sequence[tuple[DrivenStretch, float]]
) -> SectionPlan:
    """The plan of a section from its runs, each with the price of time of its span (NaN: the run's own)."""
    speeds = np.concatenate([runs[0][0].speeds_mps[:1], *(run.speeds_mps[1:] for run, _ in runs)])
    trajectory, balance = _driven(section, speeds)
    times_s = [departure_s + float(trajectory.t_s[node]) for node in section.places]
    timings = [
        PlannedTime(time_s=t, held=held_at(window, t, 2.0 * tol.TIME_TOLERANCE_S))
        for t, window in zip(times_s, windows, strict=True)
    ]
    return SectionPlan(
        start=section.start,
        end=section.end,
        departure=timings[0],
        arrival=timings[-1],
        passings=_passed(section, trajectory, departure_s, timings[1:-1]),
        trajectory=trajectory,
        balance=balance,
        least_time_s=float(section.least_s[-1]),
        lambda_w=tuple(run.lambda_w if math.isnan(price_w) else price_w for run, price_w in runs),
        feasible=all(run.feasible for run, _ in runs),
    )


def _passed(
    section: JourneySection, trajectory: Trajectory, departure_s: float, timings: Sequence[PlannedTime]
) -> tuple[PassedAt, ...]:
    """The passings of a section in order: those that are enforced, with their `timings`, and the wishes."""
    enforced = [
        PassedAt(passing=passing, timing=timing, speed_mps=float(trajectory.v_mps[node]))
        for passing, timing, node in zip(section.passings, timings, section.places[1:-1], strict=True)
    ]
    wishes = []
    for passing in section.wishes:
        time_s, speed_mps = trajectory.passed(passing.position_m)
        timing = PlannedTime(time_s=departure_s + time_s, held=Held.FREE)
        wishes.append(PassedAt(passing=passing, timing=timing, speed_mps=speed_mps))
    return tuple(sorted((*enforced, *wishes), key=lambda x: x.passing.position_m))


def _driven(section: JourneySection, speeds: Floats) -> tuple[Trajectory, EnergyBalance]:
    trajectory = trajectory_on(section.whole, section.whole, speeds)
    return trajectory, trajectory.balance(section.whole.vehicle, section.whole.loss)


def _joined(parts: Sequence[tuple[float, Trajectory]]) -> Trajectory:
    """Trajectories one after the other, each from its own time; the train stands between them."""
    runs = [trajectory for _, trajectory in parts]

    def intervals(name: str, standing: float | None) -> Floats:
        values = [getattr(run, name) for run in runs]
        gaps = [run[:1] if standing is None else [standing] for run in values]
        pieces = [piece for pair in zip(gaps, values, strict=True) for piece in pair]
        return np.concatenate(pieces[1:])  # The first run has no gap before it.

    nodes = {
        "s_m": np.concatenate([run.s_m for run in runs]),
        "t_s": np.concatenate([begin_s + run.t_s for begin_s, run in parts]),
        "v_mps": np.concatenate([run.v_mps for run in runs]),
    }
    forces = {name: intervals(name, 0.0) for name in ("force_el_n", "force_friction_n")}
    line = ("grade_ratio", "grade_and_curve_n", "tunnel_n_per_mps2", "limit_mps", "supply")
    return Trajectory(**nodes, **forces, **{name: intervals(name, None) for name in line})
