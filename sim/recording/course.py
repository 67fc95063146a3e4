"""The course of a recorded drive, its stands, its clock, and the part of the recording between two times.

The clock has one zero for every table, picture and page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.bus import topics
from das.bus.recording import Recording, Stamped
from das.bus.topics import Topic, message_time_ns
from das.domain.errors import DasError
from das.domain.units import NS

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
OWN_TIMETABLE: Final = "own_timetable"
"""Key of a replay whose timetable is the trip itself, because no other was given."""


def own_timetable(recording: Recording) -> bool:
    """Whether the times of a journey come from the drive itself, because its replay had no timetable."""
    return OWN_TIMETABLE in recording.metadata.get("run", {})


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenCourse:
    """Positions and speeds of a train, each array of shape (samples,)."""

    time_ns: Times
    s_m: Floats
    speed_mps: Floats

    @classmethod
    def of(cls, recording: Recording) -> DrivenCourse:
        """The course of a recording: the truth if it was recorded, else the positions reported by localisation.

        Raises DasError if the recording has no position at all.
        """
        for topic in (topics.TRUTH, topics.POSITION, topics.ADVICE):
            data = recording.columns(topic, "time_ns", "s_m", "speed_mps")
            if len(data["time_ns"]):
                order = np.argsort(data["time_ns"], kind="stable")
                return DrivenCourse(**{name: data[name][order] for name in ("time_ns", "s_m", "speed_mps")})
        raise DasError(f"{recording.path}: holds no positions of train {recording.train}, so there is nothing to show")

    def between_ns(self, start_ns: int, end_ns: int) -> Times:
        """The times (ns) of a part of the course: at both its ends, and at the positions between them."""
        inside = self.time_ns[(self.time_ns > start_ns) & (self.time_ns < end_ns)]
        return np.concatenate(([start_ns], inside, [end_ns]))

    def at(self, time_ns: Times, values: Floats) -> Floats:
        """Values along the course (one per position) at other times; before and after it, the values at its ends."""
        first_ns = self.time_ns[0]
        return np.asarray(np.interp(np.maximum(time_ns - first_ns, 0), self.time_ns - first_ns, values))


def stretches_of(holds: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """The stretches of samples at which a condition holds: index of the first, and index behind the last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(np.int8)))
    return [(first, end) for first, end in edges.reshape(-1, 2).tolist()]


def known(value: float) -> float | None:
    """A value for JSON, which has no NaN: None stands for it."""
    return None if math.isnan(value) else value


OWN_DEPARTURE: Final = "the departure of the trip"
"""Zero of the clock of a replay without a timetable."""
MINUTE_S: Final = 60
HOUR_S: Final = 3600
DAY_S: Final = 86400
FORMS: Final = (
    "12:34 (minutes and seconds on the drive's clock), 1:02:03, 754 (seconds), 08:16:34Z (time of day, UTC) or "
    "2026-11-21T08:16:34"
)
_ON_CLOCK: Final = re.compile(r"(?P<sign>[+−-]?)(?:(?P<h>\d+):(?=\d\d:))?(?P<m>\d+):(?P<s>[0-5]\d(?:\.\d+)?)")
_SECONDS: Final = re.compile(r"(?P<sign>[+−-]?)(?P<s>\d{1,9}(?:\.\d+)?)")
_OF_DAY: Final = re.compile(r"\d\d:\d\d(:\d\d(\.\d+)?)?Z", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class DriveClock:
    """A clock that shows 0 at `zero_ns` (ns since 1970); times of day are in a time zone.

    The zero is the timetable's first departure, as in the tables of a run; without a timetable it is the departure of
    a replayed trip, or else the first position.
    """

    zero_ns: int
    zero_is: str = "the timetable's departure"
    """The event at which the clock shows 0, in words for pages."""
    zone: tzinfo = UTC

    @classmethod
    def of_recording(cls, recording: Recording) -> DriveClock:
        """The clock of any recording; without timetable and positions, its zero is the first message."""
        try:
            return cls.of(recording, int(DrivenCourse.of(recording).time_ns[0]))
        except DasError:
            first_ns = min(entries[0].log_time_ns for entries in recording.messages.values())
            return cls.of(recording, first_ns, "the first message")

    @classmethod
    def of(cls, recording: Recording, first_ns: int, first_is: str = "the first position") -> DriveClock:
        """The clock of a recording whose first position (or what `first_is` states) is at `first_ns`."""
        for entry in recording.of(topics.JOURNEY):
            for stop in entry.message.stops[:1]:
                if stop.departure_ns and abs(stop.departure_ns - first_ns) * NS < DAY_S:
                    own = own_timetable(recording)
                    return cls(zero_ns=int(stop.departure_ns), zero_is=OWN_DEPARTURE if own else cls.zero_is)
        return cls(zero_ns=first_ns, zero_is=first_is)

    def since_s(self, time_ns: int) -> float:
        """The time on the clock at a moment (s)."""
        return (time_ns - self.zero_ns) * NS

    def shown(self, time_ns: int) -> str:
        """The clock in minutes and seconds, "12:34"; before zero "−0:10"."""
        return minutes(self.since_s(time_ns))

    def of_day(self, time_ns: int) -> str:
        """The time of day in the clock's time zone, "08:16:34"."""
        return f"{datetime.fromtimestamp(round(time_ns * NS), self.zone):%H:%M:%S}"

    def moment_ns(self, text: str) -> int:
        """The moment (ns since 1970) that a user's text names; DasError for a text in none of the `FORMS`."""
        text = text.strip()
        for form in (_ON_CLOCK, _SECONDS):
            if found := form.fullmatch(text):
                return self.zero_ns + round(_seconds(found.groupdict()) / NS)
        zero, dated = datetime.fromtimestamp(self.zero_ns * NS, UTC), "T" in text.upper()
        try:
            if not (dated or _OF_DAY.fullmatch(text)):
                raise ValueError
            moment = datetime.fromisoformat(text if dated else f"{zero:%Y-%m-%d}T{text.upper()}")
            moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
            if not dated:  # the moment nearest to the zero: a drive may pass midnight
                moment += timedelta(days=round((zero - moment) / timedelta(days=1)))
            return round(moment.timestamp() / NS)
        except (ValueError, OverflowError):
            raise DasError(f"time {text!r}: expected {FORMS}") from None


def _seconds(parts: Mapping[str, str | None]) -> float:
    hours, minute, second = (float(parts.get(name) or 0.0) for name in ("h", "m", "s"))
    return (HOUR_S * hours + MINUTE_S * minute + second) * (1.0 if parts["sign"] in ("", "+") else -1.0)


def spell(time_s: float) -> str:
    """A duration (s) in words: "41 min 38 s", "2 h 3 min"."""
    whole = round(time_s)
    hours, rest = divmod(whole, HOUR_S)
    if hours:
        return f"{hours} h {rest // MINUTE_S} min"
    return f"{rest // MINUTE_S} min {rest % MINUTE_S} s" if rest >= MINUTE_S else f"{rest} s"


def times_text(count: int) -> str:
    """Words for a number of times: "once", "twice", "3 times"."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def minutes(time_s: float) -> str:
    """A time (s) as minutes and seconds, "12:34"; empty for NaN."""
    if math.isnan(time_s):
        return ""
    whole = round(time_s)
    return f"{'−' if whole < 0 else ''}{abs(whole) // MINUTE_S}:{abs(whole) % MINUTE_S:02d}"


def utc(time_ns: int) -> str:
    """A time (ns since 1970) as date and time of day (UTC) to the second."""
    try:
        return f"{datetime.fromtimestamp(time_ns * NS, UTC):%Y-%m-%d %H:%M:%S}"
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"


def stated_ns(entry: Stamped) -> int:
    """The time (ns since 1970) that a message states; the recorder's time for a message that states none."""
    return message_time_ns(entry.message) or entry.log_time_ns


def times_of(recording: Recording, topic: Topic) -> Times:
    """The times (ns) that the messages of a topic state (see `stated_ns`), in the order recorded."""
    return np.array([stated_ns(entry) for entry in recording.of(topic)], dtype=np.int64)


WHOLE: Final = (topics.JOURNEY.name, topics.PLAN.name)
"""Topics whose earlier messages a part of a recording keeps: a journey or a plan may hold throughout the part."""
HELD: Final = tuple(one.name for one in (topics.RESTRICTION, topics.TARGET, topics.DELAY, topics.STATUS))
"""Topics whose last earlier message a part of a recording keeps, because it still holds."""


def part_of(recording: Recording, start: str | None, end: str | None) -> Recording:
    """The part of a recording between two times in a user's words (see `FORMS`); None stands for its ends.

    Raises DasError if a text is no time, or if the train has no position between the times.
    """
    if start is None and end is None:
        return recording
    trip = DrivenCourse.of(recording)
    clock = DriveClock.of(recording, int(trip.time_ns[0]))
    first_ns, last_ns = int(trip.time_ns[0]), int(trip.time_ns[-1])
    from_ns = first_ns if start is None else clock.moment_ns(start)
    to_ns = last_ns if end is None else clock.moment_ns(end)
    if not ((trip.time_ns >= from_ns) & (trip.time_ns <= to_ns)).any():
        said = f"--from {start or clock.shown(first_ns)} --to {end or clock.shown(last_ns)}"
        raise DasError(f"{said}: expected times of the drive, {clock.shown(first_ns)} to {clock.shown(last_ns)}")
    kept = {name: _kept(entries, name, from_ns, to_ns) for name, entries in recording.messages.items()}
    return replace(recording, messages=kept)


def _kept(entries: Sequence[Stamped], topic: str, from_ns: int, to_ns: int) -> tuple[Stamped, ...]:
    timed = [(stated_ns(entry), entry) for entry in entries]
    if topic in WHOLE:
        return tuple(entry for at_ns, entry in timed if at_ns <= to_ns)
    before = [entry for at_ns, entry in timed if at_ns < from_ns] if topic in HELD else []
    return (*before[-1:], *(entry for at_ns, entry in timed if from_ns <= at_ns <= to_ns))


STANDING_MPS: Final = 0.3
"""Speed (m/s) below which a train stands: receivers report a few cm/s at rest."""
POSITION_ERROR_M: Final = 3.0
"""Error of a receiver's positions (m); shorter distances do not show the time of a stop."""


class StandingTime(NamedTuple):
    """A stand of the train: the indices of its first and last sample, and its position (m)."""

    first: int
    last: int
    s_m: float


def stands(trip: DrivenCourse) -> tuple[StandingTime, ...]:
    """Every stand of the train, in order of time; creeping below `STANDING_MPS` does not end a stand."""
    return tuple(
        StandingTime(first, end - 1, float(np.median(trip.s_m[first:end])))
        for first, end in stretches_of(trip.speed_mps < STANDING_MPS)
    )


def stood_ns(
    s_m: float, near_m: float, trip: DrivenCourse, measured: DrivenCourse | None = None
) -> tuple[StandingTime | None, int, int]:
    """The stand that is nearest to a position (None: none within `near_m`), and the times at which the train came to it
    and left it.

    Times are in ns since 1970, 0 if they are not in the record. `trip` shows where the train stood. If the course of a
    receiver (`measured`) has the same stand, it gives the times.
    """
    stand = _nearest(stands(trip), s_m, near_m)
    if stand is None:
        return None, 0, 0
    told = None if measured is None else _nearest(stands(measured), s_m, near_m)
    course, stood, error_m = trip, stand, 0.0
    if measured is not None and told is not None:
        course, stood, error_m = measured, told, POSITION_ERROR_M
    rest = at_rest(course, stood)
    return stand, arrival_ns(course, rest, error_m), departure_ns(course, rest, error_m)


def _nearest(stood: Sequence[StandingTime], s_m: float, near_m: float) -> StandingTime | None:
    """The stand that is nearest to a position; None if none is within `near_m`."""
    near = [one for one in stood if abs(one.s_m - s_m) <= near_m]
    return min(near, key=lambda one: abs(one.s_m - s_m), default=None)


def at_rest(trip: DrivenCourse, stand: StandingTime) -> StandingTime:
    """A stand cut to the samples from the first to the last with a speed of exactly 0; uncut if there is none.

    A train that has begun to move has left, even if it is slower than the noise.
    """
    zeros = stand.first + np.flatnonzero(trip.speed_mps[stand.first : stand.last + 1] == 0)
    return stand._replace(first=int(zeros[0]), last=int(zeros[-1])) if len(zeros) else stand


def arrival_ns(trip: DrivenCourse, stand: StandingTime, error_m: float = 0.0) -> int:
    """The time (ns since 1970) at which the train came to a stand; 0 if it stood from the first sample on.

    At constant deceleration the train needs 2·Δs/v from the last moving sample to the stand. If that distance is within
    the error of the positions (`error_m`), the time is halfway between the samples in motion and at rest: taking the
    sample at rest would make trips too long.
    """
    return _edge_ns(trip, stand.first - 1, stand.first, error_m)


def departure_ns(trip: DrivenCourse, stand: StandingTime, error_m: float = 0.0) -> int:
    """The time (ns since 1970) at which the train left a stand, as `arrival_ns`; 0 if it stood to the last sample."""
    return _edge_ns(trip, stand.last + 1, stand.last, error_m)


def _edge_ns(trip: DrivenCourse, moving: int, rest: int, error_m: float) -> int:
    """The time (ns) at which a stand began or ended between a moving sample and one at rest; 0: no moving sample."""
    if not 0 <= moving < len(trip.time_ns):
        return 0
    moving_ns, rest_ns = int(trip.time_ns[moving]), int(trip.time_ns[rest])
    whole_ns, speed_mps = abs(rest_ns - moving_ns), float(trip.speed_mps[moving])
    if error_m > 0.0 and 0.5 * speed_mps * whole_ns * NS < error_m:
        return (moving_ns + rest_ns) // 2
    way_m = abs(float(trip.s_m[rest] - trip.s_m[moving]))
    needed_ns = min(round(2.0 * way_m / max(speed_mps, 1e-3) / NS), whole_ns)
    return moving_ns + (needed_ns if rest > moving else -needed_ns)
