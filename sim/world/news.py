"""What comes up on the way: signals, restrictions, faults, and who is told about each of them when."""

from __future__ import annotations

import math

from das.cab.heard import Target
from das.domain.restriction import Restriction
from das.domain.units import KM, KMH
from sim.plant.plant import PlantState
from sim.world.day import Day
from sim.world.disturbances import (
    AnnouncedRestriction,
    BusOutage,
    DelayOnTheWay,
    NodeRestart,
    SensorOutage,
    SignalStop,
    TrainAhead,
)

NODE_DOWN_S = 2.0
"""A node that is restarted does not answer for this long (s)."""


class DayNews:
    """Keeps what is known by now; its methods are to be called once a second, in the order of time."""

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
        """Restrictions of which driver and node are told, until the tail has left them; `holding` says which hold."""
        self.shown: tuple[Restriction, ...] = ()
        """Restrictions that the driver keeps to: those of `told` that count now, and stretches on which only he must be
        slow."""

    def update(self, state: PlantState) -> list[str]:
        """Take note of a state; a sentence about each thing that is new."""
        return [
            *self._signals(state),
            *self._traffic(state),
            *self._restrictions(state),
            *self._outages(state.time_s),
        ]

    def holding(self, now_s: float) -> list[Restriction]:
        """The restrictions that hold at a time of the run's clock (s), of those that are told."""
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
        """Whether no message gets through to the node, or there is no node."""
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
        """Update the targets: traffic management wants the train to see the signal clear. A sentence about each new
        one."""
        before = self.targets
        self.targets = tuple(
            Target(
                s_m=x.at_m - x.seen_m,
                earliest_ns=self._day.service.moment_ns(x.clears_s),
                reason=f"signal at km {x.at_m / KM:.1f}",
            )
            for x in self._day.of(TrainAhead)
            if x.at_m - x.told_m <= state.s_m < x.at_m and state.time_s < x.clears_s
        )
        return [
            f"target: not at km {x.s_m / KM:.1f} before {self._day.service.clock_s(x.earliest_ns):.0f} s"
            for x in self.targets
            if x not in before
        ]

    def _restrictions(self, state: PlantState) -> list[str]:
        """Update the restrictions: a restriction is over when the tail has left it. A sentence about each new one."""
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
        return [
            f"restriction to {x.limit_mps / KMH:.0f} km/h, km {x.start_m / KM:.1f} to {x.end_m / KM:.1f}"
            f"{x.window_words()}"
            for x in self.told
            if x not in before
        ]

    def _outages(self, now_s: float) -> list[str]:
        begun = [x for x in self._faults_to_come if x.from_s <= now_s]
        self._faults_to_come = [x for x in self._faults_to_come if x not in begun]
        return [
            f"{f'localisation: {x.fault}' if isinstance(x, SensorOutage) else 'bus outage'}, {x.for_s:.0f} s"
            for x in begun
        ]


def _lasts(fault: SensorOutage | BusOutage, now_s: float) -> bool:
    return fault.from_s <= now_s < fault.from_s + fault.for_s
