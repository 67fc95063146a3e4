"""Speeds above the limit: above the line's limit over the whole train, or above a temporary restriction that the node
has received.

The train's own top speed is no limit: a train above the top speed in its file may be another train.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Source
from das.domain.restriction import Restriction
from das.domain.units import KMH, NS
from sim.drive.table import DriveTable
from sim.recording.course import DrivenCourse, Floats, Times, stretches_of

OVER_MPS: Final = 1.0 * KMH
"""Largest excess (m/s) over a limit that does not count; it is within the error of a speedometer."""
BEYOND_M: Final = 0.5
"""Distance (m) of the train's head beyond a signal above which it counts as passed."""


@dataclass(frozen=True, kw_only=True)
class Violations:
    """The violations of a drive.

    `signals_passed` counts the signals passed at danger; `beyond_signal_m` is the furthest that the train went beyond
    such a signal (m). `over_limit_s` is the time above limits (s), `over_limit_mps` the greatest excess (m/s).
    """

    signals_passed: int = 0
    beyond_signal_m: float = 0.0
    over_limit_s: float = 0.0
    over_limit_mps: float = 0.0


class TemporaryLimit(NamedTuple):
    """A restriction, and the span of time (ns) in which the lists that the node received contained it."""

    restriction: Restriction
    told_ns: int
    lifted_ns: int

    def holds_at(self, time_ns: Times) -> NDArray[np.bool_]:
        """Whether, at each moment (ns), the node knew of the restriction and its time window was open."""
        told = (time_ns >= self.told_ns) & (time_ns < self.lifted_ns)
        return np.asarray(told & self.restriction.holds_at(time_ns))

    def changes(self) -> list[tuple[int, str]]:
        """The moments (ns) at which the restriction was received, began, ended and was lifted, with a word for each."""
        one = self.restriction
        window = ((one.valid_from_ns, "begins"), (one.valid_until_ns, "ends"))
        inside = [(at_ns, word) for at_ns, word in window if self.told_ns < at_ns < self.lifted_ns]
        return [(self.told_ns, "received"), *inside, (self.lifted_ns, "lifted")]


class Signal(NamedTuple):
    """A signal at danger: its position (m), and the span of time in which the driver saw it at danger."""

    s_m: float
    start_ns: int
    end_ns: int


def signals(table: DriveTable) -> tuple[Signal, ...]:
    """The signals at danger that the driver saw."""
    found: list[Signal] = []
    before_m = -1.0
    for time_ns, signal_m in zip(*(one.tolist() for one in table.of_topic("cab", "signal_m")), strict=True):
        if signal_m == before_m:
            found[-1] = found[-1]._replace(end_ns=time_ns)
        elif signal_m > 0.0:
            found.append(Signal(signal_m, time_ns, time_ns))
        before_m = signal_m if signal_m > 0.0 else -1.0
    return tuple(found)


def temporary_limits(table: DriveTable) -> tuple[TemporaryLimit, ...]:
    """The restrictions that the node received, in the order in which they were lifted.

    Every message holds all restrictions that are in force.
    """
    since_ns: dict[Restriction, int] = {}
    found = []
    lists = [(one.time_ns, one.valid) for one in table.said.restrictions]
    for time_ns, told in [*lists, (int(table.course.time_ns[-1]) + 1, ())]:
        found += [TemporaryLimit(one, since_ns[one], time_ns) for one in sorted(since_ns.keys() - set(told))]
        since_ns = {one: since_ns.get(one, time_ns) for one in told}
    return tuple(found)


def limit_in_force(table: DriveTable, told: Iterable[TemporaryLimit]) -> Floats:
    """The limit of the line (m/s) over the train at every position of its course, with the restrictions known by then.

    It is NaN where it is not known. If line and train are not known, the line's limit is that recorded by a simulator,
    and a restriction holds beyond its end until the node states a higher limit.
    """
    trip, inputs = table.course, table.known_inputs
    at, length_m, said_mps = trip.time_ns, 0.0, np.full(len(trip.time_ns), np.nan)
    if inputs is not None:
        length_m = inputs.vehicle.train_length_m
        limit_mps = inputs.route.limits_over_train(length_m).at(trip.s_m)
    else:
        advised_ns, source, advised_mps = table.of_topic("advice", "source", "limit_mps")
        said_mps = _held(advised_ns, np.where(source == Source.NONE, np.nan, advised_mps), at)
        true_ns, line_mps = table.of_topic("truth", "limit_mps")
        limit_mps = _held(true_ns, line_mps, at)
    for span in told:
        one = span.restriction
        over = (trip.s_m >= one.start_m) & ((trip.s_m - length_m <= one.end_m) | (said_mps <= one.limit_mps))
        over &= span.holds_at(at)
        limit_mps[over] = np.fmin(limit_mps[over], one.limit_mps)
    return limit_mps


class SpanAbove(NamedTuple):
    """A span of time (ns) above an allowed speed.

    `over_mps` is the greatest excess, `allowed_mps` the speed that was allowed there, `lasted_s` the duration.
    """

    start_ns: int
    end_ns: int
    over_mps: float
    allowed_mps: float
    lasted_s: float


def spans_above(trip: DrivenCourse, allowed_mps: Floats) -> Iterator[SpanAbove]:
    """The spans of time in which a train exceeded the allowed speed by more than the error of a speedometer."""
    at, over_mps = trip.time_ns, trip.speed_mps - allowed_mps
    for first, end in stretches_of(over_mps > OVER_MPS):
        worst = first + int(np.argmax(over_mps[first:end]))
        lasted_s = float(at[min(end, len(at) - 1)] - at[first]) * NS
        yield SpanAbove(int(at[first]), int(at[end - 1]), float(over_mps[worst]), float(allowed_mps[worst]), lasted_s)


def violations_of(trip: DrivenCourse, limit_mps: Floats, seen: Iterable[Signal]) -> Violations:
    """The violations of a recorded drive, as far as positions once a second show."""
    fast, passed = tuple(spans_above(trip, limit_mps)), tuple(signals_passed(trip, seen))
    return Violations(
        signals_passed=len(passed),
        beyond_signal_m=max((one.beyond_m for one in passed), default=0.0),
        over_limit_s=sum(one.lasted_s for one in fast),
        over_limit_mps=max((one.over_mps for one in fast), default=0.0),
    )


class PassedSignal(NamedTuple):
    """A signal that was passed at danger: its position (m), the time (ns) of the passing, and the overrun (m)."""

    s_m: float
    time_ns: int
    beyond_m: float


def signals_passed(trip: DrivenCourse, seen: Iterable[Signal]) -> Iterator[PassedSignal]:
    """The signals that the train's head passed while they were at danger."""
    for signal in seen:
        during = (trip.time_ns >= signal.start_ns) & (trip.time_ns <= signal.end_ns)
        beyond_m = float(trip.s_m[during].max(initial=-math.inf)) - signal.s_m
        if beyond_m > BEYOND_M:
            passed = during & (trip.s_m > signal.s_m)
            yield PassedSignal(signal.s_m, int(trip.time_ns[int(np.argmax(passed))]), beyond_m)


def _held(time_ns: Times, values: Floats, at: Times) -> Floats:
    """The last value at or before each time, NaN before the first."""
    held: Floats = np.append(values, np.nan)[np.searchsorted(time_ns, at, side="right") - 1]
    return held
