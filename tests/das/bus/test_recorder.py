"""The recorder without processes and sockets, by a clock that the test sets; the units that a recording tells."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader

from das.bus import das_pb2, topics
from das.bus.recorder import COMMENTS, Recorder, RecordingFile, comments
from das.bus.recording import read_recording
from das.bus.topics import CONTROL, POSITION, RECORDER, decoded
from tests.support import generated_messages
from tests.support.driven_node import START_NS, TRAIN, S, Sink
from tests.support.hand_clock import HandClock


class HandRecorder:
    """A recorder that hears what the test says, when its clock says so."""

    def __init__(self, path: Path) -> None:
        self.clock, self.sink = HandClock(START_NS), Sink()
        self.file = RecordingFile(path, self.clock.clocks)
        self.recorder = Recorder(self.sink, self.file, None, self.clock.clocks)  # type: ignore[arg-type]

    def hear_position(self, s_m: float) -> None:
        message = das_pb2.Position(time_ns=self.clock(), s_m=s_m)
        self.recorder.take(decoded(POSITION, POSITION.key(TRAIN), message.SerializeToString()))


@pytest.fixture
def made(tmp_path: Path) -> HandRecorder:
    return HandRecorder(tmp_path / "run.mcap")


def test_what_was_heard_is_on_the_disk_soon_though_the_file_was_never_finished(made: HandRecorder) -> None:
    for i in range(300):
        made.hear_position(float(i))
    on_disk = made.file.path.stat().st_size
    made.clock.time_ns += S // 2 - 1000
    made.file.flush_if_due()
    assert made.file.path.stat().st_size == on_disk
    made.clock.time_ns += 1000
    made.file.flush_if_due()
    recording = read_recording(made.file.path)
    assert not recording.complete
    assert [one.message.s_m for one in recording.of(POSITION)] == [float(i) for i in range(300)]
    made.file.close()


def test_before_the_first_control_the_log_has_the_time_of_day_and_then_that_of_the_run(made: HandRecorder) -> None:
    made.hear_position(1.0)
    control = das_pb2.Control(time_ns=START_NS - 3600 * S, tick=1)
    made.recorder.take(decoded(CONTROL, CONTROL.key(TRAIN), control.SerializeToString()))
    made.clock.time_ns += S
    made.hear_position(2.0)
    made.file.close()
    logged = {one.message.s_m: one.log_time_ns for one in read_recording(made.file.path).of(POSITION)}
    assert logged == {1.0: START_NS, 2.0: START_NS - 3600 * S}


def test_how_far_the_recorder_is_comes_once_a_second_without_any_message(made: HandRecorder) -> None:
    for _ in range(31):
        made.recorder.report_if_due()
        made.clock.time_ns += S // 10
    made.file.close()
    assert [(one.time_ns - START_NS) // (S // 10) for one in made.sink.of(RECORDER)] == [0, 11, 22]


def test_an_attachment_has_the_time_of_day(made: HandRecorder) -> None:
    made.file.add_attachment("route.toml", "application/octet-stream", b"x")
    made.file.close()
    with made.file.path.open("rb") as stream:
        (attachment,) = make_reader(stream).iter_attachments()
    assert (attachment.name, attachment.log_time, attachment.create_time) == ("route.toml", START_NS, START_NS)


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


def test_the_generated_files_are_those_of_das_proto(tmp_path: Path) -> None:
    """After a change of das.proto, `python -m tests.support.generated_messages` writes them anew."""
    assert generated_messages.main(tmp_path) == 0
    made, kept = tmp_path / "das" / "bus", files("das.bus")
    assert (made / COMMENTS).read_text(encoding="utf-8") == (kept / COMMENTS).read_text(encoding="utf-8")
    # Other versions of protoc write other text around the same description.
    anew, before = (
        re.findall(r"AddSerializedFile\(.*", (one / "das_pb2.py").read_text("utf-8")) for one in (made, kept)
    )
    assert anew == before != []
    assert "class Position" in (made / "das_pb2.pyi").read_text(encoding="utf-8")


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
    assert told["das.Advice"][".Guidance.Instruction.speed_mps"].startswith("[m/s] ")
    assert told["das.Journey"][".Journey.Stop.arrival_ns"].startswith("[ns since 1970, UTC]")
