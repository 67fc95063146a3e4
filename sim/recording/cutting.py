"""A part of a recorded drive, between two moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from das.bus import topics
from das.bus.recorder import message_time_ns
from das.bus.recording import Recording, Stamped
from das.bus.topics import Topic
from das.domain.errors import DasError
from sim.recording.clock import DriveClock
from sim.recording.course import DrivenCourse

WHOLE: Final = (topics.JOURNEY, topics.PLAN)
"""Topics that keep all messages before the part: a journey holds for all of it, and so may the first plan."""
HELD: Final = (topics.RESTRICTION, topics.TARGET, topics.DELAY, topics.STATUS)
"""Topics of which the last message before the part still holds in it."""


def part_of(recording: Recording, start: str | None, end: str | None) -> Recording:
    """The part of a recording between two times as a user writes them (`sim.recording.clock.FORMS`); None: its ends.

    Raises DasError for a text that is no time, and where the train has no position in between.
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
    kept = {
        name: _kept(entries, next(topic for topic in topics.TOPICS if topic.name == name), from_ns, to_ns)
        for name, entries in recording.messages.items()
    }
    return replace(recording, messages=kept)


def _kept(entries: Sequence[Stamped], topic: Topic, from_ns: int, to_ns: int) -> tuple[Stamped, ...]:
    """The messages of a topic that say something about the part, in their order."""
    timed = [(message_time_ns(entry.message) or entry.log_time_ns, entry) for entry in entries]
    if topic in WHOLE:
        return tuple(entry for at_ns, entry in timed if at_ns <= to_ns)
    before = [entry for at_ns, entry in timed if at_ns < from_ns] if topic in HELD else []
    return (*before[-1:], *(entry for at_ns, entry in timed if from_ns <= at_ns <= to_ns))
