"""The schema of a topic as a recording holds it: the messages' descriptors, and the comment of each field.

A field's comment begins with its unit in brackets. Protobuf compiles comments away; a recording keeps those of our
messages in the place that protobuf has for them (`source_code_info`), so that the file itself tells the units.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any, Final

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from das.bus import das_pb2

COMMENTS: Final = "das_comments.json"
"""Comments of the fields of das.proto by the field's full name; das/bus/generate.py writes it."""
SPAN: Final = (0, 0, 0)
"""A place in das.proto, which protobuf wants with each comment; nobody needs it in a recording."""
Path = tuple[int, ...]


@cache
def comments() -> dict[str, str]:
    """The comments of the fields of our messages, by the field's full name ("das.Position.s_m")."""
    found: dict[str, str] = json.loads((files("das.bus") / COMMENTS).read_text(encoding="utf-8"))
    return found


def schema_of(message: type[Message]) -> bytes:
    """A serialized FileDescriptorSet of a message, with the comments of its fields and of those within them."""
    found = build_file_descriptor_set(message)
    for file in found.file:
        if file.name == das_pb2.DESCRIPTOR.name:
            _add_comments(file, message.DESCRIPTOR)
    return found.SerializeToString()


def _add_comments(file: FileDescriptorProto, message: Any) -> None:
    for one in _with_inner(message):
        for number, field in enumerate(one.fields):
            text = comments().get(field.full_name)
            if text:
                place = (*_place(one), DescriptorProto.FIELD_FIELD_NUMBER, number)
                file.source_code_info.location.add(path=place, span=SPAN, trailing_comments=text)


def _with_inner(message: Any) -> Iterator[Any]:
    """The message and our messages within it, each once."""
    known: dict[str, Any] = {}
    waiting = [message]
    while waiting:
        one = waiting.pop()
        if one.full_name not in known and one.file is message.file:
            known[one.full_name] = one
            waiting += [field.message_type for field in one.fields if field.message_type is not None]
    yield from known.values()


def _place(message: Any) -> Path:
    """The path of a message in its file, as `SourceCodeInfo` counts it."""
    outer = message.containing_type
    if outer is None:
        beside = list(message.file.message_types_by_name)
        return FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, beside.index(message.name)
    inner = [one.name for one in outer.nested_types]
    return *_place(outer), DescriptorProto.NESTED_TYPE_FIELD_NUMBER, inner.index(message.name)
