"""What the node lets in: messages of a sensible size and order, and one publisher of the train's position."""

from __future__ import annotations

import math
from typing import Any

from das.bus.session import Received
from das.bus.topics import JOURNEY, POSITION, RESTRICTION, Topic
from das.domain.units import NS
from das.trip import MOST_RESTRICTIONS, MOST_STOPS

LONGEST_TEXT = 200
"""More letters no operator means."""
AHEAD_S = 60.0
"""A message further ahead of the clock than this would shut out those that come after it: it waits."""
SILENT_S = 3.0
"""A publisher of positions not heard for so long has given way to the next; as long as a position is of use."""


class Guard:
    """Judges messages before the node acts on them; feed it with every message in the order heard.

    `now_ns` is the node's clock, 0 while it has none.
    """

    def __init__(self) -> None:
        self._newest_ns: dict[str, int] = {}
        self._publishers = Publishers()
        self._unheeded = ""
        self._early: dict[str, Received] = {}

    def problem(self, received: Received, now_ns: int) -> str:
        """Why a message is to be ignored, or nothing."""
        message, topic = received.message, received.topic
        self._early.pop(topic.name, None)
        if topic is RESTRICTION:
            return self._problem_of_restrictions(received, now_ns)
        found = self._problem_of(received, now_ns)
        if not found and topic is POSITION and not self._publishers.is_heard(received.source, now_ns):
            found = f"one of a second publisher, {received.source or 'unnamed'},"
        if not found and topic is JOURNEY:
            found = self._replayed(topic, message.time_ns)
        return f"{topic.name}: {found} was ignored" if found else ""

    def distrust(self, now_ns: int) -> str:
        """Why there must be no advice, or nothing: two publishers of the position, or restrictions nobody can heed."""
        return self._publishers.contested(now_ns) or self._unheeded

    def come_due(self, now_ns: int) -> list[Received]:
        """Messages from ahead of the clock that are so no more, to be taken anew: the clock was wrong and is right."""
        return [one for one in self._early.values() if (one.message.time_ns - now_ns) * NS <= AHEAD_S]

    def _problem_of_restrictions(self, received: Received, now_ns: int) -> str:
        """As of any message; but whoever cannot heed restrictions must not advise until there are others."""
        if found := self._problem_of(received, now_ns):
            self._unheeded = f"restrictions that cannot be heeded: {found}"
            return self._unheeded
        if found := self._replayed(RESTRICTION, received.message.time_ns):
            return f"{RESTRICTION.name}: {found} was ignored"
        self._unheeded = ""
        return ""

    def _problem_of(self, received: Received, now_ns: int) -> str:
        """Why a message by itself is of no use (now), or nothing."""
        message, topic = received.message, received.topic
        if message is None:
            return "a message that cannot be read"
        ahead_s = (message.time_ns - now_ns) * NS
        if now_ns > 0 and topic in (JOURNEY, RESTRICTION) and ahead_s > AHEAD_S:
            self._early[topic.name] = received
            return f"one from {ahead_s:.0f} s ahead of the clock"
        return _problem_of_sense(topic, message)

    def _replayed(self, topic: Topic, time_ns: int) -> str:
        """Why it is not the newest, or nothing; from now on it is. The bus itself repeats the newest."""
        newest_ns = self._newest_ns.get(topic.name, time_ns)
        if time_ns < newest_ns:
            return f"one {(newest_ns - time_ns) * NS:.0f} s older than the last"
        self._newest_ns[topic.name] = time_ns
        return ""


class Publishers:
    """Who says where the train is: one session at a time, known by its name in Zenoh's time stamps."""

    def __init__(self) -> None:
        self._source: str | None = None
        self._heard_ns = 0
        self._rival, self._rival_ns = "", 0

    def is_heard(self, source: str, now_ns: int) -> bool:
        """Whether this publisher's position counts; another one's does when the one before has gone silent."""
        if self._source is None or not _within(now_ns, self._heard_ns):
            self._source, self._rival = source, ""
        if source != self._source:
            self._rival, self._rival_ns = source, now_ns
            return False
        self._heard_ns = now_ns
        return True

    def contested(self, now_ns: int) -> str:
        """Why no position can be trusted, or nothing: two say where the train is, and one of them is wrong."""
        if self._rival and _within(now_ns, self._rival_ns) and _within(now_ns, self._heard_ns):
            return f"two publishers of the position: {self._source or 'unnamed'} and {self._rival}"
        return ""


def _problem_of_sense(topic: Topic, message: Any) -> str:
    """Why nobody can have meant this, or nothing."""
    if topic is RESTRICTION:
        if len(message.restrictions) > MOST_RESTRICTIONS:
            return f"{len(message.restrictions)} of them, more than {MOST_RESTRICTIONS}"
        return next((_shown(one) for one in message.restrictions if not _is_sensible(one)), "")
    if topic is JOURNEY:
        if len(message.stops) > MOST_STOPS:
            return f"one of {len(message.stops)} stops, more than {MOST_STOPS}"
        texts = (message.train, message.route_id, message.vehicle_id, *(stop.name for stop in message.stops))
        longest = max(map(len, texts))
        return f"one with a name of {longest} letters" if longest > LONGEST_TEXT else ""
    return ""


def _is_sensible(one: Any) -> bool:
    numbers = (one.start_m, one.end_m, one.limit_mps)
    return all(map(math.isfinite, numbers)) and one.start_m < one.end_m and one.limit_mps > 0


def _shown(one: Any) -> str:
    return f"one of {one.limit_mps:g} m/s from {one.start_m:g} to {one.end_m:g} m"


def _within(now_ns: int, then_ns: int) -> bool:
    return abs(now_ns - then_ns) * NS <= SILENT_S
