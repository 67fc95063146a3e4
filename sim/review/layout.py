"""The blueprint of a review: plots over distance and time with one cursor, the cab, the energy, and lists to click on.

A plot of rerun follows the active timeline and shows ±30 s about the cursor unless its axis has a range, which linked
axes ignore. So every plot has its own range, the whole trip on the drive's clock. Plots over distance are
two-dimensional views.
"""

from __future__ import annotations

from typing import Any, Final, Literal, NamedTuple

import rerun.blueprint as rrb

from das.domain.units import NS
from sim.drive.series import BUFFER_PERCENT, QUANTITIES, MapTrack
from sim.review.cab_display import CAB_CARD, DIAL, EXTENT
from sim.review.lanes import COST, WAY, lane_entity
from sim.review.rerun_drawing import BOOKMARKS, BOTTOM, ENERGY, FURNITURE, MARGIN, WIDTH, Timelines
from sim.review.scene import ReviewScene

MARGIN_RATIO: Final = 0.02


class Row(NamedTuple):
    """A view over time: its quantity or its lanes, its share of the height, the corner of its legend, and its title.

    The title is for lanes; a quantity has a title of its own.
    """

    origin: str
    share: float
    legend: Literal["LeftTop", "LeftBottom", "RightTop"] | None = None
    lanes: tuple[str, ...] = ()
    title: str = ""


DRIVING: Final = (WAY, "advised", "shown", "signal", COST)
NODE: Final = ("advised", "node", "no advice")
"""`DRIVING` and `NODE` name the lanes about the driving and the lanes about the node."""
LANES: Final = "/"
"""The origin of a view of lanes: their names are those of entities at the root."""
TABS: Final = {
    "Over time": (
        Row("speed", 2.0),
        Row(LANES, 0.6, lanes=DRIVING, title="Display text, and energy cost of the driving (kWh)"),
        Row("lever", 1.2),
    ),
    "Energy": (Row("lost", 1.0), Row("energy", 1.0, "LeftTop")),
    "Forces, delay": (
        Row("force", 1.6, "LeftBottom"),
        Row("gradient", 0.9),
        Row("deviation", 1.2, "RightTop"),
        Row("buffer", 0.9),
    ),
    "State of the node": (
        Row(LANES, 0.2, lanes=NODE, title="Modes advised, state of the node, and times without advice"),
        Row("estimate", 2.0, "RightTop"),
        Row("calibration", 2.0, "RightTop"),
    ),
}
HEIGHTS: Final = {"buffer": BUFFER_PERCENT, "lever": (-105.0, 105.0)}
"""Ranges of the axes that do not follow from what is shown."""
ALWAYS: Final = {"lost", "energy"}
"""Views that are never left out, because their series are found only after the layout is made."""
LANE_SHARE: Final = 0.6
"""Height that each lane adds to the share of its view."""


def blueprint(scene: ReviewScene) -> rrb.Blueprint:
    """The layout for a window of about 1600 × 1000; views without anything to show are left out."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_over_distance(), _over_time(scene), row_shares=[0.9, 1.0]),
            rrb.Vertical(*_cab(scene), rrb.Tabs(*_tabs(scene)), row_shares=[1.0, 0.8, 1.1]),
            column_shares=[2.05, 1.0],
        ),
        rrb.TimePanel(timeline=Timelines.of_scene(scene).line_clock, state="collapsed", play_state="Paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _over_distance() -> rrb.View:
    left, right, below = MARGIN
    bounds = rrb.VisualBounds2D(x_range=(-left, WIDTH + right), y_range=(0.0, BOTTOM + below))
    quiet: dict[Any, Any] = {f"distance/{name}": rrb.EntityBehavior(interactive=False) for name in FURNITURE}
    return rrb.Spatial2DView(origin="distance", name="Over distance", visual_bounds=bounds, overrides=quiet)


def _over_time(scene: ReviewScene) -> rrb.Container:
    tabs = [_rows(rows, scene, name) for name, rows in TABS.items()]
    return rrb.Tabs(*(tab for tab in tabs if tab is not None))


def _cab(scene: ReviewScene) -> list[rrb.View]:
    """What the driver saw at the moment of the cursor; of a recording without a display, what the node advised."""
    name = (
        "In the cab, as the driver saw it" if scene.drive.table.has("cab") else "Driven (the display was not recorded)"
    )
    bounds = rrb.VisualBounds2D(x_range=(-EXTENT, EXTENT), y_range=(-EXTENT, 0.8 * EXTENT))
    quiet: dict[Any, Any] = {f"{DIAL}/{part}": rrb.EntityBehavior(interactive=False) for part in ("scale", "figures")}
    words = rrb.TextDocumentView(origin=CAB_CARD, name="Text of the display at the cursor")
    return [rrb.Spatial2DView(origin=DIAL, name=name, visual_bounds=bounds, overrides=quiet), words]


def _tabs(scene: ReviewScene) -> list[rrb.View]:
    """The lists, in which a click on a time moves the cursor to it, and the views about the whole drive."""
    clock = Timelines.of_scene(scene).line_clock
    columns = rrb.TextLogColumns(timeline_columns=[clock], text_log_columns=["body"])
    found: list[rrb.View] = [rrb.TextLogView(origin=BOOKMARKS, name="Bookmarks", columns=columns)]
    found.append(rrb.TextDocumentView(origin=ENERGY, name="Energy"))
    found.append(rrb.TextDocumentView(origin="summary", name="Summary"))
    way = scene.way
    if way is not None:
        found.append(_track(way))
    if scene.drive.table.said.node or scene.drive.table.said.simulator:
        found.append(rrb.TextLogView(origin="events", name="Log", columns=columns))
    return found


def _rows(rows: tuple[Row, ...], scene: ReviewScene, name: str) -> rrb.Vertical | None:
    """The views for which there is something to show, one under the other; None if there are none."""
    found = scene.quantities | ALWAYS
    lanes = {lane.name for lane in scene.lanes} | {COST}  # the lane of costs is found later
    rows = tuple(row._replace(lanes=_said(row.lanes, lanes)) for row in rows)
    shown = [row for row in rows if row.origin in found or lanes & set(row.lanes)]
    shares = [row.share + LANE_SHARE * len(lanes & set(row.lanes)) for row in shown]
    axis = _whole_trip(scene)
    return rrb.Vertical(*(_view(row, axis) for row in shown), row_shares=shares, name=name) if shown else None


def _said(lanes: tuple[str, ...], found: set[str]) -> tuple[str, ...]:
    """The lanes; without that of the modes advised where that of the display stands beside it."""
    return tuple(one for one in lanes if not (one == "advised" and {"shown"} & found & set(lanes)))


def _view(row: Row, axis: rrb.TimeAxis) -> rrb.View:
    if row.origin == LANES:
        contents = [f"+ /{lane_entity(name)}" for name in row.lanes]
        return rrb.StateTimelineView(origin=row.origin, contents=contents, name=row.title, time_view=axis)
    legend = rrb.PlotLegend(row.legend, visible=row.legend is not None)
    heights = rrb.ScalarAxis(range=HEIGHTS[row.origin]) if row.origin in HEIGHTS else None
    return rrb.TimeSeriesView(
        origin=row.origin, name=QUANTITIES[row.origin].long_title, axis_x=axis, axis_y=heights, plot_legend=legend,
    )  # fmt: skip


def _whole_trip(scene: ReviewScene) -> rrb.TimeAxis:
    start_ns, end_ns = Timelines.of_scene(scene).local_ns(scene.trip.time_ns[[0, -1]]).tolist()
    margin_ns = max(round(MARGIN_RATIO * (end_ns - start_ns)), round(1.0 / NS))
    ends = [rrb.TimeRangeBoundary.absolute(nanos=at_ns) for at_ns in (start_ns - margin_ns, end_ns + margin_ns)]
    return rrb.TimeAxis(view_range=rrb.TimeRange(*ends))


def _track(way: MapTrack) -> rrb.View:
    low, high = way.plane_m.min(axis=0), way.plane_m.max(axis=0)
    margin = 2.0 * MARGIN_RATIO * max(float((high - low).max()), 100.0)
    (left, top), (right, bottom) = low - margin, high + margin
    bounds = rrb.VisualBounds2D(x_range=(left, right), y_range=(top, bottom))
    return rrb.Spatial2DView(origin="track", name="Track", visual_bounds=bounds)
