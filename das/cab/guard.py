"""What the node lets in: messages of a sensible size and order, and one publisher of the train's position."""

from __future__ import annotations

from typing import Any

from das.bus.presence import Presence
from das.bus.session import Received
from das.bus.topics import JOURNEY, POSITION, RESTRICTION, TARGET, Topic
from das.cab.operators import STATES, Operators
from das.cab.trip import MOST_RESTRICTIONS, MOST_STOPS, MOST_TARGETS
from das.domain.errors import DasError
from das.domain.route import Restriction
from das.domain.units import NS
from das.estimate.localisation import STALE_AFTER_S

LONGEST_TEXT = 200
"""More letters no operator means."""
AHEAD_S = 60.0
"""A message further ahead of the clock than this would shut out those that come after it."""
SILENT_S = STALE_AFTER_S
"""A publisher of positions not heard for so long has given way to the next; as long as a position is of use."""


class Guard:
    """Judges messages before the node acts on them; feed it with every message in the order heard.

    `now_ns` is the node's clock, 0 while it has none.
    """

    def __init__(self) -> None:
        self._newest_ns: dict[str, int] = {}
        self._publishers, self._operators = Publishers(), Operators()
        self._unheeded = ""
        self._in_force: list[tuple[float, float, float]] = []
        self._early: dict[str, Received] = {}

    def heeds(self, received: Received) -> bool:
        """Whether the sender of a message is the one whose word counts; `take_news` says who is not."""
        topic, before = received.topic, self._operators.source(received.topic)
        counts = self._operators.heeds(received)
        if before is not None and self._operators.source(topic) != before:
            # Times of a publisher that is gone say nothing of how old this one's messages are.
            self._newest_ns.pop(topic.name, None)
            self._early.pop(topic.name, None)
        return counts

    def see(self, presence: Presence) -> list[Received]:
        """Take note of a publisher that came or went; returns the messages to be taken again, for they count now."""
        return self._operators.see(presence)

    def take_news(self) -> list[str]:
        """What has happened to the publishers since this was last asked, in words."""
        return self._operators.take_news()

    def problem(self, received: Received, now_ns: int) -> str:
        """Why a message is to be ignored, or nothing."""
        message, topic = received.message, received.topic
        if topic is RESTRICTION:
            return self._problem_of_restrictions(received, now_ns)
        found = self._problem_of(received, now_ns)
        if not found and topic is POSITION and not self._publishers.is_heard(received.source, now_ns):
            found = f"one of a second publisher, {received.source or 'unnamed'},"
        if not found and topic in STATES:
            found = self._replayed(topic, message.time_ns, now_ns)
        return f"{topic.name}: {found} was ignored" if found else ""

    def due(self, now_ns: int) -> list[Received]:
        """The newest messages that were ahead of the clock and are no more, to be judged again: each time said once.

        A clock that was wrong is set right, or hears of the time after the message; nobody says it a second time.
        """
        there = [one for one in self._early.values() if _ahead_s(one.message, now_ns) <= AHEAD_S]
        for one in there:
            del self._early[one.topic.name]
        return there

    def distrust(self, now_ns: int) -> str:
        """Why there must be no advice, or nothing: two publishers, or restrictions nobody can heed."""
        return self._publishers.contested(now_ns) or self._operators.contested() or self._unheeded

    def lose_restrictions(self, why: str) -> str:
        """Nobody knows what is in force until restrictions come that can be heeded; returns the reason."""
        self._unheeded = f"restrictions that cannot be heeded: {why}"
        return self._unheeded

    def _problem_of_restrictions(self, received: Received, now_ns: int) -> str:
        """As of any message; but whoever cannot heed restrictions must not advise until there are others."""
        if found := self._problem_of(received, now_ns):
            return self.lose_restrictions(found)
        told = [(one.start_m, one.end_m, one.limit_mps) for one in received.message.restrictions]
        if found := self._replayed(RESTRICTION, received.message.time_ns, now_ns):
            if told != self._in_force:  # a replay, or an operator whose clock was set back: nobody can tell
                return self.lose_restrictions(f"{found}, which said otherwise")
            return f"{RESTRICTION.name}: {found} was ignored"
        self._in_force, self._unheeded = told, ""
        return ""

    def _problem_of(self, received: Received, now_ns: int) -> str:
        """Why a message by itself is of no use, or nothing."""
        topic, message = received.topic, received.message
        if message is not None and topic in STATES and now_ns > 0 and _ahead_s(message, now_ns) > AHEAD_S:
            self._early[topic.name] = received
            return f"one from {_ahead_s(message, now_ns):.0f} s ahead of the clock"
        problem = _problem_of_sense(topic, message) if message is not None else "a message that cannot be read"
        if problem:
            self._early.pop(topic.name, None)
        return problem

    def _replayed(self, topic: Topic, time_ns: int, now_ns: int) -> str:
        """Why it is not the newest, or nothing; from now on it is. The bus itself repeats the newest."""
        newest_ns = self._newest_ns.get(topic.name, time_ns)
        was_set_back = now_ns > 0 and (newest_ns - now_ns) * NS > AHEAD_S  # the clock: the newest shuts out nothing
        if time_ns < newest_ns and not was_set_back:
            return f"one {(newest_ns - time_ns) * NS:.0f} s older than the last"
        self._newest_ns[topic.name] = time_ns
        self._early.pop(topic.name, None)
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


def _ahead_s(message: Any, now_ns: int) -> float:
    return float((message.time_ns - now_ns) * NS)


def _problem_of_sense(topic: Topic, message: Any) -> str:
    """Why nobody can have meant this, or nothing."""
    if topic is RESTRICTION:
        if len(message.restrictions) > MOST_RESTRICTIONS:
            return f"{len(message.restrictions)} of them, more than {MOST_RESTRICTIONS}"
        return next((_shown(one) for one in message.restrictions if not _is_restriction(one)), "")
    if topic is TARGET:
        if len(message.targets) > MOST_TARGETS:
            return f"one of {len(message.targets)} targets, more than {MOST_TARGETS}"
        return _too_long(*(one.stop for one in message.targets))
    if topic is JOURNEY:
        if len(message.stops) > MOST_STOPS:
            return f"one of {len(message.stops)} stops, more than {MOST_STOPS}"
        texts = (message.train, message.route_id, message.vehicle_id, message.load, message.level)
        return _too_long(*texts, *(stop.name for stop in message.stops))
    return ""


def _too_long(*texts: str) -> str:
    longest = max(map(len, texts), default=0)
    return f"one with a name of {longest} letters" if longest > LONGEST_TEXT else ""


def _is_restriction(one: Any) -> bool:
    try:
        Restriction(start_m=one.start_m, end_m=one.end_m, limit_mps=one.limit_mps)
    except DasError:
        return False
    return True


def _shown(one: Any) -> str:
    return f"one of {one.limit_mps:g} m/s from {one.start_m:g} to {one.end_m:g} m"


def _within(now_ns: int, then_ns: int) -> bool:
    return abs(now_ns - then_ns) * NS <= SILENT_S
