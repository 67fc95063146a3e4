"""Positions and efforts that come at moments of their own, paired to samples of one moment each."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.calibration_settings import SampleSettings
from das.estimate.effort import Effort
from das.estimate.window import Sample


class _Place(NamedTuple):
    """A measured position of the head (m) and a speed (m/s), and whether the sender says that they are usable."""

    time_ns: int
    s_m: float
    speed_mps: float
    usable: bool


class Pairing:
    """Makes samples of positions and efforts; a position waits until the effort after it is heard."""

    def __init__(self, vehicle: Vehicle, line_length_m: float, settings: SampleSettings) -> None:
        self._vehicle, self._line_length_m, self._settings = vehicle, line_length_m, settings
        self._places: deque[_Place] = deque(maxlen=settings.most_waiting)
        self._before: Effort | None = None
        self._effort: Effort | None = None

    def add_effort(self, effort: Effort) -> None:
        """Take over measured forces; impossible, repeated and late ones are ignored."""
        last = self._effort
        if not self._is_possible(effort):
            return
        if last is not None and effort.time_ns <= last.time_ns:
            if (last.time_ns - effort.time_ns) * NS <= self._settings.longest_gap_s:
                return
            last = None  # the clock was set back
        self._before, self._effort = last, effort

    def add_position(self, time_ns: int, s_m: float, speed_mps: float, *, usable: bool) -> None:
        """Take over a position of the head (m) and a speed (m/s); waiting positions of later times are dropped."""
        if self._places and time_ns < self._places[-1].time_ns:
            self._places.clear()
        self._places.append(_Place(time_ns, s_m, speed_mps, usable))

    def samples(self) -> Iterator[Sample | None]:
        """Yield the samples that can be made now; None stands for a position that cannot be used.

        A sample has the force of its moment, linear between the efforts before and after. A position without an effort
        before and after it is passed over.
        """
        effort, before = self._effort, self._before
        if effort is None:
            return
        while self._places and self._places[0].time_ns <= effort.time_ns:
            place = self._places.popleft()
            if not self._is_plausible(place):
                yield None
                continue
            forces = self._forces_at(place.time_ns, before, effort)
            if forces is not None:
                yield Sample(place.time_ns * NS, place.s_m, place.speed_mps, *forces)

    def _is_possible(self, effort: Effort) -> bool:
        """Whether a train like this one can have such forces; false for forces that are not a number."""
        train = self._vehicle
        electric_n = max(train.traction.max_force_n, train.electric_brake.max_force_n)
        most_n = self._settings.possible_force_ratio * (electric_n + train.friction_brake_force_n)
        return abs(effort.force_el_n) <= most_n and -most_n <= effort.force_friction_n <= 0

    def _is_plausible(self, place: _Place) -> bool:
        """Whether a position is usable, on the line, and no faster than the train; false for what is not a number."""
        on_line = 0 <= place.s_m <= self._line_length_m
        fastest_mps = self._settings.overspeed_ratio * self._vehicle.max_speed_mps
        return place.usable and on_line and abs(place.speed_mps) <= fastest_mps

    def _forces_at(self, time_ns: int, before: Effort | None, effort: Effort) -> tuple[float, float] | None:
        """Return the whole wheel force and its friction part (N) at a moment; None where it is not between efforts."""
        longest_gap_s = self._settings.longest_gap_s
        if time_ns == effort.time_ns:
            share = 1.0
            before = before or effort
        elif before is None or time_ns < before.time_ns or (effort.time_ns - before.time_ns) * NS > longest_gap_s:
            return None
        else:
            share = (time_ns - before.time_ns) / (effort.time_ns - before.time_ns)
        electric_n = before.force_el_n + share * (effort.force_el_n - before.force_el_n)
        friction_n = before.force_friction_n + share * (effort.force_friction_n - before.force_friction_n)
        return electric_n + friction_n, friction_n
