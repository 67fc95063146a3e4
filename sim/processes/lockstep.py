"""Node and recorder in lockstep with a simulation: time only moves when both have answered.

Every tick the node is asked (Control) and its answer awaited, so nothing is lost at any speed and a run does not
depend on how fast the machine is.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from google.protobuf.message import Message
from mcap.reader import make_reader

from das.bus import codec, das_pb2
from das.bus.acl import Role
from das.bus.config import BusFolder
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, CONTROL, RECORDER, RESTRICTION, STATUS, TARGET, Topic
from das.cab.heard import JourneyHeard
from das.domain.errors import DasError
from sim.processes.process import Process

START_TIMEOUT_S = 120.0
"""The node compiles its solver the first time on a machine."""
ANSWER_TIMEOUT_S = 10.0
RECORDER_WINDOW = 50
"""The recorder may be this many ticks behind before the simulation waits for it."""


@dataclass(frozen=True, kw_only=True)
class Crew:
    """How node and recorder of a run are started."""

    train: str
    node_arguments: tuple[str, ...]
    out: Path
    metadata: dict[str, str]
    start_ns: int
    attachments: tuple[Path, ...] = ()
    bus: BusFolder | None = None


@dataclass(kw_only=True)
class Traffic:
    """Messages of a run: sent by topic, advices given and withdrawn, above the limit, and what the recording holds."""

    ticks: int = 0
    start_s: float = 0.0
    sent: Counter[str] = field(default_factory=Counter)
    recorded: Counter[str] = field(default_factory=Counter)
    advices_given: int = 0
    advices_withdrawn: int = 0
    above_limit: int = 0

    @property
    def lost(self) -> int:
        """Messages sent or answered that are not in the recording."""
        expected = {**self.sent, ADVICE.name: self.ticks}
        return sum(max(count - self.recorded[name], 0) for name, count in expected.items())


class Lockstep:
    """Node and recorder as processes on a bus of their own; use with `with`. Raises DasError where one fails."""

    def __init__(self, crew: Crew) -> None:
        self.crew, self.traffic = crew, Traffic()
        self._ports = [endpoint(port) for port in free_ports(3)]
        self._stack = ExitStack()
        self._node_state, self._reason = das_pb2.Status.STATE_STARTING, ""
        self._written = das_pb2.RecorderStatus()
        self._answered: Any | None = None
        self._asked_tick = 0
        self._told_ns = {RESTRICTION.name: 0, TARGET.name: 0}

    def __enter__(self) -> Lockstep:
        try:
            self._recorder = self._stack.enter_context(self._start_recorder())
            self._node = self._start_node()
            self._stack.callback(lambda: self._node.__exit__(None, None, None))
            self.bus = self._stack.enter_context(self._own_bus())
        except BaseException:
            self._stack.close()
            raise
        return self

    def _own_bus(self) -> Bus:
        hear, files = (ADVICE, STATUS, RECORDER), self.crew.bus
        if files is not None:
            return Bus(self.crew.train, hear=hear, file=files.file(Role.SIMULATOR))
        return Bus(self.crew.train, listen=self._ports[0], connect=self._ports[1:], hear=hear)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def begin(self, journey: JourneyHeard) -> None:
        """Wait for both, and until the node has taken the journey."""
        began = time.perf_counter()
        waiting = (das_pb2.Status.STATE_WAITING, das_pb2.Status.STATE_READY)
        self._until(
            lambda: self._node_state in waiting and self._written.node_state in waiting,
            START_TIMEOUT_S,
            "node and recorder to start",
        )
        self.send(*codec.told(journey))
        self._until_taken()
        self.traffic.start_s = time.perf_counter() - began

    def restart_node(self) -> None:
        """Kill the node, start it anew, and wait until it has the journey again (the bus keeps it for it)."""
        # What the node said so far must not be lost with it: how far that got would depend on the machine.
        self._until(self._all_written, ANSWER_TIMEOUT_S, "the recorder to write the last advice")
        self._node.kill()
        self._node.__exit__(None, None, None)
        self._node_state = das_pb2.Status.STATE_STARTING
        self._node = self._start_node()
        self._until_taken()

    def send(self, topic: Topic, message: Message) -> None:
        """Publish a message and count it."""
        self.bus.publish(topic, message)
        self.traffic.sent[topic.name] += 1
        if topic.name in self._told_ns:
            self._told_ns[topic.name] = message.time_ns  # type: ignore[attr-defined]

    def ask(self, now_ns: int, tick: int) -> Any:
        """The node's advice for a tick."""
        self._answered, self._asked_tick = None, tick
        self.send(CONTROL, self._control(now_ns, tick))
        self._until(
            lambda: self._answered is not None and self._answered.tick == tick,
            ANSWER_TIMEOUT_S,
            f"the node's advice for second {tick}",
        )
        self._until(lambda: tick - self._written.tick <= RECORDER_WINDOW, ANSWER_TIMEOUT_S, "the recorder to keep up")
        self._count(self._answered)
        return self._answered

    def finish(self, now_ns: int) -> None:
        """Tell both that the run is over, wait until everything is written, and stop them."""
        self._until(self._all_written, ANSWER_TIMEOUT_S, "the recorder to write the last tick")
        last = self._asked_tick + 1
        self.send(CONTROL, self._control(now_ns, last, das_pb2.Control.COMMAND_FINISH))
        stopping = das_pb2.Status.STATE_STOPPING
        self._until(
            lambda: self._written.tick == last and self._written.node_state == stopping,
            ANSWER_TIMEOUT_S,
            "the recorder to finish",
            watch_node=False,
        )
        self._node.stop()
        self._recorder.finish()
        self.traffic.recorded = recorded_counts(self.crew.out)

    def _control(
        self, now_ns: int, tick: int, command: das_pb2.Control.Command.ValueType = das_pb2.Control.COMMAND_TICK
    ) -> das_pb2.Control:
        """A tick; the node answers it when it has heard what was told before, which comes by a way of its own."""
        return das_pb2.Control(
            time_ns=now_ns,
            tick=tick,
            command=command,
            restrictions_ns=self._told_ns[RESTRICTION.name],
            targets_ns=self._told_ns[TARGET.name],
        )

    def _all_written(self) -> bool:
        return self._written.tick >= self._asked_tick and self._written.advice_tick >= self._asked_tick

    def _until_taken(self) -> None:
        """Until the node is ready, and the recorder has heard it say so."""
        ready, refused = das_pb2.Status.STATE_READY, das_pb2.Status.STATE_WITHDRAWN
        self._until(
            lambda: self._node_state == refused or self._node_state == self._written.node_state == ready,
            START_TIMEOUT_S,
            "the node to take the journey",
        )
        if self._node_state == refused:
            raise DasError(f"the node: {self._reason}")

    def _count(self, advice: Any) -> None:
        self.traffic.ticks += 1
        if advice.mode == das_pb2.MODE_NONE:
            self.traffic.advices_withdrawn += 1
            return
        self.traffic.advices_given += 1
        self.traffic.above_limit += advice.advised_speed_mps > advice.limit_mps + 1e-6

    def _until(self, done: Callable[[], bool], timeout_s: float, what: str, *, watch_node: bool = True) -> None:
        """Take messages until a condition holds; DasError when a process ended or it takes too long."""
        deadline = time.monotonic() + timeout_s
        while not done():
            received = self.bus.receive(0.2)
            if received is None:
                if watch_node:
                    self._node.check()
                self._recorder.check()
                if time.monotonic() > deadline:
                    raise DasError(f"waited {timeout_s:.0f} s for {what}")
                continue
            message = received.message
            if message is None:
                continue
            if received.topic is ADVICE:
                self._answered = message
            elif received.topic is STATUS:
                self._node_state, self._reason = message.state, message.reason
            elif received.topic is RECORDER:
                self._written = message

    def _start_recorder(self) -> Process:
        crew = self.crew
        arguments = [
            *self._place(1, Role.RECORDER),
            "--out",
            str(crew.out),
            "--overwrite",
            "--metadata",
            json.dumps(crew.metadata),
        ]
        arguments += ["--start-ns", str(crew.start_ns)]
        for path in crew.attachments:
            arguments += ["--attach", str(path)]
        return Process("recorder", "das.bus.recorder", arguments)

    def _start_node(self) -> Process:
        return Process("node", "das.node", [*self._place(2, Role.NODE), "--clock", "bus", *self.crew.node_arguments])

    def _place(self, own: int, role: Role) -> Sequence[str]:
        """Train and endpoints of the process that listens on port `own`, or its role's bus file."""
        if self.crew.bus is not None:
            return ["--train", self.crew.train, *self.crew.bus.file(role).arguments()]
        others = [port for i, port in enumerate(self._ports) if i != own]
        connect = [word for port in others for word in ("--connect", port)]
        return ["--train", self.crew.train, "--listen", self._ports[own], *connect]


def sleep_until(moment: float) -> None:
    """Sleep until a moment of time.perf_counter, in naps that Ctrl-C ends."""
    while (left := moment - time.perf_counter()) > 0:
        time.sleep(min(left, 0.2))


def recorded_counts(path: Path) -> Counter[str]:
    """Messages in a finished recording by topic name."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    counts: Counter[str] = Counter()
    if summary is not None and summary.statistics is not None:
        for channel, count in summary.statistics.channel_message_counts.items():
            counts[summary.channels[channel].topic.rpartition("/")[2]] += count
    return counts
