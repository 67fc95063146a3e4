"""What is around a simulated train on its day: stops, signals, limits, and sensors and operators that report them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from typing import Any

import numpy as np

from das.cab.heard import (
    DelayHeard,
    EffortHeard,
    Heard,
    PositionHeard,
    RestrictionsHeard,
    TargetsHeard,
)
from das.domain.route import Stretches
from sim.drive.limits import Violations
from sim.drivers.cab import AdviceView, CabView
from sim.plant.plant import PlantState
from sim.world.calls import Calls
from sim.world.day import Day
from sim.world.news import DayNews
from sim.world.safety import Watch
from sim.world.sensors import SimulatedLocalisation, TrainControl

DELAY_EVERY_S = 10
COMPARED_EVERY_S = 35.0
"""A display of the deviation alone shows a new one this often, as SBB's does every 30 to 40 s."""


class Surroundings:
    """The surroundings of a train on a day; the methods are to be called in the order of time."""

    def __init__(self, day: Day) -> None:
        self._service = day.service
        self.news, self.calls = DayNews(day), Calls(day)
        self._localisation, self._train_control = SimulatedLocalisation(day), TrainControl(day)
        self._limits = _LimitSteps(day.service.line.limits_mps)
        self._line_limits = _LimitSteps(day.service.line.line_limits_mps)
        self._watch = Watch(day.plant.vehicle.train_length_m)
        # A node is told of restrictions even where there are none: until then it must not advise.
        self._compared_s, self._deviation_s = -math.inf, math.nan
        self._sent: tuple[tuple[Any, ...] | None, tuple[Any, ...]] = (None, ())

    @property
    def violations(self) -> Violations:
        """What the run has violated so far."""
        return self._watch.found

    def measure(self, state: PlantState) -> list[Heard]:
        """What the train's sensors say in a state; to be called once a tick, also when nobody hears it."""
        fix, effort = self._localisation.measure(state), self._train_control.measure(state)
        measured: list[Heard] = [] if fix is None else [PositionHeard(fix=fix)]
        return measured if effort is None else [*measured, EffortHeard(effort=effort)]

    def operators(self, tick: int, now_ns: int, state: PlantState) -> Iterator[Heard]:
        """What operator and traffic management say at a tick that gets through: the delay now and then, and changes."""
        if tick % DELAY_EVERY_S == 1:
            yield DelayHeard(time_ns=now_ns, delay_s=self._delay_s(state))
        before, self._sent = self._sent, (self.news.told, self.news.targets)
        if self.news.told != before[0]:
            yield RestrictionsHeard(time_ns=now_ns, restrictions=self.news.told)
        if self.news.targets != before[1]:
            yield TargetsHeard(time_ns=now_ns, targets=self.news.targets)

    def compared_s(self, state: PlantState) -> float:
        """How late the train was (s) when that was last compared for a display of it alone."""
        if state.time_s >= self._compared_s + COMPARED_EVERY_S:
            self._compared_s, self._deviation_s = state.time_s, self._delay_s(state)
        return self._deviation_s

    def _delay_s(self, state: PlantState) -> float:
        """How late the train is (s) against the plan for the timetable, as the operator knows it (early < 0).

        A train that waits is never early.
        """
        calls, service = self.calls, self._service
        if calls.finished:
            return calls.arrivals[-1].time_s - service.clock_s(calls.timetable.arrival_ns)
        run = service.planned[calls.section].trajectory
        departure_s = service.clock_s(calls.timetable.departure_ns)
        late_s = state.time_s - departure_s - float(np.interp(state.s_m, run.s_m, run.t_s))
        return max(late_s, 0.0) if calls.waits else late_s

    def cab(self, state: PlantState, shown: AdviceView | None) -> CabView:
        """What the driver sees in a state, with the advice on the display (None: there is none)."""
        calls, news, timetable = self.calls, self.news, self.calls.timetable
        return CabView(
            state.time_s,
            state.s_m,
            state.speed_mps,
            self._limits.at(state.s_m),
            calls.stop_m,
            self._service.clock_s(timetable.departure_ns),
            self._service.clock_s(timetable.arrival_ns),
            calls.may_depart(state.time_s),
            news.signal_m,
            news.shown,
            shown,
        )

    def follow(self, before: PlantState, after: PlantState, span_s: float) -> list[str]:
        """Take note of a motion that took a time: stops kept, rules violated; a sentence about each."""
        called = self.calls.take(before, after)
        violated = self._watch.take(
            after,
            span_s,
            signal_m=self.news.signal_m,
            limit_mps=self._line_limits.at(after.s_m),
            temporary=self.news.holding(after.time_s),
        )
        return violated if called is None else [called, *violated]


class _LimitSteps:
    """A limit (m/s) by the position of the train's head, quick to look up."""

    def __init__(self, limits: Stretches) -> None:
        self._at_m: list[float] = limits.start_m.tolist()
        self._limit_mps: list[float] = limits.value.tolist()

    def at(self, s_m: float) -> float:
        return self._limit_mps[max(bisect_right(self._at_m, s_m) - 1, 0)]
