"""Reads an MCAP recording that the recorder wrote: whole or cut off, in one pass, with its checksums checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, cast

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message
from mcap import records
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader
from mcap.stream_reader import CRCValidationError, StreamReader
from numpy.typing import NDArray

from das.bus.topics import TOPICS, Topic, topic_of
from das.domain.errors import DasError, InputError

MAGIC: Final = b"\x89MCAP0\r\n"
FLOATS: Final = (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT)
TEXTS: Final = (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_MESSAGE)


class Stamped(NamedTuple):
    """A message and when it was recorded."""

    log_time_ns: int
    message: Any


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What a recording holds of one train.

    `messages` holds the messages by topic name, each topic's in the order of their log times. `train` is the first
    train of the file, `trains` are all of them. `metadata` holds texts by record name and key, `attachments` the names
    of the attached files (see `extract_attachments`). `complete` is False for a file without its end: it was cut off.
    """

    path: Path
    train: str
    trains: tuple[str, ...]
    messages: dict[str, tuple[Stamped, ...]]
    metadata: dict[str, dict[str, str]]
    attachments: tuple[str, ...]
    complete: bool

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics of which there are messages, sorted."""
        return tuple(sorted(self.messages))

    def of(self, topic: Topic | str) -> tuple[Stamped, ...]:
        """The messages of a topic, which is empty if the topic was not recorded.

        A topic is given by itself or by its name ("position"). Raises InputError for a name that no topic has.
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
    for name in fields or [one.name for one in kind.DESCRIPTOR.fields]:
        result[name] = _column(
            [getattr(m.message, name) for m in messages], known[name].cpp_type, known[name].is_repeated
        )
    return result


def _column(values: list[Any], cpp_type: int, repeated: bool) -> NDArray[Any]:
    """The values of one field as an array of shape (messages,)."""
    dtype: Any = np.float64 if cpp_type in FLOATS else object if cpp_type in TEXTS else np.int64
    plain: Callable[[Any], Any] = _as_dict if cpp_type == FieldDescriptor.CPPTYPE_MESSAGE else lambda value: value
    if not repeated:
        if dtype is not object:
            return np.array(values, dtype=dtype)
        cells = [plain(value) for value in values]
    elif dtype is object:
        cells = [[plain(value) for value in several] for several in values]
    else:
        cells = [np.array(several, dtype=dtype) for several in values]
    column = np.empty(len(cells), dtype=object)
    for i, cell in enumerate(cells):  # assigned as a whole, lists of equal lengths would become a second dimension
        column[i] = cell
    return column


def _as_dict(message: Message) -> dict[str, Any]:
    """A message's fields by name; messages within it as well."""
    result: dict[str, Any] = {}
    for description in message.DESCRIPTOR.fields:
        value = getattr(message, description.name)
        inner = description.cpp_type == FieldDescriptor.CPPTYPE_MESSAGE
        if description.is_repeated:
            result[description.name] = [_as_dict(one) if inner else one for one in value]
        else:
            result[description.name] = _as_dict(value) if inner else value
    return result


def extract_attachments(path: Path, folder: Path) -> list[Path]:
    """Write the attachments of a whole recording into a folder, by their bare names, and return where they are.

    Nothing is returned for a recording that was cut off, or where a file cannot be written.
    """
    written = []
    try:
        with path.open("rb") as file:
            for attachment in make_reader(file).iter_attachments():
                target = folder / Path(attachment.name).name
                target.write_bytes(attachment.data)
                written.append(target)
    except (OSError, ValueError, McapError):  # ValueError: a name that no file can have
        return []
    return written


def read_recording(path: str | Path) -> Recording:
    """Read a recording; of one that was cut off, all that was written before.

    Raises DasError for a file that is missing, not MCAP, damaged (checksums, contents), or without a message of a
    train.

        recording = das.read_recording("recordings/zurich-zug-late.mcap")
        position = recording.columns("position")
        position["s_m"], position["speed_mps"]
    """
    path = Path(path)
    found = _Contents(path=path)
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise DasError(f"{path}: not a regular file")  # opening a pipe would wait for its other end
        with path.open("rb") as file:
            complete = _read(file, found)
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise DasError(f"{str(path)!r}: cannot be read ({error})") from None
    if not found.messages:
        raise DasError(f"{path}: holds no messages of a train{'' if complete else ' before it was cut off'}")
    ordered = sorted(found.messages, key=lambda entry: entry[2].log_time_ns)
    trains = tuple(dict.fromkeys(train for train, _, _ in ordered))
    messages: dict[str, list[Stamped]] = {}
    for train, name, stamped in ordered:
        if train == trains[0]:
            messages.setdefault(name, []).append(stamped)
    return Recording(
        path=path,
        train=trains[0],
        trains=trains,
        messages={name: tuple(entries) for name, entries in messages.items()},
        metadata=found.metadata,
        attachments=tuple(found.attachments),
        complete=complete,
    )


class _Bounded:
    """A stream that raises EndOfFile rather than give fewer bytes than asked for: so a cut is told from damage."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.left = file, size

    def read(self, length: int) -> bytes:
        if length > self.left:
            raise EndOfFile
        self.left -= length
        return self.file.read(length)


@dataclass
class _Contents:
    """What a recording was found to hold so far: (train, topic name, message), metadata, names of attachments."""

    path: Path
    messages: list[tuple[str, str, Stamped]] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: list[str] = field(default_factory=list)

    def collect(self, stream: Iterator[records.McapRecord]) -> None:
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, Topic]] = {}
        for record in stream:
            if isinstance(record, records.Message):
                if record.channel_id in channels:
                    train, topic = channels[record.channel_id]
                    message = topic.message.FromString(record.data)
                    self.messages.append((train, topic.name, Stamped(record.log_time, message)))
            elif isinstance(record, records.Schema):
                schemas[record.id] = record.name
            elif isinstance(record, records.Channel):
                known = topic_of(record.topic)
                if known is not None:
                    self._check(record, schemas.get(record.schema_id, ""), known)
                    channels[record.id] = (record.topic.split("/")[1], known)
            elif isinstance(record, records.Metadata):
                self.metadata[record.name] = dict(record.metadata)
            elif isinstance(record, records.Attachment):
                self.attachments.append(record.name)

    def _check(self, channel: records.Channel, schema: str, topic: Topic) -> None:
        expected = topic.message.DESCRIPTOR.full_name
        if channel.message_encoding != "protobuf" or schema != expected:
            raise DasError(f"{self.path}: channel {channel.topic} holds {schema!r}, expected protobuf {expected!r}")


def _read(file: IO[bytes], found: _Contents) -> bool:
    """Collect the contents up to the end of the file; the answer says whether the recording is complete."""
    path, size = found.path, file.seek(0, 2)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise DasError(f"{path}: not an MCAP recording")
    file.seek(max(size - len(MAGIC), len(MAGIC)))
    ended = file.read() == MAGIC
    file.seek(0)
    reader = StreamReader(cast("IO[bytes]", _Bounded(file, size)), validate_crcs=True, record_size_limit=None)
    try:
        found.collect(reader.records)
    except EndOfFile:
        if not ended:
            return False
        raise DasError(f"{path}: damaged: a record is longer than the file") from None
    except CRCValidationError as error:
        raise DasError(f"{path}: damaged: wrong checksum in a {type(error.record).__name__.lower()}") from error
    except (DasError, OSError):
        raise
    except Exception as error:
        # Damaged bytes surface as errors of the decompressor, of struct, of UTF-8, … : there is no common class.
        detail = " ".join(f"{type(error).__name__}: {error}".split())
        raise DasError(f"{path}: damaged: {detail}") from error
    return True
