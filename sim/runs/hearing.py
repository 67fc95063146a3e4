"""Rebuilds the cab of a recording from the options of its node, and sends it the recorded messages again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from typer.exceptions import TyperException

from das.bus import codec, topics
from das.bus.contents import Contents, RecordedMessage
from das.bus.recording import Stamped
from das.bus.topics import ADVICE, CONTROL, EFFORT, JOURNEY, RESTRICTION, STATUS, TARGET, Received, Topic
from das.cab.cab import Cab
from das.cab.outputs import NodeState, Output
from das.command_line.application import single_command
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.node.options import AdviceGiven, ClockKind, LineServed, NodeOptions, NodePlace, TrainServed
from sim.recording.check import restarts_of
from sim.recording.inputs import AttachedFiles
from sim.recording.opening import NODE_ARGUMENTS

FILES: Final = {"--route": "route", "--vehicle": "vehicle", "--loss-map": "loss_map"}
"""Options of the node that name an input file, and what the recording's metadata call it."""


@dataclass
class NodeGiven:
    """The command line of a recording's node, and notes about how well it is known.

    `typed` are its arguments as recorded or given by the user; in `words`, they name the recording's own files, clock
    and train.
    """

    words: list[str]
    notes: list[str] = field(default_factory=list)
    typed: list[str] = field(default_factory=list)

    def options(self) -> NodeOptions:
        """The arguments as options of the node; DasError for options that this version's node does not have."""
        kept: list[NodeOptions] = []

        def keep(line: LineServed, driven: TrainServed, place: NodePlace, advice: AdviceGiven) -> None:
            kept.append(NodeOptions(line=line, driven=driven, place=place, advice=advice))

        try:
            single_command("das-node", keep, ())(list(self.words), standalone_mode=False)
        except TyperException as error:
            raise DasError(f"options of the node: {error.format_message()} (give them with --node)") from None
        if not kept:  # --help or --version were among them
            raise DasError("options of the node: expected those with which it advises")
        return kept[0]


def node_given(contents: Contents, train: str, folder: Path, said: str | None) -> NodeGiven:
    """The command line of a train's node; files that are attached to the recording are put into `folder`.

    `said` is the command line that the user gives instead of the recorded one; the files that it names are used. If
    neither is known, the command line is guessed from the journey and the topics, and a note says so. Raises DasError
    for an unusable command line, and for a file that a recording names but that is neither attached to it nor bundled.
    """
    given = _words(contents, train, contents.metadata_of(train).get("run", {}), said)
    given.typed = list(given.words)
    if said is None:
        given.words = _with_files(contents, given, folder)
        _refuse_what_is_only_named(contents.path, given.options(), folder)
    if topics.CONTROL in {one.topic for one in contents.messages if one.train == train}:
        given.words += ["--clock", "bus"]
    given.words += ["--train", train]
    return given


def _words(contents: Contents, train: str, run: Mapping[str, str], said: str | None) -> NodeGiven:
    if said is not None:
        try:
            return NodeGiven(shlex.split(said))
        except ValueError as error:
            raise DasError(f"--node {said!r}: expected options of das-node ({error})") from None
    if NODE_ARGUMENTS in run:
        try:
            words = json.loads(run[NODE_ARGUMENTS])
        except ValueError as error:
            raise DasError(f"{contents.path}: metadata run.{NODE_ARGUMENTS}: not JSON ({error})") from None
        if isinstance(words, list) and all(isinstance(word, str) for word in words):
            return NodeGiven(words)
        raise DasError(f"{contents.path}: metadata run.{NODE_ARGUMENTS}: expected a list of strings")
    return _guessed(contents, train, run)


def _guessed(contents: Contents, train: str, run: Mapping[str, str]) -> NodeGiven:
    heard = [one for one in contents.messages if one.train == train]
    journey = next((one.message for one in heard if one.topic is topics.JOURNEY), None)
    if journey is None:
        raise DasError(f"{contents.path}: there is no journey: give the options of the node (--node)")
    vehicle, _, load = journey.vehicle_id.partition("/")
    words = ["--route", journey.route_id, "--vehicle", vehicle]
    words += ["--load", load] if load else []
    words += ["--reverse"] if journey.reversed else []
    words += ["--level", run["level"]] if "level" in run else []
    words += ["--calibrate"] if any(one.topic is topics.ESTIMATE for one in heard) else []
    guided = any(one.topic is topics.ADVICE and one.message.HasField("guide") for one in heard)
    words += ["--guide" if guided else "--no-guide"]
    note = "the options of the node are not in the recording; assumed: " + " ".join(words)
    return NodeGiven(words, [f"{note} (give it with --node)"])


def _with_files(contents: Contents, given: NodeGiven, folder: Path) -> list[str]:
    """The arguments, with the recording's own files in place of names and of paths on another machine."""
    words, files = list(given.words), AttachedFiles(contents, folder)
    for option, kind in FILES.items():
        if option not in words[:-1]:
            continue
        place = words.index(option) + 1
        if files.has(kind):
            words[place] = str(files.place_vehicle() if kind == "vehicle" else files.place(kind))
        else:
            what = kind.replace("_", " ")
            given.notes.append(f"the recording does not contain its {what} along: {words[place]} of today is used")
    return words


def _refuse_what_is_only_named(recording: Path, options: NodeOptions, folder: Path) -> None:
    """Raise DasError if the arguments in a recording would open a file that is neither attached to it nor bundled.

    Files in `folder` are the attached ones. The options are checked as parsed, however they were spelled.
    """
    line, driven, bundled = options.line, options.driven, {*catalogue("routes"), *catalogue("vehicles")}
    named: list[tuple[str, str | Path | None]] = [
        ("--route", line.route),
        ("--vehicle", driven.vehicle),
        *(("--other-vehicle", name) for name in driven.other_vehicle or ()),
        ("--loss-map", driven.loss_map),
        ("--tables", options.advice.tables),
        ("--bus", options.place.bus),
    ]
    for option, name in named:
        if name is not None and name not in bundled and not Path(name).resolve().is_relative_to(folder.resolve()):
            raise DasError(
                f"{recording}: names {option} {name}, which is not attached, and opened only if you name it: "
                f"expected --node with all options of das-node, {option} among them"
            )


def by_bus_clock(options: NodeOptions) -> bool:
    """Whether a simulation asked the node for its advice at every tick."""
    return options.advice.clock is ClockKind.BUS


STATES = (JOURNEY, RESTRICTION, TARGET)
"""The topics whose last message the bus keeps for a node that restarts."""
HeardAgain = Callable[[float, float], None]
"""Called with the number of messages received so far and the number of all messages."""


class Said(NamedTuple):
    """A message that a node sent: its topic, the message, and the number of the tick (from 1) in which it was sent."""

    topic: Topic
    message: Any
    tick: int


@dataclass
class Rehearing:
    """A cab that receives the messages of a recording again. `make` makes a new cab, as at every start of the node."""

    make: Callable[[], Cab]
    by_bus_clock: bool
    calibrates: bool
    said: list[Said] = field(default_factory=list)
    _ticks: int = 0
    _judged_ns: int = 0

    def run(self, messages: Sequence[RecordedMessage], progress: HeardAgain) -> list[Said]:
        """Receive all messages of one train in the order of the file; returns what the cab sent."""
        for i, _ in enumerate(self.steps(messages), start=1):
            progress(i, len(messages))
        return self.said

    def steps(self, messages: Sequence[RecordedMessage]) -> Iterator[tuple[RecordedMessage, Sequence[Said]]]:
        """Receive the messages of one train one by one; yields each message, and what the cab sent in answer."""
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
        """Replace the cab by one that has received only what the bus keeps, as after a restart of the node."""
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
        heard = codec.decode(Received(one.topic, one.topic.key(one.train), one.message), now_ns)
        if heard is not None:
            self._keep(self._cab.hear(heard), 0)

    def _answer(self, control: Any) -> None:
        """Answer a simulation as the node does: first receive the states that were sent before the question."""
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
            topic, message = codec.encode_output(output, tick)
            self.said.append(Said(topic, message, self._ticks))


def _wanted(control: Any) -> dict[str, int]:
    return {RESTRICTION.name: control.restrictions_ns, TARGET.name: control.targets_ns}


def _announced(messages: Sequence[RecordedMessage]) -> dict[str, list[RecordedMessage]]:
    """By topic, the restrictions and targets that a Control message names, in the order of their times.

    States reach the recorder on paths of their own, so it may have written them some ticks too early or too late. The
    Control messages show when the node received them.
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
    """Indices, in the list of messages, of the first status after each restart of the node."""
    places = [i for i, one in enumerate(messages) if one.topic is STATUS]
    found = restarts_of([Stamped(messages[i].log_time_ns, messages[i].message) for i in places])
    return {places[i] for i in found}


OF_THE_PROCESS = (NodeState.STARTING, NodeState.STOPPING)
"""States that the process around the cab reports, not the cab."""


def recorded_words(messages: Sequence[RecordedMessage], topics: Sequence[Topic]) -> list[Said]:
    """The recorded messages of a node on these topics, except messages of the process around its cab."""
    said, ticks = [], 0
    for one in messages:
        if one.topic not in topics or (one.topic is STATUS and of_the_process(one.message)):
            continue
        if one.topic is ADVICE:
            ticks += 1
        one.message.DiscardUnknownFields()  # of an older version, in which the message had more
        said.append(Said(one.topic, one.message, ticks if one.topic is ADVICE else ticks + 1))
    return said


def of_the_process(status: Any) -> bool:
    """Whether a status comes from the process around the cab, which starts, waits for a journey, or stops."""
    waits = status.state == NodeState.WAITING and status.reason == "waiting for a journey" and not status.advices
    return waits or status.state in OF_THE_PROCESS
