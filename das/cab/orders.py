"""Checks whether a journey is for this train and line, finds its train, and extracts the data for the legs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

from das.advice.advice import Timetable
from das.cab.heard import JourneyHeard
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_vehicle
from das.domain.journey import OrderedStop
from das.domain.levels import Level
from das.domain.route import Route, Stop
from das.domain.units import NS
from das.domain.vehicle import Vehicle

DAY_NS = 86_400 * 10**9
"""Difference (ns) from the clock; if all times of a journey differ by more, the journey is of another day."""


def is_of_another_day(journey: JourneyHeard, now_ns: int) -> bool:
    """Whether all times of a journey are more than a day from the clock (ns since 1970; 0: not set, so False)."""
    known_ns = [at_ns for stop in journey.stops for at_ns in (stop.arrival_ns, stop.departure_ns) if at_ns > 0]
    return now_ns > 0 and bool(known_ns) and all(abs(at_ns - now_ns) > DAY_NS for at_ns in known_ns)


class Trains:
    """Finds a train by its id and load state, and gives the same object each time.

    `started` is the train that the node was started with, `base` the same train without a load state; `others` are
    names or files of further trains. Raises DasError for a file that cannot be used.
    """

    def __init__(self, started: Vehicle, base: Vehicle, others: Sequence[str] = ()) -> None:
        self._found = {(base.id, ""): base, (started.id, ""): started}
        for name in others:
            vehicle = load_vehicle(name)
            self._found.setdefault((vehicle.id, ""), vehicle)

    @property
    def known(self) -> list[Vehicle]:
        """The trains that have been found so far."""
        return list(self._found.values())

    def find(self, vehicle_id: str, load: str = "") -> Vehicle:
        """The train of an id in a load state (empty: that of the file); DasError if there is none."""
        key = vehicle_id, load
        if key not in self._found and load:
            self._found[key] = self.find(vehicle_id).loaded(load)
        elif key not in self._found:
            # The id is never taken as a path, because it comes over the bus.
            if vehicle_id not in catalogue("vehicles"):
                known = sorted({name for name, _ in self._found} | set(catalogue("vehicles")))
                raise DasError(f"it is for vehicle {vehicle_id!r}, this node knows {', '.join(known)}")
            self._found[key] = load_vehicle(vehicle_id)
        return self._found[key]


@dataclass(frozen=True, kw_only=True)
class Order:
    """An accepted journey: stops, timetables of the legs, train, and loss level (None: the node's own)."""

    stops: tuple[Stop, ...]
    timetables: tuple[Timetable, ...]
    vehicle: Vehicle
    level: Level | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Post:
    """The assignment of this on-board system: the train's name, the route and its direction, and the known trains."""

    train: str
    route: Route
    trains: Trains
    reverse: bool = False

    def accept(self, journey: JourneyHeard) -> Order:
        """The journey as an order; raises DasError if it is not for this train, line or day, or is implausible."""
        if journey.route_id != self.route.id:
            raise DasError(f"it is for route {journey.route_id!r}, this node has {self.route.id!r}")
        if journey.train and journey.train != self.train:
            raise DasError(f"it is for train {journey.train!r}, this node is for {self.train!r}")
        if journey.reversed != self.reverse:
            ordered, own = ("in reverse" if way else "forwards" for way in (journey.reversed, self.reverse))
            raise DasError(f"it is for the route {ordered}, but this node is set to {own}")
        if len(journey.stops) < 2:
            raise DasError(f"it has {len(journey.stops)} stops, expected at least 2")
        _check_times(journey.stops)
        if is_of_another_day(journey, journey.heard_ns):
            both_ns = journey.stops[0].departure_ns, journey.heard_ns
            departs, now = (f"{datetime.fromtimestamp(at_ns * NS, UTC):%Y-%m-%d %H:%M} UTC" for at_ns in both_ns)
            raise DasError(f"it departs on {departs}, more than a day from the node's clock ({now})")
        if journey.level and journey.level not in list(Level):
            raise DasError(f"level {journey.level!r}: expected one of {', '.join(Level)}")
        return Order(
            stops=tuple(Stop(name=stop.name, position_m=stop.s_m) for stop in journey.stops),
            timetables=tuple(
                Timetable(departure_ns=start.departure_ns, arrival_ns=end.arrival_ns)
                for start, end in pairwise(journey.stops)
            ),
            vehicle=self.trains.find(journey.vehicle_id, journey.load),
            level=Level(journey.level) if journey.level else None,
        )


def _check_times(stops: Sequence[OrderedStop]) -> None:
    """Raise DasError for a time before 1970 (0: no time), or if the first departure or the last arrival is missing."""
    for number, stop in enumerate(stops, 1):
        for name, time_ns in (("arrival", stop.arrival_ns), ("departure", stop.departure_ns)):
            if time_ns < 0:
                raise DasError(f"stop {number} has the {name} {time_ns} ns, expected nanoseconds since 1970")
    if not stops[0].departure_ns:
        raise DasError("the first stop has no departure")
    if not stops[-1].arrival_ns:
        raise DasError("the last stop has no arrival")
