"""What "above the limit" means: the limit of the line over the train, with the temporary restrictions told by then.

The train's own top speed is no limit: a train that is faster than its file says may be another train.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Source
from das.bus import topics
from das.bus.recording import Recording
from das.bus.restrictions import meant
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from sim.drive.attribution.inputs import DriveInputs, inputs_of
from sim.recording.course import DrivenCourse, Floats, Times


class TemporaryLimit(NamedTuple):
    """A restriction, and from when to when the node was told about it (ns)."""

    restriction: Restriction
    told_ns: int
    lifted_ns: int

    def holds_at(self, time_ns: Times) -> NDArray[np.bool_]:
        """Whether the node was told about it at each moment (ns), and its window was open."""
        told = (time_ns >= self.told_ns) & (time_ns < self.lifted_ns)
        return np.asarray(told & self.restriction.holds_at(time_ns))

    def changes(self) -> list[tuple[int, str]]:
        """The moments (ns) at which it was told, began to hold, ended and was lifted, each with that word."""
        one = self.restriction
        window = ((one.valid_from_ns, "begins"), (one.valid_until_ns, "ends"))
        inside = [(at_ns, word) for at_ns, word in window if self.told_ns < at_ns < self.lifted_ns]
        return [(self.told_ns, "told"), *inside, (self.lifted_ns, "lifted")]


def temporary_limits(recording: Recording, trip: DrivenCourse) -> tuple[TemporaryLimit, ...]:
    """The restrictions that the node was told about, in the order in which they were lifted.

    Every message holds all restrictions that are in force.
    """
    since_ns: dict[Restriction, int] = {}
    found = []
    for time_ns, told in [*told_lists(recording), (int(trip.time_ns[-1]) + 1, ())]:
        found += [TemporaryLimit(one, since_ns[one], time_ns) for one in sorted(since_ns.keys() - set(told))]
        since_ns = {one: since_ns.get(one, time_ns) for one in told}
    return tuple(found)


def told_lists(recording: Recording) -> Iterator[tuple[int, tuple[Restriction, ...]]]:
    """The time (ns) and the restrictions of each message, in order of time."""
    messages = [entry.message for entry in recording.of(topics.RESTRICTION)]
    for message in sorted(messages, key=lambda message: message.time_ns):
        yield int(message.time_ns), meant(message.restrictions)


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
    for span in temporary_limits(recording, trip):
        one = span.restriction
        over = (trip.s_m >= one.start_m) & ((trip.s_m - length_m <= one.end_m) | (said_mps <= one.limit_mps))
        over &= span.holds_at(at)
        limit_mps[over] = np.fmin(limit_mps[over], one.limit_mps)
    return at, limit_mps


def known_inputs(recording: Recording) -> DriveInputs | None:
    """Line and train of a recorded drive; None where the recording neither brings them along nor names bundled ones."""
    try:
        return inputs_of(recording)
    except DasError:
        return None


def _held(time_ns: Times, values: Floats, at: Times) -> Floats:
    """The last value at or before each time, NaN before the first."""
    held: Floats = np.append(values, np.nan)[np.searchsorted(time_ns, at, side="right") - 1]
    return held
