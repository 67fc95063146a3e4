"""How a run kept its stops: departures, arrivals, and which section the train is on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from das.advice.advice import Timetable
from sim.drivers.cab import AT_STOP_M
from sim.plant.plant import PlantState
from sim.world.day import Day


@dataclass(frozen=True, kw_only=True)
class KeptCall:
    """How a run kept one stop; times are in s on the run's clock.

    `due_s` is the timetable's arrival, at the first stop its departure. `arrived_s` is NaN at the first stop,
    `departed_s` at the last. `missed_m` is how far beyond the stop the train stood.
    """

    name: str
    due_s: float
    arrived_s: float
    departed_s: float
    missed_m: float

    @property
    def late_s(self) -> float:
        """How late the train arrived; at the first stop, how late it left (early < 0)."""
        return (self.departed_s if math.isnan(self.arrived_s) else self.arrived_s) - self.due_s


class Calls:
    """Follows a train from stop to stop; its methods are to be called in the order of time."""

    def __init__(self, day: Day) -> None:
        self._day, self._service = day, day.service
        self.departures: list[PlantState] = []
        self.arrivals: list[PlantState] = []

    @property
    def section(self) -> int:
        """Index of the section the train is on. At a stop it is the next section's, at the last stop the last one's."""
        return min(len(self.arrivals), len(self._service.fronts) - 1)

    @property
    def timetable(self) -> Timetable:
        return self._service.timetables[self.section]

    @property
    def stop_m(self) -> float:
        """Position (m) of the next stop."""
        return self._service.stops[self.section + 1].position_m

    @property
    def finished(self) -> bool:
        """Whether the train has arrived at the last stop."""
        return len(self.arrivals) == len(self._service.fronts)

    @property
    def waits(self) -> bool:
        """Whether the train is at a stop, before its departure."""
        return not self.finished and len(self.departures) == len(self.arrivals)

    def may_depart(self, now_s: float) -> bool:
        """Whether a train that waits at a stop may depart now (True for a train that does not wait)."""
        return not self.waits or now_s >= self._ready_s()

    def _ready_s(self) -> float:
        """When the train may depart: not before the timetable's departure, the end of the dwell, and what delays it
        further."""
        ready_s = self._service.clock_s(self.timetable.departure_ns)
        if self.arrivals:
            ready_s = max(ready_s, self.arrivals[-1].time_s + self._service.scenario.dwell_s)
        return ready_s + self._day.held_s[self.section]

    def take(self, before: PlantState, after: PlantState) -> str | None:
        """Note a departure or an arrival between two states; a sentence about it, or None. A stand beyond the stop
        counts."""
        if self.waits:
            if after.speed_mps > 0:
                self.departures.append(before)
                return self._said("departed", self.section, before.time_s, self.timetable.departure_ns)
        elif not self.finished and after.speed_mps <= 0 and self.stop_m - after.s_m <= AT_STOP_M:
            stop, due_ns = self.section + 1, self.timetable.arrival_ns
            self.arrivals.append(after)
            return self._said("arrived", stop, after.time_s, due_ns)
        return None

    def _said(self, what: str, stop: int, time_s: float, due_ns: int) -> str:
        return f"{what} {self._service.stops[stop].name}, {time_s - self._service.clock_s(due_ns):+.1f} s"

    def kept(self) -> Iterator[KeptCall]:
        """How the finished run kept each of its stops."""
        service, nan = self._service, math.nan
        due_ns = [service.timetables[0].departure_ns, *(t.arrival_ns for t in service.timetables)]
        arrived = [nan, *(state.time_s for state in self.arrivals)]
        departed = [*(state.time_s for state in self.departures), nan]
        missed = [0.0, *(s.s_m - x.position_m for s, x in zip(self.arrivals, service.stops[1:], strict=True))]
        for i, stop in enumerate(service.stops):
            yield KeptCall(
                name=stop.name,
                due_s=service.clock_s(due_ns[i]),
                arrived_s=arrived[i],
                departed_s=departed[i],
                missed_m=missed[i],
            )
