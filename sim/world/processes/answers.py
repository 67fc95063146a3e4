"""What node, recorder and an external driver said last."""

from __future__ import annotations

from typing import Any, NamedTuple

from das.bus.topics import ADVICE, CONTROLS, RECORDER, STATUS, Topic
from das.cab.outputs import NodeState


class Written(NamedTuple):
    """How far the recorder has got: the last tick and the last advice it wrote, and the node's state in the file."""

    tick: int = 0
    advice_tick: int = 0
    node_state: int = NodeState.STARTING


class Answers:
    """Keeps the last word of node, recorder and external driver."""

    def __init__(self) -> None:
        self.node_state: int = NodeState.STARTING
        """The state that the node said last."""
        self.reason = ""
        """Why the node is in that state, in its words."""
        self.written = Written()
        """How far the recorder has got."""
        self.advice: Any | None = None
        """The last advice (the bus's message); None before the first."""
        self.controls: Any | None = None
        """What an external driver answered last (the bus's message); None before it said anything."""
        self.driver = ""
        """The session of the external driver who is heeded: the first one heard; empty: whoever is heard next."""
        self.other_drivers = 0
        """How many messages of other sessions that would drive as well were left out."""

    def take(self, topic: Topic, message: Any | None, source: str = "") -> None:
        """Take note of a message of a session (`source`); None, one that cannot be read, is left out."""
        if message is None:
            return
        if topic is ADVICE:
            self.advice = message
        elif topic is CONTROLS:
            self._take_controls(message, source)
        elif topic is STATUS:
            self.node_state, self.reason = message.state, message.reason
        elif topic is RECORDER:
            self.written = Written(message.tick, message.advice_tick, message.node_state)

    def _take_controls(self, message: Any, source: str) -> None:
        self.driver = self.driver or source
        if source == self.driver:
            self.controls = message
        else:
            self.other_drivers += 1

    def advised(self, tick: int) -> bool:
        """Whether the node has answered a tick."""
        return self.advice is not None and self.advice.tick == tick

    def answered(self, look: int) -> bool:
        """Whether an external driver has answered a look."""
        return self.controls is not None and self.controls.look == look
