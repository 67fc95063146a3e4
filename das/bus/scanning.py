"""Reads an MCAP file record by record, with the library's own classes. Damaged ones are noted and skipped, never
returned.

Chunks and attachments have checksums, and a complete file has one over all of its data and one over its index. Metadata
get a checksum of their own here, because MCAP gives them none until the file is finished.
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Final, NamedTuple

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from das.domain.errors import DasError

MAGIC: Final = b"\x89MCAP0\r\n"
MAGIC_BYTES_WRONG: Final = 2
"""Largest number of the first bytes in which a damaged MCAP file may differ from an intact one."""
RECORD: Final = struct.Struct("<BQ")
"""The header of a record: kind, length (bytes)."""
CHUNK: Final = struct.Struct("<QQQII")
"""The header of a chunk: times of the first and last message (ns), unpacked size (bytes), checksum, length of the
compression's name."""
MESSAGE: Final = struct.Struct("<HIQQ")
"""The header of a message: channel, sequence number, time recorded (ns), time sent (ns)."""
SIGNATURE: Final = re.compile(rb"\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4")
"""The bytes that name a chunk's compression; a search for the next chunk looks for them."""
SIGNATURE_AT: Final = RECORD.size + CHUNK.size - 4
"""The byte of a chunk's record at which its compression is named."""
KINDS: Final[dict[int, Any]] = {one: getattr(records, one.name.title().replace("_", "")) for one in Opcode}
"""The library's class of each kind of record."""
PRIVATE: Final = 0x80
"""First number of the record kinds of other programs, which a reader skips."""
MOST_EXPANSION: Final = 100
"""Largest ratio of the unpacked size of a file to its size. The project's recordings have 3 to 10."""
ALWAYS_BYTES: Final = 16 << 20
"""Size (bytes) to which a file may always unpack, however small it is."""
MOST_MESSAGES: Final = 2_000_000
"""Largest number of messages that are read from a file (60 hours of recording); more would delay the reader too
much."""
SOMEWHERE: Final = "wrong checksum of the data, whose messages are intact"
MOST_LISTED = 5
"""Largest number of damaged places that are listed one by one."""
CHECKSUM: Final = "crc32"
"""The key of the hexadecimal checksum over the name of a metadata record and its other entries."""
UNCHECKED: Final = "unchecked "
"""The prefix to the name of metadata without any checksum; no command uses such metadata."""


@dataclass(frozen=True, kw_only=True)
class Damage:
    """A damaged stretch of a file.

    `what` describes it in words. `lost`: it contained messages, attachments or metadata, which are left out.
    `from_ns` and `to_ns` are the times (ns since 1970) of its first and last message; 0 if the file does not state
    them.
    """

    start_byte: int
    end_byte: int
    what: str
    lost: bool = True
    from_ns: int = 0
    to_ns: int = 0

    def __str__(self) -> str:
        return f"{self.what} (bytes {self.start_byte} to {self.end_byte})" if self.end_byte else self.what


@dataclass(frozen=True, kw_only=True)
class Health:
    """The health of a file as found while reading it.

    `complete` is False for a file that was cut off. `cut_byte` is where a truncated last record begins (-1: none).
    `missing` is the number of messages missing according to the sequence numbers; None if these do not rise through the
    file. `unchecked` names the parts without a checksum.
    """

    size_bytes: int
    complete: bool
    damage: tuple[Damage, ...] = ()
    cut_byte: int = -1
    missing: int | None = None
    unchecked: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether the file is complete and undamaged, with no message missing."""
        return self.complete and not self.damage and not self.missing

    def warnings(self) -> list[str]:
        """Lines of text for a reader: damage, missing messages, a cut, and parts without a checksum."""
        lines = [f"damaged: {one}{'; it is left out' if one.lost else ''}" for one in self.damage[:MOST_LISTED]]
        if len(self.damage) > MOST_LISTED:
            lines.append(f"damaged: {len(self.damage) - MOST_LISTED} more places")
        if self.missing:
            lines.append(f"{self.missing} messages are missing, according to their sequence numbers")
        if not self.complete:
            lines.append("it was cut off: it contains only messages written before")
        if self.unchecked:
            lines.append(f"damage would go unnoticed (no checksum) in: {', '.join(self.unchecked)}")
        return lines


def sealed(name: str, data: Mapping[str, str]) -> dict[str, str]:
    """The entries of a metadata record with their checksum."""
    return {**data, CHECKSUM: f"{zlib.crc32(json.dumps([name, sorted(data.items())]).encode()):08x}"}


def unsealed(name: str, data: Mapping[str, str]) -> tuple[dict[str, str], bool | None]:
    """The entries of a metadata record without their checksum, and whether it is right (None: there is none)."""
    entries = {key: value for key, value in data.items() if key != CHECKSUM}
    return entries, None if CHECKSUM not in data else sealed(name, entries) == data


class FoundRecord(NamedTuple):
    """A record, its place in the file, and whether it has a valid checksum of its own."""

    record: Any
    start_byte: int
    proven: bool


class _DamagedError(Exception):
    """A record is damaged; `times_ns` are those of its first and last message, as it states them."""

    def __init__(self, what: str, times_ns: tuple[int, int] = (0, 0)) -> None:
        super().__init__(what)
        self.times_ns = times_ns


class Scan:
    """A walk through the bytes of a file. `walk` yields the records; the attributes are complete when it has ended.

    `ended` states whether the file has its last bytes, `data_proven` whether the checksum over all data is right (None:
    there is none), and `index_proven` whether the one over the index at the end is right. `cut_byte` is where the last
    record of a cut file begins; -1 if the file ends with a whole record.
    """

    def __init__(self, data: bytes) -> None:
        """`data` is the content of the file."""
        self.data, self.size = data, len(data)
        self.ended = self.size >= 2 * len(MAGIC) and data[-len(MAGIC) :] == MAGIC
        self._last = self.size - len(MAGIC) * self.ended
        self.damage: list[Damage] = []
        self.data_proven: bool | None = None
        self.index_proven = self.has_footer = False
        self.cut_byte = self._data_end = -1
        self._unknown: list[tuple[int, int]] = []
        self._left_bytes = max(ALWAYS_BYTES, MOST_EXPANSION * self.size)
        self._left_messages = MOST_MESSAGES

    def walk(self) -> Iterator[FoundRecord]:
        """Yield the records of the data and of the index in their order.

        Raises DasError for a file that is not MCAP, or too large to read when unpacked.
        """
        first = self.data[: len(MAGIC)]
        wrong = sum(a != b for a, b in zip(first, MAGIC, strict=False))
        if len(first) < len(MAGIC) or wrong > MAGIC_BYTES_WRONG:
            raise DasError("not an MCAP recording" if self.size else "is empty: nothing was recorded")
        if wrong:
            self._note(0, len(MAGIC), "the first bytes of the file", lost=False)
        at = len(MAGIC)
        while at < self._last and not self.has_footer:
            try:
                end, found = self._end(at), self._record(at)
            except _DamagedError as why:
                end, found = self._after_damage(at, why)
            yield from found
            at = end
        self._finish(at)

    def _finish(self, at: int) -> None:
        """Record the damage that shows only after the whole walk."""
        if self.has_footer and not self.ended and MAGIC.startswith(self.data[at:]):  # cut within its last bytes
            self.has_footer, self.cut_byte = False, at
        elif self.has_footer != self.ended or (self.ended and at < self._last):
            self._note(at, self.size, "the end of the file", lost=False)
        if self.data_proven is not True:
            for start, end in self._unknown:
                self._note(start, end, "a record of an unknown kind")
        self.damage.sort(key=lambda one: one.start_byte)

    def _end(self, at: int) -> int:
        """The stated end of the record at a place; beyond the file where there is no record."""
        head = self.data[at : min(at + RECORD.size, self._last)]
        return at + RECORD.size + RECORD.unpack(head)[1] if len(head) == RECORD.size else self.size + 1

    def _record(self, at: int) -> list[FoundRecord]:
        """The records at a place; raises _DamagedError if they are damaged."""
        kind, end = self.data[at], self._end(at)
        if end > self._last:
            raise _DamagedError("a record without its end")
        if kind == Opcode.CHUNK:
            return self._chunk(at, end)
        if SIGNATURE.match(self.data, at + SIGNATURE_AT, end):
            raise _DamagedError("wrong kind of a record")
        content = self.data[at + RECORD.size : end]
        if kind == Opcode.MESSAGE:
            return [FoundRecord(_message(content), at, False)]
        if kind >= PRIVATE:
            self._unknown.append((at, end))
            return []
        if kind not in KINDS:
            raise _DamagedError("a record of no known kind")
        checksum = int.from_bytes(content[-4:], "little") if kind == Opcode.ATTACHMENT else 0
        if checksum and zlib.crc32(content[:-4]) != checksum:
            raise _DamagedError("wrong checksum in an attachment")
        record = _read(KINDS[kind], content)
        if isinstance(record, records.DataEnd):
            self._end_of_data(record, at)
        elif isinstance(record, records.Footer):
            self._end_of_index(record, at)
        return [FoundRecord(record, at, checksum != 0)]

    def _chunk(self, at: int, end: int) -> list[FoundRecord]:
        """The schemas, channels and messages of a chunk, proven by its checksum."""
        if end - at < RECORD.size + CHUNK.size:
            raise _DamagedError("a chunk that cannot be read")
        first_ns, last_ns, _, checksum, _ = CHUNK.unpack_from(self.data, at + RECORD.size)
        times_ns = first_ns, last_ns
        if self._chunk_end(at) != end:
            raise _DamagedError("wrong length of a chunk", times_ns)
        try:
            plain = self._unpacked(_read(records.Chunk, self.data[at + RECORD.size : end]))
            if checksum and zlib.crc32(plain) != checksum:
                raise _DamagedError("wrong checksum in a chunk")
            found = list(self._inside(plain))
        except _DamagedError as error:
            raise _DamagedError(str(error), times_ns) from error
        except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError, ValueError) as error:
            raise _DamagedError("a chunk that cannot be decompressed", times_ns) from error
        return [FoundRecord(one, at, checksum != 0) for one in found]

    def _unpacked(self, chunk: records.Chunk) -> bytes:
        """The unpacked content of a chunk, never more than one byte beyond the size that it states."""
        size, packed, rest = chunk.uncompressed_size, chunk.data, b""
        if chunk.compression == "zstd" and zstandard.frame_content_size(packed) not in (-1, size):
            raise _DamagedError("a chunk of another size than it states")
        if size > self._left_bytes:
            raise _DamagedError(
                f"a chunk that unpacks to {size >> 20} MiB, too much for a file of {self.size >> 10} KiB"
            )
        self._left_bytes -= size
        if chunk.compression == "zstd":
            # Bytes after the compressed data belong to another record: then the chunk's length is damaged.
            unpack = zstandard.ZstdDecompressor()
            packed = unpack.decompress(packed, max_output_size=max(size, 1), allow_extra_data=False)
        elif chunk.compression == "lz4":
            frame = LZ4FrameDecompressor()
            packed, rest = frame.decompress(packed, max_length=size + 1), frame.unused_data
        if len(packed) != size or rest:
            raise _DamagedError("a chunk of another size than it states")
        return bytes(packed)

    def _inside(self, plain: bytes) -> Iterator[Any]:
        """The records in an unpacked chunk."""
        kinds, at = (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA), 0
        while at < len(plain):
            kind, length = RECORD.unpack_from(plain, at) if at + RECORD.size <= len(plain) else (0, 0)
            content = plain[at + RECORD.size : at + RECORD.size + length]
            if kind not in kinds:
                raise _DamagedError("a chunk that contains other records than messages")
            if len(content) < length:
                raise _DamagedError("a record that is longer than its chunk")
            self._left_messages -= kind == Opcode.MESSAGE
            if self._left_messages < 0:
                raise DasError(f"holds more than {MOST_MESSAGES} messages: cut it into shorter recordings")
            yield _message(content) if kind == Opcode.MESSAGE else _read(KINDS[kind], content)
            at += RECORD.size + length

    def _chunk_end(self, at: int) -> int:
        """Where a chunk at a place ends by the length of its packed messages; beyond the file if it is no chunk."""
        signature = SIGNATURE.match(self.data, at + SIGNATURE_AT)
        start = signature.end() if signature else at + SIGNATURE_AT + 4
        plain = signature is None and not any(self.data[at + SIGNATURE_AT : start])  # without compression
        if not (signature or plain) or start + 8 > self._last:
            return self.size + 1
        return start + 8 + int.from_bytes(self.data[start : start + 8], "little")

    def _end_of_data(self, record: records.DataEnd, at: int) -> None:
        if self._data_end >= 0:
            raise _DamagedError("a second end of the data")
        self._data_end = at
        if record.data_section_crc:
            self.data_proven = self._checksum(0, at) == record.data_section_crc
            if not self.data_proven and not self.damage:
                self._note(0, at, SOMEWHERE, lost=False)

    def _end_of_index(self, record: records.Footer, at: int) -> None:
        self.has_footer = True
        if self._data_end < 0:
            self._note(at, at, "the mark at the end of the data is missing", lost=False)
        if record.summary_crc:
            start = record.summary_start or at
            right = self._checksum(start, at + RECORD.size + 16) == record.summary_crc
            self.index_proven = right and self._data_end < start <= at
            if not self.index_proven:
                self._note(min(start, at), self.size, "wrong checksum of the index, which is not used", lost=False)

    def _checksum(self, start: int, end: int) -> int:
        return zlib.crc32(memoryview(self.data)[start:end])

    def _after_damage(self, at: int, why: _DamagedError) -> tuple[int, list[FoundRecord]]:
        """Record damage at a place; returns where to continue, and the records of the chunk found here or later."""
        if here := self._sound_chunk(at):
            self._note(at, here[0], "the header of a chunk, whose messages are intact", lost=False)
            return here
        end = self._end(at)
        if end == self._last or (end < self._last and self.data[end] in KINDS and self._end(end) <= self._last):
            self._note(at, end, str(why), times_ns=why.times_ns)
            return end, []
        for signature in SIGNATURE.finditer(self.data, at + 1 + SIGNATURE_AT, self._last):
            place = signature.start() - SIGNATURE_AT
            if self.data[place] == Opcode.CHUNK and (found := self._sound_chunk(place)):
                self._note(at, place, str(why))
                return found
        if self.ended:
            self._note(at, self._last, str(why))
        else:
            self.cut_byte = at
        return self._last, []

    def _sound_chunk(self, at: int) -> tuple[int, list[FoundRecord]] | None:
        """The end of the chunk at a place, as it states itself, and its records; None if there is no intact one."""
        end = self._chunk_end(at)
        try:
            found = self._chunk(at, end) if end <= self._last else []
        except _DamagedError:
            return None
        return (end, found) if found and found[0].proven else None

    def _note(self, start: int, end: int, what: str, *, lost: bool = True, times_ns: tuple[int, int] = (0, 0)) -> None:
        from_ns, to_ns = times_ns
        self.damage.append(Damage(start_byte=start, end_byte=end, what=what, lost=lost, from_ns=from_ns, to_ns=to_ns))


def _read(kind: Any, content: bytes) -> Any:
    """A record by the library's reader; raises _DamagedError if it cannot be read, or has another length."""
    stream = ReadDataStream(BytesIO(content))
    try:
        record = kind.read(stream)
    except Exception as error:  # Struct, UTF-8, end of the data …: there is no common class.
        raise _DamagedError(f"a record ({kind.__name__}) that cannot be read") from error
    if stream.count != len(content):
        raise _DamagedError(f"a record ({kind.__name__}) that cannot be read")
    return record


def _message(content: bytes) -> records.Message:
    """The message in the content of a record, faster than by the library's reader."""
    if len(content) < MESSAGE.size:
        raise _DamagedError("a message that is too short")
    channel, sequence, log_ns, sent_ns = MESSAGE.unpack_from(content)
    return records.Message(channel, log_ns, content[MESSAGE.size :], sent_ns, sequence)
