"""The scene as rerun entities: over time, over distance in a plane that can be zoomed, and on the track.

Rerun's own plots always follow its active timeline. So curves over distance lie in a plane, in which 1 unit is 1/1600
of the trip in both directions. Speed, force and gradient are scaled into strips one below the other, and a cursor
follows the time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, tzinfo
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.advice.wording import Language
from das.domain.units import KM, KMH, NS
from sim.drive.series import QUANTITIES, STYLES, MapTrack, quantity_of
from sim.meanings import STANDING_GREY, VIEWER, Meaning, rgba
from sim.recording.course import STANDING_MPS, DriveClock, DrivenCourse, Floats, Times, stretches_of
from sim.review.cab_display import send_cab
from sim.review.lanes import Lane, lane_entity
from sim.review.scene import DRAWN_OVER_DISTANCE, ReviewScene
from sim.review.words import DisplayWords, summary

DRIVE_CLOCK, POSITION = "drive_clock", "position_m"
"""Names of two timelines: time on the drive's clock, and position on the route (m). The third is the line's clock."""
ENERGY, BOOKMARKS = "account", "bookmarks"
"""Entities of the energy attribution and of the bookmarks."""
MARKDOWN: Final = rr.MediaType.MARKDOWN
LEVELS: Final[Mapping[int, str]] = {
    Log.DEBUG: "DEBUG",
    Log.INFO: "INFO",
    Log.WARNING: "WARN",
    Log.ERROR: "ERROR",
    Log.FATAL: "CRITICAL",
}

INK: Final = rgba(VIEWER.ink)
GRID: Final = INK & ~0xFF | 0x40
"""The grid is a faint ink."""
TRAIN: Final = rgba(VIEWER.of[Meaning.DRIVEN])
SLOW, FAST = (np.array(list(bytes.fromhex(one[1:]))) for one in (STANDING_GREY, VIEWER.of[Meaning.DRIVEN]))
"""Colours of the track at standstill and at the highest speed: grey, and the blue of what was driven."""
TRACK_PIECES: Final = 300
REACHED_M: Final = 200.0
"""Distance (m) beyond the ends of the train's course within which a stop is drawn as well."""

WIDTH: Final = 1600.0
"""Width of the trip in the plane."""
NICE: Final = (1.0, 2.0, 5.0, 10.0)
FURNITURE: Final = ("grid", "axes", "stops", "names", "key", "here")
"""Entities over distance that show nothing when a user points at them."""
SIGNAL_SHARE: Final = 0.12
LANE_LETTERS: Final = 137.0
"""Letters that fit into a lane in the window that the layout is made for."""
FIGURE: Final = re.compile(r"[+-]?\d[\d.]*")
LETTER: Final = 6.0
"""Half the width of a letter and its bubble in the window that the layout is made for."""
THIN: Final = rr.Radius.ui_points(0.5)


class Strip(NamedTuple):
    """A strip of the plane: the quantity, the rows of its top and bottom, and the least range of values."""

    name: str
    top: float
    bottom: float
    least: tuple[float, float]


STRIPS: Final = (
    Strip("speed", 60.0, 370.0, (0.0, 10.0)),
    Strip("force", 405.0, 500.0, (-10.0, 10.0)),
    Strip("gradient", 535.0, 590.0, (-5.0, 5.0)),
)
BOTTOM: Final = STRIPS[-1].bottom
MARGIN: Final = (100.0, 30.0, 105.0)
"""Room left and right of the lines, and under them for the positions; above there are 44 for the names of stops."""


@dataclass(frozen=True, kw_only=True)
class Timelines:
    """Puts messages on all timelines: the clock of the line (the one to look at), that of the drive, and the position.

    The viewer opens at the earliest moment of a timeline, so `opening_ns` is the first moment that is drawn.
    """

    trip: DrivenCourse
    clock: DriveClock
    zone: tzinfo
    opening_ns: int

    @classmethod
    def of_scene(cls, scene: ReviewScene) -> Timelines:
        """The timelines of a scene: they begin at the first bookmark if the train stood until then, else at the first
        position."""
        trip = scene.trip
        first_ns = min((one.time_ns for one in scene.bookmarks), default=int(trip.time_ns[0]))
        stood = not (trip.speed_mps[trip.time_ns < first_ns] > STANDING_MPS).any()
        opening_ns = max(first_ns, int(trip.time_ns[0])) if stood else int(trip.time_ns[0])
        return cls(trip=trip, clock=scene.clock, zone=scene.drive.table.zone, opening_ns=opening_ns)

    @property
    def line_clock(self) -> str:
        """The name of the timeline of the line's clock; the list of bookmarks is as wide as this name."""
        return f"clock in {self.zone}" if str(self.zone) != "UTC" else "clock in UTC (no zone)"

    def local_ns(self, time_ns: Times) -> Times:
        """Moments as the line's clock shows them, the earlier ones moved to the opening: ns since 1970 there."""
        ahead = datetime.fromtimestamp(self.opening_ns * NS, self.zone).utcoffset() or timedelta()
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
    """Send everything to rerun that is to be shown, except the energy attribution; the display is in a language."""
    out.send_recording_name(f"{scene.recording.train} ({scene.recording.path.name})")
    lines = Timelines.of_scene(scene)
    for name, (time_ns, values) in scene.series.items():
        if len(time_ns):
            _series(out, lines, name, time_ns, values)
    for lane in scene.lanes_in_words:
        _lane(out, lines, lane)
    _bookmarks(out, lines, scene)
    _events(out, lines, scene)
    send_cab(out, lines.of, scene, DisplayWords(language, scene.drive.table.zone))
    if scene.way is not None:
        _location(out, lines, scene.way, scene)
    _over_distance(out, lines, scene)
    out.log("summary", rr.TextDocument(summary(scene.drive, scene.filled_from), media_type=MARKDOWN), static=True)


def send_attribution(out: rr.RecordingStream, scene: ReviewScene) -> None:
    """Send where the energy went in a scene with its energy attribution, or why it is not known."""
    lines, shown = Timelines.of_scene(scene), scene.attribution
    why_not = f"The energy is not attributed: {scene.drive.energy.why_no_attribution}."
    out.log(ENERGY, rr.TextDocument(why_not if shown is None else shown.text, media_type=MARKDOWN), static=True)
    if shown is not None:
        for name in shown.series:
            _series(out, lines, name, *scene.series[name])
        if shown.spans:
            _lane(out, lines, shown.lane)


def _series(out: rr.RecordingStream, lines: Timelines, name: str, time_ns: Times, values: Floats) -> None:
    """Send a series in its style."""
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
    """Send a lane of states, with one row for each change. A state too short for its words has its figure, or none."""
    entity = lane_entity(lane.name)
    time_ns = np.array([change.time_ns for change in lane.changes])
    ends_ns = np.maximum(np.append(time_ns, lines.trip.time_ns[-1]), lines.opening_ns)
    letters = np.diff(ends_ns) / max(float(lines.trip.time_ns[-1] - lines.opening_ns), 1.0) * LANE_LETTERS
    texts = [fitting(change.state, room) for change, room in zip(lane.changes, letters, strict=True)]
    # A value is told from another one with the same colour and the same words by its end, which is not shown.
    values = {f"{change.state}|{text}": (text, change.state) for change, text in zip(lane.changes, texts, strict=True)}
    shades = np.array([rgba(lane.color(state, VIEWER)) for _, state in values.values()], dtype=np.uint32)
    labels = [text or " " for text, _ in values.values()]
    out.log(entity, rr.StateConfiguration(values=list(values), labels=labels, colors=shades), static=True)
    states = [f"{one.state}|{text}" if one.state else "" for one, text in zip(lane.changes, texts, strict=True)]
    out.send_columns(entity, lines.of(time_ns), rr.StateChange.columns(state=states))


def fitting(state: str, letters: float) -> str:
    """The words of a state, or else the figure in them, or else nothing: whatever fits into a number of letters."""
    figure = FIGURE.search(state)
    for text in (state, figure[0] if figure else ""):
        if len(text) + 1 <= letters:
            return text
    return ""


def _bookmarks(out: rr.RecordingStream, lines: Timelines, scene: ReviewScene) -> None:
    """Send the bookmarks as points on the driven speed, and as a list in which a click leads to their time."""
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
    """Send the events of the node and the log of the simulator."""
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


def _location(out: rr.RecordingStream, lines: Timelines, way: MapTrack, scene: ReviewScene) -> None:
    """Send the track in a plane, coloured by speed, with the stops."""
    index, trip = lines.of(way.time_ns), lines.trip
    radius, dot = rr.Radius.ui_points(2.5), rr.Radius.ui_points(7.0)
    ends = np.unique(np.linspace(0, len(way.time_ns) - 1, TRACK_PIECES + 1).astype(int))
    speed = trip.at(way.time_ns[ends[:-1]], trip.speed_mps)
    share = speed / max(float(speed.max(initial=0.0)), 1.0)
    shades = np.rint(SLOW + share[:, None] * (FAST - SLOW)).astype(np.uint8)
    pieces = [way.plane_m[a : b + 1] for a, b in pairwise(ends)]
    out.log("track/way", rr.LineStrips2D(pieces, colors=shades, radii=radius), static=True)
    _track_stops(out, way, scene)
    out.log("track/train", rr.Points2D.from_fields(colors=TRAIN, radii=dot), static=True)
    out.send_columns("track/train", index, rr.Points2D.columns(positions=way.plane_m))


def _track_stops(out: rr.RecordingStream, way: MapTrack, scene: ReviewScene) -> None:
    """Send the names of the stops that the train reached, each at the train's location when it did."""
    at_m = scene.trip.at(way.time_ns, scene.trip.s_m)
    rising = np.maximum.accumulate(at_m)
    reached = [
        (name, way.plane_m[min(int(np.searchsorted(rising, s_m)), len(rising) - 1)])
        for name, s_m in scene.stops
        if at_m.min() - REACHED_M <= s_m <= at_m.max() + REACHED_M
    ]
    if reached:
        names, places = [name for name, _ in reached], [place for _, place in reached]
        radius = rr.Radius.ui_points(4.0)
        out.log("track/stops", rr.Points2D(places, labels=names, colors=INK, radii=radius), static=True)


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Where things lie in the plane: positions (m) to columns, values of a strip to rows."""

    start_m: float
    end_m: float
    ranges: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, scene: ReviewScene) -> Plane:
        """The plane of a scene: as far as the train drove, and as high as what was driven, allowed and advised."""
        start_m, end_m = float(scene.trip.s_m.min()), float(scene.trip.s_m.max())
        ranges = {strip.name: _range(scene, strip) for strip in STRIPS}
        return cls(start_m=start_m, end_m=max(end_m, start_m + 1.0), ranges=ranges)

    def x(self, s_m: Floats | float) -> Floats:
        """Columns of positions (m)."""
        return np.asarray((np.asarray(s_m) - self.start_m) * (WIDTH / (self.end_m - self.start_m)))

    def y(self, name: str, values: Floats | float) -> Floats:
        """Rows of values in the strip of a quantity; values beyond its range lie at its edge."""
        strip = next(one for one in STRIPS if one.name == name)
        low, high = self.ranges[name]
        share = np.clip((np.asarray(values) - low) / (high - low), 0.0, 1.0)
        return np.asarray(strip.bottom - share * (strip.bottom - strip.top))


def _range(scene: ReviewScene, strip: Strip) -> tuple[float, float]:
    """The range of a strip: round figures about all that is to be shown."""
    found = scene.extent(strip.name) or strip.least
    low, high = min(strip.least[0], found[0]), max(strip.least[1], found[1])
    step = _step(high - low)
    return step * np.floor(low / step), step * np.ceil(1.02 * high / step)


def _step(range_: float, most: int = 6) -> float:
    """The distance between grid lines: a round figure, such that there are no more than `most` lines."""
    rough = range_ / most
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * next(one for one in NICE if one * power >= rough))


def _over_distance(out: rr.RecordingStream, lines: Timelines, scene: ReviewScene) -> None:
    """Send everything over distance."""
    plane = Plane.of(scene)
    _grid(out, plane)
    _stops(out, plane, scene)
    _places(out, plane, scene)
    named: dict[Meaning, None] = {}
    for number, trace in enumerate(scene.over_distance(DRAWN_OVER_DISTANCE)):
        style = STYLES[trace.name]
        pieces = unbroken(plane.x(trace.s_m), plane.y(trace.quantity, trace.values), trace.values)
        if style.held:
            pieces = [stepped(piece) for piece in pieces]
        radius, color = rr.Radius.ui_points(0.6 * style.width), rgba(VIEWER.of[style.meaning])
        drawn = rr.LineStrips2D(pieces, colors=color, radii=radius, draw_order=20.0 + number)
        out.log(f"distance/{trace.name}", drawn, static=True)
        named[style.meaning] = None
    # What each colour means, once, under the positions.
    x = np.linspace(0.0, WIDTH, len(named) + 2)[1:-1]
    texts = [(float(at), BOTTOM + 60.0, meaning.value) for at, meaning in zip(x, named, strict=True)]
    _texts(out, "distance/key", texts, [rgba(VIEWER.of[meaning]) for meaning in named])
    _here(out, plane, lines)


def unbroken(x: Floats, y: Floats, values: Floats) -> list[Floats]:
    """The pieces of a line between values that are not known, each of shape (points, 2)."""
    points = np.column_stack((x, y))
    return [points[first:end] for first, end in stretches_of(np.isfinite(values))]


def stepped(points: Floats) -> Floats:
    """The points of values that hold until the next, with the corners."""
    corners = np.column_stack((points[1:, 0], points[:-1, 1]))
    found = np.empty((2 * len(points) - 1, 2))
    found[::2], found[1::2] = points, corners
    return found


def _grid(out: rr.RecordingStream, plane: Plane) -> None:
    """Send the grid, and the figures on its axes."""
    lines: list[Floats] = []
    texts: list[tuple[float, float, str]] = []
    km = _step((plane.end_m - plane.start_m) / KM, most=12)
    for at in np.arange(np.ceil(plane.start_m / KM / km), np.floor(plane.end_m / KM / km) + 1) * km:
        x = float(plane.x(at * KM))
        lines += [np.array([(x, strip.top), (x, strip.bottom)]) for strip in STRIPS]
        texts.append((x, BOTTOM + 22.0, f"km {at:g}"))
    for strip in STRIPS:
        low, high = plane.ranges[strip.name]
        step = _step(high - low, most={"speed": 6, "force": 3}.get(strip.name, 2))
        top = step * np.floor(high / step)
        for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step:
            y = float(plane.y(strip.name, value))
            lines.append(np.array([(0.0, y), (WIDTH, y)]))
            text = f"{value + 0.0:g}{f' {QUANTITIES[strip.name].spelt_unit}' if value == top else ''}"
            texts.append((-14.0 - LETTER * len(text), y, text))
    out.log("distance/grid", rr.LineStrips2D(lines, colors=GRID, radii=THIN, draw_order=10.0), static=True)
    _texts(out, "distance/axes", texts, [INK] * len(texts))


def _texts(
    out: rr.RecordingStream, entity: str, texts: Sequence[tuple[float, float, str]], colors: Sequence[int]
) -> None:
    """Send texts at places of the plane."""
    if texts:
        places, labels = [(x, y) for x, y, _ in texts], [text for _, _, text in texts]
        shades, radius = np.array(colors, np.uint32), rr.Radius.ui_points(0.0)
        drawn = rr.Points2D(places, labels=labels, colors=shades, radii=radius, show_labels=True)
        out.log(entity, drawn, static=True)


def _stops(out: rr.RecordingStream, plane: Plane, scene: ReviewScene) -> None:
    """Send a line at every stop, and its name above it."""
    texts = [
        (float(plane.x(s_m)), 14.0, name)
        for name, s_m in scene.stops
        if plane.start_m - REACHED_M <= s_m <= plane.end_m + KM
    ]
    if texts:
        lines = [np.array([(x, 28.0), (x, BOTTOM)]) for x, _, _ in texts]
        out.log("distance/stops", rr.LineStrips2D(lines, colors=INK, radii=THIN), static=True)
        _texts(out, "distance/names", texts, [INK] * len(texts))


def _places(out: rr.RecordingStream, plane: Plane, scene: ReviewScene) -> None:
    """Send what has a place of its own: restrictions, signals at danger and targets."""
    strip, (_, top) = STRIPS[0], plane.ranges["speed"]
    height = strip.bottom - SIGNAL_SHARE * (strip.bottom - strip.top)
    limits, signals, targets = (
        scene.places_of(meaning) for meaning in (Meaning.LIMIT, Meaning.DANGER, Meaning.OPERATOR)
    )
    if limits:
        minima = [(float(plane.x(one.start_m)), strip.top) for one in limits]
        maxima = [(float(plane.x(one.end_m)), float(plane.y("speed", min(one.limit_mps / KMH, top)))) for one in limits]
        sizes, color = np.subtract(maxima, minima), rgba(VIEWER.of[Meaning.LIMIT])
        labels = [one.text for one in limits]
        boxes = rr.Boxes2D(mins=minima, sizes=sizes, colors=color, labels=labels, show_labels=True)
        out.log("distance/restrictions", boxes, static=True)
    if signals:
        color = rgba(VIEWER.of[Meaning.DANGER])
        posts = [np.array([(x, strip.bottom), (x, height)]) for one in signals for x in [float(plane.x(one.start_m))]]
        out.log("distance/signals", rr.LineStrips2D(posts, colors=color, radii=rr.Radius.ui_points(1.5)), static=True)
    for entity, found in (("distance/danger", signals), ("distance/targets", targets)):
        texts = [(float(plane.x(one.start_m)), height, one.text) for one in found]
        _texts(out, entity, texts, [rgba(VIEWER.of[one.meaning]) for one in found])


def _here(out: rr.RecordingStream, plane: Plane, lines: Timelines) -> None:
    """Send the cursor: a line and a dot that follow the train."""
    trip = lines.trip
    x, y = plane.x(trip.s_m), plane.y("speed", trip.speed_mps / KMH)
    index = lines.of(trip.time_ns)
    strips = np.empty((len(x), 2, 2), np.float32)
    strips[:, :, 0], strips[:, 0, 1], strips[:, 1, 1] = x[:, None], STRIPS[0].top, BOTTOM
    out.log("distance/here", rr.LineStrips2D.from_fields(colors=INK, radii=rr.Radius.ui_points(1.2)), static=True)
    out.send_columns("distance/here", index, rr.LineStrips2D.columns(strips=strips))
    dot = rr.Points2D.from_fields(colors=TRAIN, radii=rr.Radius.ui_points(6.0), draw_order=40.0)
    out.log("distance/train", dot, static=True)
    out.send_columns("distance/train", index, rr.Points2D.columns(positions=np.column_stack((x, y))))
