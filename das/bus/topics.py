"""The registry of topics, each with its message type and publisher; received messages, and restrictions in them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any, Final, TypeVar

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError, Message

from das.bus import das_pb2
from das.domain.errors import DasError, InputError
from das.domain.restriction import Restriction

TRAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True, kw_only=True)
class Topic:
    """One topic, with the key `<root>/<train>/<name>`.

    A `latched` topic keeps its last message for late subscribers. Publishers wait instead of losing a message.
    """

    name: str
    root: str
    message: type[Message]
    publisher: str
    recorded: bool = True
    latched: bool = False

    def key(self, train: str) -> str:
        """The key in Zenoh, and the name of the channel in a recording."""
        return f"{self.root}/{train}/{self.name}"


TOPICS: Final = (
    POSITION := Topic(name="position", root="das", message=das_pb2.Position, publisher="localisation"),
    DELAY := Topic(name="delay", root="das", message=das_pb2.Delay, publisher="operator"),
    EFFORT := Topic(name="effort", root="das", message=das_pb2.Effort, publisher="train control"),
    JOURNEY := Topic(name="journey", root="das", message=das_pb2.Journey, publisher="operator", latched=True),
    RESTRICTION := Topic(
        name="restriction", root="das", message=das_pb2.Restrictions, publisher="operator", latched=True
    ),
    TARGET := Topic(name="target", root="das", message=das_pb2.Targets, publisher="operator", latched=True),
    CONTROL := Topic(name="control", root="das", message=das_pb2.Control, publisher="simulator"),
    ADVICE := Topic(name="advice", root="das", message=das_pb2.Advice, publisher="node"),
    PLAN := Topic(name="plan", root="das", message=das_pb2.Plan, publisher="node"),
    ESTIMATE := Topic(name="estimate", root="das", message=das_pb2.Estimate, publisher="node"),
    STATUS := Topic(name="status", root="das", message=das_pb2.Status, publisher="node", latched=True),
    EVENT := Topic(name="event", root="das", message=Log, publisher="node"),
    TRUTH := Topic(name="truth", root="sim", message=das_pb2.Truth, publisher="simulator"),
    LOCATION := Topic(name="location", root="sim", message=LocationFix, publisher="simulator"),
    CAB := Topic(name="cab", root="sim", message=das_pb2.Cab, publisher="simulator"),
    CONTROLS := Topic(name="controls", root="sim", message=das_pb2.Controls, publisher="driver", recorded=False),
    ACTION := Topic(name="action", root="sim", message=das_pb2.Action, publisher="desk"),
    MARK := Topic(name="mark", root="sim", message=das_pb2.Mark, publisher="desk"),
    DECISION := Topic(name="decision", root="sim", message=das_pb2.Decision, publisher="simulator"),
    MEASURES := Topic(name="measures", root="sim", message=das_pb2.Measures, publisher="simulator"),
    SAVING := Topic(name="saving", root="sim", message=das_pb2.Saving, publisher="simulator"),
    LOG := Topic(name="log", root="sim", message=Log, publisher="simulator"),
    RECORDER := Topic(
        name="recorder", root="das", message=das_pb2.RecorderStatus, publisher="recorder", recorded=False
    ),
)
"""Every topic, in the order in which recordings and views list them."""
RECORDED: Final = tuple(topic for topic in TOPICS if topic.recorded)


def check_train_name(train: str) -> str:
    """The name of a train, if it can be part of a key; raises DasError otherwise."""
    if not TRAIN_NAME.fullmatch(train):
        raise DasError(f"train name {train!r}: expected 1 to 64 letters, digits, '.', '_' or '-'")
    return train


def topic_of(key: str) -> Topic | None:
    """The topic of a key or of a channel's name; None if it is foreign."""
    root, _, rest = key.partition("/")
    _, _, name = rest.partition("/")
    return next((topic for topic in TOPICS if topic.root == root and topic.name == name), None)


@dataclass(frozen=True)
class Received:
    """A received message; `message` is None if the payload is not of the topic's type.

    `source` is the session that put the time stamp on it, normally the sender's; `size` is in bytes.
    """

    topic: Topic
    key: str
    message: Any
    source: str = ""
    size: int = 0


def decoded(topic: Topic, key: str, payload: bytes, source: str = "") -> Received:
    """The received message of a topic from its payload."""
    try:
        message: Message | None = topic.message.FromString(payload)
    except DecodeError:
        message = None
    return Received(topic, key, message, source, len(payload))


def message_time_ns(message: Any) -> int:
    """The time that a message states (ns since 1970); 0 if it has none."""
    if hasattr(message, "time_ns"):
        return int(message.time_ns)
    if hasattr(message, "timestamp"):  # not its method, which rejects times that a sender may state
        return int(message.timestamp.seconds * 1_000_000_000 + message.timestamp.nanos)
    return 0


_Kind = TypeVar("_Kind", bound=Restriction)


def encode_restriction(one: Restriction) -> das_pb2.Restrictions.Restriction:
    """The message of a restriction; an open end of the time window is left unset."""
    return das_pb2.Restrictions.Restriction(**vars(one))


def decode_restriction(message: Any, kind: type[_Kind]) -> _Kind:
    """The restriction of a message. If `kind` checks the figures, as Restriction does, wrong ones raise InputError."""
    return kind(**{one.name: getattr(message, one.name) for one in fields(kind)})


def valid_restrictions(messages: Iterable[Any]) -> tuple[Restriction, ...]:
    """The restrictions of a recorded list; entries that no node accepts as a restriction are left out."""
    found = []
    for message in messages:
        with suppress(InputError):
            found.append(decode_restriction(message, Restriction))
    return tuple(found)
