"""The closed loop: train, driver, localisation and what happens, second by second, and the advice in between."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from das.cab.heard import (
    DelayHeard,
    EffortHeard,
    Heard,
    PositionHeard,
    RestrictionsHeard,
    TargetsHeard,
    ToldRestriction,
)
from das.domain.errors import DasError
from das.estimate.effort import Effort
from das.estimate.fix import PositionFix
from sim.drivers.cab import AdviceView, CabView, Driver, Presentation, present
from sim.plant.plant import COAST, Command, PlantState
from sim.world.calls import Calls, KeptCall
from sim.world.day import Day
from sim.world.link import Link, Tick, Told
from sim.world.news import DayNews
from sim.world.safety import Violations, Watch
from sim.world.sensors import SimulatedLocalisation, TrainControl
from sim.world.service import Service

TICK_S = 1.0
LOOK_S = 0.2
"""A driver looks and acts this often."""
BEFORE_S, AFTER_S = 10.0, 10.0
"""A run begins this long before the timetable's departure and ends this long after the arrival."""
LONGEST_RATIO, LONGEST_S = 3.0, 1800.0
"""A run may last so many times its timetable, and this much more."""
DELAY_EVERY_S = 10

Progress = Callable[[float, float], None]
"""Called every tick with what is driven and the whole way (m)."""


@dataclass(kw_only=True)
class Counts:
    """Ticks by what came of them: advised, withdrawn, nothing heard (of the advised: above the limit)."""

    advised: int = 0
    withdrawn: int = 0
    unheard: int = 0
    above_limit: int = 0

    def take(self, advice: Any) -> None:
        """Count an advice."""
        if int(advice.mode) == 0:
            self.withdrawn += 1
            return
        self.advised += 1
        self.above_limit += advice.advised_speed_mps > advice.limit_mps + 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A finished run: one state a tick, the stops as kept, and how the advice fared.

    `legs`: the states at departure and arrival of every section.
    """

    states: tuple[PlantState, ...]
    calls: tuple[KeptCall, ...]
    legs: tuple[tuple[PlantState, PlantState], ...]
    counts: Counts
    violations: Violations

    @property
    def late_s(self) -> float:
        """Arrival at the last stop after the timetable's (early < 0)."""
        return self.calls[-1].late_s


class World:
    """One day's run; `run` drives it to its end."""

    def __init__(self, day: Day, driver: Driver, presentation: Presentation, link: Link) -> None:
        self.day, self.service = day, day.service
        self.driver, self.presentation, self.link = driver, presentation, link
        self._localisation, self._news, self._calls = SimulatedLocalisation(day), DayNews(day), Calls(day)
        self._train_control = TrainControl(day)
        self._limits, self._watch = _LimitSteps(self.service), Watch(day.plant.vehicle.train_length_m)
        # A node is told of restrictions even where there are none: until then it must not advise.
        self._sent: tuple[tuple[Any, ...] | None, tuple[Any, ...]] = (None, ())
        self._events: list[str] = []
        self._view: AdviceView | None = None
        self._command: Command = COAST
        self._counts = Counts()

    def run(self, progress: Progress | None = None) -> Run:
        """Drive from before the departure to after the last arrival; DasError where the train does not get there."""
        service, calls = self.service, self._calls
        first_m, last_m = service.stops[0].position_m, service.stops[-1].position_m
        state = self.day.plant.at(first_m, time_s=-BEFORE_S)
        states = [state]
        latest_s = LONGEST_S + LONGEST_RATIO * service.clock_s(service.timetables[-1].arrival_ns)
        while not calls.finished or state.time_s < calls.arrivals[-1].time_s + AFTER_S:
            tick = len(states)
            # Times of ticks are exact: sums of steps are not.
            state = self._second(tick, state)._replace(time_s=tick * TICK_S - BEFORE_S)
            states.append(state)
            if state.time_s > latest_s:
                at = f"it is at {state.s_m:.0f} m, the next stop at {calls.stop_m:.0f} m"
                raise DasError(f"the simulated train did not arrive within {latest_s:.0f} s ({at})")
            if progress is not None:
                progress(state.s_m - first_m, last_m - first_m)
        legs = zip(calls.departures, calls.arrivals, strict=True)
        return Run(
            states=tuple(states),
            calls=tuple(calls.kept()),
            legs=tuple(legs),
            counts=self._counts,
            violations=self._watch.found,
        )

    def _second(self, tick: int, state: PlantState) -> PlantState:
        """One second: what is heard and shown now, then the driver at the controller."""
        now_ns = self.service.moment_ns(state.time_s)
        self._events += self._news.update(state)
        self._advise(tick, now_ns, state)
        events, self._events = tuple(self._events), []
        self.link.tell(now_ns, Told(state, self._cab(state), self._command, events))
        for _ in range(round(TICK_S / LOOK_S)):
            self._command = self.driver.command(self._cab(state))
            after = self.day.plant.advance(state, self._command, LOOK_S)
            event = self._calls.take(state, after)
            if event is not None:
                self._events.append(event)
            state = after
            self._events += self._watched(state)
        return state

    def _watched(self, state: PlantState) -> list[str]:
        limit_mps = self._limits.at(state.s_m)
        return self._watch.take(
            state, LOOK_S, signal_m=self._news.signal_m, limit_mps=limit_mps, temporary=self._news.told
        )

    def _advise(self, tick: int, now_ns: int, state: PlantState) -> None:
        """Ask for advice and show it, where there is a node to ask."""
        measured, effort = self._localisation.measure(state), self._train_control.measure(state)
        if self._news.restart_due(state.time_s):
            self._events.append("the node is killed and started anew")
            self.link.restart()
        if self._news.cut_off(state.time_s):
            self._counts.unheard += 1
            return
        told = tuple(self._told(tick, now_ns, state, measured, effort))
        advice = self.link.exchange(Tick(tick, now_ns, told))
        self._counts.take(advice)
        self._view = present(
            advice,
            self.presentation,
            self.service.line.train,
            clock_zero_ns=self.service.timetables[0].departure_ns,
        )

    def _told(
        self, tick: int, now_ns: int, state: PlantState, measured: PositionFix | None, effort: Effort | None
    ) -> Iterator[Heard]:
        """What sensors and operators say at a tick."""
        if measured is not None:
            yield PositionHeard(fix=measured)
        if effort is not None:
            yield EffortHeard(effort=effort)
        if tick % DELAY_EVERY_S == 1:
            yield DelayHeard(time_ns=now_ns, delay_s=self._delay_s(state))
        before, self._sent = self._sent, (self._news.told, self._news.targets)
        if self._news.told != before[0]:
            restrictions = tuple(ToldRestriction(*one) for one in self._news.told)
            yield RestrictionsHeard(time_ns=now_ns, restrictions=restrictions)
        if self._news.targets != before[1]:
            yield TargetsHeard(time_ns=now_ns, targets=self._news.targets)

    def _delay_s(self, state: PlantState) -> float:
        """Deviation from the plan for the timetable, as the operator knows it; who waits for the time is not early."""
        if self._calls.finished:
            return self._calls.arrivals[-1].time_s - self.service.clock_s(self._calls.timetable.arrival_ns)
        run = self.service.planned[self._calls.section].trajectory
        departure_s = self.service.clock_s(self._calls.timetable.departure_ns)
        late_s = state.time_s - departure_s - float(np.interp(state.s_m, run.s_m, run.t_s))
        return max(late_s, 0.0) if self._calls.waits else late_s

    def _cab(self, state: PlantState) -> CabView:
        calls, news, timetable = self._calls, self._news, self._calls.timetable
        return CabView(
            state.time_s,
            state.s_m,
            state.speed_mps,
            self._limits.at(state.s_m),
            calls.stop_m,
            self.service.clock_s(timetable.departure_ns),
            self.service.clock_s(timetable.arrival_ns),
            calls.may_depart(state.time_s),
            news.signal_m,
            news.shown,
            self._view,
        )


class _LimitSteps:
    """The limit over the train by the position of its head, quick to look up."""

    def __init__(self, service: Service) -> None:
        limits = service.line.limits_mps
        self._at_m: list[float] = limits.start_m.tolist()
        self._limit_mps: list[float] = limits.value.tolist()

    def at(self, s_m: float) -> float:
        return self._limit_mps[max(bisect_right(self._at_m, s_m) - 1, 0)]
