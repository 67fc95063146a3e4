"""Speed, force and gradient over distance; stops, restrictions, signals and targets stand at their places."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from das.bus import topics
from das.domain.units import KM, KMH
from sim.recording.course import Floats, Times
from sim.review.canvas import SMALL, Panel, bands, curve, legend, marks, name_stops, share_x
from sim.review.colors import Meaning, Theme
from sim.review.series import FirstPlans
from sim.review.story import Story

PANELS: Final = (
    Panel("Speed (km/h)", 3.1, above_in=0.62),
    Panel("Force (kN)", 1.3),
    Panel("Gradient (‰)", 0.75),
)
MARGIN_RATIO: Final = 0.01
HEADROOM: Final = 1.13
"""The top of the speed axis, as a multiple of the highest speed: the marks' numbers stand above the curves."""

LABEL_HEIGHT: Final = 0.88
"""Height of a restriction's label, as a share of the axis: above nearly all that is driven, under the numbers."""

WHOSE: Final = ("advised", "driven")
USUAL_PERCENT: Final = (2.5, 97.5)
"""The axis of force shows the advised force between these percentiles."""


def over_distance(axes: list[Any], story: Story, theme: Theme) -> None:
    """Draw the panels into three axes."""
    trip, plan = story.trip, FirstPlans.of(story.recording)
    curves = {name: (trip.at(at, trip.s_m), values) for name, (at, values) in story.series.items()}
    if plan is not None:  # it would be elsewhere than the train was at its times
        curves["speed/optimum"] = plan.s_m, plan.speed_mps / KMH
    panels = dict(zip(("speed", "force", "gradient"), axes, strict=True))
    for name, (places_m, values) in curves.items():
        axis = panels.get(name.split("/")[0])
        if axis is not None:
            curve(axis, name, places_m / KM, values, theme)
    margin_m = MARGIN_RATIO * max(float(np.ptp(trip.s_m)), 100.0)
    share_x(axes, ((trip.s_m.min() - margin_m) / KM, (trip.s_m.max() + margin_m) / KM), "Position (km)", theme)

    def along(time_ns: Times) -> Floats:
        return trip.at(time_ns, trip.s_m) / KM

    for axis in axes:
        bands(axis, along, story.silences, theme)
    force_axis(panels["force"], story)
    speed_axis(panels["speed"], story)
    _places(panels["speed"], story, theme)
    legend(panels["speed"], theme)
    marks(panels["speed"], along, story.happenings, theme)


def speed_axis(axis: Any, story: Story) -> None:
    """Let the speed axis reach from 0 to above everything that was allowed, advised or driven."""
    speeds = [values for name, (_, values) in story.series.items() if name.startswith("speed/") and len(values)]
    top = max((float(np.nanmax(values)) for values in speeds if not np.isnan(values).all()), default=0.0)
    axis.set_ylim(0.0, HEADROOM * max(top, 10.0))


def force_axis(axis: Any, story: Story) -> None:
    """Let the force axis show all that was driven, and what was advised except for the last metres before a stop."""
    advised, driven = (values[np.isfinite(values)] for values in (story.series[f"force/{x}"][1] for x in WHOSE))
    if len(advised) and len(driven):
        low, high = np.percentile(advised, USUAL_PERCENT)
        low, high = min(low, driven.min()), max(high, driven.max())
        margin = max(0.06 * (high - low), 1.0)
        axis.set_ylim(low - margin, high + margin)


def _places(axis: Any, story: Story, theme: Theme) -> None:
    """Draw what has a place of its own: restrictions, signals, targets and stops."""
    top = axis.get_ylim()[1]
    for limit in story.limits:
        one = limit.restriction
        restricted(axis, (one.start_m / KM, one.end_m / KM), one.limit_mps / KMH, top, theme)
    red = theme.of[Meaning.DANGER]
    for signal in story.signals:
        axis.plot([signal.s_m / KM] * 2, [0.0, 0.12 * top], color=red, linewidth=1.6)
        axis.plot(signal.s_m / KM, 0.12 * top, "o", color=red, markersize=6.0, label=_once(axis, "signal at danger"))
    for point in story.points:
        axis.axvline(point.s_m / KM, color=theme.of[Meaning.OPERATOR], linewidth=1.2, linestyle="-.")
        _label(axis, (point.s_m / KM, 0.12 * top), point.text, Meaning.OPERATOR, theme)
    _stops(axis, story, theme)


def restricted(axis: Any, ends: tuple[float, float], speed_kmh: float, top_kmh: float, theme: Theme) -> None:
    """Hatch the speeds that a temporary restriction forbids."""
    color = theme.of[Meaning.LIMIT]
    axis.fill_between(
        ends, speed_kmh, top_kmh, facecolor=color, alpha=0.18, hatch="//", edgecolor=color, lw=0.0,
        label=_once(axis, "restriction"),
    )  # fmt: skip
    _label(axis, (0.5 * sum(ends), LABEL_HEIGHT * top_kmh), f"{speed_kmh:.0f} km/h", Meaning.LIMIT, theme)


def _once(axis: Any, label: str) -> str | None:
    """The label; None if the axis has it already."""
    return None if label in axis.get_legend_handles_labels()[1] else label


def _label(axis: Any, at: tuple[float, float], text: str, meaning: Meaning, theme: Theme) -> None:
    low, high = axis.get_xlim()
    x, y = at
    color = theme.of[meaning]
    box = {"facecolor": theme.background, "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    if low <= x <= high:
        axis.text(x, y, text, ha="center", va="center", color=color, fontsize=SMALL, bbox=box, zorder=5.0)


def _stops(axis: Any, story: Story, theme: Theme) -> None:
    stops = [
        (stop.name, stop.s_m / KM) for one in story.recording.of(topics.JOURNEY)[-1:] for stop in one.message.stops
    ]
    for _, at_km in stops:
        axis.axvline(at_km, color=theme.ink, linewidth=0.6, alpha=0.5)
    name_stops(axis, stops, theme)
