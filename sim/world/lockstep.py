"""Node and recorder in lockstep with a simulation: time only moves when both have answered.

Every tick the node is asked (Control) and its answer awaited, so nothing is lost at any speed and a run does not
depend on how fast the machine is.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.reader import make_reader

from das.advice.regimes import Regime
from das.bus import codec
from das.bus.config import BusFolder
from das.bus.roles import Role
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, CONTROLS, RECORDER, RESTRICTION, STATUS, TARGET, Topic
from das.cab.heard import Heard, JourneyHeard
from das.cab.outputs import NodeState
from das.domain.errors import DasError
from sim.recording.opening import NODE_ARGUMENTS

STOP_TIMEOUT_S = 30.0


class Process:
    """A child process running a module of ours; use with `with`. Its words go to a file and into errors."""

    def __init__(self, name: str, module: str, arguments: Sequence[str]) -> None:
        self.name = name
        self._log = tempfile.NamedTemporaryFile(prefix=f"{name}-", suffix=".log", delete=False)  # noqa: SIM115
        # A session of its own: Ctrl-C comes to us alone, and we stop the children in order.
        self._child = subprocess.Popen(
            [sys.executable, "-m", module, "--with-parent", str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        self._log.close()
        Path(self._log.name).unlink(missing_ok=True)

    def check(self) -> None:
        """Raise DasError with its last words if the process has ended."""
        code = self._child.poll()
        if code is not None:
            if code < 0:
                raise DasError(f"the {self.name} was killed by {signal.Signals(-code).name}")
            raise DasError(f"the {self.name} ended: {self._last_words()}")

    def kill(self) -> None:
        """End it with SIGKILL, as a crash would."""
        self._child.kill()
        self._child.wait()

    def stop(self) -> int:
        """End it with SIGTERM, after a while with SIGKILL; returns its exit code."""
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGTERM)
            try:
                self._child.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
        return self._child.wait()

    def finish(self) -> None:
        """End it with SIGTERM; raise DasError with its last words if it did not end well."""
        if self.stop() != 0:
            self.check()

    def _last_words(self) -> str:
        lines = Path(self._log.name).read_text(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "it said nothing"


@dataclass(frozen=True, kw_only=True)
class Processes:
    """How node and recorder of a run are started.

    `driver_at` is the endpoint where an external driver finds the simulator; None where there is no such driver. With a
    bus folder the bus file says where, and any text will do.
    """

    train: str
    node_arguments: tuple[str, ...]
    out: Path
    metadata: dict[str, str]
    start_ns: int
    attachments: tuple[Path, ...] = ()
    bus: BusFolder | None = None
    driver_at: str | None = None


class Stations:
    """The places on the bus of simulator, node and recorder: free ports of this machine, or those of a bus folder."""

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._ports = [endpoint(port) for port in free_ports(3)]
        if processes.driver_at is not None:
            self._ports[0] = processes.driver_at

    def open_bus(self) -> Bus:
        """Open the simulator's own session, which hears what node, recorder and an external driver say."""
        driver = () if self._processes.driver_at is None else (CONTROLS,)
        hear, files = (ADVICE, STATUS, RECORDER, *driver), self._processes.bus
        if files is not None:
            return Bus(self._processes.train, hear=hear, file=files.file(Role.SIMULATOR))
        return Bus(self._processes.train, listen=self._ports[0], connect=self._ports[1:], hear=hear)

    def start_recorder(self) -> Process:
        """Start the recorder of the run."""
        processes = self._processes
        arguments = [
            *self._place(1, Role.RECORDER),
            "--out",
            str(processes.out),
            "--overwrite",
            "--metadata",
            json.dumps({**processes.metadata, NODE_ARGUMENTS: json.dumps(processes.node_arguments)}),
        ]
        arguments += ["--start-ns", str(processes.start_ns)]
        for path in processes.attachments:
            arguments += ["--attach", str(path)]
        return Process("recorder", "das.recorder", arguments)

    def start_node(self) -> Process:
        """Start a node that goes by the simulation's clock."""
        return Process(
            "node", "das.node", [*self._place(2, Role.NODE), "--clock", "bus", *self._processes.node_arguments]
        )

    def _place(self, own: int, role: Role) -> Sequence[str]:
        """Train and endpoints of the process that listens on port `own`, or its role's bus file."""
        if self._processes.bus is not None:
            return ["--train", self._processes.train, *self._processes.bus.file(role).arguments()]
        others = [port for i, port in enumerate(self._ports) if i != own]
        connect = [word for port in others for word in ("--connect", port)]
        return ["--train", self._processes.train, "--listen", self._ports[own], *connect]


def location(time_ns: int, latitude_deg: float, longitude_deg: float) -> LocationFix:
    """A place of the train on the map."""
    fix = LocationFix(latitude=latitude_deg, longitude=longitude_deg, frame_id="train")
    fix.timestamp.FromNanoseconds(time_ns)
    return fix


def happened(time_ns: int, text: str, level: Any = Log.INFO) -> Log:
    """A message for people to read, about something that happened."""
    log = Log(level=level, message=text, name="das-sim")
    log.timestamp.FromNanoseconds(time_ns)
    return log


class Written(NamedTuple):
    """How far the recorder has got: the last tick and the last advice it wrote, and the node's state in the file."""

    tick: int = 0
    advice_tick: int = 0
    node_state: int = NodeState.STARTING


class Answers:
    """Keeps the latest message of node, recorder and external driver."""

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
        """The external driver's latest answer (the bus's message); None before the first."""
        self.driver = ""
        """Session of the external driver in control: the first one heard. If empty, the next one takes control."""
        self.other_drivers = 0
        """How many messages were ignored because they came from other sessions that tried to drive as well."""

    def take(self, topic: Topic, message: Any | None, source: str = "") -> None:
        """Take note of a message of a session (`source`). A message that could not be read is None and is ignored."""
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


START_TIMEOUT_S = 120.0
"""Longest wait (s) for the start: the node compiles its solver the first time on a machine."""
ANSWER_TIMEOUT_S = 10.0
HEARD_EVERY_S = 0.2
"""While no message comes, the processes of node and recorder are checked at this interval (s)."""
RECORDER_WINDOW = 50
"""The recorder may be this many ticks behind before the simulation waits for it."""


@dataclass(kw_only=True)
class Traffic:
    """Counts of a run: messages sent and recorded by topic; advices given, withdrawn, and above the limit."""

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

    def __init__(self, processes: Processes) -> None:
        self.processes, self.traffic = processes, Traffic()
        self._stations, self.answers = Stations(processes), Answers()
        self._stack = ExitStack()
        self._asked_tick = 0
        self._told_ns = {RESTRICTION.name: 0, TARGET.name: 0}

    def __enter__(self) -> Lockstep:
        try:
            self._recorder = self._stack.enter_context(self._stations.start_recorder())
            self._node = self._stations.start_node()
            self._stack.callback(lambda: self._node.__exit__(None, None, None))
            self.bus = self._stack.enter_context(self._stations.open_bus())
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def begin(self, journey: JourneyHeard) -> None:
        """Wait until node and recorder have started and the node has accepted the journey."""
        began = time.perf_counter()
        answers, waiting = self.answers, (NodeState.WAITING, NodeState.READY)
        self._until(
            lambda: answers.node_state in waiting and answers.written.node_state in waiting,
            START_TIMEOUT_S,
            "node and recorder to start",
        )
        self.tell(journey)
        self._until_taken()
        self.traffic.start_s = time.perf_counter() - began

    def restart_node(self) -> None:
        """Kill the node, start it anew, and wait until it has the journey again, which the bus keeps."""
        # No message of the node may be lost by the kill: how many got through would depend on the machine.
        self._until(self._all_written, ANSWER_TIMEOUT_S, "the recorder to write the last advice")
        self._node.kill()
        self._node.__exit__(None, None, None)
        self.answers.node_state = NodeState.STARTING
        self._node = self._stations.start_node()
        self._until_taken()

    def tell(self, value: Heard) -> None:
        """Send the node one of its inputs."""
        self.send(*codec.encode_input(value))

    def send(self, topic: Topic, message: Message) -> None:
        """Publish a message and count it."""
        self.bus.publish(topic, message)
        self.traffic.sent[topic.name] += 1
        if topic.name in self._told_ns:
            self._told_ns[topic.name] = message.time_ns  # type: ignore[attr-defined]

    def ask(self, now_ns: int, tick: int) -> Any:
        """The node's advice for a tick."""
        answers, self._asked_tick = self.answers, tick
        answers.advice = None
        self._ask(now_ns, tick)
        self._until(lambda: answers.advised(tick), ANSWER_TIMEOUT_S, f"the node's advice for second {tick}")
        self._until(lambda: tick - answers.written.tick <= RECORDER_WINDOW, ANSWER_TIMEOUT_S, "the recorder to keep up")
        self._count(answers.advice)
        return answers.advice

    def finish(self, now_ns: int) -> None:
        """Tell node and recorder that the run is over, wait until everything is written, and stop both."""
        self._until(self._all_written, ANSWER_TIMEOUT_S, "the recorder to write the last tick")
        answers, last = self.answers, self._asked_tick + 1
        self._ask(now_ns, last, finish=True)
        self._until(
            lambda: answers.written.tick == last and answers.written.node_state == NodeState.STOPPING,
            ANSWER_TIMEOUT_S,
            "the recorder to finish",
            watch_node=False,
        )
        self._node.stop()
        self._recorder.finish()
        self.traffic.recorded = recorded_counts(self.processes.out)

    def _ask(self, now_ns: int, tick: int, *, finish: bool = False) -> None:
        """Send a Control message.

        The node answers only when it has heard the restrictions and targets sent before, which travel separately.
        """
        asked = codec.control(
            now_ns,
            tick,
            restrictions_ns=self._told_ns[RESTRICTION.name],
            targets_ns=self._told_ns[TARGET.name],
            finish=finish,
        )
        self.send(*asked)

    def _all_written(self) -> bool:
        written = self.answers.written
        return written.tick >= self._asked_tick and written.advice_tick >= self._asked_tick

    def _until_taken(self) -> None:
        """Wait until the node is ready and the recorder has written that it is."""
        answers, ready, refused = self.answers, NodeState.READY, NodeState.WITHDRAWN
        self._until(
            lambda: answers.node_state == refused or answers.node_state == answers.written.node_state == ready,
            START_TIMEOUT_S,
            "the node to take the journey",
        )
        if answers.node_state == refused:
            raise DasError(f"the node: {answers.reason}")

    def _count(self, advice: Any) -> None:
        self.traffic.ticks += 1
        if advice.mode == Regime.NONE:
            self.traffic.advices_withdrawn += 1
            return
        self.traffic.advices_given += 1
        self.traffic.above_limit += advice.advised_speed_mps > advice.limit_mps + 1e-6

    def hear(self, done: Callable[[], bool], timeout_s: float, *, watch_node: bool = True) -> bool:
        """Take messages until a condition holds; returns whether it does, DasError when a process ended."""
        deadline = time.monotonic() + timeout_s
        while not done():
            received = self.bus.receive(min(max(deadline - time.monotonic(), 0.0), HEARD_EVERY_S))
            if received is not None:
                self.answers.take(received.topic, received.message, received.source)
                continue
            if watch_node:
                self._node.check()
            self._recorder.check()
            if time.monotonic() >= deadline:
                return False
        return True

    def _until(self, done: Callable[[], bool], timeout_s: float, what: str, *, watch_node: bool = True) -> None:
        """Take messages until a condition holds; DasError when a process ended or it takes too long."""
        if not self.hear(done, timeout_s, watch_node=watch_node):
            raise DasError(f"waited {timeout_s:.0f} s for {what}")


def sleep_until(moment: float) -> None:
    """Sleep until a moment of time.perf_counter, in short steps so that Ctrl-C can end it."""
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
