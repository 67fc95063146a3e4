"""Lets a cab hear what was recorded, in the order of the recording, and keeps what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from das.bus import codec
from das.bus.contents import RecordedMessage
from das.bus.received import Received
from das.bus.recording import Stamped
from das.bus.topics import ADVICE, CONTROL, EFFORT, JOURNEY, RESTRICTION, STATUS, TARGET, Topic
from das.cab.cab import Cab
from das.cab.outputs import NodeState, Output
from sim.recording.check import restarts_of

STATES = (JOURNEY, RESTRICTION, TARGET)
"""What the bus keeps for a node that is started anew."""
HeardAgain = Callable[[float, float], None]
"""Called with how many messages are heard and how many there are."""


class Said(NamedTuple):
    """Something that a node said: on which topic, the message, and in the how-many-th tick (from 1)."""

    topic: Topic
    message: Any
    tick: int


@dataclass
class Rehearing:
    """A cab that hears a recording again. `make` gives a new cab, as whenever the node was started anew."""

    make: Callable[[], Cab]
    by_bus_clock: bool
    calibrates: bool
    said: list[Said] = field(default_factory=list)
    _ticks: int = 0
    _judged_ns: int = 0

    def run(self, messages: Sequence[RecordedMessage], progress: HeardAgain) -> list[Said]:
        """Hear all messages of one train in the order of the file; returns what the cab said."""
        for i, _ in enumerate(self.steps(messages), start=1):
            progress(i, len(messages))
        return self.said

    def steps(self, messages: Sequence[RecordedMessage]) -> Iterator[tuple[RecordedMessage, Sequence[Said]]]:
        """Hear the messages of one train one by one: each message, and what the cab said upon it."""
        self._cab = self.make()
        self._kept: dict[str, RecordedMessage] = {}
        self._waiting = _announced(messages) if self.by_bus_clock else {}
        starts = _starts(messages)
        waits = {id(one) for several in self._waiting.values() for one in several}
        try:
            for i, one in enumerate(messages):
                before = len(self.said)
                if i in starts:
                    self._start_anew()
                if one.topic is CONTROL and self.by_bus_clock:
                    self._answer(one.message)
                elif one.topic is ADVICE and not self.by_bus_clock:
                    self._tick(one.message.time_ns, one.message.tick)
                elif id(one) not in waits:
                    self._hear(one)
                yield one, self.said[before:]
        finally:
            self._cab.close()

    def _start_anew(self) -> None:
        """The node was started anew: a cab that has heard nothing but what the bus keeps."""
        self._cab.close()
        self._cab = self.make()
        self._judged_ns = 0
        for one in list(self._kept.values()):
            self._hear(one)

    def _hear(self, one: RecordedMessage) -> None:
        if one.topic is EFFORT and not self.calibrates:  # such a node does not listen to it
            return
        if one.topic in STATES:
            self._kept[one.topic.name] = one
        now_ns = self._judged_ns if self.by_bus_clock else one.log_time_ns
        heard = codec.heard(Received(one.topic, one.topic.key(one.train), one.message), now_ns)
        if heard is not None:
            self._keep(self._cab.hear(heard), 0)

    def _answer(self, control: Any) -> None:
        """Answer a simulation as the node does: first hear the states that were sent before it was asked."""
        if codec.finishes(control):
            return
        for name, wanted_ns in _wanted(control).items():
            waiting = self._waiting.get(name, [])
            while waiting and waiting[0].message.time_ns <= wanted_ns:
                self._hear(waiting.pop(0))
        self._tick(control.time_ns, control.tick)

    def _tick(self, now_ns: int, tick: int) -> None:
        self._judged_ns = now_ns
        outputs = self._cab.tick(now_ns)
        self._ticks += 1
        self._keep(outputs, tick)

    def _keep(self, outputs: Sequence[Output], tick: int) -> None:
        for output in outputs:
            topic, message = codec.said(output, tick)
            self.said.append(Said(topic, message, self._ticks))


def _wanted(control: Any) -> dict[str, int]:
    """The times (ns) of the restrictions and targets that a node must have heard before it answers."""
    return {RESTRICTION.name: control.restrictions_ns, TARGET.name: control.targets_ns}


def _announced(messages: Sequence[RecordedMessage]) -> dict[str, list[RecordedMessage]]:
    """Restrictions and targets by topic that a Control message names, in the order of their times.

    States come to the recorder on ways of their own, so that it may have written them some ticks too early or too
    late. When the node heard them is known from the Control messages.
    """
    latest = {RESTRICTION.name: 0, TARGET.name: 0}
    for one in messages:
        if one.topic is CONTROL:
            for name, wanted_ns in _wanted(one.message).items():
                latest[name] = max(latest[name], wanted_ns)
    return {
        name: sorted(
            (one for one in messages if one.topic.name == name and one.message.time_ns <= wanted_ns),
            key=lambda one: int(one.message.time_ns),
        )
        for name, wanted_ns in latest.items()
    }


def _starts(messages: Sequence[RecordedMessage]) -> set[int]:
    """Places of the first status of every node that was started anew."""
    places = [i for i, one in enumerate(messages) if one.topic is STATUS]
    found = restarts_of([Stamped(messages[i].log_time_ns, messages[i].message) for i in places])
    return {places[i] for i in found}


OF_THE_PROCESS = (NodeState.STARTING, NodeState.STOPPING)
"""States that the process says, not the cab."""


def recorded_words(messages: Sequence[RecordedMessage], topics: Sequence[Topic]) -> list[Said]:
    """What the node said in a recording, without what its process said beside the cab."""
    said, ticks = [], 0
    for one in messages:
        if one.topic not in topics or (one.topic is STATUS and of_the_process(one.message)):
            continue
        if one.topic is ADVICE:
            ticks += 1
        said.append(Said(one.topic, one.message, ticks if one.topic is ADVICE else ticks + 1))
    return said


def of_the_process(status: Any) -> bool:
    """Whether a status was said by the process around the cab: while it starts, waits for a journey, or stops."""
    waits = status.state == NodeState.WAITING and status.reason == "waiting for a journey" and not status.advices
    return waits or status.state in OF_THE_PROCESS
