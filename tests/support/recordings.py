"""Recordings for tests: one of a short trip, written message by message, and the count in an unfinished one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from das.bus import das_pb2, topics
from das.bus.recorder import RecordingFile
from das.bus.recording import read_contents, read_recording
from das.bus.sealing import sealed
from das.domain.errors import DasError

START_NS = 1_800_000_000_000_000_000
SECONDS = 600
Publish = Callable[[topics.Topic, object, float], None]


def write_recording(
    path: Path, *, trains: tuple[str, ...] = ("t1",), only: tuple[topics.Topic, ...] = topics.RECORDED,
    seconds: int = SECONDS, data_crcs: bool = True, before: Callable[[Publish], None] | None = None,
) -> Path:  # fmt: skip
    """A trip of 600 s at 1 Hz, its speed a half sine to 40 m/s, flushed every second; the first train starts first."""
    with path.open("wb") as file:
        writer = Writer(file, enable_data_crcs=data_crcs)
        writer.start()
        run = {"command": "das-sim run", "route_sha256": "0123456789abcdef0123", "energy_j": "3.6e6"}
        writer.add_metadata("run", sealed("run", run))
        writer.add_attachment(START_NS, START_NS, "route.toml", "text/plain", b"[route]")
        channels: dict[str, int] = {}
        for index, train in enumerate(trains):

            def publish(
                topic: topics.Topic, message: object, t_s: float, train: str = train, index: int = index
            ) -> None:
                if topic in only:
                    key = topic.key(train)
                    if key not in channels:
                        channels[key] = writer.register_channel(key, "protobuf", register_schema(writer, topic.message))
                    sent = START_NS + round(t_s * 1e9)
                    data = message.SerializeToString()  # type: ignore[attr-defined]
                    writer.add_message(channels[key], sent + 1_000_000 + index, data, sent)

            publish_head(publish, train)
            if before is not None:
                before(publish)
            for t_s in range(seconds):
                publish_second(publish, t_s)
                writer.flush()
        writer.finish()
    return path


def write_messages(
    path: Path, key: str, messages: Mapping[int, Message], *, add: Callable[[Writer], Any] | None = None,
    numbered: bool = False, **options: Any,
) -> Path:  # fmt: skip
    """A recording of another program: messages of one channel by log time (ns), numbered from 0 at 1 ns if asked."""
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema = register_schema(writer, type(next(iter(messages.values()))))
        channel = writer.register_channel(key, "protobuf", schema)
        for log_ns, message in messages.items():
            writer.add_message(channel, log_ns, message.SerializeToString(), 1, log_ns - 1 if numbered else 0)
        if add is not None:
            add(writer)
        writer.finish()
    return path


def with_run(source: Path, out: Path, *attach: tuple[str, bytes], without: bool = False, **run: str) -> Path:
    """A recording with other entries about its run and more attached files; `without` the original attachments."""
    contents = read_contents(source)
    file = RecordingFile(out)
    file.add_metadata("run", {**contents.metadata["run"], **run})
    for one in () if without else contents.attachments:
        file.add_attachment(one.name, one.media_type, one.data)
    for name, data in attach:
        file.add_attachment(name, "text/plain", data)
    for message in contents.messages:
        file.add(message.topic, message.topic.key(message.train), message.message, message.log_time_ns)
    file.close()
    return out


def at_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e9)


def speed_mps(t_s: float) -> float:
    return 40.0 * math.sin(math.pi * t_s / SECONDS)


def position_m(t_s: float) -> float:
    return 40.0 * SECONDS / math.pi * (1.0 - math.cos(math.pi * t_s / SECONDS))


def publish_head(publish: Publish, train: str) -> None:
    stops = [das_pb2.Journey.Stop(name="A", s_m=0.0), das_pb2.Journey.Stop(name="B", s_m=position_m(SECONDS))]
    journey = das_pb2.Journey(time_ns=at_ns(-5), train=train, route_id="route", vehicle_id="vehicle", stops=stops)
    publish(topics.JOURNEY, journey, -5)
    publish_event(publish, -5, "section solved", Log.INFO)
    publish_event(publish, 100, "signal at danger", Log.INFO, topics.LOG)


def publish_before(publish: Publish) -> None:
    """The messages of a node before the first position, and at its end with a clock other than a replay's."""
    publish(topics.DELAY, das_pb2.Delay(time_ns=at_ns(-4), delay_s=20.0), -4)
    publish(topics.ADVICE, das_pb2.Advice(time_ns=at_ns(-3), mode=8, source=2), -3)
    publish(topics.STATUS, das_pb2.Status(time_ns=at_ns(-9000), state=5), SECONDS)


def publish_event(publish: Publish, t_s: float, text: str, level: int, topic: topics.Topic = topics.EVENT) -> None:
    event = Log(message=text, level=level, name="node")  # type: ignore[arg-type]
    event.timestamp.FromNanoseconds(at_ns(t_s))
    publish(topic, event, t_s)


def publish_second(publish: Publish, t_s: int) -> None:
    time_ns, s_m, v_mps = at_ns(t_s), position_m(t_s), speed_mps(t_s)
    withdrawn = 200 <= t_s < 220
    publish(topics.POSITION, das_pb2.Position(time_ns=time_ns, s_m=s_m + 2.0, speed_mps=v_mps, quality=1), t_s)
    truth = das_pb2.Truth(
        time_ns=time_ns, s_m=s_m, speed_mps=v_mps, force_el_n=1e5 * math.cos(math.pi * t_s / SECONDS),
        force_friction_n=-1e3 if t_s > 500 else 0.0, energy_input_j=3.6e6, gradient_ratio=0.005, limit_mps=45.0,
    )  # fmt: skip
    publish(topics.TRUTH, truth, t_s)
    if withdrawn:
        publish(
            topics.ADVICE,
            das_pb2.Advice(time_ns=time_ns, s_m=s_m, reason=das_pb2.Reason(code=1, text="position invalid")),
            t_s,
        )
    else:
        advice = das_pb2.Advice(
            time_ns=time_ns, s_m=s_m, speed_mps=v_mps, mode=1 if t_s < 300 else 4, advised_speed_mps=v_mps + 0.5,
            advised_force_n=9e4, predicted_deviation_s=3.0, buffer_ratio=0.07, source=2, limit_mps=45.0,
        )  # fmt: skip
        publish(topics.ADVICE, advice, t_s)
    publish(
        topics.STATUS, das_pb2.Status(time_ns=time_ns, state=4 if withdrawn else 3, version="0.1.0", advices=t_s), t_s
    )
    fix = LocationFix(latitude=47.0 + s_m * 9e-6, longitude=8.5)
    fix.timestamp.FromNanoseconds(time_ns)
    publish(topics.LOCATION, fix, t_s)
    if t_s % 10 == 0:
        plan = das_pb2.Plan(time_ns=time_ns, s_m=[s_m, s_m + 100.0], t_s=[0.0, 5.0], speed_mps=[v_mps, v_mps])
        publish(topics.PLAN, plan, t_s)
    if t_s % 60 == 0:
        publish(topics.DELAY, das_pb2.Delay(time_ns=time_ns, delay_s=30.0), t_s)
    if t_s == 200:
        publish_event(publish, t_s, "advice withdrawn", Log.WARNING)


def advices_so_far(path: Path) -> int:
    """Number of advice messages in a recording that is being written; 0 while it is not readable yet."""
    try:
        return len(read_recording(path).of(topics.ADVICE))
    except DasError:
        return 0
