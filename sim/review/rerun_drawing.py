"""The scene as rerun entities over time, and the layout of the viewer.

A plot of rerun shows ±30 s around the cursor unless its axis has a range, which linked axes ignore. Therefore every
plot has its own range, the whole trip.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final, Literal, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.advice.wording import Language
from das.domain.units import KMH, NS, kwh_figure
from sim.drive.attribution import Attribution
from sim.drive.series import BUFFER_PERCENT, QUANTITIES, STYLES, quantity_of
from sim.meanings import VIEWER, rgba
from sim.recording.course import STANDING_MPS, DriveClock, DrivenCourse, Floats, Times
from sim.review.first_page import in_lines
from sim.review.scene import COST, WAY, Lane, ReviewScene, instructions, lane_entity
from sim.review.tables import cause_rows, figures, input_rows
from sim.review.words import DisplayWords, cards

DRIVE_CLOCK, POSITION = "drive_clock", "position_m"
"""Names of two timelines: time on the drive's clock, and position on the route (m). The third is the line's clock."""
CAB, ENERGY, BOOKMARKS = "cab", "account", "bookmarks"
"""Entities of the words of the display, of the energy attribution and of the bookmarks."""
MARKDOWN: Final = rr.MediaType.MARKDOWN
LEVELS: Final[Mapping[int, str]] = {
    Log.DEBUG: "DEBUG",
    Log.INFO: "INFO",
    Log.WARNING: "WARN",
    Log.ERROR: "ERROR",
    Log.FATAL: "CRITICAL",
}

INK: Final = rgba(VIEWER.ink)
LANE_LETTERS: Final = 137.0
"""Number of letters that fit into a lane in the layout's window."""
FIGURE: Final = re.compile(r"[+-]?\d[\d.]*")


@dataclass(frozen=True, kw_only=True)
class Timelines:
    """Puts messages on all timelines: the clock of the line (shown at first), the clock of the drive, and the position.

    The viewer opens at the earliest moment of a timeline, so `opening_ns` is the first moment that is drawn.
    """

    trip: DrivenCourse
    clock: DriveClock
    opening_ns: int

    @classmethod
    def of_scene(cls, scene: ReviewScene) -> Timelines:
        """The timelines of a scene, from the first bookmark if the train stood until then, else from the first
        position."""
        trip = scene.trip
        first_ns = min((one.time_ns for one in scene.bookmarks), default=int(trip.time_ns[0]))
        stood = not (trip.speed_mps[trip.time_ns < first_ns] > STANDING_MPS).any()
        opening_ns = max(first_ns, int(trip.time_ns[0])) if stood else int(trip.time_ns[0])
        return cls(trip=trip, clock=scene.drive.table.clock, opening_ns=opening_ns)

    @property
    def line_clock(self) -> str:
        """The name of the timeline of the line's clock; the list of bookmarks is as wide as this name."""
        return f"clock in {self.clock.zone}" if str(self.clock.zone) != "UTC" else "clock in UTC (no zone)"

    def local_ns(self, time_ns: Times) -> Times:
        """Moments on the line's clock (ns since 1970 there); those before the opening are moved to it."""
        ahead = datetime.fromtimestamp(self.opening_ns * NS, self.clock.zone).utcoffset() or timedelta()
        return np.asarray(np.maximum(time_ns, self.opening_ns) + round(ahead.total_seconds() / NS))

    def of(self, time_ns: Times) -> list[rr.TimeColumn]:
        """Columns of all timelines for moments (ns since 1970)."""
        at_ns = np.maximum(time_ns, self.opening_ns)
        position_m = np.maximum(np.rint(self.trip.at(at_ns, self.trip.s_m)), 0.0)
        return [
            rr.TimeColumn(self.line_clock, timestamp=self.local_ns(time_ns).astype("datetime64[ns]")),
            rr.TimeColumn(DRIVE_CLOCK, duration=(at_ns - self.clock.zero_ns).astype("timedelta64[ns]")),
            rr.TimeColumn(POSITION, sequence=position_m.astype(np.int64)),
        ]

    def in_seconds(self, time_ns: Times) -> list[rr.TimeColumn]:
        """Columns of all timelines for moments of a list, in whole seconds so that they fit its column."""
        return self.of(np.rint(time_ns * NS).astype(np.int64) * round(1 / NS))


def send(out: rr.RecordingStream, scene: ReviewScene, language: Language) -> None:
    """Send the whole scene to rerun; the display is in the given language."""
    out.send_recording_name(f"{scene.drive.recording.train} ({scene.drive.recording.path.name})")
    lines, attribution = Timelines.of_scene(scene), scene.drive.energy.attribution
    for name, (time_ns, values) in scene.series.items():
        if len(time_ns):
            _series(out, lines, name, time_ns, values)
    said = instructions(scene.drive)
    for lane in scene.lanes:  # that of the display has its words instead of modes, if it showed how to drive
        _lane(out, lines, said if lane.name == said.name and said.changes else lane)
    _bookmarks(out, lines, scene)
    _events(out, lines, scene)
    found = cards(scene.drive.table, DisplayWords(language, scene.drive.table.zone))
    if found:
        columns = rr.TextDocument.columns(text=[one.text for one in found], media_type=[MARKDOWN] * len(found))
        out.send_columns(CAB, lines.of(np.array([one.time_ns for one in found])), columns)
    why_not = f"The energy is not attributed: {scene.drive.energy.why_no_attribution}."
    texts = {ENERGY: attribution_text(attribution) if attribution else why_not, "summary": summary(scene)}
    for entity, text in texts.items():
        out.log(entity, rr.TextDocument(text, media_type=MARKDOWN), static=True)


def summary(scene: ReviewScene) -> str:
    """The first page of the report, its figures and its sources (Markdown)."""
    recording, filled = scene.drive.recording, scene.filled_from
    lines = [f"### Train {recording.train}", *(f"**Damaged: {one}.**" for one in recording.health.damage)]
    lines += [f"**{filled[0].upper()}{filled[1:]}.**"] if filled else []
    lines += [f"Also recorded, not shown: {', '.join(recording.trains[1:])}"] if len(recording.trains) > 1 else []
    rows = [("", figures(scene.drive)), ("Sources", input_rows(scene.drive))]
    return "\n\n".join([*lines, *in_lines(scene.drive), *(_table((title, ""), one) for title, one in rows)])


def attribution_text(attribution: Attribution) -> str:
    """The energy by cause as the report has it (Markdown)."""
    above = attribution.above
    source = "of the simulated train" if above.measured else "estimated from positions; not measured"
    rows = [
        ("optimum for the same times", kwh_figure(above.optimum_j), ""),
        *((one["label"], one["kwh"], one["meaning"]) for one in cause_rows(attribution)),
        ("**as driven**", f"**{kwh_figure(above.driven_j)}**", ""),
    ]
    head = f"### Above the optimum for the same times: {above.words}"
    return "\n\n".join([head, _table(("", "kWh", ""), rows), f"Energy at the current collector, {source}."])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(one.replace('|', '/') for one in row)} |" for row in cells)


def _series(out: rr.RecordingStream, lines: Timelines, name: str, time_ns: Times, values: Floats) -> None:
    style, modes = STYLES[name], rr.components.InterpolationMode
    looks = rr.SeriesLines(
        colors=rgba(VIEWER.of[style.meaning]),
        names=f"{style.label}, {QUANTITIES[quantity_of(name)].spelt_unit}",
        widths=style.width,
        interpolation_mode=modes.StepAfter if style.held else modes.Linear,
    )
    out.log(name, looks, static=True)
    out.send_columns(name, lines.of(time_ns), rr.Scalars.columns(scalars=values))


def _lane(out: rr.RecordingStream, lines: Timelines, lane: Lane) -> None:
    """Send a lane of states, with one row for each change. A state too short for its text shows only its figure, or
    nothing."""
    entity = lane_entity(lane.name)
    time_ns = np.array([change.time_ns for change in lane.changes])
    ends_ns = np.maximum(np.append(time_ns, lines.trip.time_ns[-1]), lines.opening_ns)
    letters = np.diff(ends_ns) / max(float(lines.trip.time_ns[-1] - lines.opening_ns), 1.0) * LANE_LETTERS
    texts = [fitting(change.state, room) for change, room in zip(lane.changes, letters, strict=True)]
    # Values with the same colour and words are distinguished by their end, which is not shown.
    values = {f"{change.state}|{text}": (text, change.state) for change, text in zip(lane.changes, texts, strict=True)}
    shades = np.array([rgba(lane.color(state, VIEWER)) for _, state in values.values()], dtype=np.uint32)
    labels = [text or " " for text, _ in values.values()]
    out.log(entity, rr.StateConfiguration(values=list(values), labels=labels, colors=shades), static=True)
    states = [f"{one.state}|{text}" if one.state else "" for one, text in zip(lane.changes, texts, strict=True)]
    out.send_columns(entity, lines.of(time_ns), rr.StateChange.columns(state=states))


def fitting(state: str, letters: float) -> str:
    """The words of a state, else the figure in them, else nothing: the first that fits into a number of letters."""
    figure = FIGURE.search(state)
    for text in (state, figure[0] if figure else ""):
        if len(text) + 1 <= letters:
            return text
    return ""


def _bookmarks(out: rr.RecordingStream, lines: Timelines, scene: ReviewScene) -> None:
    """Send the bookmarks as points on the speed curve, and as a list in which a click leads to their time."""
    if not scene.bookmarks:
        return
    trip, time_ns = lines.trip, np.array([one.time_ns for one in scene.bookmarks])
    index = lines.of(time_ns)
    points = rr.SeriesPoints(colors=INK, names="bookmark (see the list)", markers="Diamond", marker_sizes=5.0)
    out.log("speed/bookmarks", points, static=True)
    speeds = rr.Scalars.columns(scalars=trip.at(time_ns, trip.speed_mps) / KMH)
    out.send_columns("speed/bookmarks", index, speeds)
    columns = rr.TextLog.columns(
        text=[one.text for one in scene.bookmarks],
        level=["INFO"] * len(scene.bookmarks),
        color=np.array([rgba(one.color(VIEWER)) for one in scene.bookmarks], dtype=np.uint32),
    )
    out.send_columns(BOOKMARKS, lines.in_seconds(time_ns), columns)


def _events(out: rr.RecordingStream, lines: Timelines, scene: ReviewScene) -> None:
    said = sorted((*scene.drive.table.said.node, *scene.drive.table.said.simulator), key=lambda one: one.time_ns)
    if said:
        time_ns = np.array([one.time_ns for one in said])
        early_s = ((lines.opening_ns - time_ns) * NS).tolist()
        columns = rr.TextLog.columns(
            text=[
                f"({s:.0f} s before) {one.words}" if s > 0 else one.words for one, s in zip(said, early_s, strict=True)
            ],
            level=[LEVELS.get(one.level, "TRACE") for one in said],
        )
        out.send_columns("events", lines.in_seconds(time_ns), columns)


MARGIN_RATIO: Final = 0.02


class Row(NamedTuple):
    """A view over time: its quantity or its lanes, its share of the height, the corner of its legend, and its title.

    The title is for lanes; a quantity has its own title.
    """

    origin: str
    share: float
    legend: Literal["LeftTop", "LeftBottom", "RightTop"] | None = None
    lanes: tuple[str, ...] = ()
    title: str = ""


DRIVING: Final = (WAY, "advised", "shown", "signal", COST)
NODE: Final = ("advised", "node", "no advice")
"""Names of the lanes about the driving (`DRIVING`) and about the node (`NODE`)."""
LANES: Final = "/"
"""The origin of a view of lanes: their names are names of entities at the root."""
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
"""Ranges of the axes that do not follow from the values shown."""
LANE_SHARE: Final = 0.6
"""Height that each lane adds to the share of its view."""


def blueprint(scene: ReviewScene) -> rrb.Blueprint:
    """The layout for a window of about 1600 × 1000; views without anything to show are left out."""
    tabs = [_rows(rows, scene, name) for name, rows in TABS.items()]
    recorded = scene.drive.table.has("cab")
    display = "Display at the cursor" if recorded else "Advice at the cursor (no display was recorded)"
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*(tab for tab in tabs if tab is not None)),
            rrb.Vertical(rrb.TextDocumentView(origin=CAB, name=display), rrb.Tabs(*_tabs(scene))),
            column_shares=[2.05, 1.0],
        ),
        rrb.TimePanel(timeline=Timelines.of_scene(scene).line_clock, state="collapsed", play_state="Paused"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _tabs(scene: ReviewScene) -> list[rrb.View]:
    clock = Timelines.of_scene(scene).line_clock
    columns = rrb.TextLogColumns(timeline_columns=[clock], text_log_columns=["body"])
    found: list[rrb.View] = [
        rrb.TextLogView(origin=BOOKMARKS, name="Bookmarks", columns=columns),
        rrb.TextDocumentView(origin=ENERGY, name="Energy"),
        rrb.TextDocumentView(origin="summary", name="Summary"),
    ]
    if scene.drive.table.said.node or scene.drive.table.said.simulator:
        found.append(rrb.TextLogView(origin="events", name="Log", columns=columns))
    return found


def _rows(rows: tuple[Row, ...], scene: ReviewScene, name: str) -> rrb.Vertical | None:
    found = {quantity_of(one) for one, (time_ns, _) in scene.series.items() if len(time_ns)}
    lanes = {lane.name for lane in scene.lanes}
    rows = tuple(row._replace(lanes=_said(row.lanes, lanes)) for row in rows)
    shown = [row for row in rows if row.origin in found or lanes & set(row.lanes)]
    shares = [row.share + LANE_SHARE * len(lanes & set(row.lanes)) for row in shown]
    axis = _whole_trip(scene)
    return rrb.Vertical(*(_view(row, axis) for row in shown), row_shares=shares, name=name) if shown else None


def _said(lanes: tuple[str, ...], found: set[str]) -> tuple[str, ...]:
    """The lanes; the lane of the modes advised is left out if the lane of the display is shown."""
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
