"""The node: wiring between the bus, a clock and the cab. Every decision is the cab's."""

from __future__ import annotations

from collections.abc import Iterable

from das.bus import codec
from das.bus.session import Bus
from das.bus.topics import STATUS, Received
from das.cab.cab import Cab
from das.cab.heard import ClockSet, Kind, NodeSeen, PublisherSeen
from das.cab.outputs import Event, NodeState, Output, Severity, Status
from das.command_line.printing import say
from das.node.clock import Clock

CAUGHT_UP = 1_000
"""At most so many messages are taken at the start, before a section is prepared."""


class Node:
    """Hands what the bus carries to the cab, and what the cab says to the bus."""

    def __init__(self, bus: Bus, cab: Cab, clock: Clock) -> None:
        self.bus, self.cab, self.clock = bus, cab, clock
        self.finished = False
        """Whether the run is over, as a simulation says."""

    def take(self, received: Received) -> None:
        """Let the cab hear one message; answer the simulation's clock where it asks."""
        self.look_around()
        heard = codec.heard(received, self.clock.judged_at_ns())
        if heard is not None:
            self.publish(self.cab.hear(heard))
        self.clock.note(received)
        control = self.clock.due()
        if control is None:
            return
        if codec.finishes(control):
            self.finished = True
        else:
            self.tick(control.time_ns, control.tick)

    def look_around(self) -> None:
        """Take note of a clock that was set, and of publishers (also other nodes of this train) that came or went."""
        now_ns = self.clock.judged_at_ns()
        if step_s := self.clock.set_by_s():
            self.publish(self.cab.hear(ClockSet(step_s=step_s, heard_ns=now_ns)))
        for one in self.bus.presences():
            if one.topic is STATUS:
                self.publish(self.cab.hear(NodeSeen(source=one.source, there=one.there)))
                continue
            seen = PublisherSeen(kind=Kind(one.topic.name), source=one.source, there=one.there, heard_ns=now_ns)
            self.publish(self.cab.hear(seen))

    def catch_up(self) -> None:
        """Take what is already there: a node that was started anew has its journey on the bus."""
        for _ in range(CAUGHT_UP):
            received = self.bus.receive(0.0, skip_outdated=True)
            if received is None:
                return
            self.take(received)

    def tick(self, now_ns: int, tick: int = 0) -> None:
        """Advise once; what no message can carry (a time beyond the end of the clock) is withdrawn as a fault."""
        outputs = self.cab.tick(now_ns, dropped=self.bus.dropped)
        try:
            messages = [codec.said(output, tick) for output in outputs]
        except ValueError as error:
            outputs = self.cab.fail(now_ns, error)
            messages = [codec.said(output, tick) for output in outputs]
        self._publish(outputs, messages)

    def publish(self, outputs: Iterable[Output]) -> None:
        """Publish what the cab says."""
        said = list(outputs)
        self._publish(said, [codec.said(output) for output in said])

    def _publish(self, outputs: Iterable[Output], messages: Iterable[codec.Outgoing]) -> None:
        """Publish messages; with the wall clock, events go to standard error as well."""
        for output, message in zip(outputs, messages, strict=True):
            self.bus.publish(*message)
            if isinstance(output, Event) and self.clock.is_wall:
                say(f"{self.bus.train}: {output.text}")

    def status(self, state: NodeState, reason: str) -> None:
        """Publish how the process is, beside what the cab says."""
        self.publish([Status(time_ns=self.clock.now_ns(), state=state, reason=reason)])

    def event(self, text: str) -> None:
        """Publish a warning about the process, for people to read."""
        self.publish([Event(time_ns=self.clock.now_ns(), severity=Severity.WARNING, text=text)])
