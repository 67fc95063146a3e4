"""Reading of recordings: whole, cut and damaged files, and a topic's messages as columns."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2, topics
from das.bus.recording import read_recording
from das.domain.errors import DasError, InputError
from tests.support.recordings import SECONDS, at_ns, position_m, write_messages, write_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap")


def test_round_trip(whole: Path) -> None:
    recording = read_recording(whole)
    assert recording.complete
    assert recording.train == "t1"
    assert recording.trains == ("t1",)
    assert recording.metadata["run"]["command"] == "das-sim run"
    assert recording.attachments == ("route.toml",)
    counts = {name: len(entries) for name, entries in recording.messages.items()}
    assert counts == {
        "position": 600, "truth": 600, "advice": 600, "status": 600, "location": 600,
        "plan": 60, "delay": 10, "event": 2, "journey": 1, "log": 1,
    }  # fmt: skip
    assert recording.of(topics.JOURNEY)[0].message.stops[1].name == "B"
    assert list(recording.of(topics.PLAN)[0].message.t_s) == [0.0, 5.0]
    assert recording.of(topics.CONTROL) == ()


def test_columns(whole: Path) -> None:
    recording = read_recording(whole)
    position = recording.columns(topics.POSITION, "time_ns", "s_m", "quality")
    np.testing.assert_allclose(position["s_m"], [position_m(t) + 2.0 for t in range(SECONDS)])
    assert position["time_ns"].dtype == np.int64
    assert position["time_ns"][1] == at_ns(1)
    assert position["log_time_ns"][1] == at_ns(1) + 1_000_000
    assert recording.columns(topics.ADVICE, "reason")["reason"][200]["text"] == "position invalid"
    empty = recording.columns(topics.EFFORT, "force_el_n", "time_ns")
    assert (empty["force_el_n"].dtype, empty["time_ns"].dtype, len(empty["time_ns"])) == (np.float64, np.int64, 0)


def test_a_topic_is_given_by_its_name_and_without_fields_all_are_told(whole: Path) -> None:
    recording = read_recording(str(whole))
    assert recording.topics == tuple(sorted(recording.messages))
    assert recording.of("position") == recording.of(topics.POSITION)
    truth = recording.columns("truth")
    assert set(truth) == {"log_time_ns"} | {field.name for field in das_pb2.Truth.DESCRIPTOR.fields}
    assert {len(column) for column in truth.values()} == {SECONDS}
    assert len(recording.columns("control")["time_ns"]) == 0
    assert recording.meanings("advice", "mode")[4] == "MODE_COAST"


def test_repeated_fields_and_messages_within_messages(whole: Path) -> None:
    recording = read_recording(whole)
    plan = recording.columns("plan")
    assert (plan["s_m"].shape, plan["s_m"].dtype) == ((60,), object)
    for t, s_m in zip(range(0, SECONDS, 10), plan["s_m"], strict=True):
        np.testing.assert_allclose(s_m, [position_m(t), position_m(t) + 100.0])
    assert {column.shape for column in plan.values()} == {(60,)}
    assert [len(force_n) for force_n in plan["force_n"]] == [0] * 60
    journey = recording.columns("journey", "stops")
    assert journey["stops"].shape == (1,)
    first, last = journey["stops"][0]
    assert first == {"name": "A", "s_m": 0.0, "arrival_ns": 0, "departure_ns": 0}
    assert last["name"] == "B"
    time = recording.columns("location", "timestamp")["timestamp"][1]
    assert time["seconds"] * 1_000_000_000 + time["nanos"] == at_ns(1)


@pytest.mark.parametrize(
    ("topic", "field", "message"),
    [
        ("nothing", "s_m", "topic = 'nothing': expected one of position, delay"),
        ("position", "nothing", "field of position = 'nothing': expected one of time_ns, s_m"),
    ],
)
def test_unknown_names(whole: Path, topic: str, field: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_recording(whole).columns(topic, field)


def test_only_enumerations_have_meanings(whole: Path) -> None:
    recording = read_recording(whole)
    with pytest.raises(InputError, match="field of advice = 's_m': expected mode, next_mode"):
        recording.meanings("advice", "s_m")
    with pytest.raises(InputError, match="it has no enumeration"):
        recording.meanings("delay", "delay_s")


def test_a_number_beyond_64_bits_is_refused_in_one_line(tmp_path: Path) -> None:
    path = write_messages(tmp_path / "large.mcap", "das/t1/control", {1: das_pb2.Control(tick=2**64 - 1)})
    with pytest.raises(DasError, match=r"large.mcap: control: a number is too large for 64 bits"):
        read_recording(path).columns("control", "tick")


def test_messages_are_in_the_order_of_their_log_times(tmp_path: Path) -> None:
    delays = {t_s: das_pb2.Delay(delay_s=t_s) for t_s in (3, 1, 2)}
    path = write_messages(tmp_path / "shuffled.mcap", "das/t1/delay", delays)
    assert [entry.message.delay_s for entry in read_recording(path).of(topics.DELAY)] == [1.0, 2.0, 3.0]


def test_no_train_of_two_is_chosen_in_silence(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "two.mcap", trains=("b", "a"), seconds=5)
    assert "holds several trains or drives, b, a: name one (--of-train)" in refused(path)
    with pytest.raises(DasError, match="holds no train 'c', expected one of b, a"):
        read_recording(path, train="c")
    for train in ("a", "b"):
        recording = read_recording(path, train=train)
        assert recording.trains == ("b", "a")
        assert recording.train == train
        assert len(recording.of(topics.POSITION)) == 5
        assert recording.of(topics.JOURNEY)[0].message.train == train


@pytest.mark.parametrize("share", [0.1, 0.37, 0.5, 0.65])
def test_cut_file(whole: Path, tmp_path: Path, share: float) -> None:
    content = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(share * len(content))])
    recording, full = read_recording(cut), read_recording(whole).of(topics.POSITION)
    assert not recording.complete
    found = recording.of(topics.POSITION)
    assert 0 < len(found) < SECONDS
    assert found == full[: len(found)]
    assert recording.metadata["run"]


def truths_before(cut: Path) -> int:
    """How many messages of a cut file are read; 0 where it is refused, which must not be for damage."""
    try:
        recording = read_recording(cut)
    except DasError as error:
        reason = str(error)
    else:
        assert not recording.complete
        return len(recording.of(topics.TRUTH))
    assert "\n" not in reason
    assert "damaged" not in reason
    return 0


@pytest.mark.slow
def test_every_cut_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    content = write_recording(tmp_path / "short.mcap", seconds=2).read_bytes()
    cut = tmp_path / "cut.mcap"
    counts = []
    for size in (*range(0, len(content) - 31, 31), *range(len(content) - 31, len(content))):
        cut.write_bytes(content[:size])
        counts.append(truths_before(cut))
    assert counts == sorted(counts)
    assert counts[-1] == 2


def refused(path: Path) -> str:
    with pytest.raises(DasError) as error:
        read_recording(path)
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_unusable_files(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "missing.mcap")
    assert "directory" in refused(tmp_path)
    os.mkfifo(tmp_path / "pipe.mcap")
    assert "not a regular file" in refused(tmp_path / "pipe.mcap")
    (tmp_path / "nothing.mcap").write_bytes(b"")
    assert "is empty: nothing was recorded" in refused(tmp_path / "nothing.mcap")
    for content in (b"\x89MC", b"garbage" * 1000):
        (tmp_path / "garbage.mcap").write_bytes(content)
        assert "not an MCAP recording" in refused(tmp_path / "garbage.mcap")
    assert "no messages" in refused(write_recording(tmp_path / "empty.mcap", seconds=0, only=()))


@pytest.mark.slow
def test_damage_is_found(whole: Path, tmp_path: Path) -> None:
    content, damaged = whole.read_bytes(), tmp_path / "damaged.mcap"
    for place in range(200, int(0.7 * len(content)), 8009):
        damaged.write_bytes(content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :])
        assert "damaged" in refused(damaged)


def test_a_wrong_checksum_is_named(tmp_path: Path) -> None:
    path = write_messages(tmp_path / "plain.mcap", "das/t1/event", {1: Log(message="hello")}, compression=0)
    path.write_bytes(path.read_bytes().replace(b"hello", b"hallo"))
    assert "wrong checksum in a chunk" in refused(path)


def test_a_channel_with_another_message_is_refused(tmp_path: Path) -> None:
    path = write_messages(tmp_path / "other.mcap", "das/t1/position", {1: das_pb2.Delay()})
    assert "das/t1/position holds 'das.Delay', expected protobuf 'das.Position'" in refused(path)


def test_attached_files_are_read_also_where_the_end_is_cut_off(whole: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:100_000])
    for path in (whole, cut):
        assert [(one.name, one.data) for one in read_recording(path).attached] == [("route.toml", b"[route]")]
