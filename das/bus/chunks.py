"""Chunks of an MCAP file: unpacked within bounds, checked by their checksum, and taken apart strictly."""

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
"""Times of the first and the last message (ns), unpacked size (bytes), checksum, length of the compression's name."""
MESSAGE: Final = struct.Struct("<HIQQ")
"""Channel, running number, time recorded (ns), time sent (ns)."""
RECORD: Final = struct.Struct("<BQ")
COMPRESSIONS: Final = ("", "zstd", "lz4")
LARGEST_CHUNK_BYTES: Final = 64 << 20
"""The recorder's chunks are a few kB, other programs' some MB; one that claims more than this is not unpacked."""
MOST_EXPANSION: Final = 100
ALWAYS_BYTES: Final = 16 << 20
"""A file may unpack to this many times its size, or to this many bytes. Recordings of ours unpack to 3 to 10 times."""
MOST_MESSAGES: Final = 2_000_000
"""A recording of 60 hours has as many messages; a file with more would hold up its reader."""


class ChunkError(Exception):
    """A record is not as it was written; `first_ns` and `last_ns` are the times of its messages as it states them."""

    def __init__(self, what: str, first_ns: int = 0, last_ns: int = 0) -> None:
        super().__init__(what)
        self.first_ns, self.last_ns = first_ns, last_ns


@dataclass
class Budget:
    """What may still be unpacked of a file; a small file cannot keep its reader busy, whatever it claims."""

    left_bytes: int
    left_messages: int = MOST_MESSAGES

    @classmethod
    def of(cls, size_bytes: int) -> Budget:
        """The budget of a file by its size."""
        return cls(max(ALWAYS_BYTES, MOST_EXPANSION * size_bytes))

    def take(self, size_bytes: int) -> None:
        """Spend bytes; raises DasError where there are not so many left."""
        self.left_bytes -= size_bytes
        if self.left_bytes < 0:
            raise DasError(f"unpacks to more than {MOST_EXPANSION} times its size: not a recording")

    def take_message(self) -> None:
        """Spend one message; raises DasError where there are too many."""
        self.left_messages -= 1
        if self.left_messages < 0:
            raise DasError(f"holds more than {MOST_MESSAGES} messages: cut it into shorter recordings")


@dataclass(frozen=True)
class Chunk:
    """A chunk as it stands in the file: where its record begins, its stated times (ns), size and checksum.

    `length` is the length of the record's content by the chunk's own words (bytes).
    """

    at: int
    first_ns: int
    last_ns: int
    plain_bytes: int
    crc: int
    compression: str
    length: int
    packed: bytes

    @property
    def end(self) -> int:
        """Where the chunk's record ends in the file (byte)."""
        return self.at + RECORD.size + self.length

    def error(self, what: str) -> ChunkError:
        """Something is wrong with this chunk."""
        return ChunkError(what, self.first_ns, self.last_ns)


def chunk_at(content: bytes, at: int, *, whole: bool = True) -> Chunk:
    """The chunk whose record begins at byte `at` of the file; `content` is what follows the record's kind and length.

    With `whole` false, `content` may hold the head alone. Raises ChunkError where it is no chunk.
    """
    if len(content) < HEAD.size:
        raise ChunkError("a chunk that is too short")
    first_ns, last_ns, plain_bytes, crc, letters = HEAD.unpack_from(content)
    name, rest = content[HEAD.size : HEAD.size + letters], HEAD.size + letters
    if letters > 4 or name.decode("ascii", errors="replace") not in COMPRESSIONS or len(content) < rest + 8:
        raise ChunkError("a chunk that cannot be read")
    packed_bytes = int.from_bytes(content[rest : rest + 8], "little")
    packed = content[rest + 8 : rest + 8 + packed_bytes]
    if whole and len(packed) < packed_bytes:
        raise ChunkError("a chunk that cannot be read")
    length = rest + 8 + packed_bytes
    return Chunk(at, first_ns, last_ns, plain_bytes, crc, name.decode("ascii"), length, packed)


def contents(chunk: Chunk, budget: Budget) -> list[records.McapRecord]:
    """The schemas, channels and messages of a chunk; raises ChunkError where they are not as written.

    Raises DasError where the file unpacks to more than its budget.
    """
    plain = _unpacked(chunk, budget)
    if chunk.crc and zlib.crc32(plain) != chunk.crc:
        raise chunk.error("wrong checksum in a chunk")
    found: list[records.McapRecord] = []
    at, size = 0, len(plain)
    try:
        while at < size:
            kind, length = RECORD.unpack_from(plain, at)
            start = at + RECORD.size
            at = start + length
            if at > size:
                raise chunk.error("a record that is longer than its chunk")
            if kind == Opcode.MESSAGE:
                budget.take_message()
                found.append(message_of(plain[start:at]))
            elif kind == Opcode.CHANNEL:
                found.append(records.Channel.read(ReadDataStream(BytesIO(plain[start:at]))))
            elif kind == Opcode.SCHEMA:
                found.append(records.Schema.read(ReadDataStream(BytesIO(plain[start:at]))))
            else:
                raise chunk.error("a chunk with something other than messages in it")
    except (ChunkError, DasError):
        raise
    except Exception as error:  # Struct, UTF-8, end of the data …: there is no common class.
        raise chunk.error("a chunk whose records cannot be read") from error
    return found


def message_of(content: bytes) -> records.Message:
    """A message's record from its content; raises ChunkError where it is too short."""
    if len(content) < MESSAGE.size:
        raise ChunkError("a message that is too short")
    channel, sequence, log_ns, sent_ns = MESSAGE.unpack_from(content)
    return records.Message(
        channel_id=channel, sequence=sequence, log_time=log_ns, publish_time=sent_ns, data=content[MESSAGE.size :]
    )


def _unpacked(chunk: Chunk, budget: Budget) -> bytes:
    if chunk.plain_bytes > LARGEST_CHUNK_BYTES:
        raise chunk.error(f"a chunk that claims to hold {chunk.plain_bytes >> 20} MiB")
    budget.take(chunk.plain_bytes)
    try:
        plain = _decompressed(chunk)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError, ValueError) as error:
        raise chunk.error("a chunk that cannot be decompressed") from error
    if len(plain) != chunk.plain_bytes:
        raise chunk.error("a chunk of another size than it says")
    return plain


def _decompressed(chunk: Chunk) -> bytes:
    """The plain bytes, never more than the chunk says plus one."""
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.packed) not in (-1, chunk.plain_bytes):
            raise ValueError("another size")
        return zstandard.ZstdDecompressor().decompress(chunk.packed, max_output_size=max(chunk.plain_bytes, 1))
    if chunk.compression == "lz4":
        return bytes(LZ4FrameDecompressor().decompress(chunk.packed, max_length=chunk.plain_bytes + 1))
    return chunk.packed
