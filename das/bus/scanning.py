"""Walks through an MCAP file record by record. Damaged records are noted and skipped, never returned.

Each chunk and each attachment has a checksum, and a complete file has one over all of its data. If the length of a
record is damaged, the walk goes on at the next chunk whose checksum is right. Metadata get a checksum of their own
here, because MCAP gives them none until the file is finished.
"""

from __future__ import annotations

import contextlib
import json
import zlib
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, Any, Final, NamedTuple

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from das.bus.chunks import HEAD, Budget, ChunkError, chunk_of, contents, message_of, stated_length
from das.domain.errors import DasError

MAGIC: Final = b"\x89MCAP0\r\n"
HEAD_BYTES: Final = 9
"""Every record begins with its kind (1 byte) and its length (8 bytes)."""
PRIVATE: Final = 0x80
"""Record kinds from this number on belong to other programs; a reader skips them."""
SIGNATURES: Final = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
"""The bytes in a chunk that name its compression; a search for the next chunk looks for them."""
SIGNATURE_AT: Final = 37
"""The byte of a chunk's record at which its compression is named."""
WINDOW_BYTES: Final = 1 << 20
LARGEST_RECORD_BYTES: Final = 1 << 30
MAGIC_BYTES_WRONG: Final = 2
"""A file whose first bytes differ from those of an MCAP file in at most this many places counts as a damaged one."""
SIMPLE: Final[dict[int, Any]] = {
    Opcode.HEADER: records.Header,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.CHUNK_INDEX: records.ChunkIndex,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex,
    Opcode.STATISTICS: records.Statistics,
    Opcode.METADATA: records.Metadata,
    Opcode.METADATA_INDEX: records.MetadataIndex,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset,
    Opcode.DATA_END: records.DataEnd,
    Opcode.FOOTER: records.Footer,
}
SOMEWHERE: Final = "wrong checksum of the data, whose messages are whole"
OTHERS: Final = (Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.MESSAGE, Opcode.MESSAGE_INDEX)
MOST_LISTED = 5
"""At most this many places of damage are listed one by one."""
CHECKSUM: Final = "crc32"
"""The key of the hexadecimal checksum over the name of a metadata record and its other entries."""
UNCHECKED: Final = "unchecked "
"""The prefix to the name of metadata without any checksum; no command uses such metadata."""


@dataclass(frozen=True, kw_only=True)
class Damage:
    """A damaged stretch of a file.

    `what` describes it in words. `lost` says whether it held messages, attachments or metadata, which are left out.
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

    `complete` is False for a file that was cut off. `cut_byte` is where the record begins that was cut in two (-1: none
    was). `missing` counts messages that are missing according to the running numbers; None if these do not rise through
    the file. `unchecked` names the parts without a checksum.
    """

    size_bytes: int
    complete: bool
    damage: tuple[Damage, ...] = ()
    cut_byte: int = -1
    missing: int | None = None
    unchecked: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether the file is whole, undamaged and without holes."""
        return self.complete and not self.damage and not self.missing

    def warnings(self) -> list[str]:
        """Lines of text for a reader: damage, missing messages, a cut, and parts without a checksum."""
        lines = [f"damaged: {one}{'; it is left out' if one.lost else ''}" for one in self.damage[:MOST_LISTED]]
        if len(self.damage) > MOST_LISTED:
            lines.append(f"damaged: {len(self.damage) - MOST_LISTED} more places")
        if self.missing:
            lines.append(f"{self.missing} messages are missing, by their running numbers")
        if not self.complete:
            lines.append("it was cut off: it holds what was written before")
        if self.unchecked:
            lines.append(f"damage would not be seen, for there is no checksum, in: {', '.join(self.unchecked)}")
        return lines


def sealed(name: str, data: Mapping[str, str]) -> dict[str, str]:
    """The entries of a metadata record with their checksum."""
    return {**data, CHECKSUM: f"{_checksum(name, data):08x}"}


def unsealed(name: str, data: Mapping[str, str]) -> tuple[dict[str, str], bool | None]:
    """The entries of a metadata record without their checksum, and whether it is right (None: there is none)."""
    entries = {key: value for key, value in data.items() if key != CHECKSUM}
    if CHECKSUM not in data:
        return entries, None
    return entries, data[CHECKSUM] == f"{_checksum(name, entries):08x}"


def _checksum(name: str, data: Mapping[str, str]) -> int:
    return zlib.crc32(json.dumps([name, sorted(data.items())], ensure_ascii=True).encode())


def begun(library: str) -> bytes:
    """The first bytes of a recording that a program has begun to write."""
    name = library.encode()
    content = (0).to_bytes(4, "little") + len(name).to_bytes(4, "little") + name
    return MAGIC + bytes([Opcode.HEADER]) + len(content).to_bytes(8, "little") + content


class FoundRecord(NamedTuple):
    """A record, where it begins in the file, and whether a checksum of its own proves it."""

    record: records.McapRecord
    start_byte: int
    proven: bool


@dataclass
class Scan:
    """A walk through a file. `walk` yields the records; the attributes are complete when it has ended.

    `ended` states whether the file has its last bytes, `data_proven` whether the checksum over all data is right (None:
    there is none), and `index_proven` whether the one over the index at the end is right. `cut_byte` is where the last
    record of a cut file begins; -1 if the file ends with a whole record.
    """

    file: IO[bytes]
    size: int
    damage: list[Damage] = field(default_factory=list)
    ended: bool = False
    data_proven: bool | None = None
    index_proven: bool | None = None
    has_footer: bool = False
    cut_byte: int = -1

    def __post_init__(self) -> None:
        self.budget = Budget.of(self.size)
        self._data_end = -1
        self._unknown: list[tuple[int, int]] = []

    def walk(self) -> Iterator[FoundRecord]:
        """Yield the records of the data and of the index in their order; raises DasError for a file that is no MCAP."""
        self._check_magic()
        at = len(MAGIC)
        last = self.size - len(MAGIC) if self.ended else self.size
        while at < last and not self.has_footer:
            head = self._read(at, HEAD_BYTES)
            if len(head) < HEAD_BYTES:
                self._note_end(at, last)
                break
            end = at + HEAD_BYTES + int.from_bytes(head[1:], "little")
            try:
                found = self._record(at, head[0], end, last)
            except ChunkError as error:
                at = yield from self._after_damage(at, end, last, error)
                continue
            yield from found
            at = end
        self._finish(at, last)

    def _finish(self, at: int, last: int) -> None:
        """Note the damage that only the whole walk can show."""
        if self.ended and at < last:
            self._note(at, last, "bytes behind the end of the index", lost=False)
        if self.has_footer and not self.ended:
            if MAGIC.startswith(self._read(at, len(MAGIC))):  # cut within its last bytes
                self.has_footer, self.cut_byte = False, at
            else:
                self._note(at, self.size, "the last bytes of the file", lost=False)
        if self.ended and not self.has_footer:
            self._note(at, last, "the end of the index is missing", lost=False)
        if self.data_proven is not True:
            for start, end in self._unknown:
                self._note(start, end, "a record of an unknown kind")
        self.damage.sort(key=lambda one: one.start_byte)

    def _check_magic(self) -> None:
        first = self._read(0, len(MAGIC))
        wrong = sum(a != b for a, b in zip(first, MAGIC, strict=False))
        if len(first) < len(MAGIC) or wrong > MAGIC_BYTES_WRONG:
            raise DasError("not an MCAP recording" if self.size else "is empty: nothing was recorded")
        if wrong:
            self._note(0, len(MAGIC), "the first bytes of the file", lost=False)
        self.ended = self.size >= 2 * len(MAGIC) and self._read(self.size - len(MAGIC), len(MAGIC)) == MAGIC

    def _record(self, at: int, kind: int, end: int, last: int) -> list[FoundRecord]:
        """The records at a place; raises ChunkError if they are damaged."""
        if end > last or end - at > LARGEST_RECORD_BYTES:
            raise ChunkError("a record is longer than the file")
        content = self._read(at + HEAD_BYTES, end - at - HEAD_BYTES)
        if kind == Opcode.CHUNK:
            return self._of_chunk(chunk_of(content), at, end)
        if content[SIGNATURE_AT - HEAD_BYTES :].startswith(SIGNATURES):
            raise ChunkError("wrong kind of a record")
        if kind == Opcode.ATTACHMENT:
            return [self._attachment(at, content)]
        if kind == Opcode.MESSAGE_INDEX:  # not used, but it may be a damaged chunk
            if len(content) < 6 or int.from_bytes(content[2:6], "little") != len(content) - 6 or len(content) % 16 != 6:
                raise ChunkError("a record (MessageIndex) that cannot be read")
            return []
        if kind == Opcode.MESSAGE:
            return [FoundRecord(message_of(content), at, False)]
        if kind >= PRIVATE:
            self._unknown.append((at, end))
            return []
        return [self._simple(at, kind, content)]

    def _simple(self, at: int, kind: int, content: bytes) -> FoundRecord:
        """A record without a checksum of its own."""
        made = SIMPLE.get(kind)
        if made is None:
            raise ChunkError("a record of no known kind")
        stream = ReadDataStream(BytesIO(content))
        what = f"a record ({made.__name__}) that cannot be read"
        try:
            record: records.McapRecord = made.read(stream)
        except Exception as error:  # Struct, UTF-8, end of the data …: there is no common class.
            raise ChunkError(what) from error
        if stream.count != len(content):
            raise ChunkError(what)
        if isinstance(record, records.DataEnd):
            self._end_of_data(record, at)
        elif isinstance(record, records.Footer):
            self._end_of_index(record, at)
        return FoundRecord(record, at, False)

    def _of_chunk(self, chunk: records.Chunk, at: int, end: int) -> list[FoundRecord]:
        """The records of a chunk, each proven by the chunk's checksum."""
        found = [FoundRecord(record, at, chunk.uncompressed_crc != 0) for record in contents(chunk, self.budget)]
        times = [one.record.log_time for one in found if isinstance(one.record, records.Message)]
        if times and (min(times), max(times)) != (chunk.message_start_time, chunk.message_end_time):
            self._note(at, end, "wrong times in the head of a chunk, whose messages are whole", lost=False)
        return found

    def _attachment(self, at: int, content: bytes) -> FoundRecord:
        stated = int.from_bytes(content[-4:], "little")
        if stated and zlib.crc32(content[:-4]) != stated:
            raise ChunkError("wrong checksum in an attachment")
        try:
            attachment = records.Attachment.read(ReadDataStream(BytesIO(content)))
        except Exception as error:  # Struct, UTF-8, end of the data …: there is no common class.
            raise ChunkError("an attachment that cannot be read") from error
        return FoundRecord(attachment, at, stated != 0)

    def _end_of_data(self, record: records.DataEnd, at: int) -> None:
        if self._data_end >= 0:
            raise ChunkError("a second end of the data")
        self._data_end = at
        if not record.data_section_crc:
            return
        self.data_proven = self._checksum(0, at) == record.data_section_crc
        if not self.data_proven and not self.damage:
            self._note(0, at, SOMEWHERE, lost=False)

    def _end_of_index(self, record: records.Footer, at: int) -> None:
        self.has_footer = True
        if self._data_end < 0:
            self._note(at, at, "the mark at the end of the data is missing", lost=False)
        if not record.summary_crc:
            return
        start = record.summary_start or at
        whole = self._data_end < start <= at
        self.index_proven = whole and self._checksum(start, at + HEAD_BYTES + 16) == record.summary_crc
        if not self.index_proven:
            self._note(min(start, at), self.size, "wrong checksum of the index, which is not used", lost=False)

    def _after_damage(self, at: int, end: int, last: int, why: ChunkError) -> Generator[FoundRecord, None, int]:
        """Note damage at a place and return where to go on; yields the records of the chunk there, or of the next."""
        here = self._sound_chunk(at, last)
        if here is not None:
            self._note(at, here[0], "the head of a chunk, whose messages are whole", lost=False)
            yield from here[1]
            return here[0]
        if self._begins_a_record(end, last):
            self._note(at, end, str(why), times=(why.first_ns, why.last_ns))
            return end
        for candidate in self._candidates(at + 1, last):
            found = self._sound_chunk(candidate, last)
            if found is not None:
                self._note(at, candidate, str(why))
                yield from found[1]
                return found[0]
        self._note_end(at, last, str(why))
        return last

    def _sound_chunk(self, at: int, last: int) -> tuple[int, list[FoundRecord]] | None:
        """The stated end of the chunk at a place, and its records; None if there is no sound chunk."""
        length = stated_length(self._read(at + HEAD_BYTES, HEAD.size + 12))
        if length is None or at + HEAD_BYTES + length > last:
            return None
        end = at + HEAD_BYTES + length
        with contextlib.suppress(ChunkError):
            chunk = chunk_of(self._read(at + HEAD_BYTES, length))
            return (end, self._of_chunk(chunk, at, end)) if chunk.uncompressed_crc else None
        return None

    def _begins_a_record(self, at: int, last: int) -> bool:
        """Whether a place looks like the beginning of a record, or is the end of the data."""
        if at >= last:
            return at == last
        head = self._read(at, HEAD_BYTES)
        length = int.from_bytes(head[1:], "little")
        return (head[0] in SIMPLE or head[0] in OTHERS) and at + HEAD_BYTES + length <= last

    def _candidates(self, at: int, last: int) -> Iterator[int]:
        """Places from `at` on where a chunk may begin, found by the name of its compression."""
        start = at
        while start < last:
            window = self._read(start, min(WINDOW_BYTES + SIGNATURE_AT + 8, last - start))
            yield from (start + i for i in sorted(_candidates_in(window)) if window[i] == Opcode.CHUNK)
            start += WINDOW_BYTES

    def _note_end(self, at: int, last: int, why: str = "a record without its end") -> None:
        """Note that nothing more can be read: a cut if the file has no end, damage if it has one."""
        if not self.ended:
            self.cut_byte = at
        else:
            self._note(at, last, why)

    def _note(self, start: int, end: int, what: str, *, lost: bool = True, times: tuple[int, int] = (0, 0)) -> None:
        self.damage.append(
            Damage(start_byte=start, end_byte=end, what=what, lost=lost, from_ns=times[0], to_ns=times[1])
        )

    def _read(self, at: int, length: int) -> bytes:
        self.file.seek(at)
        return self.file.read(length)

    def _checksum(self, start: int, end: int) -> int:
        checksum, at = 0, start
        while at < end:
            block = self._read(at, min(WINDOW_BYTES, end - at))
            if not block:
                break
            checksum, at = zlib.crc32(block, checksum), at + len(block)
        return checksum


def _candidates_in(window: bytes) -> Iterator[int]:
    """Places in a window whose bytes at `SIGNATURE_AT` name a compression."""
    for signature in SIGNATURES:
        found = window.find(signature, SIGNATURE_AT)
        while found >= 0:
            if found < WINDOW_BYTES + SIGNATURE_AT:
                yield found - SIGNATURE_AT
            found = window.find(signature, found + 1)
