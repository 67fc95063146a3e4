"""The pictures of a report: speeds, lanes of states and energy over distance, dark on white, for any colour vision."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from das.domain.units import KM, KMH, kmh, kwh
from das.drawing.colors import look_of
from sim.drive.causes import APART_MPS
from sim.drive.comparison import AlignedDrives, result
from sim.drive.events import bookmarks
from sim.drive.series import QUANTITIES, STYLES
from sim.meanings import COMPARED, LIGHT, Meaning
from sim.recording.course import DrivenCourse, Floats, Times
from sim.review.first_page import DriveFinding
from sim.review.scene import MODE_LANES, Lane, ReviewScene, Trace, lanes

LINE_RATIO: Final = 0.8
"""Width of a line in a picture, as a share of its width in rerun."""
SMALL: Final = 8.0
LETTER_SHARE: Final = 0.0085
"""Width of a letter of a stop's name, as a share of the axis of a page or of a wider picture."""
NAMES_AT_POINTS: Final = (17.0, 29.0)
"""Two rows (points above an axis) for the names of stops, over the legend. A name without room in the first row goes
into the second; a name without room there is left out."""

Along = Callable[[Times], Floats]
"""A function that returns the places of times (ns) on an axis."""


def curve(axis: Any, name: str, x: Floats, values: Floats) -> None:
    """Draw a series in its style, unless it has no value."""
    style = STYLES[name]
    if np.isfinite(values).any():
        axis.plot(
            x, values, color=LIGHT.of[style.meaning], linewidth=LINE_RATIO * style.width,
            drawstyle="steps-post" if style.held else "default", label=style.label,
            zorder=2.5 if name == "speed/limit" else 2.0,
        )  # fmt: skip


def lane_rows(axis: Any, lanes: Sequence[Lane], end_ns: int, along: Along) -> dict[str, str]:
    """Draw lanes of states up to a moment (ns), each in a row; return the colours of the states that need a legend."""
    named: dict[str, str] = {}
    axis.set_ylim(len(lanes), 0.0)
    axis.set_yticks(np.arange(len(lanes)) + 0.5, [lane.name for lane in lanes])
    axis.tick_params(axis="y", length=0.0, labelcolor=INK)
    axis.grid(visible=False, axis="y")
    for row, lane in enumerate(lanes):
        for change, following in pairwise([*lane.changes, lane.changes[-1]._replace(time_ns=end_ns)]):
            start, end = along(np.array([change.time_ns, following.time_ns]))
            if change.state:
                color = lane.color(change.state, LIGHT)
                axis.broken_barh([(start, end - start)], (row + 0.08, 0.84), facecolor=color, edgecolor=color, lw=0.8)
                if len(lane.colors) > 2 and lane.name != "no advice":
                    named.setdefault(change.state, color)
    return named


def name_stops(
    axis: Any,
    stops: Sequence[tuple[str, float]],
    at_points: tuple[float, ...] = NAMES_AT_POINTS,
) -> None:
    """Write the names of stops (name, place on the axis) above the axis, as far as they do not cover each other."""
    low, high = axis.get_xlim()
    letter = LETTER_SHARE * max(1.0, PAGE_WIDTH_IN / axis.figure.get_figwidth())
    ends = [-1.0] * len(at_points)
    for name, place in sorted(stops, key=lambda stop: stop[1]):
        share, width = (place - low) / (high - low), letter * (len(name) + 1)
        start = min(max(share - 0.5 * width, 0.0), 1.0 - width)
        row = next((row for row, end in enumerate(ends) if start >= end), None)
        if not 0.0 <= share <= 1.0 or row is None:
            continue
        ends[row] = start + width
        axis.annotate(
            name, (start + 0.5 * width, 1.0), (0.0, at_points[row]), xycoords="axes fraction",
            textcoords="offset points", ha="center", color=INK, fontsize=SMALL + 1.0,
        )  # fmt: skip


INK: Final = LIGHT.ink
PAGE_WIDTH_IN: Final = 9.0
TEXT_POINTS: Final = 8.5
EDGE_M: Final = 50.0
"""Distance (m) by which a stop that is drawn may lie beyond the ends of the drawn part of the line."""


def light_figure(heights_in: Sequence[float]) -> tuple[Figure, list[Any]]:
    """A figure with axes of these heights (inches), one below the other; they share the horizontal axis."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, sum(heights_in) + 0.7), layout="constrained", facecolor=LIGHT.background)
    FigureCanvasAgg(figure)
    ratios = list(heights_in)
    axes = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0].tolist()
    for axis in axes:
        axis.grid(color=LIGHT.grid, linewidth=0.6)
        axis.set_axisbelow(True)
        axis.tick_params(colors=INK, labelsize=TEXT_POINTS)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def named(axis: Any, *, x: str = "", y: str = "") -> None:
    """Name the axes of a picture, with their units."""
    if x:
        axis.set_xlabel(x, color=INK, fontsize=TEXT_POINTS)
    if y:
        axis.set_ylabel(y, color=INK, fontsize=TEXT_POINTS)


def page_legend(axis: Any, patches: Mapping[str, str] | None = None, *, columns: int = 4, at: float = 1.0) -> None:
    """Draw the legend, of the curves or of `patches` (name → colour), above the axes, where it covers no curve.

    `at` is its place as a multiple of the axes' height.
    """
    looks: dict[str, Any] = {"ncols": columns, "borderaxespad": 0.2, "handlelength": 2.4}
    if patches is not None:
        handles = [Patch(color=color, label=name) for name, color in patches.items()]
        looks = {"handles": handles, "ncols": 8, "borderaxespad": 0.1, "handlelength": 1.0, "columnspacing": 1.2}
    if patches is not None or axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="lower left", bbox_to_anchor=(0.0, at), frameon=False, fontsize=TEXT_POINTS, labelcolor=INK, **looks
        )


def stops(
    axis: Any,
    places: Sequence[tuple[str, float]],
    *,
    written: bool = True,
    at_points: tuple[float, ...] = NAMES_AT_POINTS,
) -> None:
    """Mark stops (name, position in m); if `written`, with their names above the axes, over a legend there."""
    for _, s_m in places:
        axis.axvline(s_m / KM, color=INK, linewidth=0.6, alpha=0.4)
    if written:
        name_stops(axis, [(name, s_m / KM) for name, s_m in places], at_points)


def as_image(figure: Figure) -> str:
    """A figure as a data URL (SVG), which embeds it in a page; the same figure gives the same URL."""
    content = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "das"}):  # fixes the ids inside the SVG, which are random otherwise
        figure.savefig(content, format="svg", metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(content.getvalue()).decode()}"


SHOWN_IN: Final = 0.3
"""Height (in) of the lane for the display's content of a compared drive."""


def comparison_figure(aligned: AlignedDrives) -> Figure:
    """Compared drives over the position: speeds with the results, contents of displays, and time and lost energy
    compared with the first drive."""
    shown = [(one, lane) for one in aligned.drives for lane in lanes(one.drive) if lane.name == "shown"]
    figure, axes = light_figure((2.6, *(SHOWN_IN for _ in shown), 1.3, 1.3))
    (speed, *told), (time, energy) = axes[:-2], axes[-2:]
    at_km = aligned.s_m / KM
    curve(speed, "speed/limit", at_km, kmh(aligned.limit_mps))
    for i, drive in enumerate(aligned.drives):
        style = {**look_of(i, COMPARED), "linewidth": 1.4}
        label = f"{drive.label}: {result(aligned, i)}" if i else drive.label
        speed.plot(at_km, kmh(aligned.speed_mps[i]), label=label, **style)
        if i:
            time.plot(at_km, aligned.time_s[i] - aligned.time_s[0], **style)
            energy.plot(at_km, kwh(aligned.lost_j[i] - aligned.lost_j[0]), **style)
    modes: dict[str, str] = {}
    for axis, (on_track, lane) in zip(told, shown, strict=True):
        course = on_track.drive.table.course

        def along(time_ns: Times, course: DrivenCourse = course) -> Floats:
            return course.at(time_ns, course.s_m) / KM

        modes |= lane_rows(axis, [lane], int(course.time_ns[-1]), along)
        axis.set_title(on_track.label, loc="right", color=INK, fontsize=TEXT_POINTS, pad=2.0)
    if modes:
        page_legend(told[0], modes, at=1.6)  # above the name of the drive
    for axis in (time, energy):
        axis.axhline(0.0, color=COMPARED[0], linewidth=1.0)
    legs = aligned.drives[0].drive.energy.legs
    places = [(legs[0].start.name, legs[0].start.s_m), *((leg.end.name, leg.end.s_m) for leg in legs)]
    common = [(name, s_m) for name, s_m in places if aligned.s_m[0] - EDGE_M <= s_m <= aligned.s_m[-1] + EDGE_M]
    for axis in (speed, time, energy):
        stops(axis, common, written=axis is speed)
    speed.set_ylim(0.0, 1.08 * float(np.nanmax(kmh(aligned.limit_mps))))
    speed.set_xlim(at_km[0] - 0.2, at_km[-1] + 0.2)
    named(speed, y=QUANTITIES["speed"].title)
    named(time, y="time against\nthe first, s")
    named(energy, y="energy lost against\nthe first, kWh", x="position, km")
    page_legend(speed)
    return figure


SPEEDS: Final = ("speed/limit", "speed/same_times", "speed/advised", "speed/shown", "speed/driven")
"""The series of the axis of speed, in drawing order."""
HEIGHTS_IN: Final = {"speed": 3.2, "modes": 0.22, "deviation": 1.0, "apart": 1.1}
"""Heights (in) of the axes over distance by their quantities, and of a lane of modes."""
FIRST_IN: Final = (7.2, 1.4, 0.4)
"""Width of the picture on the first page, and heights of its axes (in): as on paper, so that words are readable."""
NUMBERS_AT: Final = (1.48, 1.3, 1.12)
"""Heights of the numbers of the findings, as multiples of the highest speed."""
LEAST_SHARE: Final = 0.004
"""Least width of a drawn finding, as a share of the axis."""
OTHERS: Final = ("speed/same_times", "speed/optimum", "speed/shown", "speed/advised")
"""Candidates for the curve next to the drive in the picture on the first page: the first that exists is drawn."""
MOST_APART_KMH: Final = 15.0
"""Largest difference (km/h) of actual minus shown speed that is drawn; larger ones lie at the edge of the axis."""


def first_figure(scene: ReviewScene, found: Sequence[DriveFinding]) -> Figure:
    """Speed over distance on the first page: the limit, the drive, and one other trajectory.

    The places of each finding are grey stretches with its number; temporary restrictions are dashed. Below are the
    places where more energy was lost than by the optimum, if that is known.
    """
    lost = [trace for trace in scene.over_distance(("place/lost",)) if not scene.drive.energy.not_comparable]
    figure, axes = light_figure(FIRST_IN[1 : 2 + len(lost)])
    figure.set_figwidth(FIRST_IN[0])
    axis = axes[0]
    other = next((trace.name for trace in scene.over_distance(OTHERS)), OTHERS[0])
    for trace in scene.over_distance(("speed/limit", other, "speed/driven")):
        _draw(axis, trace)
        if trace.name == other:  # distinguishable in print without colours
            axis.get_lines()[-1].set_linestyle((0, (4.0, 1.2)))
    _restrictions(axis, scene)
    top_kmh = max((scene.extent("speed") or (0.0, 0.0))[1], 1.0)
    axis.set_ylim(0.0, 1.6 * top_kmh)
    reach_km = (axis.get_xlim()[1] - axis.get_xlim()[0]) * LEAST_SHARE
    for number, one in enumerate(found, start=1):
        for place in one.places:
            middle_km = (place.start_m + place.end_m) / 2.0 / KM
            half_km = max((place.end_m - place.start_m) / KM, reach_km) / 2.0
            axis.axvspan(middle_km - half_km, middle_km + half_km, color=INK, alpha=0.1, linewidth=0.0)
            _number(axis, number, middle_km, NUMBERS_AT[number - 1] * top_kmh, 8.5)
    stops(axis, _stops(scene), at_points=(4.0, 16.0))
    for below, trace in zip(axes[1:], lost, strict=True):
        _lost(below, trace)
        named(below, y="lost,\nkWh/km")
    looks = {"frameon": False, "fontsize": TEXT_POINTS, "labelcolor": INK}
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower left", ncols=4, **looks)
    named(axes[-1], x="position, km")
    named(axis, y=QUANTITIES["speed"].title)
    return figure


def _lost(axis: Any, trace: Trace) -> None:
    axis.stairs(trace.values[:-1], trace.s_m / KM, fill=True, color=LIGHT.of[STYLES[trace.name].meaning], linewidth=0.0)
    axis.axhline(0.0, color=INK, linewidth=0.7)


def _restrictions(axis: Any, scene: ReviewScene) -> None:
    """Draw the temporary restrictions that the train reached, in the colour of the limit, dashed."""
    trip, first = scene.trip, True
    for limit in scene.drive.temporary_limits:
        one = limit.restriction
        inside = (trip.s_m >= one.start_m) & (trip.s_m <= one.end_m) & limit.holds_at(trip.time_ns)
        if not inside.any():
            continue
        ends_km, at_kmh = scene.km_at(trip.time_ns[inside][[0, -1]]), np.full(2, kmh(one.limit_mps))
        axis.plot(ends_km, at_kmh, color=LIGHT.background, linewidth=2.2, zorder=2.6)
        axis.plot(
            ends_km, at_kmh, linestyle=(0, (1.5, 1.0)), color=LIGHT.of[Meaning.LIMIT], linewidth=2.2, zorder=2.7,
            label="temporary restriction" if first else None,
        )  # fmt: skip
        first = False


def _number(axis: Any, number: int, at_km: float, at_kmh: float, points: float) -> None:
    axis.text(
        at_km, at_kmh, str(number), ha="center", va="center", fontsize=points, color=LIGHT.background,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": INK, "edgecolor": "none"},
    )  # fmt: skip


def drive_figure(scene: ReviewScene) -> Figure:
    """The drive over distance: speeds, the modes advised and shown, lateness, and actual minus shown speed."""
    lanes = [lane for lane in scene.lanes if lane.name in MODE_LANES]
    below = list(scene.over_distance(("deviation/operator", "apart/shown")))
    heights_in = [HEIGHTS_IN["speed"], *([HEIGHTS_IN["modes"] * len(lanes)] if lanes else [])]
    figure, axes = light_figure([*heights_in, *(HEIGHTS_IN[trace.quantity] for trace in below)])
    _speeds(axes[0], scene)
    if lanes:
        modes = lane_rows(axes[1], lanes, int(scene.trip.time_ns[-1]), scene.km_at)
        page_legend(axes[1], modes)
    for axis, trace in zip(axes[len(heights_in) :], below, strict=True):
        _below(axis, trace)
    for axis in axes:
        stops(axis, _stops(scene), written=axis is axes[0])
    named(axes[-1], x="position, km")
    return figure


def _draw(axis: Any, trace: Trace) -> None:
    curve(axis, trace.name, trace.s_m / KM, trace.values)
    named(axis, y=QUANTITIES[trace.quantity].title)


def _speeds(axis: Any, scene: ReviewScene) -> None:
    for trace in scene.over_distance(SPEEDS):
        _draw(axis, trace)
    top = (scene.extent("speed") or (0.0, 0.0))[1]
    axis.set_ylim(0.0, 1.18 * max(top, 1.0))
    for number, one in enumerate(bookmarks(scene.drive.events), start=1):
        _number(axis, number, one.s_m / KM, (1.13, 1.07)[number % 2] * top, 6.5)
    page_legend(axis, columns=5)


def _below(axis: Any, trace: Trace) -> None:
    if trace.quantity != "apart":
        _draw(axis, trace)
        axis.axhline(0.0, color=INK, linewidth=0.7)
        return
    over_kmh, values = APART_MPS / KMH, np.clip(trace.values, -MOST_APART_KMH, MOST_APART_KMH)
    axis.axhspan(-over_kmh, over_kmh, color=LIGHT.grid, alpha=0.6, linewidth=0.0)
    _draw(axis, trace._replace(values=values))
    reach = 1.1 * max(float(np.nanmax(np.abs(values))), 2.0 * over_kmh)
    axis.set_ylim(-reach, reach)


def place_figure(scene: ReviewScene) -> Figure:
    """The energy above the optimum by place: per 100 m, and summed from the start."""
    figure, (bars, total) = light_figure((1.5, 1.4))
    lost, summed = scene.over_distance(("place/lost", "sum/lost"))
    _lost(bars, lost)
    named(bars, y=QUANTITIES[lost.quantity].title)
    _draw(total, summed)
    for axis in (bars, total):
        stops(axis, _stops(scene), written=axis is bars)
    named(total, x="position, km")
    return figure


def _stops(scene: ReviewScene) -> list[tuple[str, float]]:
    return [(call.name, call.s_m) for call in scene.drive.calls if call.reached]
