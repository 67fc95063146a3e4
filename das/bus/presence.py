"""Publishers of a latched topic that are there, or are gone, by the liveliness tokens they declare.

A token's key is `<topic key>/@adv/pub/<session>/<publisher>/…`; the session is named as in the time stamps it makes
(`Received.source`). Zenoh takes the tokens of a session back when it is closed, killed, or not heard for its lease.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

from das.bus.topics import Topic

TOKENS = "/@adv/pub/"


@dataclass(frozen=True)
class Presence:
    """A session has begun to publish a topic (`there`), or can do so no more."""

    topic: Topic
    source: str
    there: bool


class Presences:
    """Collects tokens from the threads of Zenoh; `take` hands out for each session what it has come to since."""

    def __init__(self) -> None:
        self._tokens: dict[tuple[str, str], set[str]] = {}
        self._news: dict[tuple[str, str], Presence] = {}
        self._lock = threading.Lock()

    def note(self, topic: Topic, token: str, *, there: bool) -> None:
        """Take note of a token that has appeared, or was taken back; a key that is no token's is ignored."""
        source = token.partition(TOKENS)[2].partition("/")[0]
        if not source:
            return
        place = topic.name, source
        with self._lock:
            tokens = self._tokens.setdefault(place, set())
            if there:
                tokens.add(token)
            else:
                tokens.discard(token)
            if not tokens:
                del self._tokens[place]
            self._news[place] = Presence(topic, source, bool(tokens))

    def take(self) -> list[Presence]:
        """What is new since this was last asked, the newest of each session."""
        with self._lock:
            news, self._news = list(self._news.values()), {}
        return news
