"""A message as heard on the bus, decoded from what was sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from google.protobuf.message import DecodeError, Message

from das.bus.topics import Topic


@dataclass(frozen=True)
class Received:
    """A message as heard. `message` is None where the payload is not of the topic's type.

    `source` is the session that stamped it with its time: the sender's, where that stamps; `size` in bytes.
    """

    topic: Topic
    key: str
    message: Any
    source: str = ""
    size: int = 0


def decoded(topic: Topic, key: str, payload: bytes, source: str = "") -> Received:
    """A message of a topic from what was sent."""
    message: Message | None = topic.message()
    try:
        message.ParseFromString(payload)  # type: ignore[union-attr]
    except DecodeError:
        message = None
    return Received(topic, key, message, source, len(payload))
