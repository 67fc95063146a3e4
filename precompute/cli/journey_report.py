"""A journey file in words: its table, what is unusual in it, and the time each section has to spare."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from das.command_line.printing import new_table
from das.domain.journey import Call, Journey, Passing, Window, clock
from das.domain.route import Route
from das.domain.units import KM, kmh
from das.offline.journey.plan import JourneyPlanner

if TYPE_CHECKING:
    from rich.table import Table

LEGEND = {
    "…": "open",
    "~": "a preferred time: reported, not enforced",
    "dwell": "least time at the stop",
}
SPARE_LEGEND = {
    "least": "least running time",
    "available": "from the earliest departure to the latest arrival, or to the latest departure less the dwell",
}
FAST_MPS = 100.0
"""Fastest mean speed (m/s) of a train between two stops."""
NEAR_M, AT_M = 1000.0, 20.0
"""A point with the name of a route's stop is meant to be there if it is near, and is there if it is at it (m)."""


def table(journey: Journey) -> Table:
    """The points of a journey with their windows."""
    found = new_table(journey.name, ("stop or passing",), ("km", "arrives", "departs or passes", "dwell\ns"))
    for point in journey.points:
        place = f"{point.position_m / KM:.3f}"
        if isinstance(point, Call):
            dwell = f"{point.dwell_s:g}" if point.dwell_s else ""
            found.add_row(point.name, place, _words(point.arrival), _words(point.departure), dwell)
        else:
            tolerance = f" ± {point.tolerance_s:g} s" if point.wish else ""
            found.add_row(f"  {'~ ' if point.wish else ''}{point.name}", place, "", _words(point.window) + tolerance)
    return found


def _words(window: Window) -> str:
    early, late = (clock(x)[:-2] if math.isfinite(x) else "…" for x in (window.earliest_s, window.latest_s))
    return "" if early == late == "…" else early if early == late else f"{early} – {late}"


def as_dict(journey: Journey) -> dict[str, Any]:
    """The journey for programs: times (s) on its clock, None where a window is open."""
    return {
        "id": journey.id,
        "name": journey.name,
        "points": [_point(point) for point in journey.points],
    }


def _point(point: Call | Passing) -> dict[str, Any]:
    place = {"name": point.name, "position_m": point.position_m}
    if isinstance(point, Call):
        windows = {"arrival": _bounds(point.arrival), "departure": _bounds(point.departure)}
        return {**place, "kind": "stop", **windows, "dwell_s": point.dwell_s}
    wish = {"wish": point.wish, "tolerance_s": point.tolerance_s}
    return {**place, "kind": "passing", "window": _bounds(point.window), **wish}


def _bounds(window: Window) -> list[float | None]:
    return [x if math.isfinite(x) else None for x in (window.earliest_s, window.latest_s)]


def warnings(journey: Journey, route: Route | None) -> list[str]:
    """What is unusual in a journey, one line each."""
    return [*_hurried(journey, route), *_without_dwell(journey), *([] if route is None else _misplaced(journey, route))]


def _hurried(journey: Journey, route: Route | None) -> Iterator[str]:
    """Sections that no train can drive in the time that they have."""
    for start, end in pairwise(journey.calls):
        available_s = available(start, end)
        least_s = (end.position_m - start.position_m) / FAST_MPS
        if route is not None:
            least_s = max(least_s, _least_s(route, start.position_m, end.position_m))
        if available_s < least_s:
            way_m = end.position_m - start.position_m
            speed = kmh(way_m / max(available_s, 1e-3))
            yield (
                f"{start.name} – {end.name}: {available_s:.0f} s for {way_m / KM:.1f} km: "
                f"{speed:.0f} km/h on average, more than {'the limits allow' if route else 'a train runs'}"
            )


def available(start: Call, end: Call) -> float:
    """The longest time (s) between two stops that their windows leave; inf where one is open."""
    latest_s = min(end.arrival.latest_s, end.departure.latest_s - end.dwell_s)
    return latest_s - max(start.departure.earliest_s, start.arrival.earliest_s + start.dwell_s)


def _least_s(route: Route, first_m: float, last_m: float) -> float:
    """The time (s) over a section at the line's limits all the way."""
    edges = [first_m, *(float(x) for x in route.limits_mps.start_m if first_m < x < last_m), last_m]
    return sum((b - a) / float(route.limits_mps.at(a)) for a, b in pairwise(edges))


def _without_dwell(journey: Journey) -> Iterator[str]:
    bare = [call.name for call in journey.calls[1:-1] if not call.dwell_s]
    if bare:
        yield f"no dwell_s at {', '.join(bare)}: plans stop there for no time"
    open_calls = [x.name for x in journey.calls[1:-1] if x.departure == Window() and x.arrival == Window()]
    if open_calls and len(open_calls) == len(journey.calls) - 2:
        yield "no intermediate stop has a time: only the departure and the last arrival are kept"


def _misplaced(journey: Journey, route: Route) -> Iterator[str]:
    """Points with the name of a stop of the route that are not at it."""
    for point in journey.points:
        for stop in route.stops:
            away_m = abs(stop.position_m - point.position_m)
            if stop.name.casefold() == point.name.casefold() and AT_M < away_m < NEAR_M:
                at = f"km {stop.position_m / KM:.3f} of {route.id}, not at km {point.position_m / KM:.3f}"
                yield f'{point.name}: the stop of this name is at {at}; stop = "{stop.name}" puts it there'


def spare_times(planner: JourneyPlanner) -> list[dict[str, Any]]:
    """For each section its least running time and the time that its windows leave (s); None where they are open."""
    found = []
    for section in planner.sections:
        least_s, left_s = float(section.least_s[-1]), available(section.start, section.end)
        open_end = math.isinf(left_s)
        found.append(
            {
                "from": section.start.name,
                "to": section.end.name,
                "least_s": least_s,
                "available_s": None if open_end else left_s,
                "spare_ratio": None if open_end else left_s / least_s - 1.0,
            }
        )
    return found


def spare_table(journey: Journey, rows: list[dict[str, Any]]) -> Table:
    """The least and the available time of each section."""
    found = new_table(journey.name, ("section",), ("least\ns", "available\ns", "spare\n%"))
    for row in rows:
        left = (
            ("…", "")
            if row["available_s"] is None
            else (f"{row['available_s']:.0f}", f"{100 * row['spare_ratio']:.1f}")
        )
        found.add_row(f"{row['from']} – {row['to']}", f"{row['least_s']:.0f}", *left)
    return found
