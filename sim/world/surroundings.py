"""The surroundings of a simulated train: stops, signals, limits, restrictions, sensors, and operators' messages."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from das.advice.advice import Timetable
from das.cab.heard import (
    DelayHeard,
    EffortHeard,
    Heard,
    PositionHeard,
    RestrictionsHeard,
    Target,
    TargetsHeard,
)
from das.domain.restriction import Restriction
from das.domain.route import Stretches
from das.domain.units import KM, kmh
from das.estimate.estimate import LEAST_SD_M, LEAST_SD_MPS, Effort, PositionFix, Quality
from sim.drive.calls import KeptCall
from sim.drive.limits import BEYOND_M, OVER_MPS, Violations
from sim.drivers.cab import AT_STOP_M, AdviceView, CabView
from sim.plant.kernels import PlantState
from sim.world.disturbances import (
    AnnouncedRestriction,
    BusOutage,
    DelayOnTheWay,
    NodeRestart,
    SensorFault,
    SensorOutage,
    SignalStop,
    TrainAhead,
)
from sim.world.service import Day

PASSED_M: Final = 2000.0
"""Largest distance (m) beyond a stop at which a train has not yet missed it."""


class Calls:
    """The departures and arrivals of a train from stop to stop; call the methods in the order of time."""

    def __init__(self, day: Day) -> None:
        self._day, self._service = day, day.service
        self.departures: list[PlantState] = []
        self.arrivals: list[PlantState] = []

    @property
    def section(self) -> int:
        """Index of the train's section: at a stop, the next section's; at the last stop, the last section's."""
        return min(len(self.arrivals), len(self._service.fronts) - 1)

    @property
    def timetable(self) -> Timetable:
        return self._service.timetables[self.section]

    @property
    def stop_m(self) -> float:
        """Position (m) of the next stop."""
        return self._service.stops[self.section + 1].position_m

    @property
    def missed_m(self) -> float:
        """The position (m) beyond which the train has missed its next stop: far behind it, or at the stop after it."""
        after = self._service.stops[self.section + 2 :][:1]
        return min([self.stop_m + PASSED_M, *(stop.position_m - AT_STOP_M for stop in after)])

    @property
    def finished(self) -> bool:
        """Whether the train has arrived at the last stop."""
        return len(self.arrivals) == len(self._service.fronts)

    @property
    def waits(self) -> bool:
        """Whether the train is at a stop, before its departure."""
        return not self.finished and len(self.departures) == len(self.arrivals)

    def may_depart(self, now_s: float) -> bool:
        """Whether a train that waits at a stop may depart now; True for a train that does not wait."""
        return not self.waits or now_s >= self._ready_s()

    def _ready_s(self) -> float:
        """Earliest departure (s): timetable or end of the dwell, whichever is later, plus the delay at this stop."""
        ready_s = self._service.clock_s(self.timetable.departure_ns)
        if self.arrivals:
            ready_s = max(ready_s, self.arrivals[-1].time_s + self._service.dwells_s[self.section])
        return ready_s + self._day.held_s[self.section]

    def take(self, before: PlantState, after: PlantState) -> str | None:
        """Record a departure or an arrival between two states; returns a sentence about it, or None.

        A train that stands beyond the stop has arrived as well.
        """
        if self.waits:
            if after.speed_mps > 0:
                early = "" if before.time_s >= self._ready_s() else ", before it was cleared"
                self.departures.append(before)
                return self._said("departed", self.section, before.time_s, self.timetable.departure_ns) + early
        elif not self.finished and after.speed_mps <= 0 and self.stop_m - after.s_m <= AT_STOP_M:
            stop, due_ns = self.section + 1, self.timetable.arrival_ns
            self.arrivals.append(after)
            return self._said("arrived", stop, after.time_s, due_ns)
        return None

    def _said(self, what: str, stop: int, time_s: float, due_ns: int) -> str:
        return f"{what} {self._service.stops[stop].name}, {time_s - self._service.clock_s(due_ns):+.1f} s"

    def kept(self) -> Iterator[KeptCall]:
        """The times and positions of the calls of the finished run at its stops."""
        service = self._service
        stood_m = (service.stops[0].position_m, *(state.s_m for state in self.arrivals))
        for i, (stop, due_arrival_ns, due_departure_ns) in enumerate(service.due()):
            yield KeptCall(
                name=stop.name,
                s_m=stop.position_m,
                due_arrival_ns=due_arrival_ns,
                due_departure_ns=due_departure_ns,
                arrived_ns=service.moment_ns(self.arrivals[i - 1].time_s) if i else 0,
                departed_ns=service.moment_ns(self.departures[i].time_s) if i < len(service.timetables) else 0,
                stood_m=stood_m[i],
            )


class Watch:
    """The check of a run's states for violations; call the methods in the order of time."""

    def __init__(self, length_m: float) -> None:
        self._length_m = length_m
        self._passed: set[float] = set()
        self._is_over = False
        self.found = Violations()
        """The violations of the run so far."""

    def take(
        self,
        state: PlantState,
        span_s: float,
        *,
        signal_m: float,
        limit_mps: float,
        temporary: Sequence[Restriction],
    ) -> list[str]:
        """Check a state that lasted `span_s` against a signal at danger, the line's limit and temporary limits.

        Returns a sentence about each new violation.
        """
        return [*self._signal(state, signal_m), *self._speed(state, span_s, limit_mps, temporary)]

    def _signal(self, state: PlantState, signal_m: float) -> list[str]:
        beyond_m = state.s_m - signal_m
        if beyond_m <= BEYOND_M:
            return []
        is_new = signal_m not in self._passed
        self._passed.add(signal_m)
        furthest_m = max(self.found.beyond_signal_m, beyond_m)
        self.found = replace(self.found, signals_passed=len(self._passed), beyond_signal_m=furthest_m)
        return [f"signal at km {signal_m / KM:.1f} passed at danger"] if is_new else []

    def _speed(self, state: PlantState, span_s: float, limit_mps: float, temporary: Sequence[Restriction]) -> list[str]:
        here = [x.limit_mps for x in temporary if x.is_under(state.s_m, state.s_m, self._length_m)]
        allowed_mps = min([limit_mps, *here])
        was_over, over_mps = self._is_over, state.speed_mps - allowed_mps
        self._is_over = over_mps > OVER_MPS
        if not self._is_over:
            return []
        over_s, most_mps = self.found.over_limit_s + span_s, max(self.found.over_limit_mps, over_mps)
        self.found = replace(self.found, over_limit_s=over_s, over_limit_mps=most_mps)
        return [] if was_over else [f"{kmh(state.speed_mps):.0f} km/h where {kmh(allowed_mps):.0f} are allowed"]


DELAY_EVERY_S = 10
COMPARED_EVERY_S = 35.0
"""Interval (s) at which a display of the deviation alone is updated; the display of SBB is updated every 30 to 40 s."""


class Surroundings:
    """The surroundings of a train in a run; call the methods in the order of time."""

    def __init__(self, day: Day) -> None:
        self._service = day.service
        self.news, self.calls = DayNews(day), Calls(day)
        self._localisation = SimulatedLocalisation(day)
        self._effort_random = np.random.default_rng([day.seed, FORCE_STREAM])
        line = day.service.line
        self._limit, self._over_train = _Steps(line.limits_mps), _Steps(line.line_limits_mps)
        self._gradient = _Steps(day.service.route.gradients_ratio)
        self._late_s = math.nan
        self.watch = Watch(day.plant.vehicle.train_length_m)
        self._compared_s, self._deviation_s = -math.inf, math.nan
        # Without restrictions an empty list is sent, because a node without a list must not advise.
        self._sent: tuple[tuple[Any, ...] | None, tuple[Any, ...]] = (None, ())

    def measure(self, state: PlantState) -> list[Heard]:
        """The measured values of the sensors in a state; to be called once a tick, even if the values are not sent."""
        fix, noise_ratio = self._localisation.measure(state), self._service.scenario.sensors.force_noise_ratio
        self._late_s = self._delay_s(state)
        measured: list[Heard] = [] if fix is None else [PositionHeard(fix=fix)]
        if noise_ratio is not None:
            electric, friction = (1.0 + noise_ratio * self._effort_random.standard_normal(2)).tolist()
            effort = Effort(
                time_ns=self._service.moment_ns(state.time_s),
                force_el_n=electric * state.force_el_n,
                force_friction_n=friction * state.force_friction_n,
            )
            measured.append(EffortHeard(effort=effort))
        return measured

    def operators(self, tick: int, now_ns: int, state: PlantState) -> Iterator[Heard]:
        """The operators' messages that reach the node at a tick: delay (at intervals), new restrictions and targets."""
        if tick % DELAY_EVERY_S == 1:
            yield DelayHeard(time_ns=now_ns, delay_s=self._delay_s(state))
        before, self._sent = self._sent, (self.news.told, self.news.targets)
        if self.news.told != before[0]:
            yield RestrictionsHeard(time_ns=now_ns, restrictions=self.news.told)
        if self.news.targets != before[1]:
            yield TargetsHeard(time_ns=now_ns, targets=self.news.targets)

    def compared_s(self, state: PlantState) -> float:
        """The lateness of the train (s) when a display of the deviation alone was last updated."""
        if state.time_s >= self._compared_s + COMPARED_EVERY_S:
            self._compared_s, self._deviation_s = state.time_s, self._delay_s(state)
        return self._deviation_s

    def _delay_s(self, state: PlantState) -> float:
        """The lateness (s; early < 0) against the plan for the timetable; a waiting train is never early."""
        calls, service = self.calls, self._service
        if calls.finished:
            return calls.arrivals[-1].time_s - service.clock_s(calls.timetable.arrival_ns)
        run = service.planned[calls.section].trajectory
        departure_s = service.clock_s(calls.timetable.departure_ns)
        late_s = state.time_s - departure_s - float(np.interp(state.s_m, run.s_m, run.t_s))
        return max(late_s, 0.0) if calls.waits else late_s

    def cab(self, state: PlantState, shown: AdviceView | None, cause: int = 0) -> CabView:
        """The driver's view in a state, with the advice on the display (None: no advice, because of `cause`)."""
        calls, news, timetable = self.calls, self.news, self.calls.timetable
        return CabView(
            state.time_s,
            state.s_m,
            state.speed_mps,
            self._limit.at(state.s_m),
            calls.stop_m,
            self._service.clock_s(timetable.departure_ns),
            self._service.clock_s(timetable.arrival_ns),
            calls.may_depart(state.time_s),
            news.signal_m,
            news.shown,
            shown,
            cause,
            self._late_s,
            self._gradient.at(state.s_m),
            state.force_el_n,
            state.force_friction_n,
        )

    def follow(self, before: PlantState, after: PlantState, span_s: float) -> list[str]:
        """Record arrivals, departures and violations in a motion that took `span_s`; returns a sentence about each."""
        called = self.calls.take(before, after)
        violated = self.watch.take(
            after,
            span_s,
            signal_m=self.news.signal_m,
            limit_mps=self._over_train.at(after.s_m),
            temporary=self.news.holding(after.time_s),
        )
        return violated if called is None else [called, *violated]


class _Steps:
    """A quantity in steps (a limit in m/s, a gradient) by the position of the train's head, fast to look up."""

    def __init__(self, stretches: Stretches) -> None:
        self._at_m: list[float] = stretches.start_m.tolist()
        self._value: list[float] = stretches.value.tolist()

    def at(self, s_m: float) -> float:
        return self._value[max(bisect_right(self._at_m, s_m) - 1, 0)]


NODE_DOWN_S = 2.0
"""Time (s) after a restart for which the node does not answer."""


class DayNews:
    """The messages and signals known to driver and node; call the methods once a second, in the order of time."""

    def __init__(self, day: Day) -> None:
        self._day, self._length_m = day, day.service.vehicle.train_length_m
        self._signals_ahead: tuple[SignalStop | TrainAhead, ...] = (*day.of(SignalStop), *day.of(TrainAhead))
        self._seen_s: dict[SignalStop | TrainAhead, float] = {}
        self._cleared: set[SignalStop | TrainAhead] = set()
        self._waiting_restarts = sorted(day.of(NodeRestart), key=lambda x: x.at_s)
        self._down_until_s = -math.inf
        self._faults_to_come: list[SensorOutage | BusOutage] = [*day.of(SensorOutage), *day.of(BusOutage)]
        self.signal_m = math.inf
        """Position (m) of the next signal at danger that the driver sees; inf if there is none."""
        self.targets: tuple[Target, ...] = ()
        """Targets of traffic management that are in force."""
        self.told: tuple[Restriction, ...] = ()
        """Announced restrictions, until the train's tail has left them; `holding` returns those in force."""
        self.shown: tuple[Restriction, ...] = ()
        """Restrictions that the driver obeys: the announced ones in force, and those known to the driver alone."""

    def update(self, state: PlantState) -> list[str]:
        """Update signals, targets, restrictions and outages for a state; returns a sentence about each new one."""
        return [
            *self._signals(state),
            *self._traffic(state),
            *self._restrictions(state),
            *self._outages(state.time_s),
        ]

    def holding(self, now_s: float) -> list[Restriction]:
        """The announced restrictions in force at a time of the run's clock (s)."""
        now_ns = self._day.service.moment_ns(now_s)
        return [one for one in self.told if one.holds_at(now_ns)]

    def restart_due(self, now_s: float) -> bool:
        """Whether the node is to be killed now; True once for each restart."""
        if not self._waiting_restarts or now_s < self._waiting_restarts[0].at_s:
            return False
        self._waiting_restarts.pop(0)
        self._down_until_s = now_s + NODE_DOWN_S
        return True

    def cut_off(self, now_s: float) -> bool:
        """Whether no message reaches the node, or no node is running."""
        return now_s < self._down_until_s or any(_lasts(x, now_s) for x in self._day.of(BusOutage))

    def _signals(self, state: PlantState) -> list[str]:
        events = []
        for signal in self._signals_ahead:
            at, clears_s = f"signal at km {signal.at_m / KM:.1f}", self._clears_s(signal)
            in_sight = state.s_m >= signal.at_m - signal.seen_m
            if signal not in self._seen_s and in_sight and not state.time_s >= clears_s:
                self._seen_s[signal] = state.time_s
                events.append(f"{at} at danger")
            if signal in self._seen_s and signal not in self._cleared and state.time_s >= self._clears_s(signal):
                self._cleared.add(signal)
                events.append(f"{at} clear")
        self.signal_m = min((x.at_m for x in self._seen_s if x not in self._cleared), default=math.inf)
        return events

    def _clears_s(self, signal: SignalStop | TrainAhead) -> float:
        if isinstance(signal, TrainAhead):
            return signal.clears_s
        return self._seen_s.get(signal, math.inf) + signal.clears_after_s

    def _traffic(self, state: PlantState) -> list[str]:
        """Update the targets; returns a sentence for each new one. A train that meets them finds signals clear."""
        before = self.targets
        due = tuple(
            Target(s_m=x.s_m, earliest_ns=x.earliest_ns, latest_ns=x.latest_ns, reason=f"passing {x.name}")
            for x in self._day.service.passings
            if not x.wish and (x.earliest_ns or x.latest_ns) and state.s_m < x.s_m
        )
        ahead = tuple(
            Target(
                s_m=x.at_m - x.seen_m,
                earliest_ns=self._day.service.moment_ns(x.clears_s),
                reason=f"signal at km {x.at_m / KM:.1f}",
            )
            for x in self._day.of(TrainAhead)
            if x.at_m - x.told_m <= state.s_m < x.at_m and state.time_s < x.clears_s
        )
        self.targets = (*due, *ahead)
        return [
            f"target: not at km {x.s_m / KM:.1f} before {self._day.service.clock_s(x.earliest_ns):.0f} s"
            for x in ahead
            if x not in before
        ]

    def _restrictions(self, state: PlantState) -> list[str]:
        """Update the restrictions, which end when the tail has left them; returns a sentence about each new one."""
        before, ahead = self.told, state.s_m - self._length_m
        moment_ns = self._day.service.moment_ns
        self.told = tuple(
            x.restriction(moment_ns)
            for x in self._day.of(AnnouncedRestriction)
            if x.from_m - x.announced_m <= state.s_m and ahead <= x.to_m
        )
        counting = (x for x in self.told if x.counts_at(moment_ns(state.time_s)))
        slow = (Restriction(x.from_m, x.to_m, x.speed_mps) for x in self._day.of(DelayOnTheWay) if ahead <= x.to_m)
        self.shown = (*counting, *slow)
        return [f"restriction to {x.words}" for x in self.told if x not in before]

    def _outages(self, now_s: float) -> list[str]:
        begun = [x for x in self._faults_to_come if x.from_s <= now_s]
        self._faults_to_come = [x for x in self._faults_to_come if x not in begun]
        return [
            f"{f'localisation: {x.fault}' if isinstance(x, SensorOutage) else 'bus outage'}, {x.for_s:.0f} s"
            for x in begun
        ]


def _lasts(fault: SensorOutage | BusOutage, now_s: float) -> bool:
    return fault.from_s <= now_s < fault.from_s + fault.for_s


CORRELATION_S = 30.0
"""Correlation time (s, assumption) of the wandering error of a receiver's position."""
STREAM, FORCE_STREAM = 2, 3
"""Streams of a seed's random numbers: positions and efforts. Stream 1 is for disturbances; drivers have others."""


class SimulatedLocalisation:
    """The localisation of a run; call `measure` once a tick, in the order of time."""

    def __init__(self, day: Day) -> None:
        self._sensors, self._faults = day.service.scenario.sensors, day.of(SensorOutage)
        self._service = day.service
        self._random = np.random.default_rng([day.seed, STREAM])
        self._keep = math.exp(-1.0 / CORRELATION_S)
        self._offset_m = 0.0
        self._last: PositionFix | None = None

    def measure(self, state: PlantState) -> PositionFix | None:
        """The position that localisation reports in a state; None in a dropout."""
        fix = self._fix(state)
        for fault in self._faults:
            if _lasts(fault, state.time_s):
                if fault.fault is SensorFault.DROPOUT:
                    return None
                fix = self._faulty(fix, fault)
        self._last = fix
        return fix

    def _fix(self, state: PlantState) -> PositionFix:
        sensors = self._sensors
        wander, noise = self._random.standard_normal(2).tolist()
        spread_m = sensors.position_noise_m * math.sqrt(1.0 - self._keep**2)
        self._offset_m = self._keep * self._offset_m + spread_m * wander
        moving = state.speed_mps > 0
        return PositionFix(
            time_ns=self._service.moment_ns(state.time_s),
            s_m=state.s_m + (self._offset_m if moving else 0.0),
            speed_mps=max(state.speed_mps + sensors.speed_noise_mps * noise, 0.0) if moving else 0.0,
            uncertainty_m=max(sensors.position_noise_m, LEAST_SD_M),
            speed_uncertainty_mps=max(sensors.speed_noise_mps, LEAST_SD_MPS),
        )

    def _faulty(self, fix: PositionFix, fault: SensorOutage) -> PositionFix:
        """The position that a faulty receiver reports; its stated accuracy includes noise, but no jump or freezing."""
        if fault.fault is SensorFault.JUMP:
            return replace(fix, s_m=fix.s_m + fault.size_m)
        if fault.fault is SensorFault.NOISE:
            off_m = fault.size_m * float(self._random.standard_normal())
            spread_m = math.hypot(fix.uncertainty_m, fault.size_m)
            return replace(fix, s_m=fix.s_m + off_m, uncertainty_m=spread_m, quality=Quality.DEGRADED)
        return replace(self._last or fix, time_ns=fix.time_ns)
