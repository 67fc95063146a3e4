"""Reproduces a recording: today's cab gets the recorded messages, and its answers are compared with the old ones."""

from __future__ import annotations

import math
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, NamedTuple

from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message

from das.bus.contents import Contents
from das.bus.recorder import LAST_NS, message_time_ns
from das.bus.recording import recording_of
from das.bus.topics import ADVICE, ESTIMATE, EVENT, PLAN, STATUS, TOPICS
from das.cab.cab import no_stopwatch
from das.domain.errors import DasError
from das.node.process import CabPlan, plan_cab
from sim.recording.opening import open_contents
from sim.runs.hearing import HeardAgain, Rehearing, Said, by_bus_clock, node_given, recorded_words

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
"""Share by which numbers without such a unit, like energies, may differ."""


class FieldDifference(NamedTuple):
    """One field of a message that differs: its path, its recorded value, today's value, and their difference.

    `by` is NaN if the values are no numbers.
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
    """How many messages of each topic were compared, and those that differ, in the order of their times."""

    compared: Counter[str] = field(default_factory=Counter)
    differences: list[Difference] = field(default_factory=list)

    @property
    def by_field(self) -> dict[str, tuple[int, float]]:
        """For each field that differs: in how many messages, and by how much at most (NaN: not a number)."""
        found: dict[str, list[float]] = defaultdict(list)
        for one in self.differences:
            for path, by in {(_bare(x.path), x.by) for x in one.fields}:
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
    """How far a value of this field may be from the recorded one; counts and ticks must be the same."""
    for unit, amount in TOLERANCES.items():
        if name.endswith(unit):
            return amount
    return RELATIVE * abs(value) if isinstance(value, float) else 0.0


def _bare(path: str) -> str:
    return "".join(part.partition("]")[2] if "]" in part else part for part in path.split("["))


EXTRACT, SAID_FROM, SAID_TO = "extract", "said_from_ns", "said_to_ns"
"""Metadata of an extract: a recording of everything that its node received, with a part of what the node sent."""
BY_THE_WALL = (
    "the node used the wall clock and planned in the background: the time of each plan depended on its machine, and "
    "so do all later plans; differences do not mean that this version advises differently"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reproduction:
    """The result: how many ticks were judged again, what differs, and notes on how well the node is known."""

    path: Path
    train: str
    ticks: int
    comparison: Comparison
    notes: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether today's cab sends what was recorded."""
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
    path: Path, progress: HeardAgain, *, train: str | None = None, node: str | None = None, tables: Path | None = None
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
        options = given.options()
        plan = without_waiting(plan_cab(options))
        by_bus = by_bus_clock(options)
        hearing = Rehearing(plan.cab, by_bus, options.advice.calibrate)
        today = hearing.run(messages, progress)
    span = _span(contents)
    found = compare(within(recorded_words(messages, COMPARED), span), within(today, span))
    notes = [*given.notes, *([] if by_bus else [BY_THE_WALL]), *_tables_note(contents, found, tables)]
    return Reproduction(
        path=path,
        train=train,
        ticks=sum(one.topic is ADVICE for one in today),
        comparison=found,
        notes=tuple(notes),
    )


def without_waiting(plan: CabPlan) -> CabPlan:
    """The same cab, but it makes its plans within a tick and measures no time."""
    return replace(plan, settings=replace(plan.settings, background=False, stopwatch=no_stopwatch))


def _span(contents: Contents) -> tuple[int, int]:
    """From when to when (ns) a recording holds the messages of its node: all the time, unless it is an extract."""
    extract = contents.metadata.get(EXTRACT, {})
    try:
        return int(extract.get(SAID_FROM, "0")), int(extract.get(SAID_TO, str(LAST_NS)))
    except ValueError:
        raise DasError(f"{contents.path}: metadata {EXTRACT}: expected times in ns") from None


def within(said: list[Said], span: tuple[int, int]) -> list[Said]:
    """The messages that were sent in a span of time (ns)."""
    return [one for one in said if span[0] <= message_time_ns(one.message) <= span[1]]


def _tables_note(contents: Contents, found: Comparison, tables: Path | None) -> list[str]:
    from das.advice.advice import Source

    used = any(one.topic is ADVICE and one.message.source == Source.TABLE for one in contents.messages)
    return ["the node used tables: give their folder with --tables"] if used and tables is None else []
