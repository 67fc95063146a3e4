"""Compares what a node said with what today's cab says: field by field, within named tolerances."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, Final, NamedTuple

from google.protobuf.message import Message

from das.bus.recorder import message_time_ns
from das.bus.topics import ADVICE, ESTIMATE, EVENT, PLAN, STATUS
from sim.runs.reproduce.hearing import Said

COMPARED: Final = (ADVICE, PLAN, ESTIMATE, STATUS, EVENT)
"""The topics on which a cab speaks."""
IGNORED: Final = {
    "status.version": "it says which program speaks, not what it decides",
    "status.solve_s": "it is measured with a stopwatch",
    "status.last_advice_s": "it is measured with a stopwatch",
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
"""How far numbers may be apart, by the unit at the end of their names. Another machine rounds differently in the last
digits; a decision that differs is larger than these."""
RELATIVE: Final = 1e-5
"""Numbers without one of these units, such as energies, may differ by this share."""


class FieldDifference(NamedTuple):
    """One field of a message that differs: its path, what was recorded, what is said today, and by how much.

    `by` is NaN where the values are no numbers.
    """

    path: str
    recorded: Any
    today: Any
    by: float


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A message that differs; one of `recorded` and `today` is None where the other has no counterpart."""

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
        """Of each field that differs: in how many messages, and by how much at most (NaN: no number)."""
        found: dict[str, list[float]] = defaultdict(list)
        for one in self.differences:
            for path, by in {(_bare(x.path), x.by) for x in one.fields}:
                found[f"{one.topic}.{path}"].append(by)
        return {path: (len(bys), _largest(bys)) for path, bys in found.items()}


def _largest(amounts: Sequence[float]) -> float:
    return max((one for one in amounts if not math.isnan(one)), default=math.nan)


def compare(recorded: Sequence[Said], today: Sequence[Said]) -> Comparison:
    """Compare message by message; those of a topic and a time belong together, in their order."""
    before, after = _by_moment(recorded), _by_moment(today)
    result = Comparison()
    for topic, time_ns in dict.fromkeys([*before, *after]):
        olds, news = before.get((topic, time_ns), []), after.get((topic, time_ns), [])
        for old, new in _pairs(olds, news):
            result.compared[topic] += 1
            difference = _difference(topic, time_ns, old, new)
            if difference is not None:
                result.differences.append(difference)
    order = {topic.name: i for i, topic in enumerate((EVENT, PLAN, STATUS, ESTIMATE, ADVICE))}
    result.differences.sort(key=lambda one: (one.tick, order[one.topic]))
    return result


def _pairs(olds: Sequence[Said], news: Sequence[Said]) -> Iterator[tuple[Said | None, Said | None]]:
    """Messages of one moment that belong together: where some are missing, those that are the same, then the rest."""
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
    """The fields in which two messages of one kind differ."""
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
    """A path without the places in lists."""
    return "".join(part.partition("]")[2] if "]" in part else part for part in path.split("["))
