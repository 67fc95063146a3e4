"""What das-record tells its user while it records: where it listens, whom it hears, how much it has, and silence."""

from __future__ import annotations

from collections.abc import Callable

from das.bus.topics import Received
from das.command_line.printing import say
from das.domain.clocks import WALL, Clocks

SILENT_S = 10.0
"""A bus on which nothing was heard for this long (s) is called silent."""
COUNTED_EVERY_S = 60.0
"""The recorder says how many messages it has at this interval (s)."""


class LifeSigns:
    """Says on standard error what becomes of a recording; a full disk or a closed terminal never holds it up."""

    def __init__(self, name: str, clocks: Clocks = WALL, tell: Callable[[str], None] = say) -> None:
        self._name, self._seconds, self._tell = name, clocks.seconds, tell
        self._heard: set[tuple[str, str]] = set()
        self._last_s = self._counted_s = self._seconds()
        self._silent = False

    def say(self, text: str) -> None:
        """Say something about this recorder."""
        self._tell(f"das-record {self._name}: {text}")

    def take(self, received: Received) -> None:
        """Take note of a message; the first one of each sender is named."""
        self._last_s, self._silent = self._seconds(), False
        sender = received.topic.publisher, received.source
        if sender not in self._heard:
            self._heard.add(sender)
            self.say(f"hears the {received.topic.publisher} ({received.topic.name})")

    def look(self, messages: int) -> None:
        """Say how many messages are recorded, if that is due, and that nothing comes any more."""
        now_s = self._seconds()
        if not self._silent and now_s - self._last_s >= SILENT_S:
            self._silent = True
            why = "" if self._heard else ": is every process that sends running, and named by --connect?"
            self.say(f"nothing heard for {SILENT_S:.0f} s{why}")
        if now_s - self._counted_s >= COUNTED_EVERY_S:
            self._counted_s = now_s
            self.say(f"{messages} messages so far")
