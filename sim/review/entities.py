"""A recording as rerun entities: series, states, events, cab and track, on the timelines of `Timelines`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import topics
from das.bus.recording import Stamped
from das.domain.units import KMH, NS
from sim.drive.events.chronicle import place_text
from sim.drive.events.event import DriveEvent
from sim.recording.course import Floats, Times
from sim.review.account_view import AccountView
from sim.review.bookmarks import COLORS, bookmarks
from sim.review.cab_card import cards
from sim.review.colors import STANDING_GREY, VIEWER, Meaning, rgba
from sim.review.distance_view import send_distance
from sim.review.lanes import Lane, lane_entity
from sim.review.layout import ENERGY
from sim.review.series import STYLES, MapTrack
from sim.review.story import Story
from sim.review.summary import summary
from sim.review.timelines import Timelines

TRACK_PIECES: Final = 300
TRAIN: Final = rgba(VIEWER.of[Meaning.DRIVEN])
SLOW, FAST = (np.array(list(bytes.fromhex(one[1:]))) for one in (STANDING_GREY, VIEWER.of[Meaning.DRIVEN]))
"""Ends of the colours of the track, from standing to the highest speed: grey, and the blue of what was driven."""
LEVELS: Final = {Log.DEBUG: "DEBUG", Log.INFO: "INFO", Log.WARNING: "WARN", Log.ERROR: "ERROR", Log.FATAL: "CRITICAL"}
MARKDOWN: Final = rr.MediaType.MARKDOWN
REACHED_M: Final = 200.0
"""A stop this near (m) to where the train came is on its track."""


def send(out: rr.RecordingStream, story: Story, *, with_map: bool) -> None:
    """Send everything that is shown to rerun, but the account of the energy."""
    recording, lines = story.recording, Timelines(trip=story.trip, clock=story.clock)
    for name, (time_ns, values) in story.series.items():
        if len(time_ns):
            send_series(out, lines, name, time_ns, values)
    for lane in story.lanes:
        send_lane(out, lines, lane)
    marked = bookmarks(story.drive.events)
    _marks(out, lines, marked)
    _bookmarks(out, lines, marked)
    _events(out, lines, recording.of(topics.EVENT) + recording.of(topics.LOG))
    _cab(out, lines, story)
    if story.way is not None:
        _location(out, lines, story.way, story, with_map=with_map)
    send_distance(out, lines, story)
    out.log("summary", rr.TextDocument(summary(story.drive, story.filled_from), media_type=MARKDOWN), static=True)


def send_account(out: rr.RecordingStream, lines: Timelines, shown: AccountView) -> None:
    """Send the account of the energy."""
    out.log(ENERGY, rr.TextDocument(shown.text, media_type=MARKDOWN), static=True)
    for name, (time_ns, values) in shown.series.items():
        send_series(out, lines, name, time_ns, values)
    if shown.lane.changes:
        send_lane(out, lines, shown.lane)


def send_no_account(out: rr.RecordingStream, why: str) -> None:
    """Say why there is no account of the energy."""
    out.log(ENERGY, rr.TextDocument(why, media_type=MARKDOWN), static=True)


def send_series(out: rr.RecordingStream, lines: Timelines, name: str, time_ns: Times, values: Floats) -> None:
    """Send a series in its style."""
    style, modes = STYLES[name], rr.components.InterpolationMode
    looks = rr.SeriesLines(
        colors=rgba(VIEWER.of[style.meaning]),
        names=style.label,
        widths=style.width,
        interpolation_mode=modes.StepAfter if style.held else modes.Linear,
    )
    out.log(name, looks, static=True)
    out.send_columns(name, lines.of(time_ns), rr.Scalars.columns(scalars=values))


def send_lane(out: rr.RecordingStream, lines: Timelines, lane: Lane) -> None:
    """Send a lane of states, with one row for each change."""
    entity, states = lane_entity(lane.name), list(lane.colors)
    shades = np.array([rgba(lane.color(state, VIEWER)) for state in states], dtype=np.uint32)
    time_ns = np.array([change.time_ns for change in lane.changes])
    out.log(entity, rr.StateConfiguration(values=states, colors=shades), static=True)
    columns = rr.StateChange.columns(state=[change.state for change in lane.changes])
    out.send_columns(entity, lines.of(time_ns), columns)


def _marks(out: rr.RecordingStream, lines: Timelines, found: tuple[DriveEvent, ...]) -> None:
    """Send the bookmarks as points on the driven speed; their words are in the list."""
    trip = lines.trip
    if found:
        time_ns = np.array([one.time_ns for one in found])
        points = rr.SeriesPoints(
            colors=rgba(VIEWER.ink), names="bookmark (see the list)", markers="Diamond", marker_sizes=5.0
        )
        out.log("speed/bookmarks", points, static=True)
        values = trip.at(time_ns, trip.speed_mps) / KMH
        out.send_columns("speed/bookmarks", lines.of(time_ns), rr.Scalars.columns(scalars=values))


def _bookmarks(out: rr.RecordingStream, lines: Timelines, found: tuple[DriveEvent, ...]) -> None:
    """Send the list of bookmarks: a click on one leads to its time."""
    if found:
        colors = [rgba(VIEWER.of[COLORS[one.kind]] if one.kind in COLORS else VIEWER.ink) for one in found]
        columns = rr.TextLog.columns(
            text=[_bookmark_text(lines, one) for one in found],
            level=["INFO"] * len(found),
            color=np.array(colors, dtype=np.uint32),
        )
        out.send_columns("bookmarks", lines.of(np.array([one.time_ns for one in found])), columns)


def _bookmark_text(lines: Timelines, one: DriveEvent) -> str:
    """A bookmark with its time as all tables show it: rerun shows seconds."""
    return f"{lines.clock.shown(one.time_ns)}  {place_text(one.s_m)}  {one.kind}: {one.text}"


def _events(out: rr.RecordingStream, lines: Timelines, messages: tuple[Stamped, ...]) -> None:
    messages = tuple(sorted(messages, key=lambda entry: entry.message.timestamp.ToNanoseconds()))
    if messages:
        time_ns = np.array([m.message.timestamp.ToNanoseconds() for m in messages])
        early_s = (lines.trip.time_ns[0] - time_ns) * NS
        columns = rr.TextLog.columns(
            text=[_event_text(m.message, early) for m, early in zip(messages, early_s, strict=True)],
            level=[LEVELS.get(m.message.level, "TRACE") for m in messages],
        )
        out.send_columns("events", lines.of(time_ns), columns)


def _event_text(event: Log, early_s: float) -> str:
    when = f"({early_s:.0f} s before) " if early_s > 0 else ""
    return f"{when}{event.name}: {event.message}" if event.name else f"{when}{event.message}"


def _cab(out: rr.RecordingStream, lines: Timelines, story: Story) -> None:
    """Send what the driver saw, as a text that changes with the time."""
    found = cards(story.recording, story.trip)
    if found:
        columns = rr.TextDocument.columns(text=[card.text for card in found], media_type=[MARKDOWN] * len(found))
        out.send_columns("cab", lines.of(np.array([card.time_ns for card in found])), columns)


def _location(out: rr.RecordingStream, lines: Timelines, way: MapTrack, story: Story, *, with_map: bool) -> None:
    """Send the way in a plane, coloured by speed, with the stops; and on the map if it is wanted."""
    index, trip = lines.of(way.time_ns), lines.trip
    radius, dot = rr.Radius.ui_points(2.5), rr.Radius.ui_points(7.0)
    ends = np.unique(np.linspace(0, len(way.time_ns) - 1, TRACK_PIECES + 1).astype(int))
    speed = trip.at(way.time_ns[ends[:-1]], trip.speed_mps)
    share = speed / max(float(speed.max(initial=0.0)), 1.0)
    shades = np.rint(SLOW + share[:, None] * (FAST - SLOW)).astype(np.uint8)
    pieces = [way.plane_m[a : b + 1] for a, b in pairwise(ends)]
    out.log("track/way", rr.LineStrips2D(pieces, colors=shades, radii=radius), static=True)
    _track_stops(out, way, story)
    out.log("track/train", rr.Points2D.from_fields(colors=TRAIN, radii=dot), static=True)
    out.send_columns("track/train", index, rr.Points2D.columns(positions=way.plane_m))
    if with_map:
        color = rgba(VIEWER.of[STYLES["speed/driven"].meaning])
        out.log("map/way", rr.GeoLineStrings(lat_lon=[way.degrees], colors=color, radii=radius), static=True)
        out.log("map/train", rr.GeoPoints.from_fields(colors=TRAIN, radii=dot), static=True)
        out.send_columns("map/train", index, rr.GeoPoints.columns(positions=way.degrees))


def _track_stops(out: rr.RecordingStream, way: MapTrack, story: Story) -> None:
    """Send the names of the stops that the train reached, where it was then."""
    trip = story.trip
    at_m = trip.at(way.time_ns, trip.s_m)
    rising = np.maximum.accumulate(at_m)
    reached = [
        (stop.name, way.plane_m[min(int(np.searchsorted(rising, stop.s_m)), len(rising) - 1)])
        for stop in (entry for one in story.recording.of(topics.JOURNEY)[-1:] for entry in one.message.stops)
        if at_m.min() - REACHED_M <= stop.s_m <= at_m.max() + REACHED_M
    ]
    if reached:
        places: Sequence[Floats] = [place for _, place in reached]
        names = [name for name, _ in reached]
        radius = rr.Radius.ui_points(4.0)
        out.log("track/stops", rr.Points2D(places, labels=names, colors=rgba(VIEWER.ink), radii=radius), static=True)
