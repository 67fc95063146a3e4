"""Reading an MCAP recording of ours, whole or cut off, in one pass with its checksums checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

from das.bus.topics import Topic, topic_of
from das.domain.errors import DasError

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

    `messages` by topic name, each in the order of their log times. `train` is the first train of the file, `trains`
    are all of them. `metadata` by record name. `complete` is False for a file without its end: it was cut off.
    """

    path: Path
    train: str
    trains: tuple[str, ...]
    messages: dict[str, tuple[Stamped, ...]]
    metadata: dict[str, dict[str, str]]
    attachments: tuple[str, ...]
    complete: bool

    def of(self, topic: Topic) -> tuple[Stamped, ...]:
        """The messages of a topic; empty if it was not recorded."""
        return self.messages.get(topic.name, ())

    def columns(self, topic: Topic, *fields: str) -> dict[str, NDArray[Any]]:
        """Fields of a topic's messages as arrays, see `columns`."""
        return columns(self.of(topic), topic.message, fields)


def columns(messages: Sequence[Stamped], kind: type[Message], fields: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Fields of messages of one kind as arrays by field name, and `log_time_ns`; empty arrays keep their type.

    Floats as float64, integers and enumerations as int64, the rest as objects. KeyError for a field that is not there.
    """
    result: dict[str, NDArray[Any]] = {"log_time_ns": np.array([m.log_time_ns for m in messages], dtype=np.int64)}
    for name in fields:
        cpp_type = kind.DESCRIPTOR.fields_by_name[name].cpp_type
        dtype: Any = np.float64 if cpp_type in FLOATS else object if cpp_type in TEXTS else np.int64
        result[name] = np.array([getattr(m.message, name) for m in messages], dtype=dtype)
    return result


def extract_attachments(path: Path, folder: Path) -> list[Path]:
    """Write the attachments of a whole recording into a folder, by their bare names; none of one that was cut off."""
    written = []
    try:
        with path.open("rb") as file:
            for attachment in make_reader(file).iter_attachments():
                target = folder / Path(attachment.name).name
                target.write_bytes(attachment.data)
                written.append(target)
    except (OSError, McapError):
        return []
    return written


def read_recording(path: Path) -> Recording:
    """Read a recording; of one that was cut off, all that was written before.

    Raises DasError for a file that is missing, not MCAP, damaged (checksums, contents), or without a message of ours.
    """
    found = _Contents(path=path)
    try:
        with path.open("rb") as file:
            complete = _read(file, found)
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
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
    """A stream that never gives fewer bytes than asked for, so that a cut is told from damage."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.left = file, size

    def read(self, length: int) -> bytes:
        if length > self.left:
            raise EndOfFile
        self.left -= length
        return self.file.read(length)


@dataclass
class _Contents:
    """What was found so far: (train, topic name, message), metadata, names of attachments."""

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
    """Collect the contents up to the end of the file; whether the recording is complete."""
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
