"""Reads an MCAP recording, whole, cut off or damaged, in one pass, and checks every checksum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message
from mcap import records
from numpy.typing import NDArray

from das.bus.contents import RECOVERED, Contents, read_contents
from das.bus.scanning import Health
from das.bus.topics import TOPICS, Topic
from das.domain.errors import DasError, InputError
from das.domain.summary import Summary

FLOATS: Final = (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT)
TEXTS: Final = (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_MESSAGE)


UNKNOWN: Final = Health(size_bytes=0, complete=True)
"""The health of a recording that was not read from a file."""


class Stamped(NamedTuple):
    """A message and the time at which it was recorded (ns since 1970)."""

    log_time_ns: int
    message: Any


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Recording(Summary):
    """The contents of a recording for one train.

    `messages` holds the messages by topic name, those of a topic in the order of their log times. `train` is the chosen
    train, `trains` are all trains of the file. `metadata` holds texts by record name and key, `attachments` the names
    of the attached files, `attached` the files themselves. `complete` is False for a file that was cut off. `health`
    states damage and gaps of the file.
    """

    path: Path
    train: str
    trains: tuple[str, ...]
    messages: dict[str, tuple[Stamped, ...]]
    metadata: dict[str, dict[str, str]]
    attachments: tuple[str, ...]
    complete: bool
    health: Health = UNKNOWN
    attached: tuple[records.Attachment, ...] = ()

    def facts(self) -> dict[str, str]:
        """The file, the train, and the number of messages of each topic."""
        counts = ", ".join(f"{len(self.messages[name])} {name}" for name in self.topics)
        told = {"file": str(self.path), "train": self.train, "messages": counts or "none"}
        return told if self.complete else {**told, "complete": "no, it was cut off"}

    @property
    def topics(self) -> tuple[str, ...]:
        """The sorted names of the topics that have messages."""
        return tuple(sorted(self.messages))

    def of(self, topic: Topic | str) -> tuple[Stamped, ...]:
        """The messages of a topic, given as a Topic or by its name ("position"); empty if it was not recorded.

        Raises InputError for a name that no topic has.
        """
        return self.messages.get(self._topic(topic).name, ())

    def columns(self, topic: Topic | str, *fields: str) -> dict[str, NDArray[Any]]:
        """Fields of a topic's messages as arrays of shape (messages,), by field name (default: all fields).

        A field's name ends in its unit, as in `das.proto`: `speed_mps`, `time_ns`. `log_time_ns` is when the message
        was recorded. Floats are float64. Integers, truth values and enumerations are int64 (`meanings` names the
        values of an enumeration). Texts are objects. A message within the message is a dict of its fields. A repeated
        field is an array of objects, one for each message: a one-dimensional array of numbers, or a list of texts or
        dicts. A topic that was not recorded gives arrays of length 0.

        Raises InputError for a name that no topic or no field has.
        """
        known = self._topic(topic)
        names = [one.name for one in known.message.DESCRIPTOR.fields]
        for name in fields:
            if name not in names:
                raise InputError(self.path, f"field of {known.name}", name, f"one of {', '.join(names)}")
        try:
            return columns(self.of(known), known.message, fields)
        except OverflowError as error:
            raise DasError(f"{self.path}: {known.name}: a number is too large for 64 bits ({error})") from None

    def meanings(self, topic: Topic | str, field_name: str) -> dict[int, str]:
        """Names of the values of an enumeration, as `das.proto` has them: {0: "MODE_NONE", …}.

        Raises InputError for a field that is no enumeration.
        """
        known = self._topic(topic)
        enumerations = {one.name: one.enum_type for one in known.message.DESCRIPTOR.fields if one.enum_type is not None}
        if field_name not in enumerations:
            names = ", ".join(enumerations) or "none, for it has no enumeration"
            raise InputError(self.path, f"field of {known.name}", field_name, names)
        return {value.number: value.name for value in enumerations[field_name].values}

    def _topic(self, topic: Topic | str) -> Topic:
        if isinstance(topic, Topic):
            return topic
        for known in TOPICS:
            if known.name == topic:
                return known
        raise InputError(self.path, "topic", topic, f"one of {', '.join(known.name for known in TOPICS)}")


def columns(messages: Sequence[Stamped], kind: type[Message], fields: Sequence[str] = ()) -> dict[str, NDArray[Any]]:
    """Fields of messages of one kind as arrays, as `Recording.columns` describes them (default: all fields).

    Empty arrays keep their type. Raises KeyError for a field that is not there, OverflowError for a number beyond
    64 bits.
    """
    known = kind.DESCRIPTOR.fields_by_name
    result: dict[str, NDArray[Any]] = {"log_time_ns": np.array([m.log_time_ns for m in messages], dtype=np.int64)}
    for name in fields or known:
        result[name] = _column([getattr(one.message, name) for one in messages], known[name])
    return result


def _column(values: list[Any], described: Any) -> NDArray[Any]:
    """The values of one field as an array of shape (messages,)."""
    kind = described.cpp_type
    dtype: Any = np.float64 if kind in FLOATS else object if kind in TEXTS else np.int64
    if not described.is_repeated and dtype is not object:
        return np.array(values, dtype=dtype)
    column = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):  # assigned as a whole, lists of equal lengths would become a second dimension
        column[i] = _plain(value, described) if dtype is object else np.array(value, dtype=dtype)
    return column


def _plain(value: Any, described: Any) -> Any:
    """The value of a field; a message as a dict of its fields, several values as a list."""
    if described.cpp_type != FieldDescriptor.CPPTYPE_MESSAGE:
        return list(value) if described.is_repeated else value
    found = [
        {one.name: _plain(getattr(message, one.name), one) for one in message.DESCRIPTOR.fields}
        for message in (value if described.is_repeated else [value])
    ]
    return found if described.is_repeated else found[0]


def read_recording(path: str | Path, *, train: str | None = None, skip_damage: bool = False) -> Recording:
    """Read a recording; if it was cut off, everything before the cut.

    `train` chooses the train of a recording that holds several. With `skip_damage`, damaged parts are left out and
    noted in `health`; otherwise a damaged file is refused.

    Raises DasError for a file that is missing, not MCAP or damaged, that has no message of a train, or that has several
    trains while `train` is None.

        recording = das.read_recording("recordings/zurich-zug-late.mcap")
        position = recording.columns("position")
        position["time_ns"], position["s_m"], position["speed_mps"]
    """
    found = read_contents(Path(path))
    if not skip_damage:
        refuse_damage(found)
    return recording_of(found, train)


def recording_of(found: Contents, train: str | None = None) -> Recording:
    """The recording of one train from the contents of a file; raises DasError if the train cannot be chosen."""
    trains = found.trains
    chosen = _chosen(found, trains, train)
    messages: dict[str, list[Stamped]] = {}
    for one in sorted(found.messages, key=lambda entry: entry.log_time_ns):
        if one.train == chosen:
            messages.setdefault(one.topic.name, []).append(Stamped(one.log_time_ns, one.message))
    return Recording(
        path=found.path,
        train=chosen,
        trains=trains,
        messages={name: tuple(entries) for name, entries in messages.items()},
        metadata=found.metadata_of(chosen),
        attachments=tuple(one.name for one in found.attachments),
        complete=found.health.complete,
        health=found.health,
        attached=tuple(found.attachments),
    )


def refuse_damage(found: Contents) -> None:
    """Raise DasError for a file with damage, or with missing messages that `das-sim check --save` has not noted."""
    path, health = found.path, found.health
    if health.damage:
        more = f", and {len(health.damage) - 1} more places" if len(health.damage) > 1 else ""
        raise DasError(f"{path}: damaged: {health.damage[0]}{more}; das-sim check --save NEW.mcap saves what is sound")
    if health.missing and RECOVERED not in found.metadata:
        raise DasError(f"{path}: damaged: {health.missing} messages are missing, according to their sequence numbers")


def _chosen(found: Contents, trains: Sequence[str], train: str | None) -> str:
    """The train to read; raises DasError if there is none, or if there are several and none is named."""
    path = found.path
    if not trains:
        if found.health.damage:
            raise DasError(f"{path}: damaged: {found.health.damage[0]}; no message of a train is left")
        before = " before it was cut off" if not found.health.complete else ""
        raise DasError(f"{path}: holds no messages of a train{before}")
    if train is not None and train not in trains:
        raise DasError(f"{path}: holds no train {train!r}, expected one of {', '.join(trains)}")
    if train is None and len(trains) > 1:
        raise DasError(f"{path}: holds several trains or drives, {', '.join(trains)}: name one (--of-train)")
    return train or trains[0]
