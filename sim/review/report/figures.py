"""The pictures of a report: the scene drawn dark on white, with units, for people with any colour vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.domain.units import KM, KMH, kmh
from sim.drive.attribution.causes import APART_MPS
from sim.drive.events import bookmarks
from sim.drive.series import QUANTITIES, STYLES
from sim.meanings import LIGHT, Meaning
from sim.review.canvas import INK, TEXT_POINTS, curve, lane_rows, light_figure, named, page_legend, stops
from sim.review.report.findings import DriveFinding
from sim.review.scene import MODE_LANES, ReviewScene, Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEEDS: Final = ("speed/limit", "speed/same_times", "speed/advised", "speed/shown", "speed/driven")
"""The series of the axis of speed, in drawing order."""
HEIGHTS_IN: Final = {"speed": 3.2, "modes": 0.22, "deviation": 1.0, "apart": 1.1}
"""Heights (in) of the axes over distance by their quantities, and of a lane of modes."""
FIRST_IN: Final = (7.2, 1.4, 0.4)
"""Width of the picture on the first page, and heights of its axes (in): as on paper, so that words are readable."""
NUMBERS_AT: Final = (1.18, 1.12, 1.06)
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
    axis.set_ylim(0.0, 1.24 * top_kmh)
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
    for number, one in enumerate(scene.restricted_times()):
        ends_km, at_kmh = scene.km_at(np.array([one.start_ns, one.end_ns])), np.full(2, kmh(one.limit_mps))
        axis.plot(ends_km, at_kmh, color=LIGHT.background, linewidth=2.2, zorder=2.6)
        axis.plot(
            ends_km, at_kmh, linestyle=(0, (1.5, 1.0)), color=LIGHT.of[Meaning.LIMIT], linewidth=2.2, zorder=2.7,
            label=None if number else "temporary restriction",
        )  # fmt: skip


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
