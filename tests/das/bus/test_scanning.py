"""Damaged recordings: every flipped byte is harmless or told, and no value changes in silence."""

from __future__ import annotations

import random
import struct
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from das.bus import chunks, das_pb2, topics
from das.bus.contents import read_contents
from das.bus.recorder import RecordingFile
from das.bus.recording import Recording, read_recording
from das.bus.scanning import MAGIC, UNCHECKED, begun, sealed
from das.domain.errors import DasError
from tests.support.recordings import START_NS

SECONDS = 40
FLIPS = 100


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording as the recorder writes it: many chunks, metadata, an attachment."""
    path = tmp_path_factory.mktemp("recordings") / "whole.mcap"
    file = RecordingFile(path)
    file.add_attachment("route.toml", "application/octet-stream", b"[route]" * 50)
    file.add_metadata("run", {"route_sha256": "0123456789abcdef" * 4, "scenario": "clear-day"})
    for t in range(SECONDS):
        now_ns = START_NS + t * 1_000_000_000
        for topic, message in (
            (topics.POSITION, das_pb2.Position(time_ns=now_ns, s_m=20.0 * t, speed_mps=20.0)),
            (topics.ADVICE, das_pb2.Advice(time_ns=now_ns, s_m=20.0 * t, horizon_speed_mps=[20.0 + t] * 30)),
        ):
            file.add(topic, topic.key("t1"), message, now_ns)
        file.flush()
    file.close()
    return path


def cut(path: Path, share: float) -> bytes:
    """The beginning of a file: a share of its data, without any of its index."""
    content = path.read_bytes()
    data = content.index(struct.pack("<BQ", Opcode.DATA_END, 4))
    return content if share >= 1.0 else content[: int(share * data)]


def told(recording: Recording) -> dict[tuple[str, int], bytes]:
    """All messages by topic and time, as bytes."""
    return {
        (name, one.log_time_ns): one.message.SerializeToString()
        for name, entries in recording.messages.items()
        for one in entries
    }


def check_flip(path: Path, content: bytes, place: int, flip: int, sound: Recording) -> None:
    """A file with a byte flipped says nothing but what the sound one says, and says that it is damaged."""
    path.write_bytes(content[:place] + bytes([content[place] ^ flip]) + content[place + 1 :])
    try:
        found = read_recording(path, skip_damage=True)
    except DasError:  # said in one line
        return
    before, after = told(sound), told(found)
    assert after.items() <= before.items(), f"byte {place} changed a message"
    used = {name: entries for name, entries in found.metadata.items() if not name.startswith(UNCHECKED)}
    assert used.items() <= sound.metadata.items(), f"byte {place} changed the metadata"
    same = after == before and used == sound.metadata and found.attachments == sound.attachments
    assert same or found.health.warnings(), f"byte {place} cost something in silence"
    if sound.complete:
        assert found.health.warnings(), f"byte {place} was altered in silence"
    if found.complete != sound.complete:
        assert not found.health.sound


def test_a_flipped_byte_is_harmless_or_told(whole: Path, tmp_path: Path) -> None:
    content, sound = whole.read_bytes(), read_recording(whole)
    random.seed(15)
    for _ in range(FLIPS):
        check_flip(tmp_path / "flipped.mcap", content, random.randrange(len(content)), random.randrange(1, 256), sound)


def test_a_flipped_byte_of_a_cut_file_is_harmless_or_told(whole: Path, tmp_path: Path) -> None:
    """Such a file has no checksum over all of it."""
    content = cut(whole, 0.6)
    (tmp_path / "cut.mcap").write_bytes(content)
    sound = read_recording(tmp_path / "cut.mcap")
    random.seed(16)
    for _ in range(FLIPS):
        check_flip(tmp_path / "flipped.mcap", content, random.randrange(len(content)), random.randrange(1, 256), sound)


@pytest.mark.slow
def test_every_byte_of_the_beginning_flipped(whole: Path, tmp_path: Path) -> None:
    """Header, attachment, metadata and the first chunks, every byte of them, in a cut file."""
    content = cut(whole, 0.5)
    (tmp_path / "cut.mcap").write_bytes(content)
    sound = read_recording(tmp_path / "cut.mcap")
    for place in range(len(content)):
        check_flip(tmp_path / "flipped.mcap", content, place, 1 << place % 8, sound)


def test_metadata_of_a_cut_file_cannot_be_altered_in_silence(whole: Path, tmp_path: Path) -> None:
    content = cut(whole, 0.5)
    altered = content.replace(b"0123456789abcdef", b"0123456789abcdee", 1)
    assert altered != content
    path = tmp_path / "altered.mcap"
    path.write_bytes(altered)
    with pytest.raises(DasError, match="damaged: wrong checksum in the metadata 'run'"):
        read_recording(path)
    found = read_recording(path, skip_damage=True)
    assert "run" not in found.metadata
    assert any("metadata 'run'" in line for line in found.health.warnings())


def test_metadata_without_a_checksum_are_not_used_where_nothing_proves_them(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    write_with(path, lambda writer: writer.add_metadata("run", {"route_sha256": "0123"}))
    assert read_recording(path).metadata == {"run": {"route_sha256": "0123"}}
    content = path.read_bytes()
    path.write_bytes(content[: content.index(struct.pack("<BQ", Opcode.DATA_END, 4))])
    found = read_recording(path)
    assert found.metadata == {f"{UNCHECKED}run": {"route_sha256": "0123"}}
    assert any("metadata 'run'" in line for line in found.health.warnings())


def test_what_comes_after_a_damaged_length_is_found_again(whole: Path, tmp_path: Path) -> None:
    """The length of a chunk in the middle: the chunk's own words still say where it ends."""
    content = bytearray(whole.read_bytes())
    place = content.index(b"\x04\x00\x00\x00zstd", len(content) // 4) - 37
    assert content[place] == Opcode.CHUNK
    content[place + 5] ^= 0x11
    (tmp_path / "damaged.mcap").write_bytes(content)
    found = read_recording(tmp_path / "damaged.mcap", skip_damage=True)
    assert told(found) == told(read_recording(whole))
    assert "the head of a chunk, whose messages are whole" in found.health.damage[0].what


@pytest.mark.parametrize("end", [0.9, 1.0])
def test_a_chunk_whose_own_length_is_damaged_is_lost_alone(whole: Path, tmp_path: Path, end: float) -> None:
    """It claims the chunks behind it; its packed data end where they did, and those chunks are read."""
    content = bytearray(cut(whole, end))
    place = content.index(b"\x04\x00\x00\x00zstd", len(content) // 4) + 8
    content[place + 1] ^= 0x08  # 2 kB more
    (tmp_path / "damaged.mcap").write_bytes(content)
    (tmp_path / "sound.mcap").write_bytes(cut(whole, end))
    found, sound = (read_recording(tmp_path / name, skip_damage=True) for name in ("damaged.mcap", "sound.mcap"))
    assert len(told(sound)) - len(told(found)) == 2 == found.health.missing
    assert found.health.damage[0].lost
    assert found.health.damage[0].from_ns > START_NS


@pytest.mark.parametrize("end", [0.7, 1.0])
def test_the_first_chunk_is_lost_alone(whole: Path, tmp_path: Path, end: float) -> None:
    """It describes the channels; what they hold is told in metadata as well."""
    content = bytearray(cut(whole, end))
    place = content.index(b"\x04\x00\x00\x00zstd") + 60
    content[place] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(content)
    (tmp_path / "sound.mcap").write_bytes(cut(whole, end))
    found, sound = (read_recording(tmp_path / name, skip_damage=True) for name in ("damaged.mcap", "sound.mcap"))
    assert len(told(sound)) - len(told(found)) == 2 == found.health.missing
    assert found.topics == sound.topics
    damage = found.health.damage[0]
    assert damage.lost
    assert (damage.from_ns, damage.to_ns) == (START_NS, START_NS)


def test_a_hole_in_the_running_numbers_is_told(tmp_path: Path) -> None:
    path = tmp_path / "hole.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel("das/t1/delay", "protobuf", register_schema(writer, das_pb2.Delay))
        for number in (0, 1, 2, 5):
            writer.add_message(channel, number + 1, das_pb2.Delay(delay_s=number).SerializeToString(), 1, number)
        writer.finish()
    with pytest.raises(DasError, match="2 messages are missing"):
        read_recording(path)
    assert read_recording(path, skip_damage=True).health.missing == 2


def test_a_piece_that_is_in_the_file_twice_counts_once(whole: Path, tmp_path: Path) -> None:
    """A copy of a sound chunk has a right checksum; the running numbers show it."""
    content = cut(whole, 0.8)
    places = [i - 37 for i in range(len(content)) if content.startswith(b"\x04\x00\x00\x00zstd", i)]
    first, second = places[10], places[11]
    (tmp_path / "sound.mcap").write_bytes(content)
    (tmp_path / "twice.mcap").write_bytes(content[:second] + content[first:second] + content[second:])
    found = read_recording(tmp_path / "twice.mcap", skip_damage=True)
    assert told(found) == told(read_recording(tmp_path / "sound.mcap"))
    assert [len(found.of(name)) for name in found.topics] == [len(told(found)) // 2] * 2
    assert found.health.damage[0].what == "2 messages that are in the file twice"


def test_metadata_that_describe_no_channel_are_only_metadata(tmp_path: Path) -> None:
    """A reader gets back what was written with a right checksum, and nothing else."""
    path = tmp_path / "odd.mcap"
    odd = {"channel 7": {"topic": "x"}, "channel x": {}, "channel 8": {"schema_id": "-1", "topic": "", "schema": ""}}
    write_with(path, lambda writer: [writer.add_metadata(name, sealed(name, data)) for name, data in odd.items()])
    assert read_recording(path).metadata == odd


def write_with(path: Path, add: Any) -> None:
    """A recording of another program: one delay, and whatever is added."""
    with path.open("wb") as stream:
        writer = Writer(stream, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel("das/t1/delay", "protobuf", register_schema(writer, das_pb2.Delay))
        writer.add_message(channel, 1, das_pb2.Delay(delay_s=1.0).SerializeToString(), 1)
        add(writer)
        writer.finish()


def bomb(plain: bytes, claimed: int | None = None) -> bytes:
    """An MCAP file whose chunk unpacks to `plain`."""
    packed = zstandard.compress(plain, 19)
    content = struct.pack("<QQQII", 0, 0, len(plain) if claimed is None else claimed, 0, 4) + b"zstd"
    content += struct.pack("<Q", len(packed)) + packed
    return begun("test") + bytes([Opcode.CHUNK]) + struct.pack("<Q", len(content)) + content


def test_a_small_file_cannot_keep_its_reader_busy(tmp_path: Path) -> None:
    """Zeros unpack to millions of records of no bytes; only counting them took minutes."""
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(bytes(200_000_000)))
    assert path.stat().st_size < 10_000
    with pytest.raises(DasError, match="damaged: a chunk that claims to hold 190 MiB"):
        read_recording(path)
    path.write_bytes(bomb(bytes(60_000_000)))
    with pytest.raises(DasError, match="unpacks to more than 100 times its size"):
        read_recording(path)
    path.write_bytes(bomb(bytes(10_000_000)))
    with pytest.raises(DasError, match="damaged: a chunk with something other than messages in it"):
        read_recording(path)
    path.write_bytes(bomb(bytes(200_000_000), claimed=1000))
    with pytest.raises(DasError, match="damaged: a chunk that cannot be decompressed"):
        read_recording(path)


def test_more_messages_than_a_recording_can_have_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "many.mcap"
    empty = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 1, 1)
    path.write_bytes(bomb(empty * 2000))
    monkeypatch.setattr(chunks, "MOST_MESSAGES", 1000)
    monkeypatch.setattr(chunks.Budget, "of", classmethod(lambda cls, size: cls(10**9, 1000)))
    with pytest.raises(DasError, match="holds more than 1000 messages"):
        read_contents(path)


def test_a_recording_is_never_empty(tmp_path: Path) -> None:
    """From the first moment on there is a file that can be told from an empty one."""
    path = tmp_path / "run.mcap"
    file = RecordingFile(path)
    assert path.read_bytes().startswith(MAGIC)
    with pytest.raises(DasError, match="holds no messages of a train before it was cut off"):
        read_recording(path)
    file.close()
    assert [one.name for one in tmp_path.iterdir()] == ["run.mcap"]
