"""Pictures for paper: dark on white, colours that colour-blind people tell apart, units on every axis."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from das.domain.units import KM, kmh, kwh
from sim.review.canvas import curve, name_stops
from sim.review.colors import LIGHT, SEVERAL
from sim.review.series import QUANTITIES

if TYPE_CHECKING:
    from sim.drive.comparison import AlignedDrives

LINES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
"""Line styles of the drives that are compared, in the order of the drives."""
INK: Final = LIGHT.ink
WIDTH_IN: Final = 9.0
TEXT_POINTS: Final = 8.5
EDGE_M: Final = 50.0
"""A stop beyond the ends of the drawn part of the line by no more than this (m) is drawn as well."""


def light_figure(heights_in: Sequence[float]) -> tuple[Figure, list[Any]]:
    """A figure with axes of these heights (inches), one below the other; they share the horizontal axis."""
    figure = Figure(figsize=(WIDTH_IN, sum(heights_in) + 0.7), layout="constrained", facecolor=LIGHT.background)
    FigureCanvasAgg(figure)
    ratios = list(heights_in)
    axes = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0].tolist()
    for axis in axes:
        plain(axis)
    return figure, axes


def plain(axis: Any) -> None:
    """Make an axis dark on white, with a light grid behind everything."""
    axis.grid(color=LIGHT.grid, linewidth=0.6)
    axis.set_axisbelow(True)
    axis.tick_params(colors=INK, labelsize=TEXT_POINTS)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def named(axis: Any, *, x: str = "", y: str = "") -> None:
    """Name the axes of a picture, with their units."""
    if x:
        axis.set_xlabel(x, color=INK, fontsize=TEXT_POINTS)
    if y:
        axis.set_ylabel(y, color=INK, fontsize=TEXT_POINTS)


def legend(axis: Any, patches: Mapping[str, str] | None = None, *, columns: int = 4) -> None:
    """Draw the legend above the axes, where it covers no curve: of the curves, or of `patches` (name → colour)."""
    looks: dict[str, Any] = {"ncols": columns, "borderaxespad": 0.2, "handlelength": 2.4}
    if patches is not None:
        handles = [Patch(color=color, label=name) for name, color in patches.items()]
        looks = {"handles": handles, "ncols": 8, "borderaxespad": 0.1, "handlelength": 1.0, "columnspacing": 1.2}
    if patches is not None or axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=TEXT_POINTS, labelcolor=INK, **looks
        )


def stops(axis: Any, places: Sequence[tuple[str, float]], *, written: bool = True) -> None:
    """Mark stops (name, position in m); if `written`, with their names above the axes and the legend."""
    for _, s_m in places:
        axis.axvline(s_m / KM, color=INK, linewidth=0.6, alpha=0.4)
    if written:
        name_stops(axis, [(name, s_m / KM) for name, s_m in places], LIGHT)


def as_image(figure: Figure) -> str:
    """A figure as a data URL (SVG), which embeds it in a page; the same figure gives the same URL."""
    content = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "das"}):  # fixes the ids inside the SVG, which are random otherwise
        figure.savefig(content, format="svg", metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(content.getvalue()).decode()}"


def comparison_figure(aligned: AlignedDrives) -> Figure:
    """Compared drives over the position: speeds, and the time and the energy lost minus those of the first drive."""
    figure, (speed, time, energy) = light_figure((2.6, 1.5, 1.5))
    at_km = aligned.s_m / KM
    curve(speed, "speed/limit", at_km, kmh(aligned.limit_mps), LIGHT)
    for i, drive in enumerate(aligned.drives):
        style = {
            "color": SEVERAL[i % len(SEVERAL)],
            "linestyle": LINES[i % len(LINES)],
            "linewidth": 1.3,
        }
        speed.plot(at_km, kmh(aligned.speed_mps[i]), label=drive.label, **style)
        if i:
            time.plot(at_km, aligned.time_s[i] - aligned.time_s[0], **style)
            energy.plot(at_km, kwh(aligned.lost_j[i] - aligned.lost_j[0]), **style)
    for axis in (time, energy):
        axis.axhline(0.0, color=SEVERAL[0], linewidth=1.0)
    legs = aligned.drives[0].legs
    places = [(legs[0].start.name, legs[0].start.s_m), *((leg.end.name, leg.end.s_m) for leg in legs)]
    common = [(name, s_m) for name, s_m in places if aligned.s_m[0] - EDGE_M <= s_m <= aligned.s_m[-1] + EDGE_M]
    for axis in (speed, time, energy):
        stops(axis, common, written=axis is speed)
    speed.set_ylim(0.0, 1.08 * float(np.nanmax(kmh(aligned.limit_mps))))
    named(speed, y=QUANTITIES["speed"].title)
    named(time, y="Later than\nthe first (s)")
    named(energy, y="Lost more than\nthe first (kWh)", x="Position (km)")
    legend(speed)
    return figure
