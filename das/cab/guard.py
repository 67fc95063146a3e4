"""The guard of the cab: it admits messages of sensible size and order, and only one publisher of each kind."""

from __future__ import annotations

from dataclasses import dataclass, replace

from das.cab import event_wording
from das.cab.heard import (
    STATES,
    UNSTAMPED,
    Heard,
    JourneyHeard,
    Kind,
    NodeSeen,
    PublisherSeen,
    RestrictionsHeard,
    StateHeard,
    TargetsHeard,
    Unreadable,
    judged,
    kind_of,
)
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.estimate.settings import STALE_AFTER_S

MOST_RIVALS, MOST_GONE = 20, 50
"""At most so many sessions are remembered beside the one that counts, and of those that are gone; the newest stay."""


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Limits beyond which messages are rejected: how much they hold, how long their texts are, and their times."""

    most_stops: int = 200
    """Journeys with more stops are rejected as nonsense."""
    most_restrictions: int = 100
    """Messages with more restrictions are rejected as nonsense."""
    most_targets: int = 100
    """Messages with more targets are rejected as nonsense."""
    longest_text: int = 200
    """Longest name, id or remark (letters); a message with a longer one is rejected as nonsense."""
    ahead_s: float = 60.0
    """A message further ahead of the clock than this is put off: it would shut out those that come after it."""
    silent_s: float = STALE_AFTER_S
    """A publisher of positions that has been silent for this long gives way to another one. A position can be used for
    as long."""


DEFAULT = GuardSettings()


class Guard:
    """Judges messages before anything acts on them; feed it with every message in the order received."""

    def __init__(self, settings: GuardSettings = DEFAULT) -> None:
        self._settings = settings
        self._newest_ns: dict[Kind, int] = {}
        self._operators = Operators()
        self._publishers = {kind: Publishers(settings.silent_s) for kind in (Kind.POSITION, Kind.EFFORT)}
        self._in_force: list[Restriction] = []
        self._early: dict[Kind, Heard] = {}
        self._news: list[str] = []
        self._nodes: list[str] = []
        self.unheeded: str | None = None
        """Why the restrictions received last cannot be heeded; None: they can."""

    def heeds(self, heard: Heard) -> bool:
        """Whether the sender of a message is the publisher that counts for its kind; `take_news` reports the others."""
        kind, before = kind_of(heard), self._operators.source(kind_of(heard))
        if kind in STATES and heard.source == UNSTAMPED:
            self._refuse_unstamped(kind)
            return False
        counts = self._operators.heeds(heard)
        if before is not None and self._operators.source(kind) != before:
            # The times of a publisher that is gone say nothing about the age of this one's messages.
            self._newest_ns.pop(kind, None)
            self._early.pop(kind, None)
        return counts

    def see(self, seen: PublisherSeen) -> Heard | None:
        """Take note of a publisher that came or went; returns the message to be taken again because it counts now."""
        return self._operators.see(seen)

    def see_node(self, seen: NodeSeen) -> None:
        """Take note of another node of this train that came or went; if there are very many, only of the first ones."""
        if not seen.there:
            self._nodes = [one for one in self._nodes if one != seen.source]
        elif seen.source not in self._nodes and len(self._nodes) < MOST_RIVALS:
            self._nodes.append(seen.source)

    def rival_node(self) -> str:
        """The name of another node that advises this train as well; empty if there is none."""
        return self._nodes[0] if self._nodes else ""

    def take_news(self) -> list[str]:
        """What has happened to the publishers since this was last asked, in words."""
        news, self._news = self._news, []
        return news + self._operators.take_news()

    def problem(self, heard: Heard) -> str:
        """Why a message is to be ignored; empty if it is not."""
        kind, now_ns = kind_of(heard), heard.heard_ns
        if kind is Kind.RESTRICTION:
            return self._problem_of_restrictions(heard)
        found = self._problem_by_itself(heard)
        measured = self._publishers.get(kind)
        if not found and measured is not None and not measured.is_heard(heard.source, now_ns):
            unstamped = heard.source == UNSTAMPED
            found = event_wording.NOT_STAMPED if unstamped else event_wording.second_publisher(heard.source)
        if not found and isinstance(heard, StateHeard):
            found = self._replayed(heard)
        return event_wording.ignored(kind, found) if found else ""

    def due(self, now_ns: int) -> list[Heard]:
        """The messages that were ahead of the clock and no longer are; they are to be judged again.

        Each sender sends a message only once, so the newest of each kind is kept until the clock has reached it.
        """
        there = [
            (kind, one)
            for kind, one in self._early.items()
            if isinstance(one, StateHeard) and _ahead_s(one, now_ns) <= self._settings.ahead_s
        ]
        for kind, _ in there:
            del self._early[kind]
        return [one for _, one in there]

    def rivals(self, now_ns: int) -> str:
        """The two publishers that both state where the train is, so that one of them is wrong; else empty."""
        return self._publishers[Kind.POSITION].contested(now_ns)

    def unstamped(self, now_ns: int) -> bool:
        """Whether positions come without their sender's time stamp, so that two senders could not be told apart."""
        return self._publishers[Kind.POSITION].unstamped(now_ns)

    def has_rival_efforts(self, now_ns: int) -> bool:
        """Whether two publishers both state the wheel forces, or may do so unnoticed: then one of them may be wrong."""
        efforts = self._publishers[Kind.EFFORT]
        return bool(efforts.contested(now_ns)) or efforts.unstamped(now_ns)

    def rival_operators(self) -> str:
        """The two publishers that state different restrictions; else empty."""
        return self._operators.contested()

    def lose_restrictions(self, why: str) -> None:
        """Treat what is in force as unknown until restrictions are received that can be heeded."""
        self.unheeded = why

    def _refuse_unstamped(self, kind: Kind) -> None:
        """Refuse a state without its sender's time stamp: of two such senders, nobody could tell which is wrong."""
        if kind is Kind.RESTRICTION:
            self.lose_restrictions(event_wording.NOT_STAMPED)
            self._news.append(event_wording.restrictions_unheeded(event_wording.NOT_STAMPED))
        else:
            self._news.append(event_wording.ignored(kind, event_wording.NOT_STAMPED))

    def _problem_of_restrictions(self, heard: Heard) -> str:
        """Like `problem`, for restrictions: unless there are some that can be heeded, there must be no advice."""
        found = self._problem_by_itself(heard)
        if found or not isinstance(heard, RestrictionsHeard):
            self.lose_restrictions(found)
            return event_wording.restrictions_unheeded(found)
        told = list(heard.restrictions)
        if found := self._replayed(heard):
            if told != self._in_force:  # A replay, or an operator whose clock was set back: nobody can tell.
                why = event_wording.older_and_different(found)
                self.lose_restrictions(why)
                return event_wording.restrictions_unheeded(why)
            return event_wording.ignored(Kind.RESTRICTION, found)
        self._in_force, self.unheeded = told, None
        return ""

    def _problem_by_itself(self, heard: Heard) -> str:
        """Why a message is of no use, whatever was received before; empty if it is of use."""
        kind, now_ns = kind_of(heard), heard.heard_ns
        if isinstance(heard, StateHeard) and now_ns > 0 and _ahead_s(heard, now_ns) > self._settings.ahead_s:
            self._early[kind] = heard
            return event_wording.ahead_of_clock(_ahead_s(heard, now_ns))
        found = self._problem_of_sense(heard)
        if found:
            self._early.pop(kind, None)
        return found

    def _replayed(self, heard: StateHeard) -> str:
        """Why a state is older than the newest of its kind; else empty, and it becomes the newest.

        The bus repeats the newest, so an equal time is no reason.
        """
        kind, now_ns = kind_of(heard), heard.heard_ns
        newest_ns = self._newest_ns.get(kind, heard.time_ns)
        # If the clock was set back, the newest time from before must not shut anything out.
        was_set_back = now_ns > 0 and (newest_ns - now_ns) * NS > self._settings.ahead_s
        if heard.time_ns < newest_ns and not was_set_back:
            return event_wording.older_than_last((newest_ns - heard.time_ns) * NS)
        self._newest_ns[kind] = heard.time_ns
        self._early.pop(kind, None)
        return ""

    def _problem_of_sense(self, heard: Heard) -> str:
        """Why a message is nonsense; empty if it makes sense."""
        settings = self._settings
        if isinstance(heard, Unreadable):
            return heard.why or event_wording.NOT_OF_ITS_KIND
        if isinstance(heard, RestrictionsHeard):
            if len(heard.restrictions) > settings.most_restrictions:
                return event_wording.too_many_restrictions(len(heard.restrictions), settings.most_restrictions)
            wrong = next((one for one in heard.restrictions if not _is_restriction(one)), None)
            return event_wording.impossible_restriction(wrong) if wrong is not None else ""
        if isinstance(heard, TargetsHeard):
            if len(heard.targets) > settings.most_targets:
                return event_wording.too_many_targets(len(heard.targets), settings.most_targets)
            return self._too_long(*(one.stop for one in heard.targets))
        if isinstance(heard, JourneyHeard):
            if len(heard.stops) > settings.most_stops:
                return event_wording.too_many_stops(len(heard.stops), settings.most_stops)
            texts = (heard.train, heard.route_id, heard.vehicle_id, heard.load, heard.level)
            return self._too_long(*texts, *(stop.name for stop in heard.stops))
        return ""

    def _too_long(self, *texts: str) -> str:
        longest = max(map(len, texts), default=0)
        return event_wording.name_too_long(longest) if longest > self._settings.longest_text else ""


class Publishers:
    """The one publisher of a measurement that the cab heeds: a session, known by its name in Zenoh's time stamps."""

    def __init__(self, silent_s: float = DEFAULT.silent_s) -> None:
        self._silent_s = silent_s
        self._source: str | None = None
        self._heard_ns = 0
        self._rival, self._rival_ns = "", 0
        self._unstamped_ns: int | None = None

    def is_heard(self, source: str, now_ns: int) -> bool:
        """Whether a publisher's measurement counts; a new publisher counts once the previous one has gone silent.

        A measurement without its sender's time stamp never counts: two such senders could not be told apart.
        """
        if source == UNSTAMPED:
            self._unstamped_ns = now_ns
            if self._source is not None:
                self._rival, self._rival_ns = source, now_ns
            return False
        if self._source is None or not self._within(now_ns, self._heard_ns):
            self._source, self._rival = source, ""
        if source != self._source:
            self._rival, self._rival_ns = source, now_ns
            return False
        self._heard_ns = now_ns
        return True

    def contested(self, now_ns: int) -> str:
        """The two publishers that both measure now, so that neither can be trusted; else empty."""
        if self._rival and self._within(now_ns, self._rival_ns) and self._within(now_ns, self._heard_ns):
            return event_wording.two_publishers(self._source, self._rival)
        return ""

    def unstamped(self, now_ns: int) -> bool:
        """Whether measurements come without their sender's time stamp now."""
        return self._unstamped_ns is not None and self._within(now_ns, self._unstamped_ns)

    def _within(self, now_ns: int, then_ns: int) -> bool:
        return abs(now_ns - then_ns) * NS <= self._silent_s


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


def _ahead_s(heard: StateHeard, now_ns: int) -> float:
    return float((heard.time_ns - now_ns) * NS)


def _is_restriction(told: Restriction) -> bool:
    try:
        judged(told)
    except DasError:
        return False
    return True
