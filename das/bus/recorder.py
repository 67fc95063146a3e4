"""The recorder: everything said on the bus into one MCAP file, on disk within a second.

Runs as a process of its own: python -m das.bus.recorder --train T --listen E --connect E --out F.
Log time is the run's clock (the last Control message, else the wall clock), publish time the message's own.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from google.protobuf.message import Message
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import register_schema

from das import __version__
from das.bus import das_pb2
from das.bus.session import Bus, Received, check_endpoint
from das.bus.topics import CONTROL, RECORDED, RECORDER, Topic
from das.commands import StopFlag, run_command
from das.domain.errors import DasError

FLUSH_EVERY_S = 1.0
"""Default chunking would lose up to 1 MiB when the process is killed."""


class RecordingFile:
    """An MCAP file under way: protobuf messages of our topics, metadata, attachments; CRCs on."""

    def __init__(self, path: Path) -> None:
        try:
            self._file: IO[bytes] = path.open("wb")
        except OSError as error:
            raise DasError(f"{path}: cannot be written ({error.strerror})") from error
        self.path = path
        self.messages = 0
        self._writer: Any = McapWriter(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(profile="", library=f"driver-advisory-system {__version__}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._flushed = time.monotonic()

    def add(self, topic: Topic, key: str, message: Message, log_time_ns: int) -> None:
        """Write one message (to disk with the next flush)."""
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._register(topic, key)
        sent_ns = message_time_ns(message) or log_time_ns
        self._writer.add_message(channel, log_time_ns, message.SerializeToString(), sent_ns, self.messages)
        self.messages += 1

    def flush_if_due(self) -> None:
        """Put what was written on disk, at most once a second."""
        now = time.monotonic()
        if now - self._flushed >= FLUSH_EVERY_S:
            self.flush()

    def flush(self) -> None:
        self._writer.flush()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._flushed = time.monotonic()

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        self._writer.add_metadata(name, data)

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        self._writer.add_attachment(time.time_ns(), time.time_ns(), name, media_type, content)

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
            schema = self._schemas[name] = register_schema(self._writer, topic.message)
        return int(self._writer.register_channel(key, "protobuf", schema))


def message_time_ns(message: Any) -> int:
    """The time a message states (ns since 1970), 0 where it has none."""
    if hasattr(message, "time_ns"):
        return int(message.time_ns)
    if hasattr(message, "timestamp"):
        return int(message.timestamp.ToNanoseconds())
    return 0


class Recorder:
    """Writes what it hears; answers every Control message with its count, so that a fast sender can wait."""

    def __init__(self, bus: Bus, file: RecordingFile, clock_ns: int | None) -> None:
        self.bus, self.file = bus, file
        self._clock_ns = clock_ns

    def take(self, received: Received) -> None:
        """Write one message as heard; a payload that is not of its topic's type is left out."""
        if received.message is None:
            return
        if received.topic is CONTROL:
            self._clock_ns = received.message.time_ns
        log_time_ns = self._clock_ns if self._clock_ns is not None else time.time_ns()
        self.file.add(received.topic, received.key, received.message, log_time_ns)
        if received.topic is CONTROL:
            self.report(received.message.tick)

    def report(self, tick: int = 0) -> None:
        """Say how many messages are written."""
        status = das_pb2.RecorderStatus(
            time_ns=time.time_ns(), tick=tick, messages=self.file.messages, file=self.file.path.name
        )
        self.bus.publish(RECORDER, status)


def record(arguments: argparse.Namespace) -> None:
    """Record until told to stop."""
    try:
        _record(arguments, StopFlag(with_parent=arguments.with_parent))
    except OSError as error:
        raise DasError(f"{arguments.out}: cannot be written ({error.strerror})") from error


def _record(arguments: argparse.Namespace, stop: StopFlag) -> None:
    file = RecordingFile(Path(arguments.out))
    try:
        for path in arguments.attach:
            file.add_attachment(Path(path).name, "application/octet-stream", Path(path).read_bytes())
        if arguments.metadata:
            file.add_metadata("run", json.loads(arguments.metadata))
        with Bus(arguments.train, listen=arguments.listen, connect=arguments.connect, hear=RECORDED) as bus:
            recorder = Recorder(bus, file, arguments.start_ns)
            said = 0.0
            while not stop.stopped:
                received = bus.receive(0.1)
                if received is not None:
                    recorder.take(received)
                file.flush_if_due()
                if time.monotonic() - said > 1.0:
                    recorder.report()
                    said = time.monotonic()
            while (received := bus.receive(0)) is not None:
                recorder.take(received)
    finally:
        file.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the recorder process."""
    parser = argparse.ArgumentParser(prog="das.bus.recorder", description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--train", required=True, help="train name, the second part of every key")
    parser.add_argument("--listen", type=check_endpoint, required=True, help="own endpoint, tcp/127.0.0.1:PORT")
    parser.add_argument(
        "--connect", type=check_endpoint, action="append", default=[], help="endpoint of another process"
    )
    parser.add_argument("--out", required=True, help="MCAP file to write")
    parser.add_argument("--start-ns", type=int, help="the run's clock before its first Control message [default: wall]")
    parser.add_argument("--with-parent", action="store_true", help="end when the process that started it ends")
    parser.add_argument("--metadata", help="JSON object of texts, stored as metadata record 'run'")
    parser.add_argument("--attach", action="append", default=[], help="file to attach")
    parsed = parser.parse_args(arguments)
    run_command(lambda: record(parsed))


if __name__ == "__main__":
    main()
