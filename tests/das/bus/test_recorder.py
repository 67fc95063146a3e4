"""The recorder without processes and sockets, by a clock that the test sets."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from das.bus import das_pb2
from das.bus.recorder import Recorder, RecordingFile
from das.bus.recording import read_recording
from das.bus.topics import CONTROL, POSITION, RECORDER, decoded
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
