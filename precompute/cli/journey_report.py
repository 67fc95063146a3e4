"""A journey file as a table and as a picture, warnings about unusual values, and the spare time of each section."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from das.command_line.printing import new_table
from das.domain.journey import Window
from das.domain.route import Route
from das.domain.units import KM, kmh
from das.drawing.colors import BACKGROUND, GRID, INK, SEVERAL, SOFT
from das.offline.asked_journey import Call, Journey, Passing, clock
from das.offline.journey import JourneyPlanner

if TYPE_CHECKING:
    from rich.table import Table

    from das.drawing.picture import Picture

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
"""Distances (m) from a route's stop of the same name within which a point is probably meant to be at the stop, and
within which it is at the stop."""


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
    return {"id": journey.id, "name": journey.name, "points": [_point(point) for point in journey.points]}


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
    """Warnings about a journey, one line each."""
    return [*_hurried(journey, route), *_without_dwell(journey), *([] if route is None else _misplaced(journey, route))]


def _hurried(journey: Journey, route: Route | None) -> Iterator[str]:
    """Sections that no train can drive in their time."""
    for start, end in pairwise(journey.calls):
        available_s = available(start, end)
        first_m, last_m = start.position_m, end.position_m
        least_s = (last_m - first_m) / FAST_MPS
        if route is not None:  # at the line's limits all the way
            edges = [first_m, *(float(x) for x in route.limits_mps.start_m if first_m < x < last_m), last_m]
            at_limits_s = sum((b - a) / float(route.limits_mps.at(a)) for a, b in pairwise(edges))
            least_s = max(least_s, at_limits_s)
        if available_s < least_s:
            way_m, allowed = end.position_m - start.position_m, "the limits allow" if route else "a train runs"
            speed = f"{kmh(way_m / max(available_s, 1e-3)):.0f} km/h on average, more than {allowed}"
            yield f"{start.name} – {end.name}: {available_s:.0f} s for {way_m / KM:.1f} km: {speed}"


def available(start: Call, end: Call) -> float:
    """The longest time (s) between two stops that their windows allow; inf if one is open."""
    latest_s = min(end.arrival.latest_s, end.departure.latest_s - end.dwell_s)
    return latest_s - max(start.departure.earliest_s, start.arrival.earliest_s + start.dwell_s)


def _without_dwell(journey: Journey) -> Iterator[str]:
    bare = [call.name for call in journey.calls[1:-1] if not call.dwell_s]
    if bare:
        yield f"no dwell_s at {', '.join(bare)}: plans assume stops of 0 s there"
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
    """The least running time and the time that the windows allow (s), for each section; None if they are open."""
    found = []
    for section in planner.sections:
        least_s, left_s = float(section.least_s[-1]), available(section.start, section.end)
        spare = (None, None) if math.isinf(left_s) else (left_s, left_s / least_s - 1.0)
        ends = {"from": section.start.name, "to": section.end.name, "least_s": least_s}
        found.append({**ends, "available_s": spare[0], "spare_ratio": spare[1]})
    return found


def spare_table(journey: Journey, rows: list[dict[str, Any]]) -> Table:
    """The least and the available time of each section."""
    found = new_table(journey.name, ("section",), ("least\ns", "available\ns", "spare\n%"))
    for row in rows:
        left_s, spare = row["available_s"], row["spare_ratio"]
        left = ("…", "") if left_s is None else (f"{left_s:.0f}", f"{100 * spare:.1f}")
        found.add_row(f"{row['from']} – {row['to']}", f"{row['least_s']:.0f}", *left)
    return found


WIDTH_IN, LEAST_IN, IN_PER_POINT = 10.0, 4.2, 0.27
OPEN_S = 90.0
"""Length (s) of the dotted line for the open end of a window."""
NAME_LETTERS, NAME_IN = 30, 0.16
"""Longest name (letters), and least distance (inches) between two names."""
SPEED_SHARE = 0.05
"""Least share of the whole for a path that is labelled with its mean speed."""
ARRIVAL, DEPARTURE, PASSING = SEVERAL[1], SEVERAL[2], SEVERAL[3]
TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0)


def draw_timetable(journey: Journey) -> Picture:
    """The picture of a journey: windows as bars, dwells and the paths between as lines, wishes as hollow marks."""
    from das.drawing.picture import Picture

    height_in = max(LEAST_IN, 1.6 + IN_PER_POINT * len(journey.points))
    figure = Picture(figsize=(WIDTH_IN, height_in))
    axes = figure.add_axes((0.23, 0.4 / height_in, 0.74, 1.0 - 1.25 / height_in))
    _draw_course(axes, journey)
    for call in journey.calls:
        _draw_window(axes, call.position_m / KM, call.arrival, ARRIVAL)
        _draw_window(axes, call.position_m / KM, call.departure, DEPARTURE)
    for passing in journey.passings:
        window, place = passing.tolerated, passing.position_m / KM
        _draw_window(axes, place, window, PASSING)
        middle_s = 0.5 * (window.earliest_s + window.latest_s)
        if math.isfinite(middle_s):
            face = BACKGROUND if passing.wish else PASSING
            axes.plot([middle_s], [place], "o", color=PASSING, markerfacecolor=face, markersize=5, zorder=5)
    _draw_scales(axes, journey, height_in)
    figure.text(0.02, 1.0 - 0.32 / height_in, journey.name, fontsize=12, color=INK, fontweight="bold")
    words = [("arrival, not after", ARRIVAL), ("departure, from … until", DEPARTURE)]
    words += [("passing (hollow: a wish)", PASSING)] if journey.passings else []
    for i, (text, color) in enumerate((*words, ("as timed", SEVERAL[0]))):
        figure.text(0.02 + 0.2 * i, 1.0 - 0.62 / height_in, f"▬ {text}", fontsize=8.5, color=color)
    return figure


def _draw_course(axes: Any, journey: Journey) -> None:
    """Dwells as thick lines and the paths between them as thin ones, with their mean speeds."""
    stands = [(call.position_m / KM, *_stand(call)) for call in journey.calls]
    known = [stand for stand in stands if math.isfinite(stand[1])]
    for place, begin_s, end_s in known:
        axes.plot([begin_s, end_s], [place, place], color=INK, linewidth=3.0, solid_capstyle="butt", zorder=3)
    whole = max(stands[-1][0] - stands[0][0], 1e-9)
    for (a, _, leaves_s), (b, comes_s, _) in pairwise(known):
        axes.plot([leaves_s, comes_s], [a, b], color=SEVERAL[0], linewidth=1.6, zorder=2)
        if comes_s > leaves_s and (b - a) / whole > SPEED_SHARE:
            speed = f"{kmh((b - a) * KM / (comes_s - leaves_s)):.0f} km/h"
            middle = (0.5 * (leaves_s + comes_s), 0.5 * (a + b))
            axes.annotate(speed, middle, (8, -3), textcoords="offset points", fontsize=7.5, color=SOFT)


def _stand(call: Call) -> tuple[float, float]:
    """Begin and end (s) of the stand at a stop, as far as its windows state them; else NaN."""
    arrives_s, departs_s = call.arrival.latest_s, call.departure.earliest_s
    if math.isfinite(arrives_s) and math.isfinite(departs_s):
        return min(arrives_s, departs_s), departs_s
    if math.isfinite(departs_s):
        return departs_s - call.dwell_s, departs_s
    return (arrives_s, arrives_s + call.dwell_s) if math.isfinite(arrives_s) else (math.nan, math.nan)


def _draw_window(axes: Any, place: float, window: Window, color: str) -> None:
    """A window as a bar; an open end is dotted."""
    early_s, late_s = window.earliest_s, window.latest_s
    at = [place, place]
    if math.isfinite(early_s) and math.isfinite(late_s):
        axes.plot([early_s, late_s], at, color=color, linewidth=8, alpha=0.55, solid_capstyle="butt", zorder=4)
    known_s, open_s = (early_s, early_s + OPEN_S) if math.isfinite(early_s) else (late_s, late_s - OPEN_S)
    if not math.isfinite(known_s):
        return
    if not math.isfinite(late_s - early_s):
        axes.plot(sorted((known_s, open_s)), at, color=color, linewidth=2, linestyle=(0, (1, 1.4)), zorder=1)
    axes.plot([known_s], [place], "|", color=color, markersize=9, markeredgewidth=1.6, zorder=4)


def _draw_scales(axes: Any, journey: Journey, height_in: float) -> None:
    """Names and kilometres on the left, clock times below, and a line at each stop."""
    points = journey.points
    first, last = points[0].position_m / KM, points[-1].position_m / KM
    least = NAME_IN / (height_in - 1.25) * (last - first)
    kept: list[tuple[float, str]] = []
    for point in sorted(points, key=lambda point: not isinstance(point, Call)):
        place = point.position_m / KM
        if all(abs(place - other) >= least for other, _ in kept):
            name = point.name if len(point.name) <= NAME_LETTERS else f"{point.name[: NAME_LETTERS - 1]}…"
            kept.append((place, f"{name}  {place:.1f}"))
    axes.set_yticks([place for place, _ in kept], [name for _, name in kept], fontsize=8, color=INK)
    axes.set_ylim(last + 0.02 * (last - first), first - 0.02 * (last - first))
    low_s, high_s = axes.get_xlim()
    step_s = next((step for step in TICKS_S if (high_s - low_s) / step <= 10), TICKS_S[-1])
    ticks = [step_s * i for i in range(math.ceil(low_s / step_s), math.floor(high_s / step_s) + 1)]
    axes.set_xticks(ticks, [f"{int(t // 3600)}:{int(t // 60) % 60:02}" for t in ticks], fontsize=8, color=INK)
    axes.set_xlim(low_s, high_s)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
