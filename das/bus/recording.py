"""Reads an MCAP recording, whole, cut off or damaged, in one pass, and checks every checksum."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from mcap import records
from numpy.typing import NDArray

from das.bus.scanning import SOMEWHERE, UNCHECKED, Damage, Health, Scan
from das.bus.sealing import CHANNELS, NUMBERED, RECORDING, unsealed
from das.bus.topics import TOPICS, Topic, decoded, topic_of
from das.domain.errors import DasError, InputError
from das.domain.summary import Summary

DRIVE: Final = "-drive-"
"""Separator between train name and drive number, for the second and later drives of a train in a file."""
MOST_BYTES: Final = 1 << 30
"""Largest file (bytes) that is read; recordings take 50 to 500 bytes a message."""
RECOVERED: Final = "recovered"
"""The metadata record in which `das-sim check --save` states the source of a recording and what was lost."""


class RecordedMessage(NamedTuple):
    """A recorded message with its train, its topic, the time of recording (ns) and its sequence number."""

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
    """The recording (`RECORDING`) that holds the messages of a train; empty text for a recording that has no name."""
    attachments: list[records.Attachment] = field(default_factory=list)
    foreign: Counter[str] = field(default_factory=Counter)
    health: Health = field(default_factory=lambda: Health(size_bytes=0, complete=False))

    @property
    def trains(self) -> tuple[str, ...]:
        """The trains of the file, in the order of their first messages."""
        ordered = sorted(self.messages, key=lambda one: one.log_time_ns)
        return tuple(dict.fromkeys(one.train for one in ordered))

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata that apply to the whole file: of several records with the same name, their common entries."""
        return self.metadata_of(None)

    def metadata_of(self, train: str | None) -> dict[str, dict[str, str]]:
        """The metadata by their names; of several records of one name, the records of the train's recording, else those
        that name the train, else all.

        Entries on which such records differ are left out, because the record of the train's drive is unknown.
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

    Each entry of `metadata` states whether its own checksum is right (None: neither it nor another one proves it).
    """

    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    messages: list[records.Message] = field(default_factory=list)
    attachments: list[records.Attachment] = field(default_factory=list)
    metadata: list[tuple[records.Metadata, bool | None]] = field(default_factory=list)
    numbered: bool = False
    """Whether the recorder wrote the file: it gives each message of the file a unique number."""

    described: dict[int, tuple[records.Channel, records.Schema]] = field(default_factory=dict)
    """Channels and their schemas according to the recorder's metadata, with the numbers given by the recorder."""

    def use(self, record: records.McapRecord) -> None:
        """Keep a record that can be trusted, and metadata, whose own checksum is checked here."""
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
    """All records of a file; raises DasError if the file is missing, not MCAP, or too large to read.

    The file is read as a whole: with a memory map, the process would end if the file were truncated meanwhile.
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
    if raw.numbered:  # the recorder writes each message once, so a repeated one is a sign of damage
        once: dict[tuple[int, int, int, bytes], records.Message] = {}
        for message in raw.messages:
            once.setdefault((message.channel_id, message.sequence, message.log_time, message.data), message)
        if twice := len(raw.messages) - len(once):
            damage.append(Damage(what=f"{twice} messages that are in the file twice"))
        raw.messages = list(once.values())
    damage += [Damage(what=f"wrong checksum in the metadata {name!r}") for name in wrong]
    raw.metadata = [(one, True if right is None and trusted else right) for one, right in raw.metadata]
    unchecked = [f"metadata {name!r}" for name in unproven]
    unchecked += ["messages outside of chunks"] if loose and trusted else []
    return raw, Health(
        size_bytes=scan.size,
        complete=scan.ended or scan.has_footer,
        damage=tuple(damage),
        cut_byte=scan.cut_byte,
        missing=_missing(raw.messages),
        unchecked=() if scan.data_proven is True else tuple(unchecked),
    )


def _missing(messages: list[records.Message]) -> int | None:
    """The number of missing messages, according to the sequence numbers; None if these do not rise through the file."""
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
    marked = ((one, "" if right else UNCHECKED) for one, right in raw.metadata if right is not False)
    metadata = [(f"{mark}{one.name}", one.metadata) for one, mark in marked]
    result = Contents(path=path, attachments=raw.attachments, metadata_records=metadata)
    topics = {number: _our_topic(path, channel, raw) for number, channel in raw.channels.items()}
    lost: list[Damage] = []
    sources: list[str] = []
    homeless = 0
    for message in raw.messages:
        channel = raw.channels.get(message.channel_id)
        topic, at_ns = topics.get(message.channel_id), message.log_time
        if channel is None:
            homeless += 1
        elif topic is None:
            result.foreign[channel.topic] += 1
        elif (found := decoded(topic, channel.topic, message.data).message) is None:
            lost.append(Damage(what=f"a message of {channel.topic} that cannot be decoded", from_ns=at_ns, to_ns=at_ns))
        else:
            train = channel.topic.split("/")[1]
            result.messages.append(RecordedMessage(train, topic, at_ns, message.sequence, found))
            sources.append(channel.metadata.get(RECORDING, ""))
    if homeless:
        what = f"{homeless} messages of channels that are not described"
        lost.append(Damage(what=what, end_byte=health.size_bytes))
    result.health = replace(health, damage=(*health.damage, *lost))
    _tell_drives_apart(result, sources, numbered=raw.numbered)
    return result


def _tell_drives_apart(found: Contents, sources: Sequence[str], *, numbered: bool) -> None:
    """Name the second drive of a train in a merged file "<train>-drive-2", and so on; the first keeps the train's name.

    `sources` are the recordings of the messages. If they are `numbered`, the numbers may show several drives in one.
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
    """The number of the drive to which each message of a train belongs, from 0 on, in a file that does not name its
    recordings.

    A recorder uses each sequence number once, so a number that occurs twice for a train shows two drives. Raises
    DasError for drives that are interleaved in the file: their messages cannot be distinguished.
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


UNKNOWN: Final = Health(size_bytes=0, complete=True)
"""The health of a recording that was not read from a file."""


class Stamped(NamedTuple):
    """A message and the time at which it was recorded (ns since 1970)."""

    log_time_ns: int
    message: Any


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Recording(Summary):
    """The contents of a recording for one train.

    `messages` holds the messages by topic name in the order of their log times. `train` is the chosen train, `trains`
    are all in the file. `metadata` holds texts by record name and key, `attachments` the names of the attached files,
    `attached` the files. `complete` is False for a file that was cut off. `health` states damage and gaps.
    """

    path: Path
    train: str
    trains: tuple[str, ...]
    messages: dict[str, tuple[Stamped, ...]]
    metadata: dict[str, dict[str, str]]
    attachments: tuple[str, ...]
    complete: bool
    health: Health = UNKNOWN
    attached: tuple[records.Attachment, ...] = ()

    def facts(self) -> dict[str, str]:
        """The file, the train, and the number of messages of each topic."""
        counts = ", ".join(f"{len(self.messages[name])} {name}" for name in self.topics)
        told = {"file": str(self.path), "train": self.train, "messages": counts or "none"}
        return told if self.complete else {**told, "complete": "no, it was cut off"}

    @property
    def topics(self) -> tuple[str, ...]:
        """The sorted names of the topics that have messages."""
        return tuple(sorted(self.messages))

    def of(self, topic: Topic | str) -> tuple[Stamped, ...]:
        """The messages of a topic, given as a Topic or by its name ("position"); empty if it was not recorded.

        Raises InputError for a name that no topic has.
        """
        return self.messages.get(self._topic(topic).name, ())

    def columns(self, topic: Topic | str, *fields: str) -> dict[str, NDArray[Any]]:
        """Fields of a topic's messages as arrays of shape (messages,), by field name (default: all fields).

        A field's name ends in its unit, as in `das.proto`: `speed_mps`, `time_ns`. `log_time_ns` is when the message
        was recorded. Floats are float64. Integers, truth values and enumerations are int64 (`meanings` names the values
        of an enumeration). Texts are objects. A nested message is a dict of its fields. A repeated field is an array of
        objects, one for each message: a one-dimensional array of numbers, or a list of texts or dicts. A topic that was
        not recorded gives arrays of length 0.

        Raises InputError for a name that no topic or no field has.
        """
        known, messages = self._topic(topic), self.of(topic)
        described = {one.name: one for one in known.message.DESCRIPTOR.fields}
        result: dict[str, NDArray[Any]] = {"log_time_ns": np.array([m.log_time_ns for m in messages], dtype=np.int64)}
        for name in fields or described:
            if name not in described:
                raise InputError(self.path, f"field of {known.name}", name, f"one of {', '.join(described)}")
            try:
                result[name] = _column([getattr(one.message, name) for one in messages], described[name])
            except OverflowError as error:
                raise DasError(f"{self.path}: {known.name}: a number is too large for 64 bits ({error})") from None
        return result

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


def _column(values: list[Any], described: Any) -> NDArray[Any]:
    """The values of one field as an array of shape (messages,)."""
    kind, texts = described.cpp_type, (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_MESSAGE)
    is_float = kind in (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT)
    dtype: Any = np.float64 if is_float else object if kind in texts else np.int64
    if not described.is_repeated and dtype is not object:
        return np.array(values, dtype=dtype)
    column = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):  # assigned as a whole, lists of equal lengths would become a second dimension
        column[i] = _plain(value, described) if dtype is object else np.array(value, dtype=dtype)
    return column


def _plain(value: Any, described: Any) -> Any:
    """The value of a field; a message as a dict of its fields, several values as a list."""
    if described.cpp_type != FieldDescriptor.CPPTYPE_MESSAGE:
        return list(value) if described.is_repeated else value
    found = [
        {one.name: _plain(getattr(message, one.name), one) for one in message.DESCRIPTOR.fields}
        for message in (value if described.is_repeated else [value])
    ]
    return found if described.is_repeated else found[0]


def read_recording(path: str | Path, *, train: str | None = None, skip_damage: bool = False) -> Recording:
    """Read a recording; if it was cut off, everything before the cut.

    `train` chooses one of several trains in a recording. With `skip_damage`, damaged parts are left out and
    noted in `health`; otherwise a damaged file is refused.

    Raises DasError for a file that is missing, not MCAP or damaged, that has no message of a train, or that has several
    trains while `train` is None.

        recording = das.read_recording("recordings/zurich-zug-late.mcap")
        position = recording.columns("position")
        position["time_ns"], position["s_m"], position["speed_mps"]
    """
    found = read_contents(Path(path))
    if not skip_damage:
        refuse_damage(found)
    return recording_of(found, train)


def recording_of(found: Contents, train: str | None = None) -> Recording:
    """The recording of one train from the contents of a file; raises DasError if the train cannot be chosen."""
    trains = found.trains
    chosen = _chosen(found, trains, train)
    messages: dict[str, list[Stamped]] = {}
    for one in sorted(found.messages, key=lambda entry: entry.log_time_ns):
        if one.train == chosen:
            messages.setdefault(one.topic.name, []).append(Stamped(one.log_time_ns, one.message))
    return Recording(
        path=found.path,
        train=chosen,
        trains=trains,
        messages={name: tuple(entries) for name, entries in messages.items()},
        metadata=found.metadata_of(chosen),
        attachments=tuple(one.name for one in found.attachments),
        complete=found.health.complete,
        health=found.health,
        attached=tuple(found.attachments),
    )


def refuse_damage(found: Contents) -> None:
    """Raise DasError for a file with damage, or with missing messages that `das-sim check --save` has not noted."""
    path, health = found.path, found.health
    if health.damage:
        more = f", and {len(health.damage) - 1} more places" if len(health.damage) > 1 else ""
        raise DasError(f"{path}: damaged: {health.damage[0]}{more}; das-sim check --save NEW.mcap saves what is sound")
    if health.missing and RECOVERED not in found.metadata:
        raise DasError(f"{path}: damaged: {health.missing} messages are missing, according to their sequence numbers")


def _chosen(found: Contents, trains: Sequence[str], train: str | None) -> str:
    """The train to read; raises DasError if there is none, or if there are several and `train` is None."""
    path = found.path
    if not trains:
        if found.health.damage:
            raise DasError(f"{path}: damaged: {found.health.damage[0]}; no message of a train is left")
        before = " before it was cut off" if not found.health.complete else ""
        raise DasError(f"{path}: holds no messages of a train{before}")
    if train is not None and train not in trains:
        raise DasError(f"{path}: holds no train {train!r}, expected one of {', '.join(trains)}")
    if train is None and len(trains) > 1:
        raise DasError(f"{path}: holds several trains or drives, {', '.join(trains)}: name one (--of-train)")
    return train or trains[0]
