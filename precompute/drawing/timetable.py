"""Draws a journey as a time–distance picture: where the train must be when, with the windows of its times."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from das.domain.journey import Call, Journey, Window
from das.domain.units import KM, kmh
from das.drawing.colors import BACKGROUND, GRID, INK, SEVERAL
from das.drawing.picture import Picture

WIDTH_IN, LEAST_IN, IN_PER_POINT = 10.0, 4.2, 0.27
OPEN_S = 90.0
"""The open end of a window is drawn so long (s), as a dotted line."""
NAME_LETTERS, NAME_IN = 30, 0.16
"""Longest name (letters), and least distance (inches) between two names."""
SPEED_SHARE = 0.05
"""Least share of the whole for a path beside which the mean speed is written."""
ARRIVAL, DEPARTURE, PASSING = SEVERAL[1], SEVERAL[2], SEVERAL[3]
TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0)


def draw_timetable(journey: Journey) -> Picture:
    """The picture of a journey: windows as bars, dwells and the ways between as lines, wishes as hollow marks."""
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
    _draw_key(figure, height_in, passings=bool(journey.passings))
    return figure


def _draw_course(axes: Any, journey: Journey) -> None:
    """Dwells as thick lines and the ways between them as thin ones, with their mean speeds."""
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
            axes.annotate(speed, middle, (8, -3), textcoords="offset points", fontsize=7.5, color="#555555")


def _stand(call: Call) -> tuple[float, float]:
    """From when to when the train stands at a stop (s), as far as its windows say; NaN if they say nothing."""
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
            kept.append((place, f"{_shortened(point.name)}  {place:.1f}"))
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


def _shortened(name: str) -> str:
    """A name that fits beside the picture."""
    return name if len(name) <= NAME_LETTERS else f"{name[: NAME_LETTERS - 1]}…"


def _draw_key(figure: Any, height_in: float, *, passings: bool) -> None:
    """What the colours mean, in one line below the title."""
    words = [("arrival, not after", ARRIVAL), ("departure, from … until", DEPARTURE)]
    words += [("passing (hollow: a wish)", PASSING)] if passings else []
    for i, (text, color) in enumerate((*words, ("as timed", SEVERAL[0]))):
        figure.text(0.02 + 0.2 * i, 1.0 - 0.62 / height_in, f"▬ {text}", fontsize=8.5, color=color)
