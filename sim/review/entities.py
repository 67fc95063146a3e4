"""What a recording shows, as rerun entities: series, states, events, map and track, on time and on distance."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
from foxglove_schemas_protobuf.Log_pb2 import Log
from matplotlib import colormaps

from das.bus import das_pb2, topics
from das.domain.units import KMH, NS
from sim.recording import Recording, Stamped
from sim.review.distance_picture import Picture, draw
from sim.review.series import STYLES, Floats, Times, Trip, Way, series
from sim.review.summary import summary

TRIP_TIME, POSITION = "trip_time", "position_m"
"""Timelines: time since the first position of the trip, route position of the train in m."""
TRACK_PIECES: Final = 300
WHITE: Final = 0xFFFFFFFF
LEVELS: Final = {Log.DEBUG: "DEBUG", Log.INFO: "INFO", Log.WARNING: "WARN", Log.ERROR: "ERROR", Log.FATAL: "CRITICAL"}


class Lane(NamedTuple):
    """A lane of states: its entity, the field with its enumeration, and colours (RGBA) by state."""

    name: str
    field: str
    enum: Any
    colors: dict[str, int]


MODES: Final = Lane(
    "mode/advised",
    "mode",
    das_pb2.Mode,
    {
        "full traction": 0x2E9E5BFF,
        "reduced traction": 0x7CC576FF,
        "cruise": 0x3D7FD6FF,
        "coast": 0xB8B8B8FF,
        "reduced brake": 0xF2B134FF,
        "full brake": 0xE8762BFF,
        "friction brake": 0xD13B3BFF,
        "stop": 0x6B5B95FF,
    },
)
STATES: Final = Lane(
    "mode/node",
    "state",
    das_pb2.Status.State,
    {"advising": 0x3D7FD6FF, "withdrawn": 0xD13B3BFF, "ready": 0x7CC576FF, "waiting": 0xB8B8B8FF},
)


def send(out: rr.RecordingStream, recording: Recording, trip: Trip, way: Way | None) -> None:
    """Send everything there is to see."""
    for name, (time_ns, values) in series(recording, trip).items():
        if len(time_ns):
            _series(out, trip, name, time_ns, values)
    _states(out, trip, MODES, recording.of(topics.ADVICE))
    _states(out, trip, STATES, recording.of(topics.STATUS))
    _events(out, trip, recording.of(topics.EVENT) + recording.of(topics.LOG))
    if way is not None:
        _location(out, trip, way)
    _distance(out, trip, draw(recording, trip))
    out.log("summary", rr.TextDocument(summary(recording), media_type=rr.MediaType.MARKDOWN), static=True)


def _index(trip: Trip, time_ns: Times) -> list[rr.TimeColumn]:
    """Both timelines of messages of these times."""
    position_m = np.maximum(np.rint(trip.at(time_ns, trip.s_m)), 0.0)
    return [
        rr.TimeColumn(TRIP_TIME, duration=trip.trip_ns(time_ns).astype("timedelta64[ns]")),
        rr.TimeColumn(POSITION, sequence=position_m.astype(np.int64)),
    ]


def _series(out: rr.RecordingStream, trip: Trip, name: str, time_ns: Times, values: Floats) -> None:
    style, modes = STYLES[name], rr.components.InterpolationMode
    lines = rr.SeriesLines(
        colors=style.color,
        names=style.label,
        widths=style.width,
        interpolation_mode=modes.StepAfter if style.held else modes.Linear,
    )
    out.log(name, lines, static=True)
    out.send_columns(name, _index(trip, time_ns), rr.Scalars.columns(scalars=values))


def _states(out: rr.RecordingStream, trip: Trip, lane: Lane, messages: tuple[Stamped, ...]) -> None:
    """A lane of states with a row for each change, on the trip only: beside it a node's clock is not a replay's."""
    messages = tuple(m for m in messages if trip.time_ns[0] <= m.message.time_ns <= trip.time_ns[-1])
    values = [getattr(entry.message, lane.field) for entry in messages]
    changes = [i for i, value in enumerate(values) if i == 0 or value != values[i - 1]]
    if changes:
        names = {number: name.split("_", 1)[1].replace("_", " ").lower() for name, number in lane.enum.items()}
        names[0] = "" if names[0] == "none" else names[0]
        shades = np.array(list(lane.colors.values()), dtype=np.uint32)
        time_ns = np.array([messages[i].message.time_ns for i in changes])
        states = [names.get(values[i], str(values[i])) for i in changes]
        out.log(lane.name, rr.StateConfiguration(values=list(lane.colors), colors=shades), static=True)
        out.send_columns(lane.name, _index(trip, time_ns), rr.StateChange.columns(state=states))


def _events(out: rr.RecordingStream, trip: Trip, messages: tuple[Stamped, ...]) -> None:
    messages = tuple(sorted(messages, key=lambda entry: entry.message.timestamp.ToNanoseconds()))
    if messages:
        time_ns = np.array([m.message.timestamp.ToNanoseconds() for m in messages])
        early_s = (trip.time_ns[0] - time_ns) * NS
        columns = rr.TextLog.columns(
            text=[_event_text(m.message, early) for m, early in zip(messages, early_s, strict=True)],
            level=[LEVELS.get(m.message.level, "TRACE") for m in messages],
        )
        out.send_columns("events", _index(trip, time_ns), columns)


def _event_text(event: Log, early_s: float) -> str:
    when = f"({early_s:.0f} s before) " if early_s > 0 else ""
    return f"{when}{event.name}: {event.message}" if event.name else f"{when}{event.message}"


def _location(out: rr.RecordingStream, trip: Trip, way: Way) -> None:
    """The way on the map and, for want of map tiles, in the plane, coloured by speed."""
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


def _distance(out: rr.RecordingStream, trip: Trip, picture: Picture) -> None:
    """The picture over distance, with a line and a dot that follow the train."""
    out.log("distance/picture", rr.EncodedImage(contents=picture.png, media_type="image/png"), static=True)
    index = _index(trip, trip.time_ns)
    x, y = picture.pixel(trip.s_m, trip.speed_mps / KMH)
    lines = [((at, picture.top_px), (at, picture.bottom_px)) for at in x]
    out.log("distance/here", rr.LineStrips2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(0.6)), static=True)
    out.send_columns("distance/here", index, rr.LineStrips2D.columns(strips=lines))
    out.log("distance/train", rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(5.0)), static=True)
    out.send_columns("distance/train", index, rr.Points2D.columns(positions=np.column_stack((x, y))))
