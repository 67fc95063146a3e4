"""Where the train of a recording was, and how fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenCourse:
    """Where the train was and how fast: the truth if it was recorded, else what its localisation reported."""

    time_ns: Times
    s_m: Floats
    speed_mps: Floats

    @classmethod
    def of(cls, recording: Recording) -> DrivenCourse:
        """The course of a recording; raises DasError if it has no position at all."""
        for topic in (topics.TRUTH, topics.POSITION, topics.ADVICE):
            data = recording.columns(topic, "time_ns", "s_m", "speed_mps")
            if len(data["time_ns"]):
                order = np.argsort(data["time_ns"], kind="stable")
                return cls(**{name: data[name][order] for name in ("time_ns", "s_m", "speed_mps")})
        raise DasError(f"{recording.path}: holds no positions of train {recording.train}, so there is nothing to show")

    def trip_ns(self, time_ns: Times) -> Times:
        """Time (ns) since the first position; earlier messages are at 0, because rerun draws no pictures before 0."""
        since_ns: Times = np.maximum(time_ns - self.time_ns[0], 0)
        return since_ns

    def at(self, time_ns: Times, values: Floats) -> Floats:
        """Values along the course (one per position) at other times; before and after it, those of its ends."""
        return np.interp(self.trip_ns(time_ns), self.trip_ns(self.time_ns), values)
