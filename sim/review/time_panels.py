"""The trip over time: speeds, lanes of states, controller, deviation, buffer, and what the node knows."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.patches import Patch

from das.domain.units import KMH, NS
from sim.review.canvas import SMALL, Along, Panel, bands, curve, legend, marks, share_x
from sim.review.colors import Meaning, Theme
from sim.review.distance_panels import restricted, speed_axis
from sim.review.series import BUFFER_PERCENT, STYLES, Floats, Times
from sim.review.story import Story

TITLES: Final = {
    "speed": "Speed (km/h)",
    "lanes": "",
    "energy": "Energy (kWh)",
    "lever": "Controller (%)",
    "deviation": "Late (s)",
    "buffer": "Buffer (%)",
    "estimate": "Position (m)",
    "calibration": "To plan (%)",
}
HEIGHTS_IN: Final = {"speed": 1.8}
HEIGHT_IN: Final = 0.8
LEGEND_IN: Final = 0.3
LANE_IN: Final = 0.2
MINUTE_S: Final = 60.0


def panels(story: Story) -> dict[str, Panel]:
    """The panels for which there is something to show, by name."""
    shown = {name.split("/")[0] for name, (at, _) in story.series.items() if len(at)}
    found = {}
    for name, title in TITLES.items():
        if name == "lanes" and story.lanes:
            found[name] = Panel(title, LANE_IN * len(story.lanes), above_in=LEGEND_IN)
        elif name in shown:
            found[name] = Panel(title, HEIGHTS_IN.get(name, HEIGHT_IN), above_in=LEGEND_IN)
    return found


def over_time(axes: dict[str, Any], story: Story, theme: Theme) -> None:
    """Draw the panels into axes of their names."""
    trip = story.trip

    def along(time_ns: Times) -> Floats:
        minutes: Floats = (np.maximum(time_ns, trip.time_ns[0]) - story.clock.zero_ns) * (NS / MINUTE_S)
        return minutes

    for name, (at, values) in story.series.items():
        axis = axes.get(name.split("/")[0])
        if axis is not None and not name.endswith("_sd"):
            curve(axis, name, along(at), values, theme)
    start, end = along(trip.time_ns[[0, -1]]).tolist()
    margin = max(0.01 * (end - start), 1.0 / MINUTE_S)
    zero = f"{story.clock.zero_is}, {story.clock.of_day(story.clock.zero_ns)} UTC"
    share_x(list(axes.values()), (start - margin, end + margin), f"Time since {zero} (min)", theme)
    for name, axis in axes.items():
        if name == "lanes":
            _lanes(axis, story, along, theme)
        else:
            legend(axis, theme)
            bands(axis, along, story.silences, theme)
    speed_axis(axes["speed"], story)
    _restricted(axes["speed"], story, along, theme)
    legend(axes["speed"], theme)
    marks(axes["speed"], along, story.happenings, theme)
    if "buffer" in axes:
        axes["buffer"].set_ylim(*BUFFER_PERCENT)
    for name in ("calibration/mass", "calibration/resistance"):
        (at, middle), (_, sd) = story.series[name], story.series[f"{name}_sd"]
        _spread(axes.get("calibration"), along(at), middle, sd, theme.of[STYLES[name].meaning])
    at, sd = story.series["estimate/sd"]
    _spread(axes.get("estimate"), along(at), np.zeros_like(sd), sd, theme.of[Meaning.ADVISED])


def _restricted(axis: Any, story: Story, along: Along, theme: Theme) -> None:
    """The restrictions, while the train's head is on them."""
    trip, top = story.trip, axis.get_ylim()[1]
    for limit in story.limits:
        over = (trip.s_m >= limit.start_m) & (trip.s_m <= limit.end_m)
        over &= (trip.time_ns >= limit.told_ns) & (trip.time_ns < limit.lifted_ns)
        if over.any():
            ends = along(trip.time_ns[over][[0, -1]])
            restricted(axis, (float(ends[0]), float(ends[1])), limit.limit_mps / KMH, top, theme)


def _spread(axis: Any, x: Floats, middle: Floats, sd: Floats, color: str) -> None:
    """A standard deviation, as a band about what it is of."""
    if axis is not None:
        axis.fill_between(x, middle - sd, middle + sd, color=color, alpha=0.2, linewidth=0.0)


def _lanes(axis: Any, story: Story, along: Along, theme: Theme) -> None:
    lanes, end_ns = story.lanes, int(story.trip.time_ns[-1])
    axis.set_ylim(len(lanes), 0.0)
    axis.set_yticks(np.arange(len(lanes)) + 0.5, [lane.name for lane in lanes])
    axis.tick_params(axis="y", length=0.0, labelcolor=theme.ink)
    axis.grid(visible=False, axis="y")
    found: dict[str, str] = {}
    for row, lane in enumerate(lanes):
        for change, following in pairwise([*lane.changes, lane.changes[-1]._replace(time_ns=end_ns)]):
            start, end = along(np.array([change.time_ns, following.time_ns]))
            if change.state:
                color = lane.color(change.state, theme)
                axis.broken_barh([(start, end - start)], (row + 0.08, 0.84), facecolor=color, edgecolor=color, lw=0.8)
                if len(lane.colors) > 2 and lane.name != "no advice":
                    found.setdefault(change.state, color)
    axis.legend(
        handles=[Patch(color=color, label=state) for state, color in found.items()], loc="lower right",
        bbox_to_anchor=(1.0, 1.0), ncols=12, frameon=False, labelcolor=theme.ink, fontsize=SMALL, borderaxespad=0.1,
        handlelength=0.9, handleheight=0.7, columnspacing=1.0,
    )  # fmt: skip
