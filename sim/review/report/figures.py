"""The pictures of a report: the scene drawn dark on white, with units, for people with any colour vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.domain.units import KM, KMH, KN, kmh, kwh
from sim.drive.attribution.causes import APART_MPS
from sim.drive.events import bookmarks
from sim.drive.series import QUANTITIES, STYLES
from sim.meanings import EFFICIENCY_GREYS, LIGHT, Meaning
from sim.review.canvas import INK, TEXT_POINTS, curve, lane_rows, light_figure, named, page_legend, stops
from sim.review.lanes import MODE_LANES
from sim.review.report.findings import DriveFinding
from sim.review.report.sentences import told_causes
from sim.review.scene import ReviewScene, Trace, meaning_of

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
"""Curves set beside the drive in the picture on the first page: the first of them that there is."""
DRIVEN: Final = LIGHT.of[Meaning.DRIVEN]
EFFICIENCIES: Final = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9)
"""Levels of the efficiency map."""
GRID_POINTS: Final = 90
LEAST_LATE_S: Final = 5.0
"""Least range (s) of the axis of punctuality, so that fractions of a second do not look large."""
BAR_IN: Final = 0.28
MOST_APART_KMH: Final = 15.0
"""Largest difference (km/h) of driven minus shown speed that is drawn; larger ones lie at the edge of the axis."""
FAINT: Final = 0.45
"""Opacity of the bar of a departure; the bar of an arrival is opaque."""


def first_figure(scene: ReviewScene, found: Sequence[DriveFinding]) -> Figure:
    """Speed over distance on the first page: the limit, what was driven, and one trajectory beside it.

    The places of each finding are grey stretches with its number; temporary restrictions are dashed. Below is where
    more energy was lost than by the optimum, if that is known.
    """
    lost = [trace for trace in scene.over_distance(("place/lost",)) if not scene.drive.energy.not_comparable]
    figure, axes = light_figure(FIRST_IN[1 : 2 + len(lost)])
    figure.set_figwidth(FIRST_IN[0])
    axis = axes[0]
    other = next((trace.name for trace in scene.over_distance(OTHERS)), OTHERS[0])
    for trace in scene.over_distance(("speed/limit", other, "speed/driven")):
        _draw(axis, trace)
        if trace.name == other:  # told apart in print without colours
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
    """Draw how much more energy each place lost than in the optimum."""
    axis.stairs(trace.values[:-1], trace.s_m / KM, fill=True, color=LIGHT.of[STYLES[trace.name].meaning], linewidth=0.0)
    axis.axhline(0.0, color=INK, linewidth=0.7)


def _restrictions(axis: Any, scene: ReviewScene) -> None:
    """Draw the temporary restrictions that the train came to, in the colour of the limit, dashed."""
    for number, one in enumerate(scene.restricted_times()):
        ends_km, at_kmh = scene.km_at(np.array([one.start_ns, one.end_ns])), np.full(2, kmh(one.limit_mps))
        axis.plot(ends_km, at_kmh, color=LIGHT.background, linewidth=2.2, zorder=2.6)
        axis.plot(
            ends_km, at_kmh, linestyle=(0, (1.5, 1.0)), color=LIGHT.of[Meaning.LIMIT], linewidth=2.2, zorder=2.7,
            label=None if number else "temporary restriction",
        )  # fmt: skip


def _number(axis: Any, number: int, at_km: float, at_kmh: float, points: float) -> None:
    """Write a number in a dark box."""
    axis.text(
        at_km, at_kmh, str(number), ha="center", va="center", fontsize=points, color=LIGHT.background,
        bbox={"boxstyle": "round,pad=0.15", "facecolor": INK, "edgecolor": "none"},
    )  # fmt: skip


def drive_figure(scene: ReviewScene) -> Figure:
    """The drive over distance: speeds, the modes advised and shown, lateness, and driven minus shown speed."""
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
    """Draw a series over distance in its style, and name the axis."""
    curve(axis, trace.name, trace.s_m / KM, trace.values)
    named(axis, y=QUANTITIES[trace.quantity].title)


def _speeds(axis: Any, scene: ReviewScene) -> None:
    """Draw the speeds and the bookmarks' numbers."""
    for trace in scene.over_distance(SPEEDS):
        _draw(axis, trace)
    top = (scene.extent("speed") or (0.0, 0.0))[1]
    axis.set_ylim(0.0, 1.18 * max(top, 1.0))
    for number, one in enumerate(bookmarks(scene.drive.events), start=1):
        _number(axis, number, one.s_m / KM, (1.13, 1.07)[number % 2] * top, 6.5)
    page_legend(axis, columns=5)


def _below(axis: Any, trace: Trace) -> None:
    """Draw the lateness, or driven minus shown speed, about 0."""
    if trace.quantity != "apart":
        _draw(axis, trace)
        axis.axhline(0.0, color=INK, linewidth=0.7)
        return
    over_kmh, values = APART_MPS / KMH, np.clip(trace.values, -MOST_APART_KMH, MOST_APART_KMH)
    axis.axhspan(-over_kmh, over_kmh, color=LIGHT.grid, alpha=0.6, linewidth=0.0)
    _draw(axis, trace._replace(values=values))
    reach = 1.1 * max(float(np.nanmax(np.abs(values))), 2.0 * over_kmh)
    axis.set_ylim(-reach, reach)


def cause_figure(scene: ReviewScene) -> Figure:
    """The energy above the optimum by cause, as bars in the colours of the causes."""
    assert scene.drive.energy.attribution is not None
    parts = told_causes(scene.drive.energy.attribution)[::-1]
    figure, (axis,) = light_figure((max(BAR_IN * len(parts), 0.8),))
    values = np.array([kwh(energy_j) for _, energy_j in parts])
    colors = [LIGHT.of[meaning_of(cause)] for cause, _ in parts]
    axis.barh([cause.label for cause, _ in parts], values, color=colors, height=0.7)
    reach = max(float(np.abs(values).max(initial=0.0)), 0.1)
    for row, value in enumerate(values):
        axis.text(max(value, 0.0) + 0.01 * reach, row, f"{value:+.1f}", va="center", color=INK, fontsize=8.0)
    axis.set_xlim(min(1.15 * float(values.min(initial=0.0)), 0.0), 1.12 * reach)
    axis.grid(visible=False, axis="y")
    named(axis, x=QUANTITIES["cause"].title)
    return figure


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


def efficiency_figure(scene: ReviewScene) -> Figure:
    """Wheel force of the motors over speed, on the efficiency of the train's traction chain."""
    attribution = scene.drive.energy.attribution
    assert attribution is not None
    assert scene.attribution is not None
    section, vehicle = attribution.legs[0].optimum.section, attribution.inputs.vehicle
    figure, (axis,) = light_figure((3.4,))
    top_mps = min(vehicle.max_speed_mps, 1.1 * max(float(one.leg.motion.speed_mps.max()) for one in attribution.legs))
    speeds = np.linspace(0.5, top_mps, GRID_POINTS)
    pulls, brakes = vehicle.traction_effort_n(speeds), -vehicle.electric_brake_effort_n(speeds)
    shares = np.linspace(0.02, 1.0, GRID_POINTS // 2)
    for envelope in (pulls, brakes):
        force_n, speed_mps = shares[:, None] * envelope[None, :], np.broadcast_to(speeds, (len(shares), len(speeds)))
        if np.abs(envelope).max() > 0:
            _shade(axis, section, force_n, speed_mps)
        axis.plot(kmh(speeds), envelope / KN, color=INK, linewidth=1.0)
    for points in scene.attribution.motors:
        style = STYLES[points.name]
        known = style.label in axis.get_legend_handles_labels()[1]
        axis.plot(
            kmh(points.speed_mps), points.force_n / KN, ".", color=LIGHT.of[style.meaning], markersize=3.0, alpha=0.7,
            label=None if known else style.label, rasterized=True,
        )  # fmt: skip
    axis.axhline(0.0, color=INK, linewidth=0.7)
    axis.set_ylim(1.08 * float(brakes.min()) / KN, 1.08 * float(pulls.max()) / KN)
    named(axis, x=QUANTITIES["speed"].title, y=QUANTITIES["motors"].title)
    page_legend(axis)
    for handle in axis.get_legend().legend_handles:
        handle.set_markersize(8.0)
    return figure


def _shade(axis: Any, section: Any, force_n: Any, speed_mps: Any) -> None:
    """Shade the efficiency of the chain: the share of power that reaches wheels (traction) or collector (braking)."""
    mechanical_w = np.abs(force_n) * speed_mps
    loss_w = section.loss.loss_w(force_n, np.ascontiguousarray(speed_mps))
    pulling = force_n[0, 0] > 0
    efficiency = mechanical_w / (mechanical_w + loss_w) if pulling else (mechanical_w - loss_w) / mechanical_w
    filled = axis.contourf(
        kmh(speed_mps),
        force_n / KN,
        np.clip(efficiency, 0.0, 1.0),
        levels=(0.0, *EFFICIENCIES, 1.0),
        colors=EFFICIENCY_GREYS,
    )
    if pulling:
        bar = axis.figure.colorbar(filled, ax=axis, pad=0.01, fraction=0.04)
        bar.set_label("Efficiency", color=INK, fontsize=8.5)
        bar.ax.tick_params(labelsize=8.0)


def punctuality_figure(scene: ReviewScene) -> Figure:
    """How late the train arrived at and left each stop."""
    made = [call for call in scene.drive.calls if call.reached]
    figure, (axis,) = light_figure((1.6,))
    rows = np.arange(len(made))
    arrived, left = (
        np.array([getattr(call, name) for call in made], dtype=float) for name in ("arrived_late_s", "departed_late_s")
    )
    both = np.isfinite(arrived) & np.isfinite(left)
    for side, name, late, share in ((-1, "arrival", arrived, 1.0), (1, "departure", left, FAINT)):
        shifts = np.where(both, 0.18 * side, 0.0)
        axis.bar(rows + shifts, late, width=0.34, color=DRIVEN, alpha=share, label=name)
        for row, (shift, value) in enumerate(zip(shifts, late, strict=True)):
            if np.isfinite(value):
                axis.text(
                    row + shift, value, f"{value:+.0f}", ha="center", va="bottom" if value >= 0 else "top",
                    color=INK, fontsize=8.0,
                )  # fmt: skip
    axis.axhline(0.0, color=INK, linewidth=0.8)
    axis.set_xticks(rows, [call.name for call in made])
    axis.grid(visible=False, axis="x")
    low, high = axis.get_ylim()
    axis.set_ylim(min(1.25 * low, -LEAST_LATE_S), max(1.25 * high, LEAST_LATE_S))
    named(axis, y=QUANTITIES["deviation"].title)
    page_legend(axis)
    return figure


def _stops(scene: ReviewScene) -> list[tuple[str, float]]:
    """Names and positions (m) of the stops that the train reached."""
    return [(call.name, call.s_m) for call in scene.drive.calls if call.reached]
