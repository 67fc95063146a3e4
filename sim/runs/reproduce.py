"""Reproduces a recording: this cab gets its messages again, and the answers are compared with the recorded ones.

The cab is rebuilt from the options of the recording's node; a what-if sends its own messages to such a cab.
"""

from __future__ import annotations

import json
import math
import re
import shlex
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, NamedTuple

from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message
from typer.exceptions import TyperException

from das.advice.advice import Source
from das.bus import codec
from das.bus.recorder import LAST_NS
from das.bus.recording import Contents, RecordedMessage, Stamped, recording_of
from das.bus.topics import (
    ADVICE,
    CONTROL,
    EFFORT,
    ESTIMATE,
    EVENT,
    JOURNEY,
    PLAN,
    RESTRICTION,
    STATUS,
    TARGET,
    TOPICS,
    Received,
    Topic,
    message_time_ns,
)
from das.cab.outputs import NodeState, Output
from das.command_line.application import single_command
from das.command_line.printing import Progressed
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.node.command import AdviceGiven, ClockKind, LineServed, NodeOptions, NodePlace, TrainServed
from das.node.process import plan_cab
from sim.recording.check import restarts_of
from sim.recording.opening import NODE_ARGUMENTS, AttachedFiles, open_contents

FILES: Final = {"--route": "route", "--vehicle": "vehicle", "--loss-map": "loss_map"}
"""Options of the node that name an input file, and the name of that file in the recording's metadata."""


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
            raise DasError("options of the node: expected options for a normal start, without --help or --version")
        return kept[0]


def node_given(contents: Contents, train: str, folder: Path, said: str | None) -> NodeGiven:
    """The command line of a train's node; files that are attached to the recording are put into `folder`.

    `said` is a command line given by the user instead of the recorded one; the files that it names are used. If neither
    is known, the command line is guessed from the journey and the topics, with a note. Raises DasError for an unusable
    command line, and for a file that a recording names but that is neither attached to it nor bundled.
    """
    given = _words(contents, train, contents.metadata_of(train).get("run", {}), said)
    given.typed = list(given.words)
    if said is None:
        given.words = _with_files(contents, given, folder)
        _refuse_what_is_only_named(contents.path, given.options(), folder)
    if CONTROL in {one.topic for one in contents.messages if one.train == train}:
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
    journey = next((one.message for one in heard if one.topic is JOURNEY), None)
    if journey is None:
        raise DasError(f"{contents.path}: there is no journey: give the options of the node (--node)")
    vehicle, _, load = journey.vehicle_id.partition("/")
    words = ["--route", journey.route_id, "--vehicle", vehicle]
    words += ["--load", load] if load else []
    words += ["--reverse"] if journey.reversed else []
    words += ["--level", run["level"]] if "level" in run else []
    words += ["--calibrate"] if any(one.topic is ESTIMATE for one in heard) else []
    guided = any(one.topic is ADVICE and one.message.HasField("guide") for one in heard)
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
            given.notes.append(f"the recording does not contain its {what}: the present {words[place]} is used")
    return words


def _refuse_what_is_only_named(recording: Path, options: NodeOptions, folder: Path) -> None:
    """Raise DasError if parsed options name a file that is neither in `folder` (attached) nor bundled."""
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
                f"{recording}: its node used {option} {name}, which is neither attached nor bundled; such a file is "
                f"opened only if you name it: give all options of das-node with --node, {option} among them"
            )


STATES = (JOURNEY, RESTRICTION, TARGET)
"""The topics whose last message the bus keeps for a node that restarts."""


class Said(NamedTuple):
    """A message that a node sent: its topic, the message, and the number of the tick (from 1) in which it was sent."""

    topic: Topic
    message: Any
    tick: int


class Rehearing:
    """A cab that receives the messages of a recording again; it solves within a tick and measures no time.

    `by_bus_clock`: a simulation asked the node for its advice at every tick. `said` has what the cab sent so far.
    """

    def __init__(self, options: NodeOptions) -> None:
        plan = plan_cab(options)
        self.plan = replace(plan, settings=replace(plan.settings, background=False))
        """The plan of the cab, of which a new one is made at every start of the node."""
        self.by_bus_clock = options.advice.clock is ClockKind.BUS
        self.said: list[Said] = []
        self._calibrates = options.advice.calibrate
        self._ticks = self._judged_ns = 0

    @property
    def notes(self) -> list[str]:
        """A note if the answers of the recorded node depended on its machine."""
        return [] if self.by_bus_clock else [BY_THE_WALL]

    def steps(self, messages: Sequence[RecordedMessage]) -> Iterator[tuple[RecordedMessage, Sequence[Said]]]:
        """Receive the messages of one train one by one; yields each message, and what the cab sent in answer."""
        self._cab = self.plan.cab()
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
        self._cab = self.plan.cab()
        self._judged_ns = 0
        for one in list(self._kept.values()):
            self._hear(one)

    def _hear(self, one: RecordedMessage) -> None:
        if one.topic is EFFORT and not self._calibrates:  # a node without calibration does not receive it
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
    """The restrictions and targets that a Control message names, by topic, in the order of their times.

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


def recorded_words(messages: Sequence[RecordedMessage]) -> list[Said]:
    """The recorded messages of a node's cab."""
    said, ticks = [], 0
    for one in filter(is_of_cab, messages):
        if one.topic is ADVICE:
            ticks += 1
        one.message.DiscardUnknownFields()  # of an older version, in which the message had more
        said.append(Said(one.topic, one.message, ticks if one.topic is ADVICE else ticks + 1))
    return said


def is_of_cab(one: RecordedMessage) -> bool:
    """Whether a cab sent a message, and not the process around it, which starts, waits for a journey, or stops."""
    if one.topic is not STATUS:
        return one.topic in COMPARED
    status = one.message
    waits = status.state == NodeState.WAITING and status.reason == "waiting for a journey" and not status.advices
    return not waits and status.state not in (NodeState.STARTING, NodeState.STOPPING)


COMPARED: Final = tuple(topic for topic in TOPICS if topic.publisher == "node")
"""The topics on which a cab sends messages."""
TOLD_FIRST: Final = [topic.name for topic in (EVENT, PLAN, STATUS, ESTIMATE)]
"""The order of the differences in one tick, because events and plans explain the rest; other topics follow."""
IGNORED: Final = {
    "status.version": "it names the program, not its decisions",
    "status.solve_s": "it is a measured duration",
    "status.last_advice_s": "it is a measured duration",
}
"""Fields that are not compared, and why."""
TOLERANCES: Final = {
    "_mps2": 1e-4,
    "_mps": 1e-3,
    "_m": 0.1,
    "_s": 0.01,
    "_n": 10.0,
    "_ratio": 1e-4,
    "_ns": 1e7,
}
"""Largest differences of numbers, by the unit at the end of their names. Another machine rounds differently in the last
digits; another decision changes numbers by more."""
RELATIVE: Final = 1e-5
"""Share by which numbers without a unit in `TOLERANCES`, like energies, may differ."""


class FieldDifference(NamedTuple):
    """One field of a message that differs: its path, its recorded and its new value, and their difference.

    `by` is NaN if the values are not numbers.
    """

    path: str
    recorded: Any
    today: Any
    by: float


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A message that differs; `recorded` or `today` is None if there is no counterpart."""

    topic: str
    time_ns: int
    tick: int
    recorded: Any | None
    today: Any | None
    fields: tuple[FieldDifference, ...] = ()


@dataclass
class Comparison:
    """The number of compared messages of each topic, and the messages that differ, in the order of their times."""

    compared: Counter[str] = field(default_factory=Counter)
    differences: list[Difference] = field(default_factory=list)

    @property
    def by_field(self) -> dict[str, tuple[int, float]]:
        """The number of messages and the largest difference (NaN: not a number) for each field that differs."""
        found: dict[str, list[float]] = defaultdict(list)
        for one in self.differences:
            for path, by in {(re.sub(r"\[\d+\]", "", x.path), x.by) for x in one.fields}:
                found[f"{one.topic}.{path}"].append(by)
        known = {path: [by for by in bys if not math.isnan(by)] for path, bys in found.items()}
        return {path: (len(bys), max(known[path], default=math.nan)) for path, bys in found.items()}


def compare(recorded: Sequence[Said], today: Sequence[Said]) -> Comparison:
    """Compare message by message; messages with the same topic and time are paired in their order."""
    before, after = _by_moment(recorded), _by_moment(today)
    result = Comparison()
    for topic, time_ns in dict.fromkeys([*before, *after]):
        olds, news = before.get((topic, time_ns), []), after.get((topic, time_ns), [])
        for old, new in _pairs(olds, news):
            result.compared[topic] += 1
            difference = _difference(topic, time_ns, old, new)
            if difference is not None:
                result.differences.append(difference)
    order = [*TOLD_FIRST, *dict.fromkeys(one.topic for one in result.differences)]
    result.differences.sort(key=lambda one: (one.tick, order.index(one.topic)))
    return result


def _pairs(olds: Sequence[Said], news: Sequence[Said]) -> Iterator[tuple[Said | None, Said | None]]:
    """Pairs of messages of one moment. If some are missing, equal messages are paired first, then the rest in order."""
    left = list(news)
    rest: list[Said] = []
    for old in olds:
        same = next((new for new in left if new.message == old.message), None) if len(olds) != len(news) else None
        if same is None:
            rest.append(old)
        else:
            left.remove(same)
            yield old, same
    yield from zip_longest(rest, left)


def _by_moment(said: Sequence[Said]) -> dict[tuple[str, int], list[Said]]:
    found: dict[tuple[str, int], list[Said]] = defaultdict(list)
    for one in said:
        found[one.topic.name, message_time_ns(one.message)].append(one)
    return found


def _difference(topic: str, time_ns: int, old: Said | None, new: Said | None) -> Difference | None:
    fields: tuple[FieldDifference, ...] = ()
    if old is not None and new is not None:
        fields = tuple(_message(old.message, new.message, topic, ""))
        if not fields:
            return None
    some = new or old
    assert some is not None
    return Difference(
        topic=topic,
        time_ns=time_ns,
        tick=some.tick,
        recorded=None if old is None else old.message,
        today=None if new is None else new.message,
        fields=fields,
    )


def _message(old: Message, new: Message, topic: str, path: str) -> Iterator[FieldDifference]:
    for description in old.DESCRIPTOR.fields:
        name = f"{path}{description.name}"
        if f"{topic}.{name}" not in IGNORED:
            yield from _field(description, old, new, topic, name)


def _field(description: Any, old: Message, new: Message, topic: str, name: str) -> Iterator[FieldDifference]:
    one, other = getattr(old, description.name), getattr(new, description.name)
    inner = description.message_type is not None
    if description.is_repeated:
        if len(one) != len(other):
            yield FieldDifference(f"{name} (how many)", len(one), len(other), float(abs(len(one) - len(other))))
            return
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _message(a, b, topic, f"{name}[{i}].") if inner else _value(f"{name}[{i}]", a, b, description)
    elif inner:
        if old.HasField(description.name) != new.HasField(description.name):
            there, there_today = old.HasField(description.name), new.HasField(description.name)
            yield FieldDifference(f"{name} (is there)", there, there_today, math.nan)
        else:
            yield from _message(one, other, topic, f"{name}.")
    else:
        yield from _value(name, one, other, description)


def _value(path: str, one: Any, other: Any, description: Any) -> Iterator[FieldDifference]:
    if one == other or (one != one and other != other):  # noqa: PLR0124  # both are NaN
        return
    if description.enum_type is not None:
        names = {number: value.name for number, value in description.enum_type.values_by_number.items()}
        yield FieldDifference(path, names.get(one, one), names.get(other, other), math.nan)
    elif isinstance(one, str | bytes | bool):
        yield FieldDifference(path, one, other, math.nan)
    else:
        by = abs(float(one) - float(other)) if isinstance(one, float) else float(abs(one - other))
        if not by <= tolerance(description.name, one):
            yield FieldDifference(path, one, other, by)


def tolerance(name: str, value: float) -> float:
    """Largest allowed deviation of a value of this field from the recorded one; counts and ticks must be equal."""
    for unit, amount in TOLERANCES.items():
        if name.endswith(unit):
            return amount
    return RELATIVE * abs(value) if isinstance(value, float) else 0.0


EXTRACT, SAID_FROM, SAID_TO = "extract", "said_from_ns", "said_to_ns"
"""Metadata of an extract: a recording of all messages that its node received, and a part of those it sent."""
BY_THE_WALL = (
    "the node used the wall clock and planned in the background: the time of each plan depended on its machine, and "
    "so do all later plans; differences do not mean that this version advises differently"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reproduction:
    """The result: number of recomputed ticks, differences, and notes on how well the node is known."""

    path: Path
    train: str
    ticks: int
    comparison: Comparison
    notes: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether the cab of this version sends the recorded messages."""
        return not self.comparison.differences

    def as_dict(self) -> dict[str, Any]:
        """The result for JSON."""
        first = self.comparison.differences[0] if self.comparison.differences else None
        return {
            "file": str(self.path),
            "train": self.train,
            "same": self.same,
            "ticks": self.ticks,
            "compared": dict(self.comparison.compared),
            "differing": len(self.comparison.differences),
            "fields": {
                path: {"messages": count, "at_most": None if most != most else most}  # noqa: PLR0124
                for path, (count, most) in self.comparison.by_field.items()
            },
            "first": None if first is None else _as_dict(first),
            "notes": list(self.notes),
        }


def _as_dict(one: Difference) -> dict[str, Any]:
    recorded, today = (None if x is None else MessageToDict(x) for x in (one.recorded, one.today))
    return {
        "topic": one.topic,
        "time_ns": one.time_ns,
        "tick": one.tick,
        "fields": [{"field": x.path, "recorded": str(x.recorded), "today": str(x.today)} for x in one.fields],
        "recorded": recorded,
        "today": today,
    }


def reproduce(
    path: Path, progress: Progressed, *, train: str | None = None, node: str | None = None, tables: Path | None = None
) -> Reproduction:
    """Send a recording to today's cab; `node` is the command line of its node, if the recording does not hold it.

    Raises DasError for a recording that cannot be read, or in which no node advised.
    """
    contents = open_contents(path)
    train = recording_of(contents, train).train
    messages = [one for one in contents.messages if one.train == train]
    if not any(one.topic is ADVICE for one in messages):
        raise DasError(f"{path}: the recording holds no advice, so there is nothing to reproduce (das-sim replay)")
    with tempfile.TemporaryDirectory(prefix="das-reproduce-") as folder:
        given = node_given(contents, train, Path(folder), node)
        given.words += ["--tables", str(tables)] if tables is not None else []
        hearing = Rehearing(given.options())
        for number, _ in enumerate(hearing.steps(messages), start=1):
            progress(number, len(messages))
    span = _span(contents)
    found = compare(within(recorded_words(messages), span), within(hearing.said, span))
    notes = [*given.notes, *hearing.notes]
    if tables is None and any(one.topic is ADVICE and one.message.source == Source.TABLE for one in contents.messages):
        notes.append("the node used tables: give their folder with --tables")
    return Reproduction(
        path=path,
        train=train,
        ticks=sum(one.topic is ADVICE for one in hearing.said),
        comparison=found,
        notes=tuple(notes),
    )


def _span(contents: Contents) -> tuple[int, int]:
    """The span of time (ns) with the messages of a recording's node: the whole, unless it is an extract."""
    extract = contents.metadata.get(EXTRACT, {})
    try:
        return int(extract.get(SAID_FROM, "0")), int(extract.get(SAID_TO, str(LAST_NS)))
    except ValueError:
        raise DasError(f"{contents.path}: metadata {EXTRACT}: expected times in ns") from None


def within(said: list[Said], span: tuple[int, int]) -> list[Said]:
    """The messages that were sent in a span of time (ns)."""
    return [one for one in said if span[0] <= message_time_ns(one.message) <= span[1]]
