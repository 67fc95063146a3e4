"""The locked-down Zenoh session: loopback only, no scouting, explicit peers, and one ordered stream of messages.

Messages arrive through one subscriber, so that each sender's messages keep their order. Only latched topics (journey,
restrictions, targets, status) have subscribers of their own, which also fetch the last message that was sent before.
"""

from __future__ import annotations

import re
import socket
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import zenoh
from google.protobuf.message import Message

from das.bus.config import BusFile, locked_down, one_line
from das.bus.topics import CONTROL, STATUS, TOPICS, Received, Topic, check_train_name, decoded, topic_of
from das.cab.heard import UNSTAMPED
from das.domain.errors import DasError

CAPACITY = 1_000
"""Largest number of waiting messages: at 50 µs each, the newest is answered within 50 ms."""
BYTES_EACH = 8_000
"""Mean size (bytes) of the messages in a full inbox; a few larger messages fit as well."""
CONTROL_FACTOR = 10
"""Factor on the capacity of the inbox for messages that must not be dropped."""
MOST_SENDERS = 100
"""Largest number of senders whose newest state is remembered."""
HEARTBEAT_S = 1.0
"""Interval (s) at which a latched topic announces its last message, in case it was lost with a closed link."""
ENDPOINT = re.compile(r"tcp/127\.0\.0\.1:(\d{1,5})")
TOKENS = "/@adv/pub/"
"""A liveliness token has the key `<topic key>/@adv/pub/<session>/<publisher>/…`, with the session's name as in its time
stamps (`Received.source`). Zenoh withdraws the tokens of a session that is closed, killed, or silent for its lease."""


class Inbox:
    """The messages received by Zenoh's threads and not taken yet; `dropped` counts lost messages.

    When the inbox is full, the oldest message of a topic that is neither latched nor Control is dropped (a position, a
    delay). If there is none, a new message of a latched topic replaces the previous one. Control messages, and latched
    messages without a previous one, are kept up to `CONTROL_FACTOR` times the capacity.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.capacity = capacity
        self.dropped = 0
        self._waiting: dict[int, Received] = {}
        self._bytes = 0
        self._outdated: deque[int] = deque()
        self._latched: dict[str, int] = {}
        self._newest: dict[tuple[str, str], int] = {}
        self._number = 0
        self._news = threading.Condition()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, received: Received) -> None:
        """Add a message; if the inbox is full, make room for it or drop it."""
        with self._news:
            while self._is_full() and self._make_room(received):
                pass
            if self._is_full() and not self._may_wait(received):
                self.dropped += 1
                return
            self._number += 1
            self._waiting[self._number] = received
            self._bytes += received.size
            if received.topic.latched:
                self._latched[received.topic.name] = self._number
                self._newest[received.topic.name, received.source] = self._number
                if len(self._newest) > MOST_SENDERS:
                    del self._newest[next(iter(self._newest))]
            elif received.topic is not CONTROL:
                self._outdated.append(self._number)
            self._news.notify()

    def get(self, timeout_s: float, *, skip_outdated: bool = False) -> Received | None:
        """The oldest message; None after `timeout_s` without one.

        `skip_outdated` leaves out a journey, restrictions or targets if the same sender has replaced them by a message
        that arrived later and has the same or a later time. Acting on each message of a flood would take too long.
        """
        deadline = time.monotonic() + timeout_s
        with self._news:
            while True:
                while not self._waiting:
                    left_s = deadline - time.monotonic()
                    if left_s <= 0:
                        return None
                    self._news.wait(left_s)
                number = next(iter(self._waiting))
                if self._outdated and self._outdated[0] == number:
                    self._outdated.popleft()
                received = self._removed(number)
                if not (skip_outdated and self._is_outdated(received)):
                    return received

    def _is_outdated(self, received: Received) -> bool:
        """Whether a later message of the same topic and sender waits, with the same or a later time."""
        if not received.topic.latched or received.message is None:
            return False
        later = self._waiting.get(self._newest.get((received.topic.name, received.source), 0))
        is_newer = later is not None and later.message is not None
        return is_newer and bool(later.message.time_ns >= received.message.time_ns)  # type: ignore[union-attr]

    def _is_full(self) -> bool:
        return len(self._waiting) >= self.capacity or self._bytes >= BYTES_EACH * self.capacity

    def _make_room(self, coming: Received) -> bool:
        """Drop a message to make room for `coming`; returns False if there was none to drop."""
        number = self._outdated.popleft() if self._outdated else self._latched.get(coming.topic.name, 0)
        if number not in self._waiting:
            return False
        self._removed(number)
        self.dropped += 1
        return True

    def _may_wait(self, coming: Received) -> bool:
        return (coming.topic is CONTROL or coming.topic.latched) and len(self) < CONTROL_FACTOR * self.capacity

    def _removed(self, number: int) -> Received:
        received = self._waiting.pop(number)
        self._bytes -= received.size
        return received


def free_ports(count: int) -> list[int]:
    """Different TCP ports of 127.0.0.1, given to no other program for a minute unless it requests their numbers.

    A closed connection is left on each port: a bus can listen there, but the system does not assign the port.
    """
    ports = []
    for _ in range(count):
        with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()):
            server.accept()[0].close()  # The side that closes first keeps the port.
            ports.append(int(server.getsockname()[1]))
    return ports


def endpoint(port: int) -> str:
    """The loopback endpoint of a port."""
    return f"tcp/127.0.0.1:{port}"


def check_endpoint(text: str) -> str:
    """The endpoint, if it is on this machine (`tcp/127.0.0.1:PORT`); raises DasError otherwise."""
    match = ENDPOINT.fullmatch(text)
    if not match or not 0 < int(match[1]) < 65536:
        raise DasError(f"endpoint {text!r}: expected tcp/127.0.0.1:PORT (the bus stays on this machine)")
    return text


@dataclass(frozen=True)
class Presence:
    """A report that a session has begun to publish a topic (`there` is True), or no longer does."""

    topic: Topic
    source: str
    there: bool


class Presences:
    """Collects the liveliness tokens of the publishers of latched topics from the threads of Zenoh.

    `take` returns the newest presence of each session.
    """

    def __init__(self) -> None:
        self._tokens: dict[tuple[str, str], set[str]] = {}
        self._news: dict[tuple[str, str], Presence] = {}
        self._lock = threading.Lock()

    def note(self, topic: Topic, token: str, *, there: bool) -> None:
        """Take note of a token that has appeared or was withdrawn; keys that are not of tokens are ignored."""
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
        """The changes since the last call, the newest of each session."""
        with self._lock:
            news, self._news = list(self._news.values()), {}
        return news


class Bus:
    """A session for one train; use it with `with`, because an open session makes the program hang at exit.

    `listen` is the endpoint of this process; `connect` are the endpoints of others, tried until they answer; or a
    site's `file` states both. `hear` lists the topics to receive. `waiting` is the capacity of the `Inbox`.
    """

    def __init__(
        self,
        train: str,
        *,
        listen: str | None = None,
        connect: Sequence[str] = (),
        hear: Sequence[Topic] = (),
        file: BusFile | None = None,
        waiting: int = CAPACITY,
    ) -> None:
        self.train = check_train_name(train)
        self.listen = check_endpoint(listen) if listen else None
        self._hear = frozenset(topic.name for topic in hear)
        self._config = file.config(train) if file else locked_down(self.listen, [check_endpoint(x) for x in connect])
        self._place = str(file.path) if file else self.listen or "a session"
        self._inbox, self._presences = Inbox(waiting), Presences()
        self._publishers: dict[str, Any] = {}
        self._declared: list[Any] = []

    def __enter__(self) -> Bus:
        # With RUST_LOG set, Zenoh reports rejected peers on standard output.
        zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
        try:
            self._session = zenoh.open(self._config)
        except zenoh.ZError as error:
            raise DasError(f"bus: cannot open {self._place}: {one_line(error)}") from error
        # Read once: a session that is being closed does not answer, while messages may still arrive.
        self._own = str(self._session.zid())
        try:
            self._subscribe()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _subscribe(self) -> None:
        """Subscribe to latched topics with their last message, and to all others in one ordered stream."""
        for topic in TOPICS:
            if topic.latched and topic.name in self._hear:
                subscriber = zenoh.ext.declare_advanced_subscriber(
                    self._session,
                    topic.key(self.train),
                    self._on_sample,
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                    recovery=zenoh.ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
                    allowed_origin=zenoh.Locality.REMOTE,
                )
                self._declared.append(subscriber)
        if self._hear:
            everything = f"*/{self.train}/*"
            self._declared.append(
                self._session.declare_subscriber(everything, self._on_ordered, allowed_origin=zenoh.Locality.REMOTE)
            )

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def publish(self, topic: Topic, message: Message) -> None:
        """Send a message reliably; if a receiver is slow, the call waits instead of dropping the message."""
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = self._declare(topic)
        publisher.put(message.SerializeToString())

    def receive(self, timeout_s: float, *, skip_outdated: bool = False) -> Received | None:
        """The next message; None after `timeout_s` without one. `skip_outdated` is that of `Inbox.get`."""
        return self._inbox.get(timeout_s, skip_outdated=skip_outdated)

    def watch(self, topics: Sequence[Topic]) -> None:
        """Watch the publishers of latched topics: those that are present already, and those that come and go."""
        for topic in topics:

            def noted(sample: zenoh.Sample, topic: Topic = topic) -> None:
                self._presences.note(topic, str(sample.key_expr), there=sample.kind == zenoh.SampleKind.PUT)

            tokens = f"{topic.key(self.train)}{TOKENS}**"
            self._declared.append(self._session.liveliness().declare_subscriber(tokens, noted, history=True))

    def presences(self) -> list[Presence]:
        """The publishers of watched topics that came or went since the last call, except this session itself."""
        return [one for one in self._presences.take() if one.source != self._own]

    def trains(self) -> list[str]:
        """The names of the trains that nodes on this bus advise now; takes up to a second."""
        tokens = self._session.liveliness().get(f"{STATUS.root}/*/{STATUS.name}{TOKENS}**", timeout=1.0)
        return sorted({str(reply.ok.key_expr).split("/")[1] for reply in tokens if reply.ok is not None})

    @property
    def dropped(self) -> int:
        """The number of messages lost in floods so far."""
        return self._inbox.dropped

    def _declare(self, topic: Topic) -> Any:
        common: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.BLOCK,
            "reliability": zenoh.Reliability.RELIABLE,
            "express": True,
        }
        key = topic.key(self.train)
        if topic.latched:
            return zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
                publisher_detection=True,
                **common,
            )
        return self._session.declare_publisher(key, **common)

    def _on_ordered(self, sample: zenoh.Sample) -> None:
        topic = topic_of(str(sample.key_expr))
        if topic is not None and not topic.latched:
            self._on_sample(sample)

    def _source(self, sample: zenoh.Sample) -> str:
        """The session that sent a message; `UNSTAMPED` if its time stamp was missing, or over 0.5 s ahead of our clock.

        Zenoh replaces such a stamp with our own, which therefore means unstamped: we do not receive our own messages.
        """
        stamp = sample.timestamp
        source = str(stamp.get_id()) if stamp is not None else UNSTAMPED
        return UNSTAMPED if source == self._own else source

    def _on_sample(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        topic = topic_of(key)
        if topic is None or topic.name not in self._hear:
            return
        source = self._source(sample)
        if key == topic.key(self.train) and sample.kind == zenoh.SampleKind.PUT:
            self._inbox.put(decoded(topic, key, sample.payload.to_bytes(), source))
        else:  # for many trains at once, or a deletion: no sender of this project does that
            self._inbox.put(Received(topic, key, None, source))
