"""How often the messages of a topic came."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.bus.recorder import message_time_ns
from das.bus.recording import Recording
from das.bus.topics import Topic
from das.domain.units import NS


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How many messages there are, in how many a second they came, the usual and the longest time between two (s)."""

    messages: int
    per_s: float
    interval_s: float
    longest_gap_s: float


def times_of(recording: Recording, topic: Topic) -> NDArray[Any]:
    """The times (ns) that the messages of a topic state, in the order recorded; where one states none, the log's."""
    entries = recording.of(topic)
    return np.array([message_time_ns(one.message) or one.log_time_ns for one in entries], dtype=np.int64)


def rate_of(recording: Recording, topic: Topic) -> Rate | None:
    """The rate of a topic; None where it has no messages."""
    time_ns = np.sort(times_of(recording, topic))
    if not len(time_ns):
        return None
    steps_s = np.diff(time_ns) * NS
    span_s = float(time_ns[-1] - time_ns[0]) * NS
    return Rate(
        messages=len(time_ns),
        per_s=len(steps_s) / span_s if span_s > 0 else float("nan"),
        interval_s=float(np.median(steps_s)) if len(steps_s) else float("nan"),
        longest_gap_s=float(steps_s.max()) if len(steps_s) else 0.0,
    )
