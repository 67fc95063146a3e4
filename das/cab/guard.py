"""The guard of the cab: it admits messages of sensible size and order, and one publisher for each kind of message.

For a state (journey, restrictions, targets) the first session on the bus counts until it is gone (`Operator`); for a
measurement, until it is silent (`Publishers`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from das.advice import wording
from das.advice.advice import Cause, Withdrawal
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
)
from das.domain.errors import DasError
from das.domain.restriction import LONGEST_TEXT, Restriction
from das.domain.units import NS
from das.estimate.estimate import STALE_AFTER_S

MOST_RIVALS = 20
"""Largest number of waiting sessions (the newest) that are remembered, and of other nodes of the train (the first)."""
MOST_GONE = 50
"""Largest number of sessions (the newest) whose presence is remembered."""
MOST_STOPS = 200
"""Largest number of stops of a journey; a journey with more is rejected as implausible."""
MOST_RESTRICTIONS = 100
"""Largest number of restrictions in a message; a message with more is rejected as implausible."""
MOST_TARGETS = 100
"""Largest number of targets in a message; a message with more is rejected as implausible."""
AHEAD_S = 60.0
"""Longest time (s) ahead of the clock of a message used immediately; others wait, so that later ones still count."""
TOKEN_AFTER_S = 2.0
"""Time (s) after the first message of a publisher; without a liveliness token by then it counts as having none."""
NOT_STAMPED = "one without its sender's time stamp (or with one ahead of the clock)"
SILENT_S = STALE_AFTER_S
"""Silence (s) after which another publisher of measurements may take over; a position remains usable just as long."""


class Guard:
    """Checks messages before anything acts on them; pass every message in the order received."""

    def __init__(self) -> None:
        self._newest_ns: dict[Kind, int] = {}
        self._operators = {kind: Operator() for kind in STATES}
        self._publishers = {kind: Publishers() for kind in (Kind.POSITION, Kind.EFFORT)}
        self._in_force: list[Restriction] = []
        self._early: dict[Kind, StateHeard] = {}
        self._news: list[str] = []
        self._nodes: list[str] = []
        self.unheeded: str | None = None
        """Why the restrictions received last cannot be used; None if they can."""

    def counts(self, message: Heard) -> bool:
        """Whether the sender of a message is the publisher that counts for its kind; `take_news` reports the others."""
        kind, source = message.kind, message.source
        operator = self._operators.get(kind)
        if operator is None:
            return True
        if source == UNSTAMPED:
            self._refuse_unstamped(kind)
            return False
        before, known = operator.source, operator.is_rival(source)
        is_counted = operator.counts(message)
        if before is not None and operator.source != before:
            # The times of a publisher that is gone do not show the age of this publisher's messages.
            self._newest_ns.pop(kind, None)
            self._early.pop(kind, None)
            if is_counted:
                why = "has no liveliness token and its order is older" if before == operator.overtaken else "is gone"
                self._news.append(f"{kind}: {_named(operator.source)} counts from now on, {_named(before)} {why}")
        elif not is_counted and not known and operator.is_rival(source):
            there = f"what {_named(source)} says is not heeded while {_named(before)} is there"
            self._news.append(f"{kind}: two publishers: {there}")
        return is_counted

    def see(self, seen: PublisherSeen) -> Heard | None:
        """Take note of a publisher that came or went; returns the message that counts now because of that, if any."""
        operator = self._operators.get(seen.kind)
        return operator.see(seen) if operator is not None else None

    def see_node(self, seen: NodeSeen) -> None:
        """Take note of another node of this train that came or went; only the first `MOST_RIVALS` are remembered."""
        if not seen.there:
            self._nodes = [one for one in self._nodes if one != seen.source]
        elif seen.source not in self._nodes and len(self._nodes) < MOST_RIVALS:
            self._nodes.append(seen.source)

    def take_news(self) -> list[str]:
        """The reports on publishers since the last call."""
        news, self._news = self._news, []
        return news

    def problem(self, message: Heard) -> str:
        """Why a message has to be ignored; empty if it is accepted."""
        kind, now_ns = message.kind, message.heard_ns
        if kind is Kind.RESTRICTION:
            return self._problem_of_restrictions(message)
        found = self._problem_by_itself(message) if isinstance(message, StateHeard | Unreadable) else ""
        measured = self._publishers.get(kind)
        if not found and measured is not None and not measured.counts(message.source, now_ns):
            second = f"one of a second publisher ({message.source or 'unnamed'})"
            found = NOT_STAMPED if message.source == UNSTAMPED else second
        if not found and isinstance(message, StateHeard):
            found = self._replayed(message)
        return f"{kind}: {found} was ignored" if found else ""

    def due(self, now_ns: int) -> list[StateHeard]:
        """The messages that count now because time has passed; the caller must check them again.

        These are messages that were ahead of the clock and no longer are (senders do not repeat a message, so the
        newest of each kind waits here until then), and newer orders that overtake the orders of a publisher whose
        presence is unknown.
        """
        due: list[StateHeard] = []
        for one in tuple(self._early.values()):
            if _ahead_s(one, now_ns) <= AHEAD_S:
                due.append(self._early.pop(one.kind))
        for kind, operator in self._operators.items():
            if operator.turns_out_unannounced(now_ns):
                self._news.append(
                    f"{kind}: {_named(operator.source)} has no liveliness token: its end cannot be detected, and "
                    "a newer order of another publisher replaces its own; publish with das.bus.session.Bus, or with "
                    "zenoh.ext.declare_advanced_publisher and publisher_detection=True"
                )
            overtaking = operator.overtaking()
            if overtaking is not None:
                due.append(overtaking)
        return due

    def doubts(self, now_ns: int) -> dict[str, Any]:
        """The reasons to distrust the messages received so far, by the names of `das.cab.withdrawal.Trust`."""
        positions, operator = self._publishers[Kind.POSITION], self._operators[Kind.RESTRICTION]
        return {
            "two_publishers": positions.contested(now_ns),
            "two_operators": operator.contradiction(),
            "unheeded": self.unheeded,
            "two_nodes": self._nodes[0] if self._nodes else "",
        }

    def has_rival_efforts(self, now_ns: int) -> bool:
        """Whether two publishers state the wheel forces, or may do so undetected: then one of them may be wrong."""
        return self._publishers[Kind.EFFORT].contested(now_ns) is not None

    def _refuse_unstamped(self, kind: Kind) -> None:
        """Refuse a state without its sender's time stamp, because two such senders could not be distinguished."""
        if kind is Kind.RESTRICTION:
            self._news.append(self._unheeded(f"{NOT_STAMPED}: {wording.STAMP_CURE}"))
        else:
            self._news.append(f"{kind}: {NOT_STAMPED} was ignored: {wording.STAMP_CURE}")

    def _unheeded(self, why: str) -> str:
        """Drop the restrictions in force; returns the text that gives this as the reason for having no advice."""
        self.unheeded = why
        return wording.withdrawal(Withdrawal(Cause.RESTRICTIONS_UNHEEDED, why))

    def _problem_of_restrictions(self, message: Heard) -> str:
        """The `problem` of a list of restrictions: without a usable list there must be no advice."""
        assert isinstance(message, RestrictionsHeard | Unreadable)
        found = self._problem_by_itself(message)
        if found or isinstance(message, Unreadable):
            return self._unheeded(found)
        received = list(message.restrictions)
        if found := self._replayed(message):
            if received != self._in_force:  # A replay, or an operator whose clock was set back.
                return self._unheeded(f"{found}, which said otherwise")
            return f"{Kind.RESTRICTION}: {found} was ignored"
        self._in_force, self.unheeded = received, None
        return ""

    def _problem_by_itself(self, message: StateHeard | Unreadable) -> str:
        """Why a message has to be ignored, regardless of earlier messages; empty if it is accepted."""
        kind, now_ns = message.kind, message.heard_ns
        if isinstance(message, StateHeard) and now_ns > 0 and _ahead_s(message, now_ns) > AHEAD_S:
            self._early[kind] = message
            return f"one from {_ahead_s(message, now_ns):.0f} s ahead of the clock"
        if found := _nonsense(message):
            self._early.pop(kind, None)
        return found

    def _replayed(self, message: StateHeard) -> str:
        """How much older a state is than the newest of its kind, as text; empty if it is not older: then it becomes the
        newest.

        The bus repeats the newest state, so a state with an equal time is not rejected.
        """
        kind, now_ns = message.kind, message.heard_ns
        newest_ns = self._newest_ns.get(kind, message.time_ns)
        # If the clock was set back, the newest time from before must not exclude new messages.
        was_set_back = now_ns > 0 and (newest_ns - now_ns) * NS > AHEAD_S
        if message.time_ns < newest_ns and not was_set_back:
            return f"one {(newest_ns - message.time_ns) * NS:.0f} s older than the last"
        self._newest_ns[kind] = message.time_ns
        self._early.pop(kind, None)
        return ""


class Publishers:
    """Decides which session counts for one measurement; a session is known by its name in Zenoh's time stamps."""

    def __init__(self) -> None:
        self._source: str | None = None
        self._counted_ns = 0
        self._rival, self._rival_ns = "", 0
        self._unstamped_ns: int | None = None

    def counts(self, source: str, now_ns: int) -> bool:
        """Whether a measurement of this session counts; a new session counts once the previous one has gone silent.

        A measurement without its sender's time stamp never counts: two such senders could not be distinguished.
        """
        if source == UNSTAMPED:
            self._unstamped_ns = now_ns
            if self._source is not None:
                self._rival, self._rival_ns = source, now_ns
            return False
        if self._source is None or not _within(now_ns, self._counted_ns):
            self._source, self._rival = source, ""
        if source != self._source:
            self._rival, self._rival_ns = source, now_ns
            return False
        self._counted_ns = now_ns
        return True

    def contested(self, now_ns: int) -> str | None:
        """The two publishers that both measure now, so that neither can be trusted; None if there is only one.

        The text is empty if measurements come without their sender's time stamp now, and thus maybe from two.
        """
        if self._rival and _within(now_ns, self._rival_ns) and _within(now_ns, self._counted_ns):
            return f"{self._source or 'unnamed'} and {self._rival}"
        return "" if self._unstamped_ns is not None and _within(now_ns, self._unstamped_ns) else None


class Operator:
    """Decides which session counts for one state.

    The first session counts until its publisher is gone; the last messages of the others wait. Without presence
    reports, every session counts as present.

    Two sessions that state different restrictions contradict each other until they agree, or until one is gone and the
    other has sent a list since.

    A publisher without a liveliness token is never reported gone. A newer message of another session overtakes it: most
    likely it was restarted as that session. If it sends again, both are present, and neither overtakes the other.
    """

    def __init__(self) -> None:
        self.source: str | None = None
        """The session that counts."""
        self._said: dict[str | None, Heard] = {}
        self._there: dict[str | None, bool] = {}
        self._left: set[str] = set()
        self._unannounced: tuple[str | None, int] = None, 0
        self._tokenless: str | None = None
        self.overtaken: str | None = None
        """The session whose message was overtaken by a newer one, if it has not sent since."""
        self._contested = False

    def counts(self, message: Heard) -> bool:
        """Whether a message counts; a message that does not count waits while its publisher is present.

        Neither an unreadable message nor a repeated one during a contradiction makes its session the one that counts.
        """
        source, before = message.source, self._said.get(message.source)
        takes_over = source != self.source and (self.source is None or self.is_gone(self.source))
        repeated = before is not None and replace(before, heard_ns=message.heard_ns) == message
        if takes_over and isinstance(message, Unreadable):
            return True
        if takes_over and repeated and self._differs(source) and self.overtaken != self.source:
            return False
        if source == self.overtaken and not takes_over:
            self.overtaken, self._contested = None, True
            self._there.pop(source, None)
        if takes_over:
            self.source = source
        if source == self.source and not repeated:
            self._left.clear()
        self._said[source] = message
        if len(self._said) > MOST_RIVALS + 1:
            self._said.pop(next(one for one in self._said if one != self.source))
        return source == self.source

    def turns_out_unannounced(self, now_ns: int) -> bool:
        """Whether the session that counts proves to have no liveliness token; True once for each session.

        A token may come a little after the first message.
        """
        since = self._unannounced
        if not self.source or self.source in self._there:
            self._unannounced = None, 0
        elif since[0] != self.source:
            self._unannounced = self.source, now_ns
        elif abs(now_ns - since[1]) * NS >= TOKEN_AFTER_S and self._tokenless != self.source:
            self._tokenless = self.source
            return True
        return False

    def overtaking(self) -> StateHeard | None:
        """The newer message of a waiting session that counts now, because the session that counted has no token.

        Restrictions count only if they include all that were in force: both sessions may be present.
        """
        if not self.source or self._tokenless != self.source or self.source in self._there or self._contested:
            return None
        newest = self._said[self.source]
        newest_ns = newest.time_ns if isinstance(newest, StateHeard) else 0
        known = set(_places(newest) or ())
        rivals = (one for name in self._rivals() if isinstance(one := self._said[name], StateHeard))
        newer = [one for one in rivals if one.time_ns > newest_ns and known <= set(_places(one) or ())]
        if not newer:
            return None
        self._there[self.source] = False
        self.overtaken = self.source
        return max(newer, key=lambda one: one.time_ns)

    def is_rival(self, source: str) -> bool:
        """Whether a message of this session waits."""
        return source in self._rivals()

    def is_gone(self, source: str | None) -> bool:
        """Whether the publisher of a session was present and no longer is."""
        return self._there.get(source) is False

    def see(self, seen: PublisherSeen) -> Heard | None:
        """Take note of a publisher that came or went; returns the message that counts now because of that, if any.

        The last message of a publisher that comes back still holds.
        """
        source = seen.source
        if not seen.there and self.is_rival(source) and self._differs(source):
            self._left.add(source)
        self._there.pop(source, None)
        self._there[source] = seen.there
        if len(self._there) > MOST_GONE:
            self._there.pop(next(one for one in self._there if one != self.source))
        rivals = self._rivals() if self.is_gone(self.source) else []
        return next((self._said[one] for one in rivals if not self._differs(one)), None)

    def contradiction(self) -> str:
        """The two publishers that state different restrictions, and the remedy if one is gone; empty if they agree."""
        other = next((one for one in (*self._rivals(), *self._left) if self._differs(one)), None)
        if other is None:
            return ""
        one_is_gone = self.is_gone(self.source) or self.is_gone(other)
        cure = "; one of them is gone, the other has to send its list again" if one_is_gone else ""
        return f"{_named(self.source)} and {_named(other)}{cure}"

    def _rivals(self) -> list[str]:
        """The other sessions whose publishers are present."""
        return [one for one in self._said if one is not None and one != self.source and not self.is_gone(one)]

    def _differs(self, source: str) -> bool:
        """Whether the last restrictions of a session differ from the list of the session that counts."""
        return _places(self._said.get(source)) != _places(self._said.get(self.source))


def _nonsense(message: StateHeard | Unreadable) -> str:
    """Why a message is implausible; empty if it is plausible."""
    if isinstance(message, Unreadable):
        return message.why or "a message that cannot be read"
    if isinstance(message, RestrictionsHeard):
        if len(message.restrictions) > MOST_RESTRICTIONS:
            return f"{len(message.restrictions)} of them, more than {MOST_RESTRICTIONS}"
        for one in message.restrictions:
            try:
                judged(one)
            except DasError:
                return described(one)
    if isinstance(message, TargetsHeard):
        if len(message.targets) > MOST_TARGETS:
            return f"one of {len(message.targets)} targets, more than {MOST_TARGETS}"
        return _too_long(one.stop for one in message.targets)
    if isinstance(message, JourneyHeard):
        if len(message.stops) > MOST_STOPS:
            return f"one of {len(message.stops)} stops, more than {MOST_STOPS}"
        texts = (message.train, message.route_id, message.vehicle_id, message.load, message.level)
        return _too_long((*texts, *(stop.name for stop in message.stops)))
    return ""


def _too_long(texts: Iterable[str]) -> str:
    longest = max(map(len, texts), default=0)
    return f"one with a name of {longest} letters" if longest > LONGEST_TEXT else ""


def described(one: Restriction) -> str:
    """A restriction with impossible ends, limit or window, or with too long a text, in words."""
    window = f", valid from {one.valid_from_ns} to {one.valid_until_ns} ns" if one.has_window else ""
    long = "".join(f", {key} of {len(x)} letters" for key, x in one.texts.items() if len(x) > LONGEST_TEXT)
    return f"one of {one.limit_mps:g} m/s from {one.start_m:g} to {one.end_m:g} m{window}{long}"


def off_route(received: Sequence[Restriction], length_m: float) -> str:
    """The text on restrictions wholly off a route of this length (their sender may use another zero); empty if none."""
    astray = [one for one in received if one.end_m <= 0 or one.start_m >= length_m]
    if not astray:
        return ""
    more = f" and {len(astray) - 1} more" if len(astray) > 1 else ""
    return f"{Kind.RESTRICTION}: {described(astray[0])}{more} is off the route (0 to {length_m:.0f} m)"


def _within(now_ns: int, then_ns: int) -> bool:
    return abs(now_ns - then_ns) * NS <= SILENT_S


def _named(source: str | None) -> str:
    """The name of a session; words for one without a name."""
    return source or "one without a name"


def _places(message: Heard | None) -> list[tuple[float, ...]] | None:
    """The sorted figures of a message's restrictions; None for a message of another kind."""
    return sorted(one.figures for one in message.restrictions) if isinstance(message, RestrictionsHeard) else None


def _ahead_s(message: StateHeard, now_ns: int) -> float:
    return float((message.time_ns - now_ns) * NS)
