"""The contents of an MCAP file: decoded messages, metadata and attachments, as far as they can be trusted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from mcap import records

from das.bus.scanning import SOMEWHERE, UNCHECKED, Damage, Health, Scan
from das.bus.sealing import CHANNELS, NUMBERED, RECORDING, unsealed
from das.bus.topics import Topic, topic_of
from das.domain.errors import DasError

DRIVE: Final = "-drive-"
"""Between the name of a train and the number of its drive, for the second and later drives of one train in a file."""
MOST_BYTES: Final = 1 << 30
"""Largest file (bytes) that is read; recordings take 50 to 500 bytes a message."""
RECOVERED: Final = "recovered"
"""The metadata record in which `das-sim check --save` states the source of a recording and what was lost."""


class RecordedMessage(NamedTuple):
    """A recorded message with its train, its topic, the time of recording (ns) and its running number."""

    train: str
    topic: Topic
    log_time_ns: int
    sequence: int
    message: Any


@dataclass
class Contents:
    """The trusted contents of a file, in the order of the file.

    `foreign` counts the messages on channels of other programs, by topic.
    """

    path: Path
    messages: list[RecordedMessage] = field(default_factory=list)
    metadata_records: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    """The metadata records, by name; a merged file has several of one name."""
    recordings: dict[str, str] = field(default_factory=dict)
    """The recording (`RECORDING`) that holds the messages of a train; empty text for one that does not name itself."""
    attachments: list[records.Attachment] = field(default_factory=list)
    foreign: dict[str, int] = field(default_factory=dict)
    health: Health = field(default_factory=lambda: Health(size_bytes=0, complete=False))

    @property
    def trains(self) -> tuple[str, ...]:
        """The trains of the file, in the order of their first messages."""
        ordered = sorted(self.messages, key=lambda one: one.log_time_ns)
        return tuple(dict.fromkeys(one.train for one in ordered))

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata that hold for all that is in the file: of several records of one name, what they agree on."""
        return self.metadata_of(None)

    def metadata_of(self, train: str | None) -> dict[str, dict[str, str]]:
        """The metadata by their names; of several records of one name, those of the train's recording, else those that
        name the train, else all of them.

        What such records do not agree on is left out, because nothing says which of them the train's drive is.
        """
        found: dict[str, dict[str, str]] = {}
        written = self.recordings.get(train or "", "")
        for name in dict.fromkeys(name for name, _ in self.metadata_records):
            several = [entries for one, entries in self.metadata_records if one == name]
            several = (
                [one for one in several if written and one.get(RECORDING) == written]
                or [one for one in several if train is not None and one.get("train") == train]
                or several
            )
            agreed = {key: value for key, value in several[0].items() if all(x.get(key) == value for x in several)}
            found[name] = {key: value for key, value in agreed.items() if key != RECORDING}
        return found


@dataclass
class Raw:
    """The records of a file that can be trusted, before their messages are decoded.

    Each entry of `metadata` states whether its own checksum is right (None: it has none, and nothing else proves it).
    """

    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    messages: list[records.Message] = field(default_factory=list)
    attachments: list[records.Attachment] = field(default_factory=list)
    metadata: list[tuple[records.Metadata, bool | None]] = field(default_factory=list)
    numbered: bool = False
    """Whether the recorder wrote the file: it gives each message of the file a number of its own."""

    described: dict[int, tuple[records.Channel, records.Schema]] = field(default_factory=dict)
    """Channels and their schemas by the metadata of the recorder, with the numbers that it gave them."""

    def use(self, record: records.McapRecord) -> None:
        """Keep a record that can be trusted, and metadata, whose own checksum is judged."""
        if isinstance(record, records.Metadata):
            self._use_metadata(record)
        elif isinstance(record, records.Message):
            self.messages.append(record)
        elif isinstance(record, records.Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, records.Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, records.Attachment):
            self.attachments.append(record)

    def _use_metadata(self, record: records.Metadata) -> None:
        entries, right = unsealed(record.name, record.metadata)
        number, schema = record.name.removeprefix(CHANNELS), entries.get("schema_id", "")
        described = record.name.startswith(CHANNELS) and number.isdecimal() and schema.isdecimal()
        if right and described and {"topic", "schema"} <= entries.keys():
            self.numbered |= NUMBERED in entries
            of_one = {RECORDING: entries[RECORDING]} if RECORDING in entries else {}
            channel = records.Channel(int(number), entries["topic"], "protobuf", of_one, int(schema))
            named = records.Schema(channel.schema_id, b"", "protobuf", entries["schema"])
            self.described.setdefault(channel.id, (channel, named))
        else:
            self.metadata.append((records.Metadata(name=record.name, metadata=entries), right))

    def use_descriptions(self) -> None:
        """Add the channels that only metadata describe, unless the file's channels or schemas have other numbers there.

        A program that rewrites or merges recordings renumbers channels, and copies the metadata as they are.
        """
        topics = {channel.topic for channel in self.channels.values()}
        for number, (channel, schema) in self.described.items():
            if number not in self.channels and channel.topic in topics:
                return
            known, named = self.channels.get(number, channel), self.schemas.get(schema.id, schema)
            if (known.topic, named.name) != (channel.topic, schema.name):
                return
        for number, (channel, schema) in self.described.items():
            self.channels.setdefault(number, channel)
            self.schemas.setdefault(schema.id, schema)


def read_raw(path: Path) -> tuple[Raw, Health]:
    """All records of a file; raises DasError if it is missing, not MCAP, or would keep its reader busy.

    The file is read as a whole: a map of it into memory would end the process if someone cut the file meanwhile.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise DasError(f"{path}: not a regular file")  # opening a pipe would wait for its other end
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise DasError(f"{path}: is larger than {MOST_BYTES >> 20} MiB: cut it into shorter recordings")
        return _read(Scan(path.read_bytes()))
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise DasError(f"{str(path)!r}: cannot be read ({error})") from None
    except DasError as error:
        raise (error if str(error).startswith(str(path)) else DasError(f"{path}: {error}")) from None


def _read(scan: Scan) -> tuple[Raw, Health]:
    """The records that a checksum or a sound file proves, and the health of the file."""
    raw, found = Raw(), list(scan.walk())
    whole = scan.has_footer and not scan.damage and all(one.record is not None for one in found)
    trusted = scan.data_proven is True or (scan.data_proven is None and whole)
    for one in found:
        named = isinstance(one.record, records.Schema | records.Channel)
        if trusted or one.proven or isinstance(one.record, records.Metadata) or (named and scan.index_proven):
            raw.use(one.record)
    raw.use_descriptions()
    loose = [x for x in found if not x.proven and isinstance(x.record, records.Message | records.Attachment | None)]
    unproven = dict.fromkeys(record.name for record, right in raw.metadata if right is None)
    wrong = [record.name for record, right in raw.metadata if right is False]
    damage = [one for one in scan.damage if not (wrong and one.what == SOMEWHERE)]
    if loose and not trusted:
        what = f"{len(loose)} records outside of chunks, which nothing proves"
        damage.append(Damage(start_byte=loose[0].start_byte, end_byte=loose[-1].start_byte, what=what))
    messages = _without_repeated(raw.messages) if raw.numbered else raw.messages  # the recorder numbers each once
    if twice := len(raw.messages) - len(messages):
        damage.append(Damage(start_byte=0, end_byte=0, what=f"{twice} messages that are in the file twice"))
    damage += [Damage(start_byte=0, end_byte=0, what=f"wrong checksum in the metadata {name!r}") for name in wrong]
    raw.messages = messages
    raw.metadata = [(one, True if right is None and trusted else right) for one, right in raw.metadata]
    unchecked = [*(f"metadata {name!r}" for name in unproven)]
    unchecked += ["messages outside of chunks"] if loose and trusted else []
    return raw, Health(
        size_bytes=scan.size,
        complete=scan.ended or scan.has_footer,
        damage=tuple(damage),
        cut_byte=scan.cut_byte,
        missing=_missing(raw.messages),
        unchecked=() if scan.data_proven is True else tuple(unchecked),
    )


def _without_repeated(messages: list[records.Message]) -> list[records.Message]:
    """The messages without those that repeat an earlier one in channel, number, time and content."""
    once: dict[tuple[int, int, int, bytes], records.Message] = {}
    for one in messages:
        once.setdefault((one.channel_id, one.sequence, one.log_time, one.data), one)
    return list(once.values())


def _missing(messages: list[records.Message]) -> int | None:
    """How many messages are missing, according to the running numbers; None if these do not rise through the file."""
    numbers = [message.sequence for message in messages]
    if len(numbers) < 2 or any(b <= a for a, b in pairwise(numbers)):
        return None
    first = 1 if numbers[0] == 1 else 0
    return numbers[-1] - first + 1 - len(numbers)


def read_contents(path: Path) -> Contents:
    """The decoded contents of a file; damaged parts are left out and noted in `health`.

    Raises DasError as `read_raw` does, and if a channel of ours holds messages of another type than its topic's.
    """
    raw, health = read_raw(path)
    result = Contents(path=path, attachments=raw.attachments)
    for record, right in raw.metadata:
        if right is not False:
            result.metadata_records.append(
                (record.name if right else f"{UNCHECKED}{record.name}", dict(record.metadata))
            )
    topics = {number: _our_topic(path, channel, raw) for number, channel in raw.channels.items()}
    lost: list[Damage] = []
    sources: list[str] = []
    homeless = 0
    for message in raw.messages:
        channel = raw.channels.get(message.channel_id)
        topic = topics.get(message.channel_id)
        if channel is None:
            homeless += 1
        elif topic is None:
            result.foreign[channel.topic] = result.foreign.get(channel.topic, 0) + 1
        elif _decode(result, message, channel.topic, topic, lost):
            sources.append(channel.metadata.get(RECORDING, ""))
    if homeless:
        what = f"{homeless} messages of channels that are not described"
        lost.append(Damage(start_byte=0, end_byte=health.size_bytes, what=what))
    result.health = replace(health, damage=(*health.damage, *lost))
    _tell_drives_apart(result, sources, numbered=raw.numbered)
    return result


def _tell_drives_apart(found: Contents, sources: Sequence[str], *, numbered: bool) -> None:
    """Name the second drive of a train in a merged file "<train>-drive-2", and so on; the first keeps the train's name.

    `sources` are the recordings (`RECORDING`) of the messages; messages of one recording may be several drives by
    their running numbers, if it is `numbered`.
    """
    for train in found.trains:
        of_source: dict[str, list[int]] = {}
        for i, one in enumerate(found.messages):
            if one.train == train:
                of_source.setdefault(sources[i], []).append(i)
        before = 0
        for source, of_train in of_source.items():
            drives = _drives_by_number(found, train, of_train) if numbered else [0] * len(of_train)
            for i, drive in zip(of_train, drives, strict=True):
                name = f"{train}{DRIVE}{before + drive + 1}" if before + drive else train
                found.messages[i] = found.messages[i]._replace(train=name)
                found.recordings[name] = source
            before += drives[-1] + 1


def _drives_by_number(found: Contents, train: str, of_train: Sequence[int]) -> list[int]:
    """Which drive each message of a train belongs to, from 0 on, in a file that does not name its recordings.

    A recorder uses each running number once, so a number that a train has twice shows two drives. Raises DasError for
    drives that run through each other in the file: their messages cannot be told apart.
    """
    numbers = [found.messages[i].sequence for i in of_train]
    count = max(Counter(numbers).values())
    if count == 1 or not any(numbers):  # 0: by another program, which does not number its messages
        return [0] * len(numbers)
    drives: list[int] = np.cumsum(np.diff(numbers, prepend=numbers[0] - 1) <= 0).tolist()
    if drives[-1] + 1 != count:
        raise DasError(
            f"{found.path}: holds {count} drives of the train {train!r} at the same time, and its channels do not say "
            "which is which: read the files from which it was merged"
        )
    return drives


def _decode(result: Contents, message: records.Message, key: str, topic: Topic, lost: list[Damage]) -> bool:
    """Add a message to the contents; False, with a note in `lost`, if it cannot be decoded."""
    try:
        decoded = topic.message.FromString(message.data)
    except DecodeError:
        what = f"a message of {key} that cannot be decoded"
        lost.append(Damage(start_byte=0, end_byte=0, what=what, from_ns=message.log_time, to_ns=message.log_time))
        return False
    result.messages.append(RecordedMessage(key.split("/")[1], topic, message.log_time, message.sequence, decoded))
    return True


def _our_topic(path: Path, channel: records.Channel, raw: Raw) -> Topic | None:
    """The topic of a channel, None if it is foreign; raises DasError if it is ours but has messages of another type."""
    topic = topic_of(channel.topic)
    if topic is None:
        return None
    schema = raw.schemas.get(channel.schema_id)
    name, expected = schema.name if schema is not None else "", topic.message.DESCRIPTOR.full_name
    if channel.message_encoding != "protobuf" or name != expected:
        raise DasError(f"{path}: channel {channel.topic} holds {name!r}, expected protobuf {expected!r}")
    return topic
