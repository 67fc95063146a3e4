"""Every number of our messages has its unit in the comment, in das.proto and in each recording."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader

from das.bus import das_pb2, topics
from das.bus.recorder import COMMENTS, RecordingFile, comments

UNITS = {
    "_mps2": "m/s²", "_mps": "m/s", "_per_min": "1/min", "_per_s": "1/s", "_ns": "ns since 1970, UTC", "_s": "s",
    "_m": "m", "_n": "N", "_j": "J", "_ratio": "ratio",
}  # fmt: skip
"""Units by the end of a field's name; the first that fits counts."""
NUMBERS = (
    FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_INT64, FieldDescriptor.CPPTYPE_UINT64,
    FieldDescriptor.CPPTYPE_INT32, FieldDescriptor.CPPTYPE_UINT32, FieldDescriptor.CPPTYPE_FLOAT,
)  # fmt: skip


def messages(of: list[Descriptor]) -> Iterator[Descriptor]:
    for one in of:
        yield one
        yield from messages(list(one.nested_types))


ALL = list(messages(list(das_pb2.DESCRIPTOR.message_types_by_name.values())))


@pytest.mark.parametrize("message", ALL, ids=lambda one: one.full_name)
def test_the_comment_of_every_number_begins_with_its_unit(message: Descriptor) -> None:
    for field in message.fields:
        if field.cpp_type in NUMBERS:
            unit = next((one for end, one in UNITS.items() if field.name.endswith(end)), None)
            expected = unit or ("as the kind says" if field.full_name == "das.Decision.value" else "count")
            assert comments().get(field.full_name, "").startswith(f"[{expected}]"), field.full_name


def test_the_comments_are_those_of_das_proto() -> None:
    """After a change of das.proto, `python -m das.bus.generate` writes them anew."""
    text = (files("das.bus") / "das.proto").read_text(encoding="utf-8")
    behind = [
        found[1].strip() for found in re.finditer(r"^\s*(?:\w+ )?[\w.]+ \w+ = \d+;\s*//(.*)$", text, re.MULTILINE)
    ]
    raw = json.loads((files("das.bus") / COMMENTS).read_text(encoding="utf-8"))
    assert sorted(raw.values()) == sorted(" ".join(one.split()) for one in behind)


def test_a_recording_tells_the_units_of_its_fields(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "r.mcap")
    for topic, message in ((topics.ADVICE, das_pb2.Advice(time_ns=1)), (topics.JOURNEY, das_pb2.Journey(time_ns=1))):
        file.add(topic, topic.key("t1"), message, 1)
    file.close()
    with (tmp_path / "r.mcap").open("rb") as content:
        schemas = make_reader(content).get_summary().schemas.values()  # type: ignore[union-attr]
    told: dict[str, dict[str, str]] = {}
    down = {4: "message_type", 3: "nested_type", 2: "field"}  # what protobuf calls them by number
    for schema in schemas:
        (ours,) = (one for one in FileDescriptorSet.FromString(schema.data).file if one.package == "das")
        for location in ours.source_code_info.location:
            named, name = ours, ""
            for number, index in zip(location.path[::2], location.path[1::2], strict=True):
                named = getattr(named, down[number])[index]
                name += f".{named.name}"
            told.setdefault(schema.name, {})[name] = location.trailing_comments
    assert told["das.Advice"][".Advice.position_sd_m"].startswith("[m] ")
    assert told["das.Advice"][".Coaching.Instruction.speed_mps"].startswith("[m/s] ")
    assert told["das.Journey"][".Journey.Stop.arrival_ns"].startswith("[ns since 1970, UTC]")
