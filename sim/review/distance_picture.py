"""Speed, force and gradient over distance as one picture: rerun's own plots always follow its active timeline."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from das.bus import topics
from das.domain.units import KM, KMH
from sim.recording import Recording
from sim.review.series import STYLES, FirstPlans, Floats, Trip, series

BACKGROUND, INK, GRID = "#0d1011", "#cad8de", "#2b3236"
SIZE_IN, DPI = (10.4, 8.2), 200
LINE_RATIO: Final = 0.8
"""Width of a line here to its width in rerun."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG and where things are in it: pixel = origin + scale · (position in km, speed in km/h)."""

    png: bytes
    origin_px: tuple[float, float]
    scale_px: tuple[float, float]
    top_px: float
    bottom_px: float

    def pixel(self, s_m: Floats, speed_kmh: Floats) -> tuple[Floats, Floats]:
        """Pixel columns and rows of points of the speed panel."""
        (x0, y0), (dx, dy) = self.origin_px, self.scale_px
        return x0 + dx * s_m / KM, y0 + dy * speed_kmh


def draw(recording: Recording, trip: Trip) -> Picture:
    """Draw the trip over distance: what was driven, advised and allowed, with the stops of the last journey."""
    figure = Figure(figsize=SIZE_IN, dpi=DPI, facecolor=BACKGROUND)
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, sharex=True, height_ratios=(4, 2, 1.2))
    axes = dict(zip(("speed", "force", "gradient"), panels, strict=True))
    figure.subplots_adjust(left=0.075, right=0.985, top=0.955, bottom=0.065, hspace=0.09)
    for (name, axis), unit in zip(axes.items(), ("km/h", "kN", "permille"), strict=True):
        _plain(axis, f"{name.capitalize()} ({unit})")
    plan = FirstPlans.of(recording)
    curves = {name: (trip.at(at, trip.s_m), values) for name, (at, values) in series(recording, trip).items()}
    if plan is not None:  # it would be elsewhere than the train was at its times
        curves["speed/optimum"] = plan.s_m, plan.speed_mps / KMH
    for name, (places_m, values) in curves.items():
        axis, style = axes.get(name.split("/")[0]), STYLES[name]
        if axis is not None:
            axis.plot(
                places_m / KM, values, color=f"#{style.color >> 8:06x}",
                linewidth=LINE_RATIO * style.width, drawstyle="steps-post" if style.held else "default",
                label=style.label.split(",")[0],
            )  # fmt: skip
    speed, gradient = axes["speed"], axes["gradient"]
    speed.set_ylim(bottom=0)
    speed.legend(loc="lower center", ncols=4, frameon=False, labelcolor=INK)
    gradient.set_xlabel("Position (km)", color=INK)
    margin_m = 0.01 * max(float(np.ptp(trip.s_m)), 100.0)
    gradient.set_xlim((trip.s_m.min() - margin_m) / KM, (trip.s_m.max() + margin_m) / KM)
    _stops(recording, speed)
    png = io.BytesIO()
    figure.savefig(png, format="png", facecolor=BACKGROUND)
    height = figure.bbox.height
    (x0, y0), (x1, y1) = speed.transData.transform(((0.0, 0.0), (1.0, 1.0)))
    return Picture(
        png=png.getvalue(),
        origin_px=(x0, height - y0),
        scale_px=(x1 - x0, y0 - y1),
        top_px=height - speed.bbox.y1,
        bottom_px=height - gradient.bbox.y0,
    )


def _plain(axis: Any, title: str) -> None:
    axis.set_facecolor(BACKGROUND)
    axis.set_ylabel(title, color=INK)
    axis.grid(color=GRID, linewidth=0.6)
    axis.tick_params(colors=INK)
    for spine in axis.spines.values():
        spine.set_color(GRID)


def _stops(recording: Recording, axis: Any) -> None:
    low, high = axis.get_xlim()
    for journey in recording.of(topics.JOURNEY)[-1:]:
        for stop in journey.message.stops:
            if low <= stop.s_m / KM <= high:
                axis.axvline(stop.s_m / KM, color=INK, linewidth=0.6, alpha=0.5)
                place = axis.get_xaxis_transform()
                axis.text(stop.s_m / KM, 1.02, stop.name, transform=place, ha="center", color=INK)
