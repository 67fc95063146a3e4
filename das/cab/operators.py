"""Which session's word counts where two of them say what the train is to do: the first one's, until it is gone."""

from __future__ import annotations

from dataclasses import replace

from das.cab import event_wording
from das.cab.heard import STATES, Heard, Kind, PublisherSeen, RestrictionsHeard, Unreadable, kind_of

MOST_RIVALS, MOST_GONE = 20, 50
"""At most so many sessions are remembered beside the one that counts, and of those that are gone; the newest stay."""


class Operator:
    """The publisher of one state.

    The first session that is heard counts until its publisher is gone. The newest message of any other session that is
    there waits until then. Where nobody tells who is there, every session is taken to be there.

    Restrictions that two sessions say differently hold together when the first session is gone, until the other one
    tells a list after the conflict was named.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        """The session that counts."""
        self._newest: Heard | None = None
        self._rivals: dict[str, Heard] = {}
        self._gone: dict[str, Heard | None] = {}
        self._informed: set[str] = set()
        self._joined: RestrictionsHeard | None = None

    @property
    def joined(self) -> bool:
        """Whether the restrictions of a session that is gone hold together with those of the one that counts."""
        return self._joined is not None and self._joined.is_same(self._newest)

    def heeds(self, heard: Heard) -> bool:
        """Whether a message counts; one that does not is kept while its publisher is there.

        A message that cannot be read makes nobody the publisher.
        """
        source = heard.source
        if source != self.source and (self.source is None or self.source in self._gone):
            if isinstance(heard, Unreadable):
                return True
            self._rivals.pop(source, None)
            if self.source is not None:
                self._gone[self.source] = self._newest
            self.source = source
        if source == self.source:
            if self._repeats(heard):
                return False
            self._newest = heard
            self._informed.clear()
            return True
        before = self._rivals.get(source) or self._gone.get(source)
        if before is not None and _places(before) != _places(self._newest):
            self._informed.add(source)
        if source in self._gone:
            self._gone[source] = heard
        else:
            self._wait(source, heard)
        return False

    def _repeats(self, heard: Heard) -> bool:
        """Whether a message is the one that was joined, as the bus has kept it."""
        if not self.joined or self._joined is None or not isinstance(heard, RestrictionsHeard):
            return False
        return heard.time_ns <= self._joined.time_ns and not self._joined.is_same(heard)

    def _stricter(self, rival: Heard | None) -> Heard | None:
        """What holds when a rival's message counts now: its restrictions, and those that it may not know of."""
        told = self._newest
        if not isinstance(rival, RestrictionsHeard) or not isinstance(told, RestrictionsHeard):
            return rival
        if rival.source in self._informed or _places(rival) == _places(told):
            return rival
        both = tuple(dict.fromkeys((*told.restrictions, *rival.restrictions)))
        self._joined = replace(rival, restrictions=both)
        return self._joined

    def _wait(self, source: str, heard: Heard) -> None:
        """Keep a message for when the session that counts is gone."""
        if source not in self._rivals and len(self._rivals) >= MOST_RIVALS:
            self._rivals.pop(next(iter(self._rivals)))
        self._rivals[source] = heard

    @property
    def remembered(self) -> tuple[int, int]:
        """How many sessions are remembered beside the one that counts: those that wait, and those that are gone."""
        return len(self._rivals), len(self._gone)

    def is_rival(self, source: str) -> bool:
        """Whether this session has said something that waits."""
        return source in self._rivals

    def see(self, seen: PublisherSeen) -> Heard | None:
        """Take note of a publisher that came or went; returns the message that counts now for that reason, if any.

        One that comes back still says what it said last.
        """
        source = seen.source
        if seen.there:
            said = self._gone.pop(source, None)
            if said is None or source == self.source:
                return None
            if self.source in self._gone:
                return self._stricter(said)
            self._wait(source, said)
            return None
        self._gone[source] = self._rivals.pop(source, self._gone.get(source))
        if len(self._gone) > MOST_GONE:
            self._gone.pop(next(one for one in self._gone if one != self.source))
        return self._stricter(next(iter(self._rivals.values()), None)) if source == self.source else None

    def contradiction(self) -> str | None:
        """The session that says other restrictions than the one that counts; None where no session does."""
        told = _places(self._newest)
        return next((source for source, rival in self._rivals.items() if _places(rival) != told), None)


class Operators:
    """The publishers of journey, restrictions and targets; feed it all messages and who comes and goes."""

    def __init__(self) -> None:
        self._of = {kind: Operator() for kind in STATES}
        self._news: list[str] = []

    def heeds(self, heard: Heard) -> bool:
        """Whether a message counts; where it is the first of a second session that does not, that is news."""
        kind = kind_of(heard)
        operator = self._of.get(kind)
        if operator is None:
            return True
        known, before = operator.is_rival(heard.source), operator.source
        if operator.heeds(heard):
            if before is not None and operator.source != before:
                self._news.append(event_wording.takes_over(kind, operator.source, before, joined=operator.joined))
            return True
        if not known and operator.is_rival(heard.source):
            self._news.append(event_wording.not_heeded(kind, heard.source, before))
        return False

    def source(self, kind: Kind) -> str | None:
        """The session that counts for a state, as far as one is known."""
        operator = self._of.get(kind)
        return operator.source if operator is not None else None

    def remembered(self, kind: Kind) -> tuple[int, int]:
        """How many sessions of a state wait, and how many that are gone are remembered."""
        return self._of[kind].remembered

    def see(self, seen: PublisherSeen) -> Heard | None:
        """Take note of a publisher that came or went; returns the message to be taken again, for it counts now."""
        operator = self._of.get(seen.kind)
        return operator.see(seen) if operator is not None else None

    def contested(self) -> str:
        """The two publishers that say different restrictions, so that nobody can tell which hold; else nothing."""
        operator = self._of[Kind.RESTRICTION]
        other = operator.contradiction()
        return event_wording.two_operators(operator.source, other) if other is not None else ""

    def take_news(self) -> list[str]:
        """What has happened since this was last asked, in words."""
        news, self._news = self._news, []
        return news


def _places(heard: Heard | None) -> list[tuple[float, ...]] | None:
    """The figures of a message's restrictions in an order of their own; None where it cannot be read."""
    return sorted(one.figures for one in heard.restrictions) if isinstance(heard, RestrictionsHeard) else None
