"""Recordings made by hand, in memory: a train that runs at 20 m/s for 100 s, and further messages."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2, topics
from das.bus.recording import Recording, Stamped
from tests.support.recordings import at_ns

SPEED_MPS, LINE_MPS = 20.0, 40.0
SECONDS = 100


def in_memory(*sent: tuple[topics.Topic, Any]) -> Recording:
    """A recording of these messages."""
    messages: dict[str, list[Stamped]] = {}
    for topic, message in sent:
        messages.setdefault(topic.name, []).append(Stamped(0, message))
    return Recording(
        path=Path("day.mcap"), train="t1", trains=("t1",), metadata={}, attachments=(), complete=True,
        messages={name: tuple(entries) for name, entries in messages.items()},
    )  # fmt: skip


def truth(t_s: float, s_m: float, speed_mps: float, limit_mps: float = LINE_MPS) -> tuple[topics.Topic, Any]:
    return topics.TRUTH, das_pb2.Truth(time_ns=at_ns(t_s), s_m=s_m, speed_mps=speed_mps, limit_mps=limit_mps)


def recorded(*sent: tuple[topics.Topic, Any]) -> Recording:
    """A recording of a train at 20 m/s for 100 s with further messages."""
    return in_memory(*(truth(t, SPEED_MPS * t, SPEED_MPS) for t in range(SECONDS + 1)), *sent)


def told(t_s: float, *places: tuple[float, float, float]) -> tuple[topics.Topic, Any]:
    entries = [das_pb2.Restrictions.Restriction(start_m=a, end_m=b, limit_mps=v) for a, b, v in places]
    return topics.RESTRICTION, das_pb2.Restrictions(time_ns=at_ns(t_s), restrictions=entries)


def advice(t_s: float, *, valid_s: float = 3.0, **fields: Any) -> tuple[topics.Topic, Any]:
    found = das_pb2.Advice(time_ns=at_ns(t_s), valid_until_ns=at_ns(t_s + valid_s), source=2, limit_mps=LINE_MPS)
    found.MergeFrom(das_pb2.Advice(**fields))
    return topics.ADVICE, found


def withdrawn(t_s: float, reason: str, cause: int = 0) -> tuple[topics.Topic, Any]:
    return topics.ADVICE, das_pb2.Advice(
        time_ns=at_ns(t_s),
        valid_until_ns=at_ns(t_s),
        cause=cause,
        reason=das_pb2.Reason(code=1, text=reason),
        limit_mps=math.nan,
    )


def cab(t_s: float, **fields: Any) -> tuple[topics.Topic, Any]:
    return topics.CAB, das_pb2.Cab(**{"time_ns": at_ns(t_s), "signal_m": math.nan, **fields})


def logged(t_s: float, text: str, topic: topics.Topic = topics.LOG, level: int = Log.INFO) -> tuple[topics.Topic, Any]:
    event = Log(message=text, level=level)  # type: ignore[arg-type]
    event.timestamp.FromNanoseconds(at_ns(t_s))
    return topic, event


def day() -> Recording:
    """A recording with every kind of message used in the tests."""
    return recorded(
        *(advice(t, mode=3, advised_speed_mps=19.0, position_sd_m=2.0, s_m=20.0 * t) for t in range(60)),
        *(withdrawn(t, "uncertain") for t in range(60, 80)), *(advice(t, mode=4) for t in range(80, 101)),
        told(5, (400.0, 600.0, 10.0)), cab(10, presentation=3, lever_ratio=0.5, mode=3), cab(30, signal_m=1000.0),
        cab(31), logged(30, "signal at danger"), logged(31, "signal clear"),
        (topics.TARGET, das_pb2.Targets(targets=[das_pb2.Targets.Target(s_m=300.0, latest_ns=at_ns(20))])),
        (topics.ESTIMATE, das_pb2.Estimate(time_ns=at_ns(10), mass_ratio=1.1, mass_sd_ratio=0.1)),
    )  # fmt: skip
