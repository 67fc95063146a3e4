"""The recorder, which writes all messages on the bus to one MCAP file, on disk within a second.

Log time is the clock of the simulation (the last Control message), or else the wall clock; publish time is the time
that the message states. The schema of a topic also contains the comments of its fields, with their units, in
`source_code_info`; the protobuf compiler would drop these comments.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import IO, Any, Final

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
from google.protobuf.message import Message
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import build_file_descriptor_set

from das import __version__
from das.bus import das_pb2
from das.bus.sealing import CHANNELS, NUMBERED, RECORDING, sealed
from das.bus.session import Bus
from das.bus.topics import ADVICE, CONTROL, RECORDER, STATUS, Received, Topic, message_time_ns
from das.domain.clocks import WALL, Clocks
from das.domain.errors import DasError
from das.domain.files.writing import refuse_link, temporary_file

FLUSH_EVERY_S = 0.5
"""Interval (s) between writes to the disk, at most 0.1 s late: a killed recorder loses at most 1.0 s."""
CHUNK_BYTES = 1 << 18
"""Uncompressed size (bytes) at which a chunk is written; damage to one chunk loses no more."""
LIBRARY = f"driver-advisory-system {__version__}"
"""The name of the program that wrote a recording, as stated in the file."""
REPORT_EVERY_S = 1.0
"""Longest time (s) between reports of the recorder's progress, also while there are no ticks."""
LAST_NS = 2**63 - 1
"""The latest time that the file can hold (ns since 1970); a later time is recorded only inside its message."""
COMMENTS: Final = "das_comments.json"
"""The file with the comments of das.proto by full field name; tests/support/generated_messages.py writes it."""
SPAN: Final = (0, 0, 0)
"""A comment's place in das.proto: protobuf requires one, but recordings do not need it, so it is 0."""


class RecordingFile:
    """An MCAP file that is being written, with checksums: messages of our topics, metadata, attachments."""

    def __init__(self, path: Path, clocks: Clocks = WALL) -> None:
        """Begin a file, which is always readable, in place of an existing one. A symbolic link is refused."""
        self.path = path
        self.messages = 0
        self._clocks = clocks
        self._named, self._begun_ns = "", clocks.now_ns()
        self._file, beside = _begin(path)
        try:
            self._writer: Any = McapWriter(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
            )
            self._writer.start(profile="", library=LIBRARY)
            self._schemas: dict[str, int] = {}
            self._channels: dict[str, int] = {}
            self.flush()
            if beside is not None:
                os.replace(beside, path)
        except OSError as error:
            self._file.close()
            if beside is not None:
                beside.unlink(missing_ok=True)
            raise DasError(f"{path}: cannot be written ({error.strerror})") from error

    def add(self, topic: Topic, key: str, message: Message, log_time_ns: int) -> None:
        """Write one message, which is on disk after the next flush."""
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._register(topic, key)
        sent_ns = message_time_ns(message)
        if not 0 < sent_ns <= LAST_NS:
            sent_ns = log_time_ns
        self._writer.add_message(channel, log_time_ns, message.SerializeToString(), sent_ns, self.messages)
        self.messages += 1

    def flush_if_due(self) -> None:
        """Flush, if the last flush was at least `FLUSH_EVERY_S` ago."""
        if self._clocks.seconds() - self._flushed_s >= FLUSH_EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Put everything written so far on disk."""
        self._writer.flush()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._flushed_s = self._clocks.seconds()

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record with a checksum of its own, and with the name of this recording."""
        self._writer.add_metadata(name, sealed(name, {**data, RECORDING: self._name(name, data)}))

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Attach a file, stamped with the present time."""
        now_ns = self._clocks.now_ns()
        self._writer.add_attachment(now_ns, now_ns, name, media_type, content)

    def close(self) -> None:
        """Finish the file: summary, index, checksums."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def _register(self, topic: Topic, key: str) -> int:
        name = topic.message.DESCRIPTOR.full_name
        schema = self._schemas.get(name)
        if schema is None:
            schema = self._schemas[name] = self._writer.register_schema(name, "protobuf", schema_of(topic.message))
        named = {RECORDING: self._name()}
        channel = int(self._writer.register_channel(key, "protobuf", schema, named))
        # The chunk that describes the channel may be lost; the messages in later chunks must remain readable.
        self.add_metadata(
            f"{CHANNELS}{channel}", {"topic": key, "schema": name, "schema_id": str(schema), NUMBERED: "yes"}
        )
        return channel

    def _name(self, *of: object) -> str:
        """The name that identifies this recording in a merged file, from its start time and its first metadata.

        The name is not random, so that the same run gives the same file.
        """
        if not self._named:
            self._named = hashlib.sha256(json.dumps([self._begun_ns, of], sort_keys=True).encode()).hexdigest()[:16]
        return self._named


def _begin(path: Path) -> tuple[IO[bytes], Path | None]:
    """An open file for a recording, and its temporary path until it has its first bytes (None: it is in place)."""
    refuse_link(path)
    try:
        if path.exists() and not path.is_file():  # a device or a pipe is written to, not replaced
            return path.open("wb"), None
        return temporary_file(path)
    except OSError as error:
        raise DasError(f"{path}: cannot be written ({error.strerror})") from error


class Recorder:
    """Writes the messages it receives, and reports its progress at every tick, so that a fast sender can wait.

    `clock_ns` is the time of a simulation before its first Control message (None: the wall clock counts). In a
    simulation, messages without a time are left out: their number depends on how fast the machine starts a node.
    """

    def __init__(self, bus: Bus, file: RecordingFile, clock_ns: int | None, clocks: Clocks = WALL) -> None:
        self.bus, self.file, self._clocks = bus, file, clocks
        self._clock_ns, self._simulated = clock_ns, clock_ns is not None
        self._status = das_pb2.RecorderStatus(file=file.path.name)
        self._reported_s = -math.inf

    def take(self, received: Received) -> None:
        """Write one message; a payload that is not of its topic's type is left out."""
        message, topic = received.message, received.topic
        if message is None:
            return
        if topic is CONTROL and message.time_ns >= 0:
            self._clock_ns = message.time_ns
        if not self._simulated or message_time_ns(message) != 0:
            log_time_ns = self._clock_ns if self._clock_ns is not None else self._clocks.now_ns()
            self.file.add(topic, received.key, message, log_time_ns)
        if self._noted(topic, message):
            self.report()

    def _noted(self, topic: Topic, message: Any) -> bool:
        """Take note of the progress; returns whether another process may be waiting for a report."""
        status, state = self._status, self._status.node_state
        if topic is CONTROL:
            status.tick = message.tick
        elif topic is ADVICE:
            status.advice_tick = message.tick
        elif topic is STATUS:
            status.node_state = message.state
        return topic is CONTROL or topic is ADVICE or status.node_state != state

    def report(self) -> None:
        """Report how many messages are written, and up to which tick."""
        self._status.time_ns, self._status.messages = self._clocks.now_ns(), self.file.messages
        self.bus.publish(RECORDER, self._status)

    def report_if_due(self) -> None:
        """Report the progress once every `REPORT_EVERY_S`, also while no messages come."""
        if self._clocks.seconds() - self._reported_s > REPORT_EVERY_S:
            self.report()
            self._reported_s = self._clocks.seconds()


@cache
def comments() -> dict[str, str]:
    """The comments of the fields of our messages, by the field's full name ("das.Position.s_m")."""
    found: dict[str, str] = json.loads((files("das.bus") / COMMENTS).read_text(encoding="utf-8"))
    return found


def schema_of(message: type[Message]) -> bytes:
    """A serialized FileDescriptorSet of a message, with the comments of its fields and of the messages in them."""
    found = build_file_descriptor_set(message)
    for file in found.file:
        if file.name == das_pb2.DESCRIPTOR.name:
            _add_comments(file, message.DESCRIPTOR)
    return found.SerializeToString()


def _add_comments(file: FileDescriptorProto, message: Any) -> None:
    for one in _with_inner(message):
        for number, field in enumerate(one.fields):
            text = comments().get(field.full_name)
            if text:
                place = (*_place(one), DescriptorProto.FIELD_FIELD_NUMBER, number)
                file.source_code_info.location.add(path=place, span=SPAN, trailing_comments=text)


def _with_inner(message: Any) -> Iterator[Any]:
    """The message and our messages within it, each once."""
    known: dict[str, Any] = {}
    waiting = [message]
    while waiting:
        one = waiting.pop()
        if one.full_name not in known and one.file is message.file:
            known[one.full_name] = one
            waiting += [field.message_type for field in one.fields if field.message_type is not None]
    yield from known.values()


def _place(message: Any) -> tuple[int, ...]:
    """The path of a message in its file, as `SourceCodeInfo` counts it."""
    outer = message.containing_type
    if outer is None:
        beside = list(message.file.message_types_by_name)
        return FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, beside.index(message.name)
    inner = [one.name for one in outer.nested_types]
    return *_place(outer), DescriptorProto.NESTED_TYPE_FIELD_NUMBER, inner.index(message.name)
