"""A recording as rerun entities: series, states, events, map and track, on time and on distance."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Log_pb2 import Log
from matplotlib import colormaps

from das.bus import topics
from das.bus.recording import Recording, Stamped
from das.domain.units import KMH, NS
from sim.events.notes import read_notes
from sim.review.distance_picture import Picture, draw
from sim.review.lanes import Lane
from sim.review.series import STYLES, DrivenCourse, Floats, MapTrack, Times
from sim.review.story import Story
from sim.review.summary import summary

TRIP_TIME, TIME_OF_DAY, POSITION = "trip_time", "time_of_day", "position_m"
"""Names of the timelines: time since the first position of the trip, time of day (UTC), position on the route (m)."""
TRACK_PIECES: Final = 300
WHITE: Final = 0xFFFFFFFF
LEVELS: Final = {Log.DEBUG: "DEBUG", Log.INFO: "INFO", Log.WARNING: "WARN", Log.ERROR: "ERROR", Log.FATAL: "CRITICAL"}


def send(out: rr.RecordingStream, story: Story, way: MapTrack | None) -> None:
    """Send everything that is shown to rerun."""
    recording, trip = story.recording, story.trip
    for name, (time_ns, values) in story.series.items():
        if len(time_ns):
            _series(out, trip, name, time_ns, values)
    for lane in story.lanes:
        _lane(out, trip, lane)
    _marks(out, story)
    _events(out, trip, recording.of(topics.EVENT) + recording.of(topics.LOG) + _notes(recording))
    if way is not None:
        _location(out, trip, way)
    _distance(out, trip, draw(story))
    out.log("summary", rr.TextDocument(summary(recording), media_type=rr.MediaType.MARKDOWN), static=True)


def _index(trip: DrivenCourse, time_ns: Times) -> list[rr.TimeColumn]:
    """Columns of all timelines for messages of these times."""
    position_m = np.maximum(np.rint(trip.at(time_ns, trip.s_m)), 0.0)
    return [
        rr.TimeColumn(TRIP_TIME, duration=trip.trip_ns(time_ns).astype("timedelta64[ns]")),
        rr.TimeColumn(TIME_OF_DAY, timestamp=np.asarray(time_ns).astype("datetime64[ns]")),
        rr.TimeColumn(POSITION, sequence=position_m.astype(np.int64)),
    ]


def _series(out: rr.RecordingStream, trip: DrivenCourse, name: str, time_ns: Times, values: Floats) -> None:
    style, modes = STYLES[name], rr.components.InterpolationMode
    lines = rr.SeriesLines(
        colors=style.color,
        names=style.label,
        widths=style.width,
        interpolation_mode=modes.StepAfter if style.held else modes.Linear,
    )
    out.log(name, lines, static=True)
    out.send_columns(name, _index(trip, time_ns), rr.Scalars.columns(scalars=values))


def _lane(out: rr.RecordingStream, trip: DrivenCourse, lane: Lane) -> None:
    """Send a lane of states, with one row for each change."""
    entity, shades = f"mode/{lane.name.replace(' ', '_')}", np.array(list(lane.colors.values()), dtype=np.uint32)
    time_ns = np.array([change.time_ns for change in lane.changes])
    out.log(entity, rr.StateConfiguration(values=list(lane.colors), colors=shades), static=True)
    columns = rr.StateChange.columns(state=[change.state for change in lane.changes])
    out.send_columns(entity, _index(trip, time_ns), columns)


def _marks(out: rr.RecordingStream, story: Story) -> None:
    """Send what happened as points on the driven speed; the words are among the events and in the lanes."""
    trip = story.trip
    if story.happenings:
        time_ns = np.array([one.time_ns for one in story.happenings])
        points = rr.SeriesPoints(colors=WHITE, names="happened (see events)", markers="Diamond", marker_sizes=5.0)
        out.log("speed/happened", points, static=True)
        values = trip.at(time_ns, trip.speed_mps) / KMH
        out.send_columns("speed/happened", _index(trip, time_ns), rr.Scalars.columns(scalars=values))


def _events(out: rr.RecordingStream, trip: DrivenCourse, messages: tuple[Stamped, ...]) -> None:
    messages = tuple(sorted(messages, key=lambda entry: entry.message.timestamp.ToNanoseconds()))
    if messages:
        time_ns = np.array([m.message.timestamp.ToNanoseconds() for m in messages])
        early_s = (trip.time_ns[0] - time_ns) * NS
        columns = rr.TextLog.columns(
            text=[_event_text(m.message, early) for m, early in zip(messages, early_s, strict=True)],
            level=[LEVELS.get(m.message.level, "TRACE") for m in messages],
        )
        out.send_columns("events", _index(trip, time_ns), columns)


def _notes(recording: Recording) -> tuple[Stamped, ...]:
    """The notes of people as texts among the events."""
    found = []
    for note in read_notes(recording.path):
        log = Log(level=Log.INFO, message=note.text, name=" ".join(("note", *note.tags)))
        log.timestamp.FromNanoseconds(note.time_ns)
        found.append(Stamped(note.time_ns, log))
    return tuple(found)


def _event_text(event: Log, early_s: float) -> str:
    when = f"({early_s:.0f} s before) " if early_s > 0 else ""
    return f"{when}{event.name}: {event.message}" if event.name else f"{when}{event.message}"


def _location(out: rr.RecordingStream, trip: DrivenCourse, way: MapTrack) -> None:
    """Send the way on the map, and in a plane in case there are no map tiles, coloured by speed."""
    index, color = _index(trip, way.time_ns), STYLES["speed/driven"].color
    line = rr.GeoLineStrings(lat_lon=[way.degrees], colors=color, radii=rr.Radius.ui_points(2.5))
    out.log("map/way", line, static=True)
    out.log("map/train", rr.GeoPoints.from_fields(colors=WHITE, radii=rr.Radius.ui_points(7.0)), static=True)
    out.send_columns("map/train", index, rr.GeoPoints.columns(positions=way.degrees))
    ends = np.unique(np.linspace(0, len(way.time_ns) - 1, TRACK_PIECES + 1).astype(int))
    speed = trip.at(way.time_ns[ends[:-1]], trip.speed_mps)
    shades = colormaps["turbo"](speed / max(float(speed.max(initial=0.0)), 1.0), bytes=True)
    pieces = [way.plane_m[a : b + 1] for a, b in pairwise(ends)]
    out.log("track/way", rr.LineStrips2D(pieces, colors=shades, radii=rr.Radius.ui_points(2.5)), static=True)
    out.log("track/train", rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(7.0)), static=True)
    out.send_columns("track/train", index, rr.Points2D.columns(positions=way.plane_m))


def _distance(out: rr.RecordingStream, trip: DrivenCourse, picture: Picture) -> None:
    """Send the picture over distance, with a line and a dot that follow the train."""
    out.log("distance/picture", rr.EncodedImage(contents=picture.png, media_type="image/png"), static=True)
    index = _index(trip, trip.time_ns)
    x, y = picture.pixel(trip.s_m, trip.speed_mps / KMH)
    lines = [((at, picture.top_px), (at, picture.bottom_px)) for at in x]
    out.log("distance/here", rr.LineStrips2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(0.6)), static=True)
    out.send_columns("distance/here", index, rr.LineStrips2D.columns(strips=lines))
    out.log("distance/train", rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(5.0)), static=True)
    out.send_columns("distance/train", index, rr.Points2D.columns(positions=np.column_stack((x, y))))
