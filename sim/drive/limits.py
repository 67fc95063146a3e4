"""What "above the limit" means: the limit of the line over the train, with the temporary restrictions told by then.

The train's own top speed is no limit: a train that is faster than its file says may be another train.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from das.advice.advice import Source
from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from sim.drive.attribution.inputs import DriveInputs, inputs_of
from sim.recording.course import DrivenCourse, Floats, Times

Place = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class TemporaryLimit:
    """A restriction: where it holds (m), its speed (m/s), and from when to when the node was told about it (ns)."""

    start_m: float
    end_m: float
    limit_mps: float
    told_ns: int
    lifted_ns: int


def temporary_limits(recording: Recording, trip: DrivenCourse) -> tuple[TemporaryLimit, ...]:
    """The restrictions that the node was told about, in the order in which they were lifted.

    Every message holds all restrictions that are in force.
    """
    since_ns: dict[Place, int] = {}
    found = []
    for time_ns, places in [*_told(recording), (int(trip.time_ns[-1]) + 1, set[Place]())]:
        for place in sorted(since_ns.keys() - places):
            start_m, end_m, limit_mps = place
            found.append(
                TemporaryLimit(
                    start_m=start_m, end_m=end_m, limit_mps=limit_mps, told_ns=since_ns[place], lifted_ns=time_ns
                )
            )
        since_ns = {place: since_ns.get(place, time_ns) for place in places}
    return tuple(found)


def limit_in_force(recording: Recording, trip: DrivenCourse) -> tuple[Times, Floats]:
    """Times, and the limit of the line (m/s) over the train with the restrictions told by then; NaN where unknown.

    Line and length of the train are those of the recording's files. Where it brings none along, the line's limit is
    what a simulator wrote down, and behind a restriction's end it holds as long as the node says that it does.
    """
    inputs = known_inputs(recording)
    truth = recording.columns(topics.TRUTH, "time_ns", "limit_mps")
    at, length_m, said_mps = trip.time_ns, 0.0, np.full(len(trip.time_ns), np.nan)
    if inputs is not None:
        length_m = inputs.vehicle.train_length_m
        limit_mps = inputs.route.limits_over_train(length_m).at(trip.s_m)
    else:
        advice = recording.columns(topics.ADVICE, "time_ns", "source", "limit_mps")
        said_mps = np.where(advice["source"] == Source.NONE, np.nan, advice["limit_mps"])
        said_mps, limit_mps = _held(advice["time_ns"], said_mps, at), _held(truth["time_ns"], truth["limit_mps"], at)
    for one in temporary_limits(recording, trip):
        over = (trip.s_m >= one.start_m) & ((trip.s_m - length_m <= one.end_m) | (said_mps <= one.limit_mps))
        over &= (at >= one.told_ns) & (at < one.lifted_ns)
        limit_mps[over] = np.fmin(limit_mps[over], one.limit_mps)
    return at, limit_mps


def known_inputs(recording: Recording) -> DriveInputs | None:
    """Line and train of a recorded drive; None where the recording neither brings them along nor names bundled ones."""
    try:
        return inputs_of(recording)
    except DasError:
        return None


def _told(recording: Recording) -> Iterator[tuple[int, set[Place]]]:
    """Time and places of each message; entries that no node accepts as a restriction are left out."""
    messages = [entry.message for entry in recording.of(topics.RESTRICTION)]
    for message in sorted(messages, key=lambda message: message.time_ns):
        places = {(x.start_m, x.end_m, x.limit_mps) for x in message.restrictions}
        yield message.time_ns, {x for x in places if all(map(math.isfinite, x)) and x[0] < x[1] and x[2] > 0}


def _held(time_ns: Times, values: Floats, at: Times) -> Floats:
    """The last value at or before each time, NaN before the first."""
    held: Floats = np.append(values, np.nan)[np.searchsorted(time_ns, at, side="right") - 1]
    return held
