"""A journey: the stops and passing points of one train with their required times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple, Self

from das.domain.errors import MISSING, InputError
from das.domain.route import POSITION_TOLERANCE_M, Route, Stop
from das.domain.summary import Summary
from das.domain.units import KMH

LEAST_SPACING_M = 1.0
"""Least distance (m) between two points of a journey."""


class OrderedStop(NamedTuple):
    """A stop of a journey as ordered: its name, its position (m), and its times (ns since 1970; 0: none)."""

    name: str
    s_m: float
    arrival_ns: int = 0
    departure_ns: int = 0


class Held(StrEnum):
    """The bound of a window at which a time lies."""

    FREE = "free"
    EARLIEST = "earliest"
    LATEST = "latest"
    FIXED = "fixed"
    """The window is one time."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """The window of an event (s on the journey's clock); infinite bounds are open."""

    earliest_s: float = -math.inf
    latest_s: float = math.inf

    @classmethod
    def at(cls, time_s: float) -> Self:
        """The window that consists of one time."""
        return cls(earliest_s=time_s, latest_s=time_s)

    def held_at(self, time_s: float, tolerance_s: float) -> Held:
        """The bound of the window at which a time lies, within a tolerance."""
        early, late = (abs(bound_s - time_s) <= tolerance_s for bound_s in (self.earliest_s, self.latest_s))
        if early and late:
            return Held.FIXED
        return Held.EARLIEST if early else Held.LATEST if late else Held.FREE


ANY_TIME = Window()


@dataclass(frozen=True, kw_only=True)
class Call:
    """A stop of the train: the windows of its arrival and departure, and the minimum dwell between them."""

    name: str
    position_m: float
    arrival: Window = ANY_TIME
    departure: Window = ANY_TIME
    dwell_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Passing:
    """A point to be passed within a time window and between two speeds; without a window, a timing point.

    A `wish` is not enforced: plans report whether its window is kept within `tolerance_s` (the rounding of the
    timetable) and the cost of keeping it.
    """

    name: str
    position_m: float
    window: Window = ANY_TIME
    lowest_mps: float = 0.0
    highest_mps: float = math.inf
    wish: bool = False
    tolerance_s: float = 0.0

    @property
    def tolerated(self) -> Window:
        """The window extended by the tolerance at both ends."""
        window, more_s = self.window, self.tolerance_s
        return Window(earliest_s=window.earliest_s - more_s, latest_s=window.latest_s + more_s)

    def missed_s(self, time_s: float) -> float:
        """The deviation (s; late > 0) of a time from the tolerated window; 0 inside it."""
        window = self.tolerated
        return max(time_s - window.latest_s, 0.0) + min(time_s - window.earliest_s, 0.0)


@dataclass(frozen=True, kw_only=True, repr=False)
class Journey(Summary):
    """Stops and passing points in the order of travel; the first and the last are stops.

    All times are on one clock, whose zero depends on the journey (midnight, or the departure). The earliest departure
    from the first stop and the latest arrival at the last stop must be known. `mode` names the mode of the train; ""
    means the default mode of its file.
    """

    id: str
    name: str
    source: str
    points: tuple[Call | Passing, ...]
    mode: str = ""

    def __post_init__(self) -> None:
        for key, ends in (("first point", self.points[:1]), ("last point", self.points[-1:])):
            if len(self.points) < 2 or not isinstance(ends[0], Call):
                found = ends[0].name if ends else MISSING
                raise InputError(self.source, key, found, "a stop (a journey has at least two)")
        self._check_ends(self.calls[0], self.calls[-1])
        for point in self.points:
            _check_point(self.source, point)
        for before, point in pairwise(self.points):
            if not point.position_m >= before.position_m + LEAST_SPACING_M:
                expected = f"at least {LEAST_SPACING_M:g} m after {before.name} ({before.position_m:g} m)"
                raise InputError(self.source, f"position of {point.name}", f"{point.position_m:g} m", expected)
        self._check_order()

    def facts(self) -> dict[str, str]:
        """Name, stops, and the time from the first departure to the last arrival."""
        least_s, most_s = self.calls[0].departure.earliest_s, self.calls[-1].arrival.latest_s
        return {
            "name": self.name,
            "stops": ", ".join(call.name for call in self.calls),
            "departs": clock(least_s),
            "arrives by": clock(most_s),
        }

    @classmethod
    def over_stops(cls, stops: Sequence[Stop], *, time_s: float, dwell_s: float) -> Self:
        """A journey from the first to the last stop in `time_s`, with a dwell of at least `dwell_s` at each stop
        between.

        Only the departure (0 s) and the last arrival are fixed. Raises InputError if the stops do not form a journey.
        """
        first, *inner, last = stops
        calls = [Call(name=x.name, position_m=x.position_m, dwell_s=dwell_s) for x in inner]
        start = Call(name=first.name, position_m=first.position_m, departure=Window(earliest_s=0.0, latest_s=0.0))
        end = Call(name=last.name, position_m=last.position_m, arrival=Window(latest_s=time_s))
        name = f"{first.name} – {last.name}, all stops"
        return cls(id="stops", name=name, source="stops", points=(start, *calls, end))

    @property
    def calls(self) -> tuple[Call, ...]:
        """The stops of the journey."""
        return tuple(point for point in self.points if isinstance(point, Call))

    @property
    def passings(self) -> tuple[Passing, ...]:
        """The points of the journey that are not stops."""
        return tuple(point for point in self.points if isinstance(point, Passing))

    def check_on(self, route: Route) -> None:
        """Raise InputError for a point that does not lie on the route."""
        for point in self.points:
            if not 0 <= point.position_m <= route.length_m + POSITION_TOLERANCE_M:
                expected = f"a position on {route.id}, 0 … {route.length_m:g} m"
                raise InputError(self.source, f"position of {point.name}", f"{point.position_m:g} m", expected)

    def _check_ends(self, first: Call, last: Call) -> None:
        for key, call, unused in (("arrival", first, first.arrival), ("departure", last, last.departure)):
            if unused != ANY_TIME or call.dwell_s:
                given = f"{key} or dwell of {call.name}"
                raise InputError(self.source, given, "given", "none at an end of the journey")
        begins, ends = "an earliest time: the journey begins there", "a latest time: the journey ends by then"
        if not math.isfinite(first.departure.earliest_s):
            raise InputError(self.source, f"departure of {first.name}", MISSING, begins)
        if not math.isfinite(last.arrival.latest_s):
            raise InputError(self.source, f"arrival at {last.name}", MISSING, ends)

    def _check_order(self) -> None:
        """Raise InputError for a latest time that earlier earliest times and dwells make impossible."""
        reached_s, since = -math.inf, ""
        for key, window, dwell_s in self._windows():
            reached_s += dwell_s
            if window.latest_s < reached_s:
                expected = f"at least {reached_s:g} s, because of the earliest time of the {since}"
                raise InputError(self.source, f"{key}, latest", f"{window.latest_s:g} s", expected)
            if window.earliest_s > reached_s:
                reached_s, since = window.earliest_s, key

    def _windows(self) -> Iterator[tuple[str, Window, float]]:
        """Every enforced time in order: its description, its window, and the minimum dwell before it."""
        for point in self.points:
            if isinstance(point, Call):
                yield f"arrival at {point.name}", point.arrival, 0.0
                yield f"departure of {point.name}", point.departure, point.dwell_s
            elif not point.wish:
                yield f"passing {point.name}", point.window, 0.0


def _check_point(source: str, point: Call | Passing) -> None:
    if not math.isfinite(point.position_m):
        raise InputError(source, f"position of {point.name}", point.position_m, "a finite number")
    windows = (point.arrival, point.departure) if isinstance(point, Call) else (point.window,)
    for window in windows:
        # This form also rejects NaN.
        if not (window.earliest_s <= window.latest_s and window.earliest_s < math.inf and window.latest_s > -math.inf):
            shown = f"{window.earliest_s:g} … {window.latest_s:g} s"
            raise InputError(source, f"times of {point.name}", shown, "an earliest time not after the latest")
    if isinstance(point, Call):
        if not 0 <= point.dwell_s < math.inf:
            raise InputError(source, f"dwell of {point.name}", point.dwell_s, "a finite number >= 0")
        return
    if point.wish and point.window == ANY_TIME:
        raise InputError(source, f"times of {point.name}", MISSING, "a time, because the passing is a wish")
    if not (0 <= point.lowest_mps <= point.highest_mps and point.highest_mps > 0 and point.lowest_mps < math.inf):
        shown = f"{point.lowest_mps / KMH:g} … {point.highest_mps / KMH:g} km/h"
        expected = "0 <= lowest speed <= highest speed, and highest speed > 0"
        raise InputError(source, f"speeds of {point.name}", shown, expected)


def clock(time_s: float) -> str:
    """A time as hours, minutes and seconds."""
    tenths = round(10 * abs(time_s))
    sign = "-" if time_s < 0 and tenths else ""
    return f"{sign}{tenths // 36000}:{tenths // 600 % 60:02}:{tenths // 10 % 60:02}.{tenths % 10}"


def file_clock(time_s: float) -> str:
    """A time >= 0 in the notation of journey files, "08:12:30"; after midnight the hours continue beyond 24."""
    whole = round(time_s)
    return f"{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}"
