"""The inbox of a bus: bounded, in order; a flood costs the oldest positions, never the newest journey."""

from __future__ import annotations

import threading
import time
from collections import deque

from das.bus.received import Received
from das.bus.topics import CONTROL

CAPACITY = 1_000
"""Messages that may wait: at 50 µs each the newest is answered within 50 ms."""
BYTES_EACH = 8_000
"""On average a message may have so many; a few large ones still fit."""
CONTROL_FACTOR = 10
"""Where nothing may be dropped for it, a control may wait beyond the capacity, up to this many times."""
MOST_SENDERS = 100
"""The newest state of at most so many senders is known by name."""


class Inbox:
    """Messages waiting, from the threads of Zenoh to the one that answers; `dropped` counts what a flood cost.

    When full, the oldest message gives way that a newer one of its kind outdates (position, delay, what a node says);
    then of each latched topic (journey, restrictions) all but the newest. Controls are kept up to `CONTROL_FACTOR`
    times the capacity: whoever sends more is no simulation, which waits for its answers.
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
        """Add a message; makes room when full."""
        with self._news:
            while self._is_full():
                if not self._make_room(received):
                    break
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
        """The oldest message, or None after `timeout_s`.

        `skip_outdated` leaves out what its sender has outdated: a journey, restrictions or targets that are followed
        by others which are not older. To act on each of a flood of them would take longer than the flood lasts.
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
        """Whether a later message of the same sender waits that says the same kind of thing anew."""
        if not received.topic.latched or received.message is None:
            return False
        later = self._waiting.get(self._newest.get((received.topic.name, received.source), 0))
        is_newer = later is not None and later.message is not None
        return is_newer and bool(later.message.time_ns >= received.message.time_ns)  # type: ignore[union-attr]

    def _is_full(self) -> bool:
        return len(self._waiting) >= self.capacity or self._bytes >= BYTES_EACH * self.capacity

    def _make_room(self, coming: Received) -> bool:
        """Drop one message for one that comes, if there is one to drop."""
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
