"""Node and recorder as child processes in lockstep with a simulation: time moves only when both have answered.

At every tick the simulation sends the node a Control message and waits for the answer, so that no message is lost at
any speed, and a run does not depend on the speed of the machine.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.reader import make_reader

from das.advice.regimes import Regime
from das.bus import codec
from das.bus.access import BusFolder, Role
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, CONTROLS, RECORDER, RESTRICTION, STATUS, TARGET, Topic
from das.cab.heard import Heard, JourneyHeard
from das.cab.outputs import NodeState
from das.command_line.process import EXIT_INTERRUPTED, interrupted_by_termination
from das.domain.errors import DasError
from sim.recording.opening import NODE_ARGUMENTS

STOP_TIMEOUT_S = 30.0
"""Time (s) after SIGTERM at which a child process that has not ended is killed."""
PARENT_LOOK_S = 0.5
"""Interval (s) at which a process checks whether its parent is still running."""


class Process:
    """A child process that runs one of our modules; a context manager. Errors quote its output, written to a file.

    `given` are environment variables in addition to ours; `door` is a file descriptor to inherit (−1: none).
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        *,
        given: Mapping[str, str] | None = None,
        door: int = -1,
    ) -> None:
        self.name = name
        self._log = tempfile.NamedTemporaryFile(prefix=f"{name}-", suffix=".log", delete=False)  # noqa: SIM115
        # A separate session: only the parent receives Ctrl-C, and stops the children in order.
        self._child = subprocess.Popen(
            [sys.executable, "-m", module, "--with-parent", str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, **(given or {})},
            pass_fds=() if door < 0 else (door,),
        )

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._log.close()
        Path(self._log.name).unlink(missing_ok=True)

    def check(self) -> None:
        """Raise DasError with the last line that the process printed, if the process has ended."""
        code = self._child.poll()
        if code is not None:
            if code < 0:
                raise DasError(f"the {self.name} was killed by {signal.Signals(-code).name}")
            raise DasError(f"the {self.name} ended: {self._last_words()}")

    def kill(self) -> None:
        """End the process with SIGKILL, as a crash would."""
        self._child.kill()
        self._child.wait()

    def stop(self) -> int:
        """End the process with SIGTERM, after `STOP_TIMEOUT_S` with SIGKILL; returns its exit code."""
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGTERM)
            try:
                self._child.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
        return self._child.wait()

    def finish(self) -> None:
        """End the process with SIGTERM; raise DasError with the last line it printed if its exit code is not 0."""
        if self.stop() != 0:
            self.check()

    def _last_words(self) -> str:
        lines = Path(self._log.name).read_text(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "it printed nothing"


def run_child(do: Callable[[], object]) -> None:
    """Do the work of a process that `Process` started; its parent reads the reason of an error as its last words.

    The process ends as by SIGTERM when its parent ends.
    """
    _end_with_parent()
    try:
        with interrupted_by_termination():
            do()
    except DasError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


def _end_with_parent() -> None:
    parent = int(sys.argv[sys.argv.index("--with-parent") + 1])  # passed, because the parent may have ended already

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_LOOK_S)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@dataclass(frozen=True, kw_only=True)
class Processes:
    """The settings for starting node and recorder of a run.

    `driver_at` is the endpoint at which an external driver finds the simulator; None without an external driver. With a
    bus folder the endpoint is in the bus file, and any text in `driver_at` stands for an external driver.
    `recorder_at` is the recorder's endpoint (None: a free port), for a driver that also sends messages only for the
    recording. With `paced` the simulation keeps a pace and does not wait for answers.
    """

    train: str
    node_arguments: tuple[str, ...]
    out: Path
    metadata: dict[str, str]
    start_ns: int
    attachments: tuple[Path, ...] = ()
    bus: BusFolder | None = None
    driver_at: str | None = None
    recorder_at: str | None = None
    paced: bool = False


def location(time_ns: int, latitude_deg: float, longitude_deg: float) -> LocationFix:
    """The message on the position of the train on the map."""
    fix = LocationFix(latitude=latitude_deg, longitude=longitude_deg, frame_id="train")
    fix.timestamp.FromNanoseconds(time_ns)
    return fix


def happened(time_ns: int, text: str, level: Any = Log.INFO) -> Log:
    """The log message on an event, with a `text` for people."""
    log = Log(level=level, message=text, name="das-sim")
    log.timestamp.FromNanoseconds(time_ns)
    return log


class Written(NamedTuple):
    """The ticks of the last Control and the last advice that the recorder wrote, and the node's last written state."""

    tick: int = 0
    advice_tick: int = 0
    node_state: int = NodeState.STARTING


class Answers:
    """The latest messages of node, recorder and external driver."""

    def __init__(self) -> None:
        self.node_state: int = NodeState.STARTING
        """The state that the node reported last."""
        self.reason = ""
        """The node's reason for its state."""
        self.written = Written()
        """The messages that the recorder has written so far."""
        self.advice: Any | None = None
        """The last advice (the bus's message); None before the first."""
        self.controls: Any | None = None
        """The external driver's latest answer (the bus's message); None before the first."""
        self.driver = ""
        """Session of the external driver in control; while it is empty, the next session that answers takes control."""
        self.other_drivers = 0
        """Number of messages from other sessions that tried to drive as well; they were ignored."""

    def take(self, topic: Topic, message: Any | None, source: str = "") -> None:
        """Keep a message of a session (`source`); a message that could not be decoded (None) is ignored."""
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
        """Whether the node's latest advice answers this tick."""
        return self.advice is not None and self.advice.tick == tick

    def answered(self, look: int) -> bool:
        """Whether the external driver's latest answer belongs to this look."""
        return self.controls is not None and self.controls.look == look


START_TIMEOUT_S = 300.0
"""Longest wait (s) for the start: the node compiles the guide the first time on a machine, beside other processes."""
ANSWER_TIMEOUT_S = 10.0
"""Longest wait (s) for an answer of node or recorder once both have started."""
HEARD_EVERY_S = 0.2
"""Interval (s) at which the simulator checks that node and recorder still run while no message comes."""
RECORDER_WINDOW = 50
"""Number of ticks by which the recorder may lag before the simulation waits for it."""


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of ticks with advice given, withdrawn or not received, and with advice above the limit."""

    advised: int = 0
    withdrawn: int = 0
    unheard: int = 0
    above_limit: int = 0

    def plus(self, advice: Any | None) -> Counts:
        """The counts after one more tick with this advice (None: not received)."""
        if advice is None:
            return replace(self, unheard=self.unheard + 1)
        if advice.mode == Regime.NONE:
            return replace(self, withdrawn=self.withdrawn + 1)
        above = advice.advised_speed_mps > advice.limit_mps + 1e-6
        return replace(self, advised=self.advised + 1, above_limit=self.above_limit + int(above))


@dataclass(kw_only=True)
class Traffic:
    """Counts of a run over the bus: messages sent and recorded, by topic, and ticks with and without advice."""

    counts: Counts = Counts()
    start_s: float = 0.0
    """Time (s) that node and recorder took to start."""
    sent: Counter[str] = field(default_factory=Counter)
    recorded: Counter[str] = field(default_factory=Counter)

    @property
    def ticks(self) -> int:
        """Number of ticks that were answered."""
        return self.counts.advised + self.counts.withdrawn

    @property
    def lost(self) -> int:
        """Number of messages that were sent, or came as advice, but are not in the recording."""
        expected = {**self.sent, ADVICE.name: self.ticks}
        return sum(max(count - self.recorded[name], 0) for name, count in expected.items())

    def as_dict(self) -> dict[str, Any]:
        """Messages sent, recorded and lost, and the duration of the start (s), for programs."""
        return {
            "messages_sent": self.sent.total(),
            "messages_recorded": self.recorded.total(),
            "messages_lost": self.lost,
            "start_s": self.start_s,
        }


class Lockstep:
    """Node and recorder as processes on a separate bus; a context manager. Raises DasError if one fails."""

    def __init__(self, processes: Processes) -> None:
        self.processes, self.traffic, self.answers = processes, Traffic(), Answers()
        given = (processes.driver_at, processes.recorder_at, None)
        self._ports = [endpoint(free) if at is None else at for at, free in zip(given, free_ports(3), strict=True)]
        """The endpoints of simulator, recorder and node without a bus folder."""
        self._asked_tick = 0
        self._told_ns = {RESTRICTION.name: 0, TARGET.name: 0}

    def __enter__(self) -> Lockstep:
        with ExitStack() as stack:
            self._recorder = stack.enter_context(self._start_recorder())
            self._node = self._start_node()
            stack.callback(lambda: self._node.__exit__(None, None, None))
            self.bus = stack.enter_context(self._open_bus())
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _open_bus(self) -> Bus:
        """The simulator's own session, which receives the messages of node, recorder and an external driver."""
        driver = () if self.processes.driver_at is None else (CONTROLS,)
        hear, files = (ADVICE, STATUS, RECORDER, *driver), self.processes.bus
        if files is not None:
            return Bus(self.processes.train, hear=hear, file=files.file(Role.SIMULATOR))
        return Bus(self.processes.train, listen=self._ports[0], connect=self._ports[1:], hear=hear)

    def _start_recorder(self) -> Process:
        processes = self.processes
        metadata = {**processes.metadata, NODE_ARGUMENTS: json.dumps(processes.node_arguments, ensure_ascii=False)}
        arguments = [*self._place(1, Role.RECORDER), "--out", str(processes.out), "--overwrite"]
        arguments += ["--metadata", json.dumps(metadata), "--start-ns", str(processes.start_ns)]
        for path in processes.attachments:
            arguments += ["--attach", str(path)]
        return Process("recorder", "das.recorder", arguments)

    def _start_node(self) -> Process:
        arguments = [*self._place(2, Role.NODE), "--clock", "bus", *self.processes.node_arguments]
        return Process("node", "das.node", arguments)

    def _place(self, own: int, role: Role) -> Sequence[str]:
        """Arguments with the train, and a bus file or endpoints; the process listens on the port with index `own`."""
        if self.processes.bus is not None:
            return ["--train", self.processes.train, *self.processes.bus.file(role).arguments()]
        others = [port for i, port in enumerate(self._ports) if i != own]
        connect = [word for port in others for word in ("--connect", port)]
        return ["--train", self.processes.train, "--listen", self._ports[own], *connect]

    def begin(self, journey: JourneyHeard) -> None:
        """Wait until node and recorder have started, send the journey, and wait until the node has accepted it."""
        began, answers, waiting = time.perf_counter(), self.answers, (NodeState.WAITING, NodeState.READY)
        self._until(
            lambda: answers.node_state in waiting and answers.written.node_state in waiting,
            START_TIMEOUT_S,
            "node and recorder to start",
        )
        self.tell(journey)
        self._until_taken()
        self.traffic.start_s = time.perf_counter() - began

    def restart_node(self) -> None:
        """Kill the node, restart it, and wait until it has again accepted the journey, which the bus keeps.

        A run that keeps a pace does not wait: until the new node sends advice, there is none.
        """
        paced = self.processes.paced
        if not paced:
            # The kill must not lose messages, because the number lost would depend on the machine.
            self._until(self._all_written, ANSWER_TIMEOUT_S, "the recorder to write the last advice")
        self._node.kill()
        self._node.__exit__(None, None, None)
        self.answers.node_state = NodeState.STARTING
        self._node = self._start_node()
        if not paced:
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
        self.traffic.counts = self.traffic.counts.plus(answers.advice)
        return answers.advice

    def request(self, now_ns: int, tick: int) -> None:
        """Ask the node for the advice of a tick without waiting; `newest` returns the advice when it has come."""
        self._asked_tick = tick
        self._ask(now_ns, tick)

    def newest(self) -> Any | None:
        """The newest advice received since the last call; None without any."""
        advice, self.answers.advice = self.answers.advice, None
        if advice is not None:
            self.traffic.counts = self.traffic.counts.plus(advice)
        return advice

    def finish(self, now_ns: int) -> None:
        """End the run for node and recorder: wait until everything is written, and stop both."""
        if not self.hear(self._all_written, ANSWER_TIMEOUT_S) and not self.processes.paced:
            raise DasError(f"waited {ANSWER_TIMEOUT_S:.0f} s for the recorder to write the last tick")
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
        """Send a Control message that names the restrictions and targets to be received before the answer."""
        told = {"restrictions_ns": self._told_ns[RESTRICTION.name], "targets_ns": self._told_ns[TARGET.name]}
        self.send(*codec.control(now_ns, tick, **told, finish=finish))

    def _all_written(self) -> bool:
        written = self.answers.written
        return written.tick >= self._asked_tick and written.advice_tick >= self._asked_tick

    def _until_taken(self) -> None:
        answers, ready, refused = self.answers, NodeState.READY, NodeState.WITHDRAWN
        self._until(
            lambda: answers.node_state == refused or answers.node_state == answers.written.node_state == ready,
            START_TIMEOUT_S,
            "the node to take the journey",
        )
        if answers.node_state == refused:
            raise DasError(f"the node: {answers.reason}")

    def hear(self, done: Callable[[], bool], timeout_s: float, *, watch_node: bool = True) -> bool:
        """Receive messages until a condition holds; False after the timeout, DasError if a process has ended."""
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
        if not self.hear(done, timeout_s, watch_node=watch_node):
            raise DasError(f"waited {timeout_s:.0f} s for {what}")


def sleep_until(moment: float) -> None:
    """Sleep until a moment of time.perf_counter, in short steps so that Ctrl-C can end the wait."""
    while (left := moment - time.perf_counter()) > 0:
        time.sleep(min(left, 0.2))


def recorded_counts(path: Path) -> Counter[str]:
    """Number of messages in a finished recording by topic name."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    counts: Counter[str] = Counter()
    if summary is not None and summary.statistics is not None:
        for channel, count in summary.statistics.channel_message_counts.items():
            counts[summary.channels[channel].topic.rpartition("/")[2]] += count
    return counts
