"""What Zenoh refused, from its log: certificates that do not hold, and messages access control keeps out.

Zenoh tells nobody but its log, on standard output, and there in the midst of everything else. The processes that
advise and record say nothing on standard output themselves: it is turned into a pipe, read here.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Self

import zenoh

from das.cab.outputs import Moderation
from das.command_line.printing import say
from das.domain.clocks import WALL_NS

LEVELS = (
    "warn,zenoh::net::routing::hat=error,zenoh::net::runtime::orchestrator=error,zenoh::net::routing::interceptor=trace"
)
"""RUST_LOG takes their place."""
ANSI = re.compile(rb"\x1b\[[0-9;]*m")
LINE = re.compile(r"\S+Z +(?P<level>[A-Z]+) +(?:\S+ +)?ThreadId\((?P<thread>\d+)\) (?P<text>.*)")
NAMED = r"(?P<session>[0-9a-f]{1,32})(?: on \S*CertCommonName\((?P<name>[^)]*)\)\S*)?"
DENIAL = re.compile(NAMED + r" is unauthorized to (?P<what>[\w/ ]+) \((?P<flow>\w+)\) on (?P<key>\S+)")
NOT_LET_IN = "zenoh_link_tls::unicast: "
KEPT_OUT = "Msg intercepted!"
WORTH_READING = (KEPT_OUT.encode(), b"unauthorized to", b"WARN", b"ERROR")
MOST_KEPT = 100
MOST_NAMES = 1_000
LONGEST = 200


class Refusals:
    """Tells from Zenoh's log what was refused; `now_ns` is the clock of the moderation (ns since 1970)."""

    def __init__(self, now_ns: Callable[[], int] = WALL_NS) -> None:
        self._now_ns = now_ns
        self._news: deque[str] = deque(maxlen=MOST_KEPT)
        self._moderation = Moderation()
        self._denials: dict[str, str] = {}
        self._names: dict[str, str] = {}

    def listen(self) -> Self:
        """Read the log from now on: to be done once, before the bus is opened, by a process with no other output."""
        pipe, output = os.pipe()
        sys.stdout.flush()
        os.dup2(output, 1)
        os.close(output)
        threading.Thread(target=self._read, args=(pipe,), name="zenoh-log", daemon=True).start()
        zenoh.init_log_from_env_or(LEVELS)
        return self

    def take(self) -> list[str]:
        """What was refused since the last call; all of it went to standard error as well."""
        return [self._news.popleft() for _ in range(len(self._news))]

    def _read(self, pipe: int) -> None:
        rest = b""
        while block := os.read(pipe, 1 << 16):
            whole, _, rest = (rest + block).rpartition(b"\n")
            self.hear(whole)

    def hear(self, lines: bytes) -> None:
        """Take whole lines of the log, or none; then say how many were left unsaid, once their second is over."""
        # Nearly all of it says that something is in order: passed over without looking at each line.
        if any(mark in lines for mark in WORTH_READING):
            for line in ANSI.sub(b"", lines).decode(errors="replace").splitlines():
                self._line(line)
        self._say_rest()

    def _line(self, line: str) -> None:
        """One line; a denial counts only when the message was kept out: Zenoh also tries what it might deny."""
        match = LINE.match(line)
        if match is None:
            return
        thread, text = match["thread"], match["text"]
        if denial := DENIAL.search(text):
            who = self._name(denial["session"], denial["name"])
            if denial["flow"] == "ingress":
                self._denials[thread] = f"{who} may not {denial['what'].lower()} {denial['key']}"
        elif KEPT_OUT in text:
            if reason := self._denials.pop(thread, ""):
                self._say(f"refused: {reason}")
        elif match["level"] in ("WARN", "ERROR"):
            text = text.replace(" Hint: increase the system open file limit.", "")
            self._say(text.replace(NOT_LET_IN, "refused: a connection, "))

    def _name(self, session: str, name: str | None) -> str:
        """The name in the certificate of a session, as Zenoh said it before; it does not always."""
        if name is not None:
            if len(self._names) >= MOST_NAMES:
                self._names.clear()
            self._names[session] = name
        return self._names.get(session, session)

    def _say(self, text: str) -> None:
        # A key is the sender's to choose: it must not write on the terminal what it likes.
        text = "".join(letter if letter.isprintable() else "?" for letter in text[:LONGEST])
        if self._moderation.allows(self._now_ns()):
            self._news.append(f"bus: {text}")
            say(f"bus: {text}")

    def _say_rest(self) -> None:
        if unsaid := self._moderation.unsaid(self._now_ns()):
            say(f"bus: {unsaid} more of these")
