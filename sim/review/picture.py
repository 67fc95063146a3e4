"""The scene as one picture, without a viewer or a screen: over distance, over time, and what happened."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from das.bus.recording import Recording
from das.domain.units import KM, KMH, NS, kwh
from das.drawing.meanings import LIGHT, Meaning, Theme
from sim.drive.drive import Drive
from sim.recording.course import Floats, Times, minutes
from sim.review.canvas import (
    SMALL,
    Along,
    Panel,
    bands,
    curve,
    figure_of,
    lane_rows,
    legend,
    list_height_in,
    listed,
    name_stops,
    numbered_marks,
    rows,
    share_x,
)
from sim.review.lanes import WAY, Lane
from sim.review.scene import DRAWN_OVER_DISTANCE, OVER_DISTANCE, CostSpan, ReviewScene, meaning_of, speed_text
from sim.review.series import BUFFER_PERCENT, QUANTITIES, STYLES, quantity_of
from sim.review.words import headline, line_rows, on_this_day

TITLE_IN, LINE_IN = 0.35, 0.19
"""Height (in) of the title, and of each line below it."""
TITLE_POINTS, TITLE_LETTERS = 11.0, 120
"""Size of the title, and the number of letters up to which it has this size; a longer one is smaller."""
AXIS_IN: Final = 0.45
"""Room (in) for the name and the numbers of a horizontal axis."""
CLOCK_AXIS_IN: Final = 0.6
"""Room (in) for the name of a time axis, the clock and the time of day."""
NAMES_IN: Final = 0.62
"""Room (in) above the axis of speed for the names of stops and the legend."""
LEGEND_IN: Final = 0.3
DISTANCE_IN: Final = (3.1, 1.3, 0.75)
"""Heights (in) of the panels over distance."""
OVER_TIME: Final = (
    "speed",
    "lanes",
    "lever",
    "cost",
    "lost",
    "energy",
    "deviation",
    "buffer",
    "estimate",
    "calibration",
)
"""The panels over time: those of quantities by their names, that of the lanes, and that of what the driving cost."""
SPEED_IN, HEIGHT_IN, LANE_IN, COST_IN = 1.8, 0.8, 0.2, 0.26
"""Heights (in) of the panels over time: of speed, of another quantity, of a lane, and of the cost."""

MARGIN_RATIO: Final = 0.01
HEADROOM: Final = 1.13
"""The top of the speed axis, as a multiple of the highest speed: the marks' numbers stand above the curves."""
LABEL_HEIGHT: Final = 0.88
"""Height of a restriction's label, as a share of the axis: above nearly all that is driven, under the numbers."""
SIGNAL_HEIGHT: Final = 0.12
"""Height of a signal at danger and of a target, as a share of the axis."""
TICKS_S: Final = (10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200)
"""Round intervals (s) between the ticks of a time axis; it has at most `MOST_TICKS`."""
MOST_TICKS: Final = 12
FIGURE_SHARE: Final = 0.028
"""A span of the cost shows its figure (kWh) if it is at least this wide, as a share of the axis."""
COSTS: Final = {
    Meaning.AGAINST: "by another effort than advised",
    Meaning.ADVISED: "driven as advised",
    Meaning.DANGER: "signal at danger",
    Meaning.LIMIT: "restriction",
    Meaning.LOST: "lost otherwise",
}
"""What a colour of the cost means if several causes of the drive share it; otherwise the legend names the cause."""


def picture_of(recording: Recording, theme: Theme = LIGHT, *, beside: Recording | None = None) -> Figure:
    """The picture of a recording as a matplotlib figure, with the curves of another drive under its own.

    Raises DasError for a recording without positions.
    """
    other = None if beside is None else Drive(source=beside)
    scene = ReviewScene.of(Drive(source=recording), other).with_attribution()
    about_line = [f"{name}: {text}" for name, text in line_rows(scene.drive)]
    day = [*on_this_day(recording), *filter(None, [scene.filled_from]), *about_line]
    above = [Panel(QUANTITIES[name].title, height) for name, height in zip(OVER_DISTANCE, DISTANCE_IN, strict=True)]
    above[0] = above[0]._replace(above_in=NAMES_IN + TITLE_IN + LINE_IN * len(day))
    below = panels(scene)
    below["speed"] = below["speed"]._replace(above_in=AXIS_IN + NAMES_IN)
    figure, axes = figure_of((*above, *below.values()), CLOCK_AXIS_IN + list_height_in(scene.marks), theme)
    _over_distance(dict(zip(OVER_DISTANCE, axes, strict=False)), scene, theme)
    _over_time(dict(zip(below, axes[len(above) :], strict=True)), scene, theme)
    top = 1.0 - 0.7 * TITLE_IN / figure.get_figheight()
    title = headline(scene.drive)
    points = TITLE_POINTS * min(1.0, TITLE_LETTERS / len(title))
    figure.text(0.5, top, title, color=theme.ink, ha="center", fontsize=points)
    for number, line in enumerate(day):
        y = 1.0 - (TITLE_IN + (number + 0.55) * LINE_IN) / figure.get_figheight()
        figure.text(0.5, y, line, color=theme.ink, ha="center", fontsize=SMALL)
    listed(figure, scene.marks, theme)
    return figure


def panels(scene: ReviewScene) -> dict[str, Panel]:
    """The panels over time for which there is something to show, by name."""
    found: dict[str, Panel] = {}
    for name in OVER_TIME:
        if name == "lanes" and _lanes_of(scene):
            found[name] = Panel("", LANE_IN * len(_lanes_of(scene)), above_in=LEGEND_IN)
        elif name == "cost" and _costs_of(scene):
            found[name] = Panel("", COST_IN, above_in=LEGEND_IN)
        elif name in scene.quantities:
            height = SPEED_IN if name == "speed" else HEIGHT_IN
            found[name] = Panel(QUANTITIES[name].title, height, above_in=LEGEND_IN)
    return found


def _lanes_of(scene: ReviewScene) -> list[Lane]:
    """The lanes of a picture: all but that of the stops, which the picture names above its axis."""
    return [lane for lane in scene.lanes if lane.name != WAY]


def _costs_of(scene: ReviewScene) -> list[CostSpan]:
    """The spans of time that cost enough to be shown."""
    return [] if scene.attribution is None else [span for span in scene.attribution.spans if span.worth]


def _over_distance(axes: dict[str, Any], scene: ReviewScene, theme: Theme) -> None:
    """Draw the panels over distance, with everything that has a place on the line."""
    trip, speed = scene.trip, axes["speed"]
    for trace in scene.over_distance(DRAWN_OVER_DISTANCE):
        curve(axes[trace.quantity], trace.name, trace.s_m / KM, trace.values, theme)
    margin_m = MARGIN_RATIO * max(float(np.ptp(trip.s_m)), 100.0)
    ends_km = (trip.s_m.min() - margin_m) / KM, (trip.s_m.max() + margin_m) / KM
    share_x(list(axes.values()), ends_km, "Position (km)", theme)
    for axis in axes.values():
        bands(axis, scene.km_at, scene.drive.silences, theme)
    force = scene.extent("force")
    if force is not None:
        margin = max(0.06 * (force[1] - force[0]), 1.0)
        axes["force"].set_ylim(force[0] - margin, force[1] + margin)
    _speed_axis(speed, scene)
    _places(speed, scene, theme)
    legend(speed, theme)
    numbered_marks(speed, scene.km_at, scene.marks, theme)


def _speed_axis(axis: Any, scene: ReviewScene) -> None:
    """Let the speed axis reach from 0 to above everything that was allowed, advised or driven."""
    top = (scene.extent("speed") or (0.0, 0.0))[1]
    axis.set_ylim(0.0, HEADROOM * max(top, 10.0))


def _places(axis: Any, scene: ReviewScene, theme: Theme) -> None:
    """Draw everything that has a place on the line: restrictions, signals at danger, targets and stops."""
    height = SIGNAL_HEIGHT * axis.get_ylim()[1]
    for limit in scene.places_of(Meaning.LIMIT):
        _restricted(axis, (limit.start_m / KM, limit.end_m / KM), limit.limit_mps, theme)
    for signal in scene.places_of(Meaning.DANGER):
        at_km, red = signal.start_m / KM, theme.of[signal.meaning]
        axis.plot([at_km, at_km], [0.0, height], color=red, linewidth=1.6)
        axis.plot(at_km, height, "o", color=red, markersize=6.0, label=_once(axis, f"signal {signal.text}"))
    for target in scene.places_of(Meaning.OPERATOR):
        at_km = target.start_m / KM
        axis.axvline(at_km, color=theme.of[target.meaning], linewidth=1.2, linestyle="-.")
        _label(axis, (at_km, height), target.text, target.meaning, theme)
    stops = [(name, s_m / KM) for name, s_m in scene.stops]
    for _, at_km in stops:
        axis.axvline(at_km, color=theme.ink, linewidth=0.6, alpha=0.5)
    name_stops(axis, stops, theme)


def _restricted(axis: Any, ends: tuple[float, float], limit_mps: float, theme: Theme) -> None:
    """Hatch the speeds that a temporary restriction forbids."""
    color, top = theme.of[Meaning.LIMIT], axis.get_ylim()[1]
    axis.fill_between(
        ends, limit_mps / KMH, top, facecolor=color, alpha=0.18, hatch="//", edgecolor=color, lw=0.0,
        label=_once(axis, "restriction"),
    )  # fmt: skip
    _label(axis, (0.5 * sum(ends), LABEL_HEIGHT * top), speed_text(limit_mps), Meaning.LIMIT, theme)


def _once(axis: Any, label: str) -> str | None:
    """The label; None if the axis has it already."""
    return None if label in axis.get_legend_handles_labels()[1] else label


def _label(axis: Any, at: tuple[float, float], text: str, meaning: Meaning, theme: Theme) -> None:
    low, high = axis.get_xlim()
    box = {"facecolor": theme.background, "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    if low <= at[0] <= high:
        color = theme.of[meaning]
        axis.text(*at, text, ha="center", va="center", color=color, fontsize=SMALL, bbox=box, zorder=5.0)


def _over_time(axes: dict[str, Any], scene: ReviewScene, theme: Theme) -> None:
    """Draw the panels over time into axes of their names."""
    trip, clock, speed = scene.trip, scene.clock, axes["speed"]

    def along(time_ns: Times) -> Floats:
        since_s: Floats = (np.maximum(time_ns, trip.time_ns[0]) - clock.zero_ns) * NS
        return since_s

    for name, (at, values) in scene.series.items():
        axis = axes.get(quantity_of(name))
        if axis is not None and not name.endswith("_sd"):
            curve(axis, name, along(at), values, theme)
    start, end = scene.ends_s
    margin = max(MARGIN_RATIO * (end - start), 1.0)
    title = f"Clock of the drive (min:s): 0:00 is {clock.zero_is}. Under it the time of day ({clock.zone})"
    share_x(list(axes.values()), (start - margin, end + margin), title, theme)
    _ticks(list(axes.values()), scene)
    for name, axis in axes.items():
        if name == "lanes":
            named = lane_rows(axis, _lanes_of(scene), int(trip.time_ns[-1]), along, theme)
            legend(axis, theme, named)
        elif name == "cost":
            _costs(axis, _costs_of(scene), along, theme)
        else:
            legend(axis, theme)
            bands(axis, along, scene.drive.silences, theme)
    _speed_axis(speed, scene)
    for one in scene.restricted_times():
        first, last = along(np.array([one.start_ns, one.end_ns])).tolist()
        _restricted(speed, (first, last), one.limit_mps, theme)
    legend(speed, theme)
    numbered_marks(speed, along, scene.marks, theme)
    _stops(axes, scene, along, theme)
    if "buffer" in axes:
        axes["buffer"].set_ylim(*BUFFER_PERCENT)
    for name in ("calibration/mass", "calibration/resistance"):
        (at, middle), (_, sd) = scene.series[name], scene.series[f"{name}_sd"]
        _spread(axes.get("calibration"), along(at), middle, sd, theme.of[STYLES[name].meaning])
    at, sd = scene.series["estimate/sd"]
    _spread(axes.get("estimate"), along(at), np.zeros_like(sd), sd, theme.of[Meaning.ADVISED])


def _ticks(axes: Sequence[Any], scene: ReviewScene) -> None:
    """Give time axes ticks at round times of the drive's clock, with the time of day under it."""
    (start_s, end_s), clock = scene.ends_s, scene.clock
    step = next((one for one in TICKS_S if (end_s - start_s) / one <= MOST_TICKS), TICKS_S[-1])
    at_s = step * np.arange(np.ceil(start_s / step), np.floor(end_s / step) + 1)
    zero, zone = clock.zero_ns * NS, scene.drive.zone
    texts = [f"{minutes(one)}\n{datetime.fromtimestamp(round(zero + one), zone):%H:%M:%S}" for one in at_s.tolist()]
    for axis in axes:
        axis.set_xticks(at_s, texts)


def _stops(axes: dict[str, Any], scene: ReviewScene, along: Along, theme: Theme) -> None:
    """Mark when the train was at its stops, in all panels, and name them above the first."""
    names = []
    for stop in scene.drive.at_stops:
        start, end = along(np.array([stop.start_ns, stop.end_ns])).tolist()
        names.append((stop.name, 0.5 * (start + end)))
        for axis in axes.values():
            for place in {start, end}:
                axis.axvline(place, color=theme.ink, linewidth=0.6, alpha=0.5)
    name_stops(axes["speed"], names, theme)


def _spread(axis: Any, x: Floats, middle: Floats, sd: Floats, color: str) -> None:
    """Draw a band of one standard deviation on either side of a curve."""
    if axis is not None:
        axis.fill_between(x, middle - sd, middle + sd, color=color, alpha=0.2, linewidth=0.0)


def _costs(axis: Any, costs: Sequence[CostSpan], along: Along, theme: Theme) -> None:
    """Draw what the driving cost, with the figures (kWh) for which there is room."""
    rows(axis, ["cost (kWh)"], theme)
    low, high = axis.get_xlim()
    for span in costs:
        start, end = along(np.array([span.start_ns, span.end_ns]))
        color = theme.of[meaning_of(span.cause)]
        axis.broken_barh([(start, end - start)], (0.06, 0.88), facecolor=color, edgecolor="none")
        if end - start >= FIGURE_SHARE * (high - low):
            axis.text(
                0.5 * (start + end), 0.52, f"{kwh(span.energy_j):+.1f}", ha="center", va="center",
                color=theme.background, fontsize=SMALL - 1.0,
            )  # fmt: skip
    used = {meaning: {span.cause.label for span in costs if meaning_of(span.cause) is meaning} for meaning in COSTS}
    named = {names.pop() if len(names) == 1 else COSTS[meaning]: meaning for meaning, names in used.items() if names}
    legend(axis, theme, {text: theme.of[meaning] for text, meaning in named.items()})
