"""How a run keeps to its stops, signals and limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from das.advice.advice import Timetable
from das.domain.restriction import Restriction
from das.domain.units import KM, kmh
from sim.drive.calls import KeptCall
from sim.drive.limits import BEYOND_M, OVER_MPS, Violations
from sim.drivers.cab import AT_STOP_M
from sim.plant.kernels import PlantState
from sim.world.service import Day

PASSED_M: Final = 2000.0
"""Distance (m) behind a stop above which a train has missed it."""


class Calls:
    """Follows a train from stop to stop; call its methods in the order of time."""

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
        """Beyond this position (m) the train has missed its next stop: far behind it, or at the stop after it."""
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
        """When the train may depart (s): at the timetable's departure or the end of the dwell, whichever is later, plus
        the day's delay at this stop."""
        ready_s = self._service.clock_s(self.timetable.departure_ns)
        if self.arrivals:
            ready_s = max(ready_s, self.arrivals[-1].time_s + self._service.way.dwells_s[self.section])
        return ready_s + self._day.held_s[self.section]

    def take(self, before: PlantState, after: PlantState) -> str | None:
        """Note a departure or an arrival between two states; returns a sentence about it, or None.

        A train that stands beyond the stop has arrived too.
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
        """When and where the finished run called at each of its stops."""
        service = self._service
        tables, stops = service.timetables, service.stops
        due_arrivals_ns, due_departures_ns = (
            (0, *(t.arrival_ns for t in tables)),
            (*(t.departure_ns for t in tables), 0),
        )
        stood_m = (stops[0].position_m, *(state.s_m for state in self.arrivals))
        for i, stop in enumerate(stops):
            yield KeptCall(
                name=stop.name,
                s_m=stop.position_m,
                due_arrival_ns=due_arrivals_ns[i],
                due_departure_ns=due_departures_ns[i],
                arrived_ns=service.moment_ns(self.arrivals[i - 1].time_s) if i else 0,
                departed_ns=service.moment_ns(self.departures[i].time_s) if i < len(tables) else 0,
                stood_m=stood_m[i],
            )


class Watch:
    """Watches the states of a run for violations; call its methods in the order of time."""

    def __init__(self, length_m: float) -> None:
        self._length_m = length_m
        self._passed: set[float] = set()
        self._beyond_m, self._over_s, self._over_mps = 0.0, 0.0, 0.0
        self._is_over = False

    @property
    def found(self) -> Violations:
        """What the run has violated so far."""
        return Violations(
            signals_passed=len(self._passed),
            beyond_signal_m=self._beyond_m,
            over_limit_s=self._over_s,
            over_limit_mps=self._over_mps,
        )

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
        self._beyond_m = max(self._beyond_m, beyond_m)
        if signal_m in self._passed:
            return []
        self._passed.add(signal_m)
        return [f"signal at km {signal_m / KM:.1f} passed at danger"]

    def _speed(self, state: PlantState, span_s: float, limit_mps: float, temporary: Sequence[Restriction]) -> list[str]:
        here = [x.limit_mps for x in temporary if x.is_under(state.s_m, state.s_m, self._length_m)]
        allowed_mps = min([limit_mps, *here])
        was_over, over_mps = self._is_over, state.speed_mps - allowed_mps
        self._is_over = over_mps > OVER_MPS
        if not self._is_over:
            return []
        self._over_s += span_s
        self._over_mps = max(self._over_mps, over_mps)
        if was_over:
            return []
        return [f"{kmh(state.speed_mps):.0f} km/h where {kmh(allowed_mps):.0f} are allowed"]
