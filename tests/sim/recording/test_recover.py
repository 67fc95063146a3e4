"""What is sound in a damaged recording is saved, and what is gone is counted."""

from __future__ import annotations

import os
import random
import stat
import threading
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from das.bus import das_pb2, topics
from das.bus.recorder import RecordingFile
from das.bus.recording import Recording, read_contents, read_raw, read_recording
from das.domain.errors import DasError
from sim.cli.recordings import check
from sim.recording.check import check_file
from sim.recording.recover import recover
from tests.support.recordings import START_NS, write_recording

S = 1_000_000_000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "whole.mcap"
    file = RecordingFile(path)
    file.add_attachment("route.toml", "application/octet-stream", b"[route]")
    file.add_metadata("run", {"scenario": "clear-day"})
    for t in range(60):
        now_ns = START_NS + t * S
        for topic, message in (
            (topics.POSITION, das_pb2.Position(time_ns=now_ns, s_m=20.0 * t)),
            (topics.TRUTH, das_pb2.Truth(time_ns=now_ns, s_m=20.0 * t)),
        ):
            file.add(topic, topic.key("t1"), message, now_ns)
        file.flush()
    file.close()
    return path


def said(recording: Recording) -> set[tuple[str, int, bytes]]:
    return {
        (name, one.log_time_ns, one.message.SerializeToString())
        for name, entries in recording.messages.items()
        for one in entries
    }


def test_a_sound_recording_stays_the_same(whole: Path, tmp_path: Path) -> None:
    found = recover(whole, tmp_path / "new.mcap")
    assert found.losses() == []
    before, after = read_recording(whole), read_recording(tmp_path / "new.mcap")
    assert said(after) == said(before)
    assert (after.metadata, after.attachments) == (before.metadata, before.attachments)


@pytest.mark.parametrize("share", [0.15, 0.2, 0.41, 0.6])
def test_a_cut_recording_is_whole_again(whole: Path, tmp_path: Path, share: float) -> None:
    cut, new = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    content = whole.read_bytes()
    cut.write_bytes(content[: int(share * len(content))])
    found = recover(cut, new)
    after = read_recording(new)
    assert said(after) == said(read_recording(cut))
    assert len(said(after)) == found.messages
    assert after.complete
    assert after.health.sound
    assert "cut off" in after.metadata["recovered"]["lost"]
    assert check_file(new).findings == ()
    with new.open("rb") as file:  # another reader, which trusts the index
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == found.messages


def test_flipped_bytes_are_left_out_and_counted(whole: Path, tmp_path: Path) -> None:
    content, sound = whole.read_bytes(), said(read_recording(whole))
    random.seed(18)
    for _ in range(30):
        altered = bytearray(content)
        for _ in range(3):
            altered[random.randrange(200, len(content))] ^= random.randrange(1, 256)
        (tmp_path / "altered.mcap").write_bytes(altered)
        found = recover(tmp_path / "altered.mcap", tmp_path / "new.mcap")
        after = read_recording(tmp_path / "new.mcap")
        assert said(after) <= sound
        assert not after.health.damage
        if said(after) != sound:
            assert found.losses()
            assert after.metadata["recovered"]["lost"]


def test_a_lost_first_chunk_takes_no_channel_with_it(whole: Path, tmp_path: Path) -> None:
    altered = bytearray(whole.read_bytes()[:9000])
    altered[altered.index(b"\x04\x00\x00\x00zstd") + 60] ^= 1
    (tmp_path / "altered.mcap").write_bytes(altered)
    recover(tmp_path / "altered.mcap", tmp_path / "new.mcap")
    after = read_recording(tmp_path / "new.mcap")
    assert after.topics == ("position", "truth")
    assert schemas(tmp_path / "new.mcap") == schemas(whole)  # also for other readers


def schemas(path: Path) -> dict[str, bytes]:
    """The descriptions of the messages of a recording, by the names of their types."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {one.name: one.data for one in summary.schemas.values()}


def test_the_description_of_messages_of_another_version_stays(whole: Path, tmp_path: Path) -> None:
    raw, _ = read_raw(whole)
    channel = next(one for one in raw.channels.values() if one.topic.endswith("position"))
    named = raw.schemas[channel.schema_id]
    other = named.data + b"\x7a\x00"  # a part that our version does not know
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_channel(
            channel.topic, "protobuf", writer.register_schema(named.name, "protobuf", other)
        )
        writer.add_message(number, START_NS, das_pb2.Position(time_ns=START_NS).SerializeToString(), START_NS)
        writer.finish()
    recover(path, tmp_path / "new.mcap")
    assert schemas(tmp_path / "new.mcap") == {named.name: other}


def test_metadata_that_nothing_proves_do_not_become_proven(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "old.mcap", seconds=5)
    content = path.read_bytes().replace(b"crc32", b"crc99")  # as of a version without checksums
    path.write_bytes(content[: len(content) // 3])
    recover(path, tmp_path / "new.mcap")
    metadata = read_recording(tmp_path / "new.mcap").metadata
    assert "run" not in metadata
    assert metadata["unchecked run"]["route_sha256"] == "0123456789abcdef0123"


def test_messages_of_other_programs_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        channel = writer.register_channel("/camera", "json", schema, {"of": "the cab"})
        writer.add_message(channel, START_NS, b'{"a": 1}', START_NS)
        writer.finish()
    path.write_bytes(path.read_bytes()[:-30])
    recover(path, tmp_path / "new.mcap")
    with (tmp_path / "new.mcap").open("rb") as file:
        ((_, channel_found, message),) = make_reader(file).iter_messages()
    assert (channel_found.topic, channel_found.metadata, message.data) == ("/camera", {"of": "the cab"}, b'{"a": 1}')
    assert read_contents(tmp_path / "new.mcap").foreign == {"/camera": 1}


def test_nothing_is_written_where_nothing_can_be_saved(tmp_path: Path) -> None:
    new = tmp_path / "new.mcap"
    for content, expected in ((b"", "is empty"), (b"no recording" * 9, "not an MCAP recording")):
        (tmp_path / "bad.mcap").write_bytes(content)
        with pytest.raises(DasError, match=expected):
            recover(tmp_path / "bad.mcap", new)
    RecordingFile(tmp_path / "begun.mcap").close()
    with pytest.raises(DasError, match="holds no message that could be saved"):
        recover(tmp_path / "begun.mcap", new)
    assert not new.exists()


def test_a_recording_never_replaces_itself(whole: Path) -> None:
    with pytest.raises(DasError, match="the output file is also an input"):
        check(whole, save=whole)


def test_a_device_is_written_to_and_not_replaced(whole: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    recover(whole, pipe)
    reader.join()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    (tmp_path / "read.mcap").write_bytes(read[0])
    assert said(read_recording(tmp_path / "read.mcap")) == said(read_recording(whole))


def test_two_merged_recordings_are_saved_whole(whole: Path, tmp_path: Path) -> None:
    """Another drive has the same running numbers and perhaps the same channels; each of its messages is its own."""
    merged = tmp_path / "merged.mcap"
    raw, _ = read_raw(whole)
    with merged.open("wb") as file:
        writer = Writer(file)
        writer.start()
        numbers = {
            key: writer.register_channel(
                x.topic, "protobuf", writer.register_schema(named.name, "protobuf", named.data)
            )
            for key, x in raw.channels.items()
            for named in (raw.schemas[x.schema_id],)
        }
        for later_ns in (0, 1000 * S):
            for x in raw.messages:
                at_ns = x.log_time + later_ns
                writer.add_message(numbers[x.channel_id], at_ns, x.data, at_ns, x.sequence)
        with whole.open("rb") as one:
            for metadata in make_reader(one).iter_metadata():
                writer.add_metadata(metadata.name, metadata.metadata)
        writer.finish()
    found = recover(merged, tmp_path / "new.mcap")
    assert (found.messages, found.losses()) == (240, [])
    both = [read_recording(tmp_path / "new.mcap", train=name) for name in ("t1", "t1-drive-2")]
    assert [len(said(one)) for one in both] == [120, 120]
    assert check_file(merged, "t1").notes == ("also recorded, not checked: t1-drive-2 (--of-train)",)
