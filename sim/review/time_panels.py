"""The trip over time: speeds, lanes of states, controller, what it cost, deviation, buffer, and what the node knows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.patches import Patch

from das.domain.units import KMH, NS, kwh
from sim.recording.clock import minutes
from sim.recording.course import Floats, Times
from sim.review.account_view import CostSpan
from sim.review.canvas import SMALL, Along, Panel, bands, curve, legend, marks, name_stops, share_x
from sim.review.colors import Meaning, Theme
from sim.review.distance_panels import restricted, speed_axis
from sim.review.lanes import WAY, Lane
from sim.review.series import BUFFER_PERCENT, STYLES
from sim.review.story import Story

TITLES: Final = {
    "speed": "Speed (km/h)",
    "lanes": "",
    "lever": "Controller (%)",
    "cost": "",
    "lost": "Lost (kWh)",
    "energy": "Energy (kWh)",
    "deviation": "Late (s)",
    "buffer": "Buffer (%)",
    "estimate": "Position (m)",
    "calibration": "To plan (%)",
}
HEIGHTS_IN: Final = {"speed": 1.8}
HEIGHT_IN: Final = 0.8
LEGEND_IN: Final = 0.3
LANE_IN: Final = 0.2
COST_IN: Final = 0.26
TICKS_S: Final = (10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200)
"""Round distances of the ticks of a time axis (s); it has at most `MOST_TICKS`."""
MOST_TICKS: Final = 12
FIGURE_SHARE: Final = 0.028
"""A span of the cost has its figure in it if it is at least this wide, as a share of the axis."""
COSTS: Final = {
    Meaning.AGAINST: "by another effort than advised",
    Meaning.ADVISED: "driven as advised",
    Meaning.DANGER: "signal at danger",
    Meaning.LIMIT: "restriction",
    Meaning.WARNING: "hurried, and yet late",
    Meaning.NO_ADVICE: "rest",
    Meaning.LOST: "lost otherwise",
}
"""What the colours of the cost mean where several causes have one; a single cause stands there by its name."""


def panels(story: Story, costs: Sequence[CostSpan] = ()) -> dict[str, Panel]:
    """The panels for which there is something to show, by name."""
    shown = {name.split("/")[0] for name, (at, _) in story.series.items() if len(at)}
    found = {}
    for name, title in TITLES.items():
        if name == "lanes" and _lanes_of(story):
            found[name] = Panel(title, LANE_IN * len(_lanes_of(story)), above_in=LEGEND_IN)
        elif name == "cost" and costs:
            found[name] = Panel(title, COST_IN, above_in=LEGEND_IN)
        elif name in shown:
            found[name] = Panel(title, HEIGHTS_IN.get(name, HEIGHT_IN), above_in=LEGEND_IN)
    return found


def _lanes_of(story: Story) -> list[Lane]:
    """The lanes of a picture, which names the stops above its axis."""
    return [lane for lane in story.lanes if lane.name != WAY]


def over_time(axes: dict[str, Any], story: Story, theme: Theme, costs: Sequence[CostSpan] = ()) -> None:
    """Draw the panels into axes of their names; `costs` are the spans that have a price."""
    trip, clock = story.trip, story.clock

    def along(time_ns: Times) -> Floats:
        since_s: Floats = (np.maximum(time_ns, trip.time_ns[0]) - clock.zero_ns) * NS
        return since_s

    for name, (at, values) in story.series.items():
        axis = axes.get(name.split("/")[0])
        if axis is not None and not name.endswith("_sd"):
            curve(axis, name, along(at), values, theme)
    start, end = along(trip.time_ns[[0, -1]]).tolist()
    margin = max(0.01 * (end - start), 1.0)
    title = f"Clock of the drive (min:s): 0:00 is {clock.zero_is}. Under it the time of day (UTC)"
    share_x(list(axes.values()), (start - margin, end + margin), title, theme)
    _ticks(list(axes.values()), (start, end), story)
    for name, axis in axes.items():
        if name == "lanes":
            _lanes(axis, _lanes_of(story), along, int(trip.time_ns[-1]), theme)
        elif name == "cost":
            _costs(axis, costs, along, theme)
        else:
            legend(axis, theme)
            bands(axis, along, story.silences, theme)
    speed_axis(axes["speed"], story)
    _restricted(axes["speed"], story, along, theme)
    legend(axes["speed"], theme)
    marks(axes["speed"], along, story.happenings, theme)
    _stops(axes, story, along, theme)
    if "buffer" in axes:
        axes["buffer"].set_ylim(*BUFFER_PERCENT)
    for name in ("calibration/mass", "calibration/resistance"):
        (at, middle), (_, sd) = story.series[name], story.series[f"{name}_sd"]
        _spread(axes.get("calibration"), along(at), middle, sd, theme.of[STYLES[name].meaning])
    at, sd = story.series["estimate/sd"]
    _spread(axes.get("estimate"), along(at), np.zeros_like(sd), sd, theme.of[Meaning.ADVISED])


def _ticks(axes: Sequence[Any], ends_s: tuple[float, float], story: Story) -> None:
    """Give time axes ticks at round times of the drive's clock, with the time of day under it."""
    start_s, end_s = ends_s
    step = next((one for one in TICKS_S if (end_s - start_s) / one <= MOST_TICKS), TICKS_S[-1])
    at_s = step * np.arange(np.ceil(start_s / step), np.floor(end_s / step) + 1)
    zero_ns = story.clock.zero_ns
    texts = [f"{minutes(one)}\n{story.clock.of_day(zero_ns + round(one / NS))}" for one in at_s.tolist()]
    for axis in axes:
        axis.set_xticks(at_s, texts)


def _stops(axes: dict[str, Any], story: Story, along: Along, theme: Theme) -> None:
    """Mark when the train was at its stops, in all panels, and name them above the first."""
    names = []
    for stop in story.drive.at_stops:
        start, end = along(np.array([stop.start_ns, stop.end_ns]))
        names.append((stop.name, float(0.5 * (start + end))))
        for axis in axes.values():
            for place in {float(start), float(end)}:
                axis.axvline(place, color=theme.ink, linewidth=0.6, alpha=0.5)
    name_stops(axes["speed"], names, theme)


def _restricted(axis: Any, story: Story, along: Along, theme: Theme) -> None:
    """The restrictions, while the train's head is on them."""
    trip, top = story.trip, axis.get_ylim()[1]
    for limit in story.limits:
        one = limit.restriction
        over = (trip.s_m >= one.start_m) & (trip.s_m <= one.end_m) & limit.holds_at(trip.time_ns)
        if over.any():
            ends = along(trip.time_ns[over][[0, -1]])
            restricted(axis, (float(ends[0]), float(ends[1])), one.limit_mps / KMH, top, theme)


def _spread(axis: Any, x: Floats, middle: Floats, sd: Floats, color: str) -> None:
    """A standard deviation, as a band about what it is of."""
    if axis is not None:
        axis.fill_between(x, middle - sd, middle + sd, color=color, alpha=0.2, linewidth=0.0)


def _lanes(axis: Any, lanes: Sequence[Lane], along: Along, end_ns: int, theme: Theme) -> None:
    found: dict[str, str] = {}
    _rows(axis, [lane.name for lane in lanes], theme)
    for row, lane in enumerate(lanes):
        for change, following in pairwise([*lane.changes, lane.changes[-1]._replace(time_ns=end_ns)]):
            start, end = along(np.array([change.time_ns, following.time_ns]))
            if change.state:
                color = lane.color(change.state, theme)
                axis.broken_barh([(start, end - start)], (row + 0.08, 0.84), facecolor=color, edgecolor=color, lw=0.8)
                if len(lane.colors) > 2 and lane.name != "no advice":
                    found.setdefault(change.state, color)
    _key(axis, found, theme)


def _rows(axis: Any, names: Sequence[str], theme: Theme) -> None:
    """Make an axis one of rows under each other, each with a name."""
    axis.set_ylim(len(names), 0.0)
    axis.set_yticks(np.arange(len(names)) + 0.5, names)
    axis.tick_params(axis="y", length=0.0, labelcolor=theme.ink)
    axis.grid(visible=False, axis="y")


def _costs(axis: Any, costs: Sequence[CostSpan], along: Along, theme: Theme) -> None:
    """Draw what the driving cost, with the figures (kWh) that have room."""
    _rows(axis, ["cost (kWh)"], theme)
    low, high = axis.get_xlim()
    for span in costs:
        start, end = along(np.array([span.start_ns, span.end_ns]))
        axis.broken_barh([(start, end - start)], (0.06, 0.88), facecolor=theme.of[span.meaning], edgecolor="none")
        if end - start >= FIGURE_SHARE * (high - low):
            axis.text(
                0.5 * (start + end), 0.52, f"{kwh(span.energy_j):+.1f}", ha="center", va="center",
                color=theme.background, fontsize=SMALL - 1.0,
            )  # fmt: skip
    used = {meaning: {span.cause.label for span in costs if span.meaning is meaning} for meaning in COSTS}
    key = {names.pop() if len(names) == 1 else COSTS[meaning]: meaning for meaning, names in used.items() if names}
    _key(axis, {text: theme.of[meaning] for text, meaning in key.items()}, theme)


def _key(axis: Any, colors: dict[str, str], theme: Theme) -> None:
    """Draw what the colours of patches mean, above the right end of the axis."""
    axis.legend(
        handles=[Patch(color=color, label=text) for text, color in colors.items()], loc="lower right",
        bbox_to_anchor=(1.0, 1.0), ncols=12, frameon=False, labelcolor=theme.ink, fontsize=SMALL, borderaxespad=0.1,
        handlelength=0.9, handleheight=0.7, columnspacing=1.0,
    )  # fmt: skip
