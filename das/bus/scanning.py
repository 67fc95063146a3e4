"""Reads an MCAP file record by record, with the library's own classes; damaged records are noted and skipped.

Chunks, attachments, all data and the index have checksums; metadata records are given one by `das.bus.sealing`.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any, Final, NamedTuple

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import CRCValidationError, breakup_chunk

from das.bus.sealing import MAGIC
from das.domain.errors import DasError

MAGIC_BYTES_WRONG: Final = 2
"""Largest number of wrong bytes among the first eight with which a file is still read as a damaged MCAP file."""
RECORD: Final = struct.Struct("<BQ")
"""The header of a record: kind, length (bytes)."""
SIGNATURE: Final = re.compile(rb"\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4")
"""The bytes that name a chunk's compression; a search for the next chunk looks for them."""
SIGNATURE_AT: Final = RECORD.size + 28
"""Offset of the compression's name in a chunk record: after the two time stamps, the size and the checksum."""
KINDS: Final[dict[int, Any]] = {one: getattr(records, one.name.title().replace("_", "")) for one in Opcode}
"""The library's class of each kind of record."""
PRIVATE: Final = 0x80
"""First number of the record kinds of other programs, which a reader skips."""
MOST_EXPANSION: Final = 100
"""Largest ratio of the unpacked size of a file to its size. The project's recordings have 3 to 10."""
ALWAYS_BYTES: Final = 4 << 20
"""Size (bytes) to which a file may always unpack, however small it is."""
MOST_MESSAGES: Final = 2_000_000
"""Most messages that are read from a file (60 hours of recording), so that reading does not take too long."""
SOMEWHERE: Final = "the checksum over all data is wrong, although every chunk is intact"
MOST_LISTED = 5
"""Largest number of damaged places that are listed one by one."""
UNCHECKED: Final = "unchecked "
"""Prefix added to the names of metadata without a checksum; no command uses such metadata."""


@dataclass(frozen=True, kw_only=True)
class Damage:
    """A damaged stretch of a file.

    `what` describes it in words. `lost`: it contained messages, attachments or metadata, which are left out.
    `from_ns` and `to_ns` are the times (ns since 1970) of its first and last message. A number of 0 is unknown.
    """

    what: str
    start_byte: int = 0
    end_byte: int = 0
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
            lines.append("the file was cut off: later messages are missing")
        if self.unchecked:
            lines.append(f"damage would go unnoticed (no checksum) in: {', '.join(self.unchecked)}")
        return lines


class FoundRecord(NamedTuple):
    """A record (None: of another program's kind), its place, and whether its own or its chunk's checksum proves it."""

    record: Any
    start_byte: int
    proven: bool


class _DamagedError(Exception):
    """A record is damaged; `times_ns` are the times of the first and last message that the record states."""

    def __init__(self, what: str, times_ns: tuple[int, int] = (0, 0)) -> None:
        super().__init__(what)
        self.times_ns = times_ns


class Scan:
    """A walk through the bytes of a file. `walk` yields the records; the attributes are complete when it has ended.

    `ended` states whether the file ends with the MCAP magic bytes, `data_proven` whether the checksum over all data is
    right (None: there is none), `index_proven` whether the checksum over the index at the end is right. `cut_byte` is
    where the last record of a cut file begins; -1 if the file ends with a whole record.
    """

    def __init__(self, data: bytes) -> None:
        """`data` is the content of the file."""
        self.data, self.size = data, len(data)
        self.ended = self.size >= 2 * len(MAGIC) and data[-len(MAGIC) :] == MAGIC
        self._file = BytesIO(data)
        self._last = self.size - len(MAGIC) * self.ended
        self.damage: list[Damage] = []
        self.data_proven: bool | None = None
        self.index_proven = self.has_footer = False
        self.cut_byte = self._data_end = -1
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
                end, found = self._record(at)
            except _DamagedError as why:
                end, found = self._after_damage(at, why), []
            yield from found
            at = end
        if self.has_footer and not self.ended and MAGIC.startswith(self.data[at:]):  # cut within its last bytes
            self.has_footer, self.cut_byte = False, at
        elif self.has_footer != self.ended or (self.ended and at < self._last):
            self._note(at, self.size, "the end of the file", lost=False)

    def _end(self, at: int) -> int:
        """The stated end of the record at a place; beyond the file if there is no record."""
        head = self.data[at : min(at + RECORD.size, self._last)]
        return at + RECORD.size + RECORD.unpack(head)[1] if len(head) == RECORD.size else self.size + 1

    def _record(self, at: int) -> tuple[int, list[FoundRecord]]:
        """The end of the record at a place, and the records in it; raises _DamagedError if they are damaged."""
        kind, end = self.data[at], self._end(at)
        if kind == Opcode.CHUNK or SIGNATURE.match(self.data, at + SIGNATURE_AT, self._last):
            return self._chunk(at)
        if end > self._last:
            raise _DamagedError("a record without its end")
        if kind >= PRIVATE:
            return end, [FoundRecord(None, at, False)]
        if kind not in KINDS:
            raise _DamagedError("a record of an unknown kind")
        record, read_to = self._read(at, kind)
        if read_to != end:
            raise _DamagedError(f"a record ({KINDS[kind].__name__}) that cannot be read")
        checksum = int.from_bytes(self.data[end - 4 : end], "little") if kind == Opcode.ATTACHMENT else 0
        if checksum and self._checksum(at + RECORD.size, end - 4) != checksum:
            raise _DamagedError("wrong checksum in an attachment")
        if kind == Opcode.DATA_END:
            self._end_of_data(record, at)
        elif kind == Opcode.FOOTER:
            self._end_of_index(record, at)
        return end, [FoundRecord(record, at, checksum != 0)]

    def _read(self, at: int, kind: int) -> tuple[Any, int]:
        """The record at a place, read with the library, and the position at which it ends."""
        self._file.seek(at + RECORD.size)
        stream, length = ReadDataStream(self._file), self._end(at) - at - RECORD.size
        try:
            record = KINDS[kind].read(stream, *([length] if kind == Opcode.MESSAGE else []))
        except Exception as error:  # Struct, UTF-8, end of the data …: there is no common class.
            raise _DamagedError(f"a record ({KINDS[kind].__name__}) that cannot be read") from error
        return record, at + RECORD.size + stream.count

    def _chunk(self, at: int) -> tuple[int, list[FoundRecord]]:
        """The end of a chunk, and its schemas, channels and messages.

        The end is that of the compressed messages: a chunk with a damaged header is read if its checksum proves them.
        """
        chunk, end = self._read(at, Opcode.CHUNK)
        times_ns, proven = (chunk.message_start_time, chunk.message_end_time), chunk.uncompressed_crc != 0
        try:
            found = self._unpacked(chunk)
        except Exception as error:  # of this module, of the library, or of a decompressor
            what = str(error) if isinstance(error, _DamagedError) else "a chunk that cannot be decompressed"
            wrong = isinstance(error, CRCValidationError)
            raise _DamagedError("wrong checksum in a chunk" if wrong else what, times_ns) from error
        if self.data[at] != Opcode.CHUNK or end != self._end(at):
            if end > self._last or not (found and proven):
                raise _DamagedError("wrong length of a chunk", times_ns)
            self._note(at, end, "the header of a chunk, whose messages are intact", lost=False)
        self._left_messages -= len(found)
        if self._left_messages < 0:
            raise DasError(f"holds more than {MOST_MESSAGES} messages: cut it into shorter recordings")
        return end, [FoundRecord(one, at, proven) for one in found]

    def _unpacked(self, chunk: records.Chunk) -> list[Any]:
        """The records in a chunk; at most one byte more than the stated size is unpacked."""
        size, packed, rest = chunk.uncompressed_size, chunk.data, b""
        if size > self._left_bytes:
            raise _DamagedError(
                f"a chunk that unpacks to {size >> 20} MiB, too much for a file of {self.size >> 10} KiB"
            )
        self._left_bytes -= size
        if chunk.compression == "zstd" and zstandard.frame_content_size(packed) in (-1, size):
            # Bytes after the compressed data belong to another record: then the chunk's length is damaged.
            unpack = zstandard.ZstdDecompressor()
            packed = unpack.decompress(packed, max_output_size=max(size, 1), allow_extra_data=False)
        elif chunk.compression == "lz4":
            frame = LZ4FrameDecompressor()
            packed, rest = frame.decompress(packed, max_length=size + 1), frame.unused_data
        if len(packed) != size or rest:
            raise _DamagedError("a chunk whose unpacked size differs from the size in its header")
        return breakup_chunk(replace(chunk, compression="", data=packed), validate_crc=True)

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

    def _after_damage(self, at: int, why: _DamagedError) -> int:
        """Record damage at a place; returns where to continue: after the damage, or at the next proven chunk."""
        end = self._end(at)
        if end != self._last and not (end < self._last and self.data[end] in KINDS and self._end(end) <= self._last):
            found = SIGNATURE.finditer(self.data, at + 1 + SIGNATURE_AT, self._last)
            end = next((x for x in (one.start() - SIGNATURE_AT for one in found) if self._is_chunk(x)), self._last)
            if end == self._last and not self.ended:
                self.cut_byte = at
                return end
        from_ns, to_ns = why.times_ns
        self._note(at, end, str(why), from_ns=from_ns, to_ns=to_ns)
        return end

    def _is_chunk(self, at: int) -> bool:
        """Whether the checksum of a chunk at a place proves its messages; `walk` notes any damage on reading them."""
        noted = len(self.damage)
        try:
            found = self._record(at)[1] if self.data[at] == Opcode.CHUNK else []
        except _DamagedError:
            found = []
        del self.damage[noted:]
        return bool(found) and found[0].proven

    def _note(self, start: int, end: int, what: str, **more: Any) -> None:
        self.damage.append(Damage(start_byte=start, end_byte=end, what=what, **more))
