"""The node's loop: when to look for messages, and when to advise."""

from __future__ import annotations

import contextlib
import ctypes
import sys
import time
from dataclasses import dataclass

from das.bus.refusals import Refusals
from das.cab.outputs import NodeState
from das.command_line.running import StopFlag
from das.node.node import Node


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """How often the loop looks up."""

    look_s: float = 0.1
    """The loop looks up at least this often."""
    search_look_s: float = 0.005
    """The loop looks up this often while a front is being looked for."""
    least_gap_s: float = 0.05
    """However fast the world changes, advice out of turn comes no faster than this."""
    waiting_said_every_s: float = 1.0
    """A node that waits for a journey by the clock of the bus says so this often."""


DEFAULT = LoopSettings()
SWITCH_S = 0.0005
"""The thread that looks for a front hands over to the one that advises so often."""
M_MMAP_THRESHOLD, MAPPED_FROM_BYTES = -3, 1_000_000
"""Of glibc's mallopt: blocks from this size on are mapped, and unmapped when freed."""


def run(
    node: Node, stop: StopFlag, refusals: Refusals | None, period_s: float, settings: LoopSettings = DEFAULT
) -> None:
    """Answer until told to stop. By the wall clock advice comes once a period, and when the world changes."""
    due, last, said = time.monotonic() + period_s, 0.0, 0.0
    by_wall = node.clock.is_wall
    while not stop.stopped and not node.finished:
        longest_s = settings.search_look_s if node.cab.urgent or node.cab.searching else settings.look_s
        wait_s = min(max(due - time.monotonic(), 0.0), longest_s) if by_wall else settings.look_s
        received = node.bus.receive(wait_s, skip_outdated=True)
        node.look_around()
        if received is not None:
            node.take(received)
        for text in refusals.take() if refusals else ():
            node.event(text)
        now = time.monotonic()
        if by_wall and (now >= due or (node.cab.urgent and now - last >= settings.least_gap_s)):
            node.tick(node.clock.now_ns())
            last = now
            if now >= due:
                due = max(due + period_s, now)
        elif not by_wall and not node.cab.has_journey and now - said > settings.waiting_said_every_s:
            node.status(NodeState.WAITING, "waiting for a journey")
            said = now


def prepare_process() -> None:
    """Let freed fronts leave the process, and let its threads take turns more often than Python does by itself."""
    sys.setswitchinterval(SWITCH_S)
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # Another C library may have no mallopt.
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED_FROM_BYTES)
