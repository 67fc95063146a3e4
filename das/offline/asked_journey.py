"""The journey asked for: the stops and passing points of one train with their required times, and its files.

The format of the files is explained in docs/reference/file-formats.md.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import Fields
from das.domain.files.routes import MOST_STOPS, SCHEMA_VERSION
from das.domain.journey import ANY_TIME, Window
from das.domain.route import POSITION_TOLERANCE_M, Route, Stop
from das.domain.summary import Summary
from das.domain.units import KMH

LEAST_SPACING_M = 1.0
"""Least distance (m) between two points of a journey."""
LARGEST_TIME_S = 1e10
"""Largest time (s) on a journey's clock, which may count from 1970."""
TOLERANCE_S = 30.0
"""Default tolerance (s) of a passing that is a wish: timetables are rounded to minutes."""
_CLOCK = re.compile(r"(\d{1,3}):([0-5]\d)(?::([0-5]\d(?:\.\d+)?))?")


class Held(StrEnum):
    """The bound of a window at which a time lies."""

    FREE = "free"
    EARLIEST = "earliest"
    LATEST = "latest"
    FIXED = "fixed"
    """The window is one time."""


def held_at(window: Window, time_s: float, tolerance_s: float) -> Held:
    """The bound of a window at which a time lies, within a tolerance."""
    early, late = (abs(bound_s - time_s) <= tolerance_s for bound_s in (window.earliest_s, window.latest_s))
    if early and late:
        return Held.FIXED
    return Held.EARLIEST if early else Held.LATEST if late else Held.FREE


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
        start = Call(name=first.name, position_m=first.position_m, departure=Window.at(0.0))
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


def bound_of_window(source: Path, key: str, time_s: float) -> float:
    """A time (s) on a journey's clock, infinite if the window is open; InputError if beyond `LARGEST_TIME_S`."""
    if math.isfinite(time_s) and abs(time_s) > LARGEST_TIME_S:
        raise InputError(source, key, time_s, f"a time of at most {LARGEST_TIME_S:g} s, or an open window")
    return time_s


def journey_of(fields: Fields, route: Route | None) -> Journey:
    """The journey on a route that the fields of a file describe; without a route, all points must state positions.

    Raises DasError or InputError (file, key, value, expectation) if it is unusable.
    """
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "journey", "stops", "passings"])
    main = fields.table("journey")
    main.check_keys(["id", "name", "source", "description", "route", "mode"])
    if route is not None and main.text("route", route.id) != route.id:
        raise main.error("route", main.text("route"), f"{route.id}, the route it is planned on")
    points: list[Call | Passing] = [_call(table, route) for table in fields.tables("stops", MOST_STOPS)]
    points += [_passing(table, route) for table in fields.tables("passings", MOST_STOPS)]
    return Journey(
        id=main.name("id"),
        name=main.name("name"),
        source=str(fields.source),
        points=tuple(sorted(points, key=lambda point: point.position_m)),
        mode=main.name("mode", ""),
    )


def _call(fields: Fields, route: Route | None) -> Call:
    times = ("arrival_earliest", "arrival", "departure", "departure_latest")
    fields.check_keys([*_place_keys(fields), *_time_keys(fields, *times), *fields.quantity_keys({"dwell": "time"})])
    name, position_m = _place(fields, route)
    return Call(
        name=name,
        position_m=position_m,
        arrival=_window(fields, "arrival_earliest", "arrival"),
        departure=_window(fields, "departure", "departure_latest"),
        dwell_s=fields.quantity("dwell", "time", 0.0),
    )


def _passing(fields: Fields, route: Route | None) -> Passing:
    times = _time_keys(fields, "earliest", "latest", "time")
    own = ["wish", *fields.quantity_keys({"lowest_speed": "speed", "highest_speed": "speed", "tolerance": "time"})]
    fields.check_keys([*_place_keys(fields), *times, *own])
    name, position_m = _place(fields, route)
    wish = fields.flag("wish", False)
    for key in () if wish else fields.given_keys("tolerance", "time"):
        raise fields.error(key, fields.data[key], "no tolerance without wish = true")
    return Passing(
        name=name,
        position_m=position_m,
        window=_passing_window(fields),
        wish=wish,
        tolerance_s=fields.within("tolerance", "time", TOLERANCE_S, (0.0, 3600.0)) if wish else 0.0,
        lowest_mps=fields.quantity("lowest_speed", "speed", 0.0),
        highest_mps=fields.quantity("highest_speed", "speed", math.inf, unbounded=True),
    )


def _passing_window(fields: Fields) -> Window:
    """The window of a passing: from `earliest` to `latest`, or exactly at `time`."""
    exact = [key for key in _time_keys(fields, "time") if key in fields.data]
    if not exact:
        return _window(fields, "earliest", "latest")
    for key in _time_keys(fields, "earliest", "latest"):
        if key in fields.data:
            raise fields.error(key, fields.data[key], f"no window together with {exact[0]}")
    return _window(fields, "time", "time")


def _place_keys(fields: Fields) -> list[str]:
    return ["stop", "name", *fields.quantity_keys({"position": "length"})]


def _place(fields: Fields, route: Route | None) -> tuple[str, float]:
    """Name and position (m) of a point: those of the stop of the route that the file names, or those in the file."""
    if not fields.has("stop"):
        return fields.name("name"), fields.quantity("position", "length")
    for key in ("name", *fields.given_keys("position", "length")):
        if fields.has(key):
            raise fields.error(key, fields.data[key], "no name or position together with stop (a stop of the route)")
    wanted = fields.data["stop"]
    if route is None:
        raise fields.error("stop", wanted, "name and position, because no route is given; or give the route (--route)")
    number = isinstance(wanted, int) and not isinstance(wanted, bool)
    try:
        stop = route.stop(str(wanted) if number else fields.text("stop"))
    except InputError:
        raise fields.error("stop", wanted, "name or number of a stop of the route") from None
    except DasError as error:
        raise fields.error("stop", wanted, f"a stop of the route ({error})") from None
    return stop.name, stop.position_m


def _time_keys(fields: Fields, *names: str) -> list[str]:
    return [*names, *fields.quantity_keys(dict.fromkeys(names, "time"))]


def _window(fields: Fields, earliest: str, latest: str) -> Window:
    return Window(earliest_s=_time_s(fields, earliest, -math.inf), latest_s=_time_s(fields, latest, math.inf))


def _time_s(fields: Fields, name: str, default: float) -> float:
    """A time (s): a text (`arrival = "07:12:30"`, from midnight) or a quantity (`arrival_s = 450`)."""
    value: Any = fields.data.get(name, MISSING)
    if value is MISSING:
        time_s = fields.quantity(name, "time", default, unbounded=True)
        return bound_of_window(fields.source, f"{fields.prefix}{name}", time_s)
    match = _CLOCK.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise fields.error(name, value, f'a time in quotes like "07:12:30", or {name}_s')
    for key in fields.given_keys(name, "time"):
        raise fields.error(key, fields.data[key], f"only one of {name} and {key}")
    hours, minutes, seconds = match.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds or 0.0)
