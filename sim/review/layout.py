"""Our blueprint: plots over time beside map, summary and events; the picture over distance in a second tab.

A plot of rerun follows the active timeline and starts at ±30 s about the cursor unless its axis is given; linked axes
ignore what is given. So the plots show the whole trip on `trip_time`, and what is over distance is a picture.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np
import rerun.blueprint as rrb

from das.bus.topics import EVENT, LOG
from das.domain.units import NS
from sim.review.entities import TRIP_TIME
from sim.review.series import BUFFER_PERCENT, EARTH_RADIUS_M, DrivenCourse, MapTrack
from sim.review.story import Story

MARGIN_RATIO: Final = 0.02
MAP_PX: Final = (380.0, 210.0)
"""Room (px) for the map in the window for which the layout is made."""


class Row(NamedTuple):
    """A view over time: title, origin of its entities, share of the height, corner of its legend."""

    title: str
    origin: str
    share: float
    legend: Literal["LeftTop", "LeftBottom", "RightTop"] | None = None


ROWS: Final = (
    Row("Speed (km/h)", "speed", 3.0, "LeftBottom"),
    Row("Modes advised and shown, state of the node, no advice, signals", "mode", 0.55),
    Row("Force at the wheels (kN)", "force", 1.6, "LeftBottom"),
    Row("Energy at the current collector (kWh)", "energy", 0.9),
    Row("Controller: share of the largest effort (%)", "lever", 1.2, "LeftBottom"),
    Row("Gradient (permille)", "gradient", 0.9),
    Row("Deviation from the timetable, late > 0 (s)", "deviation", 1.2, "RightTop"),
    Row("Buffer: time left over the least possible (%)", "buffer", 0.9),
)
KNOWN: Final = (
    Row("Position as the node knows it (m)", "estimate", 1.0, "RightTop"),
    Row("Mass and resistance as the node finds them, against the plan (%)", "calibration", 1.0, "RightTop"),
)
"""Views in a tab of their own, because the others would become too low beside them."""

LANE_SHARE: Final = 0.35
"""Each lane adds this much to the share of its view in the height."""


def blueprint(story: Story, way: MapTrack | None) -> rrb.Blueprint:
    """The layout for a window of about 1600 × 1000; views without anything to show are left out."""
    recording = story.recording
    over_time = _rows(ROWS, story, "Over time")
    over_distance = rrb.Spatial2DView(
        origin="distance", name="Over distance", overrides={"distance/picture": rrb.EntityBehavior(interactive=False)}
    )
    tabs: list[rrb.View | rrb.Container] = [over_time, over_distance]
    if any(len(story.series[name][0]) for name in ("estimate/sd", "calibration/mass")):
        tabs.append(_rows(KNOWN, story, "What the node knows"))
    side: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="summary", name="Summary")]
    if way is not None:
        side.insert(0, _track(way))
    if recording.of(EVENT) or recording.of(LOG):
        columns = rrb.TextLogColumns(text_log_columns=["loglevel", "body"])
        side.append(rrb.TextLogView(origin="events", name="Events", columns=columns))
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*tabs), rrb.Vertical(*side), column_shares=[2.6, 1.0]),
        rrb.TimePanel(timeline=TRIP_TIME, state="collapsed", play_state="Paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _rows(rows: tuple[Row, ...], story: Story, name: str) -> rrb.Vertical:
    """The views for which there is something to show, one under the other."""
    found = {series.split("/")[0] for series, (time_ns, _) in story.series.items() if len(time_ns)}
    shares = {row: row.share + (LANE_SHARE * len(story.lanes) if row.origin == "mode" else 0.0) for row in rows}
    shown = [row for row in rows if row.origin in found or (row.origin == "mode" and story.lanes)]
    axis = _whole_trip(story.trip)
    return rrb.Vertical(*(_view(row, axis) for row in shown), row_shares=[shares[row] for row in shown], name=name)


def _view(row: Row, axis: rrb.TimeAxis) -> rrb.View:
    if row.origin == "mode":
        return rrb.StateTimelineView(origin=row.origin, name=row.title, time_view=axis)
    legend = rrb.PlotLegend(row.legend, visible=row.legend is not None)
    heights = rrb.ScalarAxis(range=BUFFER_PERCENT) if row.origin == "buffer" else None
    return rrb.TimeSeriesView(origin=row.origin, name=row.title, axis_x=axis, axis_y=heights, plot_legend=legend)


def _whole_trip(trip: DrivenCourse) -> rrb.TimeAxis:
    duration_s = float(trip.time_ns[-1] - trip.time_ns[0]) * NS
    margin_s = max(MARGIN_RATIO * duration_s, 1.0)
    start = rrb.TimeRangeBoundary.absolute(seconds=-margin_s)
    return rrb.TimeAxis(view_range=rrb.TimeRange(start, rrb.TimeRangeBoundary.absolute(seconds=duration_s + margin_s)))


def _track(way: MapTrack) -> rrb.Tabs:
    low, high = way.plane_m.min(axis=0), way.plane_m.max(axis=0)
    margin = 2.0 * MARGIN_RATIO * max(float((high - low).max()), 100.0)
    (left, top), (right, bottom) = low - margin, high + margin
    return rrb.Tabs(
        rrb.Spatial2DView(
            origin="track",
            name="Track (colour: speed)",
            visual_bounds=rrb.VisualBounds2D(x_range=(left, right), y_range=(top, bottom)),
        ),
        rrb.MapView(origin="map", name="Map (tiles need a network)", zoom=_zoom(way)),
    )


def _zoom(way: MapTrack) -> float:
    """Zoom level (a tile of 256 px shows 1/2^zoom of a parallel) at which the way fits the panel."""
    extent_m = np.maximum(np.ptp(way.plane_m, axis=0), 100.0)
    parallel_m = 2.0 * np.pi * EARTH_RADIUS_M * np.cos(np.radians(way.degrees[:, 0].mean()))
    return float(np.log2(parallel_m / 256.0 * np.min(np.array(MAP_PX) / extent_m)))
