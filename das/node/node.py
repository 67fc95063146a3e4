"""The node connects the bus, a clock (wall or simulation) and the cab; the cab makes every decision."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from das.bus import codec
from das.bus.session import Bus
from das.bus.topics import CONTROL, JOURNEY, RESTRICTION, STATUS, TARGET, Received
from das.cab.cab import Cab
from das.cab.heard import Kind, NodeSeen, PublisherSeen
from das.cab.outputs import Event, NodeState, Output, Status
from das.command_line.printing import say
from das.domain.clocks import WALL, Clocks
from das.domain.units import NS

LEAST_STEP_S = 0.05
"""Smallest step (s) of the wall clock that counts as setting it; a smaller one may come from reading it."""


class WallClock:
    """Real time, or a clock that a test injects: the node advises at its own rate, without Control messages.

    Outgoing messages have the time `now_ns` (ns since 1970); incoming messages are checked by `judged_at_ns`.
    """

    is_wall = True

    def __init__(self, clocks: Clocks = WALL) -> None:
        self.now_ns = self.judged_at_ns = clocks.now_ns
        self._seconds = clocks.seconds
        self._began_s = self._ahead_s()

    def _ahead_s(self) -> float:
        """The time of day minus the monotonic seconds (s)."""
        return self.now_ns() * NS - self._seconds()

    def set_by_s(self) -> float:
        """The time (s) by which the clock was set since the last call, from a comparison with monotonic seconds."""
        step_s = self._ahead_s() - self._began_s
        if abs(step_s) < LEAST_STEP_S:
            return 0.0
        self._began_s += step_s
        return step_s

    def take(self, received: Received) -> None:
        """None: messages do not move this clock, and no Control message requests advice by it."""


class BusClock:
    """The clock of a replay or simulation: a Control message gives the time and requests one advice message.

    The node answers the Control message once it has received all restrictions and targets sent before it. The time of
    a journey is not used to judge messages, because it may be long past.
    """

    is_wall = False

    def __init__(self) -> None:
        self._now_ns = self._control_ns = 0
        self._heard_ns = {RESTRICTION.name: 0, TARGET.name: 0}
        self._held: Any | None = None

    def now_ns(self) -> int:
        """The last time received on the bus (ns since 1970; 0 before the first)."""
        return self._now_ns

    def judged_at_ns(self) -> int:
        """The time of the last Control message answered (ns since 1970; 0 before the first)."""
        return self._control_ns

    def set_by_s(self) -> float:
        """Zero, because the setting of a simulation's clock cannot be detected."""
        return 0.0

    def take(self, received: Received) -> Any | None:
        """The Control message that can be answered after this message, whose time becomes the clock's; None: none can.

        A Control message is held until it can be answered.
        """
        topic, message = received.topic, received.message
        if message is None:
            return None
        if topic is CONTROL:
            self._held = message
        elif topic is JOURNEY:
            self._now_ns = max(self._now_ns, message.time_ns)
        elif topic.name in self._heard_ns:
            self._heard_ns[topic.name] = max(self._heard_ns[topic.name], message.time_ns)
        control = self._held
        if control is None:
            return None
        wanted = {RESTRICTION.name: control.restrictions_ns, TARGET.name: control.targets_ns}
        if any(self._heard_ns[name] < time_ns for name, time_ns in wanted.items()):
            return None
        self._held = None
        self._now_ns = self._control_ns = control.time_ns
        return control


Clock = WallClock | BusClock
CAUGHT_UP = 1_000
"""Largest number of messages that are taken at the start, before a section is prepared."""


class Node:
    """Passes messages from the bus to the cab, and the outputs of the cab to the bus."""

    def __init__(self, bus: Bus, cab: Cab, clock: Clock) -> None:
        self.bus, self.cab, self.clock = bus, cab, clock
        self.finished = False
        """Whether the simulation has reported that it is over."""

    def take(self, received: Received) -> None:
        """Pass one message to the cab, and answer the Control message that is due, if any."""
        self.look_around()
        heard = codec.decode(received, self.clock.judged_at_ns())
        if heard is not None:
            self.publish(self.cab.hear(heard))
        control = self.clock.take(received)
        if control is None:
            return
        if codec.finishes(control):
            self.finished = True
        else:
            self.tick(control.time_ns, control.tick)

    def look_around(self) -> None:
        """Report to the cab that the clock was set, and which publishers (or other nodes of the train) came or went."""
        now_ns = self.clock.judged_at_ns()
        if step_s := self.clock.set_by_s():
            self.publish(self.cab.set_clock(step_s, now_ns))
        for one in self.bus.presences():
            if one.topic is STATUS:
                self.publish(self.cab.hear(NodeSeen(source=one.source, there=one.there)))
                continue
            seen = PublisherSeen(kind=Kind(one.topic.name), source=one.source, there=one.there, heard_ns=now_ns)
            self.publish(self.cab.hear(seen))

    def catch_up(self) -> None:
        """Take the messages that are already on the bus, such as the journey of a node that was restarted."""
        for _ in range(CAUGHT_UP):
            received = self.bus.receive(0.0, skip_outdated=True)
            if received is None:
                return
            self.take(received)

    def tick(self, now_ns: int, tick: int = 0) -> None:
        """Advise once; if an output does not fit into a message (its time is too large), the cab reports a fault."""
        outputs = self.cab.tick(now_ns, dropped=self.bus.dropped)
        try:
            self.publish(outputs, tick)
        except ValueError as error:
            self.publish(self.cab.fail(now_ns, error), tick)

    def publish(self, outputs: Iterable[Output], tick: int = 0) -> None:
        """Publish outputs of the cab; with the wall clock, also print events on standard error.

        Raises ValueError, before anything is published, for an output that does not fit into a message.
        """
        for output, message in [(one, codec.encode_output(one, tick)) for one in outputs]:
            self.bus.publish(*message)
            if isinstance(output, Event) and self.clock.is_wall:
                say(f"{self.bus.train}: {output.text}")

    def status(self, state: NodeState, reason: str) -> None:
        """Publish the state of the process, in addition to the outputs of the cab."""
        self.publish([Status(time_ns=self.clock.now_ns(), state=state, reason=reason)])
