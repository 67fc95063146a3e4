"""Which session's word counts where two of them say what the train is to do: the first one's, until it is gone."""

from __future__ import annotations

from das.bus.presence import Presence
from das.bus.session import Received
from das.bus.topics import JOURNEY, RESTRICTION, TARGET, Topic

STATES = (JOURNEY, RESTRICTION, TARGET)
"""Topics whose newest message holds until the next: each has one publisher at a time."""
MOST_RIVALS, MOST_GONE = 20, 50
"""Most sessions that are remembered beside the one that counts, and of those that are gone; the newest are kept."""


class Operator:
    """The publisher of one state topic.

    The first session that is heard counts until its publisher is gone. The newest message of any other session that is
    there waits until then. Where nobody tells who is there, every session is taken to be there.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        """The session that counts."""
        self._newest: Received | None = None
        self._rivals: dict[str, Received] = {}
        self._gone: dict[str, Received | None] = {}

    def heeds(self, received: Received) -> bool:
        """Whether a message counts; one that does not is kept while its publisher is there.

        A message that cannot be read makes nobody the publisher.
        """
        source = received.source
        if source != self.source and (self.source is None or self.source in self._gone):
            if received.message is None:
                return True
            self._rivals.pop(source, None)
            if self.source is not None:
                self._gone[self.source] = self._newest
            self.source = source
        if source == self.source:
            self._newest = received
            return True
        if source in self._gone:
            self._gone[source] = received
        else:
            self._wait(source, received)
        return False

    def _wait(self, source: str, received: Received) -> None:
        """Keep a message for when the session that counts is gone."""
        if source not in self._rivals and len(self._rivals) >= MOST_RIVALS:
            self._rivals.pop(next(iter(self._rivals)))
        self._rivals[source] = received

    def is_rival(self, source: str) -> bool:
        """Whether this session has said something that waits."""
        return source in self._rivals

    def see(self, presence: Presence) -> Received | None:
        """Take note of a publisher that came or went; returns the message that counts now for that reason, if any.

        One that comes back still says what it said last.
        """
        source = presence.source
        if presence.there:
            said = self._gone.pop(source, None)
            if said is None or source == self.source:
                return None
            if self.source in self._gone:
                return said
            self._wait(source, said)
            return None
        self._gone[source] = self._rivals.pop(source, self._gone.get(source))
        if len(self._gone) > MOST_GONE:
            self._gone.pop(next(one for one in self._gone if one != self.source))
        return next(iter(self._rivals.values()), None) if source == self.source else None

    def contradiction(self) -> str:
        """The session that says other restrictions than the one that counts, or nothing."""
        told = _places(self._newest)
        return next((_named(source) for source, rival in self._rivals.items() if _places(rival) != told), "")


class Operators:
    """The publishers of journey, restrictions and targets; feed it all messages and who comes and goes."""

    def __init__(self) -> None:
        self._of = {topic.name: Operator() for topic in STATES}
        self._news: list[str] = []

    def heeds(self, received: Received) -> bool:
        """Whether a message counts; where it is the first of a second session that does not, that is news."""
        operator = self._of.get(received.topic.name)
        if operator is None:
            return True
        known, before = operator.is_rival(received.source), operator.source
        if operator.heeds(received):
            if before is not None and operator.source != before:
                self._news.append(
                    f"{received.topic.name}: {_named(operator.source)} counts from now on, {_named(before)} is gone"
                )
            return True
        if not known and operator.is_rival(received.source):
            self._news.append(
                f"{received.topic.name}: two publishers: what {_named(received.source)} says is not heeded "
                f"while {_named(before)} is there"
            )
        return False

    def source(self, topic: Topic) -> str | None:
        """The session that counts for a topic, as far as one is known."""
        operator = self._of.get(topic.name)
        return operator.source if operator is not None else None

    def see(self, presence: Presence) -> list[Received]:
        """Take note of a publisher that came or went; returns messages to be taken again, for they count now."""
        operator = self._of.get(presence.topic.name)
        waiting = operator.see(presence) if operator is not None else None
        return [waiting] if waiting is not None else []

    def contested(self) -> str:
        """Why nobody can tell which restrictions are in force, or nothing: two publishers say different things."""
        operator = self._of[RESTRICTION.name]
        other = operator.contradiction()
        if not other:
            return ""
        return f"two publishers of restrictions say different things: {_named(operator.source)} and {other}"

    def take_news(self) -> list[str]:
        """What has happened since this was last asked, in words."""
        news, self._news = self._news, []
        return news


def _named(source: str | None) -> str:
    return source or "one without a name"


def _places(received: Received | None) -> list[tuple[float, float, float]] | None:
    """The restrictions of a message in an order of their own; None where it cannot be read."""
    if received is None or received.message is None:
        return None
    return sorted((one.start_m, one.end_m, one.limit_mps) for one in received.message.restrictions)
