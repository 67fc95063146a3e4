"""The trip over distance as lines in a plane of the viewer, which can be zoomed, with a cursor that follows the time.

Rerun's own plots always follow its active timeline. In the plane, 1 unit is 1/1600 of the trip to the right, and down
1/1600 of the trip as well; speed, force and gradient are scaled into strips under each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import rerun as rr

from das.bus import topics
from das.domain.units import KM, KMH
from sim.recording.course import Floats
from sim.review.colors import VIEWER, Meaning, rgba
from sim.review.series import STYLES, FirstPlans
from sim.review.story import Story
from sim.review.timelines import Timelines

WIDTH: Final = 1600.0
"""Width of the trip in the plane."""
NICE: Final = (1.0, 2.0, 5.0, 10.0)
FURNITURE: Final = ("grid", "axes", "stops", "names", "key", "here")
"""Entities over distance about which there is nothing to be told when somebody points at them."""
SIGNAL_SHARE: Final = 0.12
LETTER: Final = 6.0
"""Half the width of a letter and its bubble in the window that the layout is made for."""
INK: Final = rgba(VIEWER.ink)
GRID: Final = INK & ~0xFF | 0x40
"""The grid is a faint ink."""
THIN: Final = rr.Radius.ui_points(0.5)


class Strip(NamedTuple):
    """A strip of the plane: the quantity, its name, the rows of its top and bottom, and the least range of values."""

    name: str
    title: str
    top: float
    bottom: float
    least: tuple[float, float]


STRIPS: Final = (
    Strip("speed", "km/h", 44.0, 390.0, (0.0, 10.0)),
    Strip("force", "kN", 425.0, 545.0, (-10.0, 10.0)),
    Strip("gradient", "permille", 580.0, 660.0, (-5.0, 5.0)),
)
BOTTOM: Final = STRIPS[-1].bottom
MARGIN: Final = (100.0, 30.0, 105.0)
"""Room left and right of the lines, and under them for the positions; above there are 44 for the names of stops."""


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Where things lie in the plane: positions (m) to columns, values of a strip to rows."""

    start_m: float
    end_m: float
    ranges: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, story: Story) -> Plane:
        """The plane of a story: as far as the train drove, and as high as what was driven, allowed and advised."""
        start_m, end_m = float(story.trip.s_m.min()), float(story.trip.s_m.max())
        return cls(
            start_m=start_m,
            end_m=max(end_m, start_m + 1.0),
            ranges={strip.name: _range(story, strip) for strip in STRIPS},
        )

    def x(self, s_m: Floats | float) -> Floats:
        """Columns of positions (m)."""
        return np.asarray((np.asarray(s_m) - self.start_m) * (WIDTH / (self.end_m - self.start_m)))

    def y(self, name: str, values: Floats | float) -> Floats:
        """Rows of values in the strip of a quantity; what is beyond its range lies at its edge."""
        strip = next(one for one in STRIPS if one.name == name)
        low, high = self.ranges[name]
        share = np.clip((np.asarray(values) - low) / (high - low), 0.0, 1.0)
        return np.asarray(strip.bottom - share * (strip.bottom - strip.top))


def _range(story: Story, strip: Strip) -> tuple[float, float]:
    """The range of a strip: round figures about all that was driven and allowed, and most of what was advised."""
    low, high = strip.least
    for name, (_, values) in story.series.items():
        known = values[np.isfinite(values)]
        if name.startswith(f"{strip.name}/") and len(known):
            ends = np.percentile(known, (2.5, 97.5)) if name == "force/advised" else (known.min(), known.max())
            low, high = min(low, float(ends[0])), max(high, float(ends[1]))
    step = _step(high - low)
    return step * np.floor(low / step), step * np.ceil(1.02 * high / step)


def _step(range_: float, most: int = 6) -> float:
    """The distance of grid lines: a round figure, so that there are no more than `most`."""
    rough = range_ / most
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * next(one for one in NICE if one * power >= rough))


def send_distance(out: rr.RecordingStream, lines: Timelines, story: Story) -> Plane:
    """Send everything over distance to rerun, and return where it lies."""
    plane = Plane.of(story)
    _grid(out, plane)
    _stops(out, plane, story)
    _places(out, plane, story)
    for number, (name, at_m, values) in enumerate(_curves(story)):
        strip, style = name.split("/")[0], STYLES[name]
        pieces = unbroken(plane.x(at_m), plane.y(strip, values), values)
        if style.held:
            pieces = [stepped(piece) for piece in pieces]
        radius, color = rr.Radius.ui_points(0.6 * style.width), rgba(VIEWER.of[style.meaning])
        out.log(
            f"distance/{name}",
            rr.LineStrips2D(pieces, colors=color, radii=radius, draw_order=20.0 + number),
            static=True,
        )
    _key(out, story)
    _here(out, plane, lines, story)
    return plane


def _curves(story: Story) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, positions (m) and values of all series that have a strip, in drawing order."""
    trip, plan = story.trip, FirstPlans.of(story.recording)
    for name in STYLES:
        if name.split("/")[0] not in {strip.name for strip in STRIPS} or name not in story.series:
            continue
        time_ns, values = story.series[name]
        at_m = trip.at(time_ns, trip.s_m)
        if name == "speed/optimum" and plan is not None:  # it would be elsewhere than the train was at its times
            within = (plan.s_m >= trip.s_m.min()) & (plan.s_m <= trip.s_m.max())
            at_m, values = plan.s_m[within], plan.speed_mps[within] / KMH
        if np.isfinite(values).any():
            yield name, at_m, values


def unbroken(x: Floats, y: Floats, values: Floats) -> list[Floats]:
    """The pieces of a line between values that are not known, each of shape (points, 2)."""
    known = np.concatenate(([False], np.isfinite(values), [False]))
    edges = np.flatnonzero(np.diff(known.astype(np.int8)))
    points = np.column_stack((x, y))
    return [points[first:end] for first, end in zip(edges[::2], edges[1::2], strict=True)]


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
        step = _step(high - low, most=6 if strip.name == "speed" else 3)
        top = step * np.floor(high / step)
        for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step:
            y = float(plane.y(strip.name, value))
            lines.append(np.array([(0.0, y), (WIDTH, y)]))
            text = f"{value + 0.0:g}{f' {strip.title}' if value == top else ''}"
            texts.append((-14.0 - LETTER * len(text), y, text))
    out.log("distance/grid", rr.LineStrips2D(lines, colors=GRID, radii=THIN, draw_order=10.0), static=True)
    _texts(out, "distance/axes", texts, [INK] * len(texts))


def _texts(
    out: rr.RecordingStream, entity: str, texts: Sequence[tuple[float, float, str]], colors: Sequence[int]
) -> None:
    """Send texts at places of the plane."""
    if texts:
        places, labels = [(x, y) for x, y, _ in texts], [text for _, _, text in texts]
        radius = rr.Radius.ui_points(0.0)
        out.log(
            entity,
            rr.Points2D(places, labels=labels, colors=np.array(colors, np.uint32), radii=radius, show_labels=True),
            static=True,
        )


def _stops(out: rr.RecordingStream, plane: Plane, story: Story) -> None:
    """Send a line at every stop, and its name above it."""
    stops = [(stop.s_m, stop.name) for entry in story.recording.of(topics.JOURNEY)[-1:] for stop in entry.message.stops]
    texts = [(float(plane.x(s_m)), 14.0, name) for s_m, name in stops if plane.start_m <= s_m <= plane.end_m + KM]
    if texts:
        lines = [np.array([(x, 28.0), (x, BOTTOM)]) for x, _, _ in texts]
        out.log("distance/stops", rr.LineStrips2D(lines, colors=INK, radii=THIN), static=True)
        _texts(out, "distance/names", texts, [INK] * len(texts))


def _places(out: rr.RecordingStream, plane: Plane, story: Story) -> None:
    """Send what has a place of its own: restrictions, signals at danger and targets."""
    strip, (_, top) = STRIPS[0], plane.ranges["speed"]
    limit, danger = rgba(VIEWER.of[Meaning.LIMIT]), rgba(VIEWER.of[Meaning.DANGER])
    limits = [limit.restriction for limit in story.limits]
    if limits:
        boxes = [
            (float(plane.x(one.start_m)), strip.top, float(plane.x(one.end_m)), float(plane.y("speed", kmh)))
            for one in limits
            if (kmh := min(one.limit_mps / KMH, top)) > 0
        ]
        labels = [f"{one.limit_mps / KMH:.0f} km/h" for one in limits]
        minima, sizes = [(a, b) for a, b, _, _ in boxes], [(c - a, d - b) for a, b, c, d in boxes]
        restricted = rr.Boxes2D(mins=minima, sizes=sizes, colors=limit, labels=labels, show_labels=True)
        out.log("distance/restrictions", restricted, static=True)
    height = strip.bottom - SIGNAL_SHARE * (strip.bottom - strip.top)
    if story.signals:
        ends = [float(plane.x(one.s_m)) for one in story.signals]
        posts = [np.array([(x, strip.bottom), (x, height)]) for x in ends]
        out.log("distance/signals", rr.LineStrips2D(posts, colors=danger, radii=rr.Radius.ui_points(1.5)), static=True)
        _texts(out, "distance/danger", [(x, height, "at danger") for x in ends], [danger] * len(ends))
    texts = [(float(plane.x(one.s_m)), height, one.text) for one in story.points]
    _texts(out, "distance/targets", texts, [rgba(VIEWER.of[Meaning.OPERATOR])] * len(texts))


def _key(out: rr.RecordingStream, story: Story) -> None:
    """Send what the colours of the lines are, once each, under the positions."""
    named = dict.fromkeys(STYLES[name].meaning for name, _, _ in _curves(story))
    x = np.linspace(0.0, WIDTH, len(named) + 2)[1:-1]
    texts = [(float(at), BOTTOM + 60.0, meaning.value) for at, meaning in zip(x, named, strict=True)]
    _texts(out, "distance/key", texts, [rgba(VIEWER.of[meaning]) for meaning in named])


def _here(out: rr.RecordingStream, plane: Plane, lines: Timelines, story: Story) -> None:
    """Send the cursor: a line and a dot that follow the train."""
    trip = story.trip
    x, y = plane.x(trip.s_m), plane.y("speed", trip.speed_mps / KMH)
    index = lines.of(trip.time_ns)
    strips = np.empty((len(x), 2, 2), np.float32)
    strips[:, :, 0], strips[:, 0, 1], strips[:, 1, 1] = x[:, None], STRIPS[0].top, BOTTOM
    blue = rgba(VIEWER.of[Meaning.DRIVEN])
    out.log("distance/here", rr.LineStrips2D.from_fields(colors=INK, radii=rr.Radius.ui_points(1.2)), static=True)
    out.send_columns("distance/here", index, rr.LineStrips2D.columns(strips=strips))
    out.log(
        "distance/train",
        rr.Points2D.from_fields(colors=blue, radii=rr.Radius.ui_points(6.0), draw_order=40.0),
        static=True,
    )
    out.send_columns("distance/train", index, rr.Points2D.columns(positions=np.column_stack((x, y))))
