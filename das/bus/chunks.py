"""Chunks of an MCAP file: unpacked within bounds, checked by their checksums, and parsed strictly."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import BytesIO
from typing import Final

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from das.domain.errors import DasError

HEAD: Final = struct.Struct("<QQQII")
"""The head of a chunk: times of the first and last message (ns), unpacked size (bytes), checksum, length of the
compression's name."""
MESSAGE: Final = struct.Struct("<HIQQ")
"""The head of a message: channel, running number, time recorded (ns), time sent (ns)."""
RECORD: Final = struct.Struct("<BQ")
"""The head of a record: kind, length (bytes)."""
COMPRESSIONS: Final = ("", "zstd", "lz4")
LARGEST_CHUNK_BYTES: Final = 64 << 20
"""A chunk that claims to be larger is not unpacked. Chunks of the recorder have a few kB, those of other programs some
MB."""
MOST_EXPANSION: Final = 100
"""A file may unpack to at most this many times its size. Recordings of this project unpack to 3 to 10 times."""
ALWAYS_BYTES: Final = 16 << 20
"""A file may always unpack to this many bytes, however small it is."""
MOST_MESSAGES: Final = 2_000_000
"""At most this many messages (60 hours of recording) are read from a file; more would hold up the reader."""


class ChunkError(Exception):
    """A record is damaged; `first_ns` and `last_ns` are the times of its messages, as the record states them."""

    def __init__(self, what: str, first_ns: int = 0, last_ns: int = 0) -> None:
        super().__init__(what)
        self.first_ns, self.last_ns = first_ns, last_ns


@dataclass
class Budget:
    """How much of a file may still be unpacked, so that a small file cannot keep its reader busy."""

    left_bytes: int
    left_messages: int = MOST_MESSAGES

    @classmethod
    def of(cls, size_bytes: int) -> Budget:
        """The budget of a file of this size."""
        return cls(max(ALWAYS_BYTES, MOST_EXPANSION * size_bytes))

    def take(self, size_bytes: int) -> None:
        """Spend bytes; raises DasError if fewer than these are left."""
        self.left_bytes -= size_bytes
        if self.left_bytes < 0:
            raise DasError(f"unpacks to more than {MOST_EXPANSION} times its size: not a recording")

    def take_message(self) -> None:
        """Spend one message; raises DasError if there are too many."""
        self.left_messages -= 1
        if self.left_messages < 0:
            raise DasError(f"holds more than {MOST_MESSAGES} messages: cut it into shorter recordings")


def chunk_of(content: bytes) -> records.Chunk:
    """The chunk in the content of a record; raises ChunkError if it is no chunk, or its stated length is wrong."""
    length = stated_length(content)
    if length is None:
        raise ChunkError("a chunk that cannot be read")
    if length != len(content):
        raise ChunkError("wrong length of a chunk", *HEAD.unpack_from(content)[:2])
    return records.Chunk.read(ReadDataStream(BytesIO(content)))  # type: ignore[no-any-return]


def stated_length(head: bytes) -> int | None:
    """The length of a chunk's content (bytes) that its first bytes state; None if they are not those of a chunk."""
    if len(head) < HEAD.size:
        return None
    rest: int = HEAD.size + HEAD.unpack_from(head)[4]
    named = head[HEAD.size : rest].decode("ascii", errors="replace")
    if named not in COMPRESSIONS or len(head) < rest + 8:
        return None
    return rest + 8 + int.from_bytes(head[rest : rest + 8], "little")


def error_in(chunk: records.Chunk, what: str) -> ChunkError:
    """The error for a damaged chunk, with the times of its messages as the chunk states them."""
    return ChunkError(what, chunk.message_start_time, chunk.message_end_time)


def contents(chunk: records.Chunk, budget: Budget) -> list[records.McapRecord]:
    """The schemas, channels and messages of a chunk; raises ChunkError if they are damaged.

    Raises DasError if the file unpacks to more than its budget.
    """
    plain = _unpacked(chunk, budget)
    if chunk.uncompressed_crc and zlib.crc32(plain) != chunk.uncompressed_crc:
        raise error_in(chunk, "wrong checksum in a chunk")
    found: list[records.McapRecord] = []
    at, size = 0, len(plain)
    try:
        while at < size:
            kind, length = RECORD.unpack_from(plain, at)
            start = at + RECORD.size
            at = start + length
            if at > size:
                raise error_in(chunk, "a record that is longer than its chunk")
            if kind == Opcode.MESSAGE:
                budget.take_message()
                found.append(message_of(plain[start:at]))
            elif kind == Opcode.CHANNEL:
                found.append(records.Channel.read(ReadDataStream(BytesIO(plain[start:at]))))
            elif kind == Opcode.SCHEMA:
                found.append(records.Schema.read(ReadDataStream(BytesIO(plain[start:at]))))
            else:
                raise error_in(chunk, "a chunk with something other than messages in it")
    except (ChunkError, DasError):
        raise
    except Exception as error:  # Errors of struct, UTF-8, the data's end … have no common class.
        raise error_in(chunk, "a chunk whose records cannot be read") from error
    return found


def message_of(content: bytes) -> records.Message:
    """The message in the content of a record; raises ChunkError if it is too short."""
    if len(content) < MESSAGE.size:
        raise ChunkError("a message that is too short")
    channel, sequence, log_ns, sent_ns = MESSAGE.unpack_from(content)
    return records.Message(
        channel_id=channel, sequence=sequence, log_time=log_ns, publish_time=sent_ns, data=content[MESSAGE.size :]
    )


def _unpacked(chunk: records.Chunk, budget: Budget) -> bytes:
    if chunk.uncompressed_size > LARGEST_CHUNK_BYTES:
        raise error_in(chunk, f"a chunk that claims to hold {chunk.uncompressed_size >> 20} MiB")
    budget.take(chunk.uncompressed_size)
    try:
        plain = _decompressed(chunk)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError, ValueError) as error:
        raise error_in(chunk, "a chunk that cannot be decompressed") from error
    if len(plain) != chunk.uncompressed_size:
        raise error_in(chunk, "a chunk of another size than it says")
    return plain


def _decompressed(chunk: records.Chunk) -> bytes:
    """The decompressed bytes, at most one byte more than the chunk states."""
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.data) not in (-1, chunk.uncompressed_size):
            raise ValueError("another size")
        most = max(chunk.uncompressed_size, 1)
        # Bytes after the compressed data belong to another record: then the chunk's length is damaged.
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=most, allow_extra_data=False)
    if chunk.compression == "lz4":
        frame = LZ4FrameDecompressor()
        plain = bytes(frame.decompress(chunk.data, max_length=chunk.uncompressed_size + 1))
        if frame.unused_data:
            raise ValueError("another length")
        return plain
    return chunk.data
