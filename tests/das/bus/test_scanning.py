"""Damaged recordings: every flipped byte is harmless or reported, and no value changes in silence."""

from __future__ import annotations

import os
import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from das.bus import das_pb2, recording, scanning, topics
from das.bus.recorder import RecordingFile
from das.bus.recording import Recording, read_contents, read_raw, read_recording
from das.bus.scanning import UNCHECKED, Damage, Health
from das.bus.sealing import MAGIC, sealed
from das.domain.errors import DasError
from tests.support.recordings import START_NS, write_messages

SECONDS = 40
FLIPS = 100
ZSTD = b"\x04\x00\x00\x00zstd"
"""The bytes in a chunk that name its compression."""


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


def sound_part(whole: Path, folder: Path, share: float) -> tuple[bytes, Recording]:
    """The beginning of a file, and the recording that it holds."""
    path = folder / "sound.mcap"
    path.write_bytes(cut(whole, share))
    return path.read_bytes(), read_recording(path)


def altered(content: bytes, place: int, flip: int) -> bytes:
    """The content with one byte changed by exclusive or."""
    return content[:place] + bytes([content[place] ^ flip]) + content[place + 1 :]


def read_damaged(folder: Path, content: bytes) -> Recording:
    """The recording of a damaged file, without its damaged parts."""
    path = folder / "damaged.mcap"
    path.write_bytes(content)
    return read_recording(path, skip_damage=True)


def messages_of(recording: Recording) -> dict[tuple[str, int], bytes]:
    """All messages by topic and time, as bytes."""
    return {
        (name, one.log_time_ns): one.message.SerializeToString()
        for name, entries in recording.messages.items()
        for one in entries
    }


def check_flip(path: Path, content: bytes, place: int, flip: int, sound: Recording) -> None:
    """A file with a flipped byte gives no values but those of the sound one, and is reported as damaged."""
    path.write_bytes(altered(content, place, flip))
    try:
        found = read_recording(path, skip_damage=True)
    except DasError:  # one line
        return
    before, after = messages_of(sound), messages_of(found)
    assert after.items() <= before.items(), f"byte {place} changed a message"
    used = {name: entries for name, entries in found.metadata.items() if not name.startswith(UNCHECKED)}
    assert used.items() <= sound.metadata.items(), f"byte {place} changed the metadata"
    same = after == before and used == sound.metadata and found.attachments == sound.attachments
    assert same or found.health.warnings(), f"byte {place} cost something in silence"
    if sound.complete:
        assert found.health.warnings(), f"byte {place} was altered in silence"
    if found.complete != sound.complete:
        assert not found.health.sound


@pytest.mark.parametrize(("share", "seed"), [(1.0, 15), (0.6, 16)])
def test_a_flipped_byte_is_harmless_or_reported(whole: Path, tmp_path: Path, share: float, seed: int) -> None:
    """A cut file has no checksum over all of it."""
    content, sound = sound_part(whole, tmp_path, share)
    random.seed(seed)
    for _ in range(FLIPS):
        check_flip(tmp_path / "flipped.mcap", content, random.randrange(len(content)), random.randrange(1, 256), sound)


@pytest.mark.nightly
def test_every_byte_of_the_beginning_flipped(whole: Path, tmp_path: Path) -> None:
    """Header, attachment, metadata and the first chunks, every byte of them, in a cut file."""
    content, sound = sound_part(whole, tmp_path, 0.5)
    for place in range(len(content)):
        check_flip(tmp_path / "flipped.mcap", content, place, 1 << place % 8, sound)


def test_metadata_of_a_cut_file_cannot_be_altered_in_silence(whole: Path, tmp_path: Path) -> None:
    content = cut(whole, 0.5)
    wrong = content.replace(b"0123456789abcdef", b"0123456789abcdee", 1)
    assert wrong != content
    found = read_damaged(tmp_path, wrong)
    with pytest.raises(DasError, match="damaged: wrong checksum in the metadata 'run'"):
        read_recording(tmp_path / "damaged.mcap")
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
    """The length of a chunk in the middle is damaged: the chunk itself still states where it ends."""
    content = whole.read_bytes()
    place = content.index(ZSTD, len(content) // 4) - 37
    assert content[place] == Opcode.CHUNK
    found = read_damaged(tmp_path, altered(content, place + 5, 0x11))
    assert messages_of(found) == messages_of(read_recording(whole))
    assert "the header of a chunk, whose messages are intact" in found.health.damage[0].what


@pytest.mark.parametrize(("share", "first"), [(0.7, True), (1.0, True), (0.9, False), (1.0, False)])
def test_a_damaged_chunk_is_lost_alone(whole: Path, tmp_path: Path, share: float, *, first: bool) -> None:
    """The first chunk describes the channels, which metadata do as well. The other chunk has a damaged length.

    It claims the chunks behind it; but its packed data end where they did before, and those chunks are read.
    """
    content, sound = sound_part(whole, tmp_path, share)
    chunk = content.index(ZSTD, 0 if first else len(content) // 4)
    found = read_damaged(tmp_path, altered(content, chunk + (60 if first else 9), 0xFF if first else 0x08))
    assert len(messages_of(sound)) - len(messages_of(found)) == 2 == found.health.missing
    assert found.topics == sound.topics
    damage = found.health.damage[0]
    assert damage.lost
    assert (damage.from_ns, damage.to_ns) == (START_NS, START_NS) if first else damage.from_ns > START_NS


def test_a_hole_in_the_running_numbers_is_messages_of(tmp_path: Path) -> None:
    delays = {log_ns: das_pb2.Delay(delay_s=log_ns) for log_ns in (1, 2, 3, 6)}
    path = write_messages(tmp_path / "hole.mcap", "das/t1/delay", delays, numbered=True, enable_data_crcs=True)
    with pytest.raises(DasError, match="2 messages are missing"):
        read_recording(path)
    assert read_recording(path, skip_damage=True).health.missing == 2


def test_a_piece_that_is_in_the_file_twice_counts_once(whole: Path, tmp_path: Path) -> None:
    """A copy of a sound chunk has a right checksum; the running numbers show it."""
    content, sound = sound_part(whole, tmp_path, 0.8)
    first, second = [i - 37 for i in range(len(content)) if content.startswith(ZSTD, i)][10:12]
    found = read_damaged(tmp_path, content[:second] + content[first:second] + content[second:])
    assert messages_of(found) == messages_of(sound)
    assert [len(found.of(name)) for name in found.topics] == [len(messages_of(found)) // 2] * 2
    assert found.health.damage[0].what == "2 messages that are in the file twice"


def test_metadata_that_describe_no_channel_are_only_metadata(tmp_path: Path) -> None:
    """A reader gets back what was written with a right checksum, and nothing else."""
    path = tmp_path / "odd.mcap"
    odd = {"channel 7": {"topic": "x"}, "channel x": {}, "channel 8": {"schema_id": "-1", "topic": "", "schema": ""}}
    write_with(path, lambda writer: [writer.add_metadata(name, sealed(name, data)) for name, data in odd.items()])
    assert read_recording(path).metadata == odd


def write_with(path: Path, add: Callable[[Writer], Any]) -> None:
    """A recording of another program: one delay, and what `add` adds."""
    write_messages(path, "das/t1/delay", {1: das_pb2.Delay(delay_s=1.0)}, add=add, enable_data_crcs=True)


def bomb(plain: bytes, claimed: int | None = None) -> bytes:
    """An MCAP file whose chunk unpacks to `plain`."""
    packed = zstandard.compress(plain, 19)
    content = struct.pack("<QQQII", 0, 0, len(plain) if claimed is None else claimed, 0, 4) + b"zstd"
    content += struct.pack("<Q", len(packed)) + packed
    return MAGIC + bytes([Opcode.CHUNK]) + struct.pack("<Q", len(content)) + content


@pytest.mark.parametrize(
    ("size", "claimed", "why"),
    [
        (200_000_000, None, "damaged: a chunk that unpacks to 190 MiB, too much for a file of"),
        (60_000_000, None, "damaged: a chunk that unpacks to 57 MiB, too much for a file of"),
        (10_000_000, None, "damaged: a chunk that unpacks to 9 MiB, too much for a file of"),
        (9 * 400_000, None, "holds no messages of a train before it was cut off"),
        (200_000_000, 1000, "damaged: a chunk whose unpacked size differs from the size in its header"),
    ],
)
def test_a_small_file_cannot_keep_its_reader_busy(tmp_path: Path, size: int, claimed: int | None, why: str) -> None:
    """Zeros unpack to millions of records of no bytes; walking through those of a few MiB takes less than a second."""
    path = tmp_path / "bomb.mcap"
    path.write_bytes(bomb(bytes(size), claimed))
    assert path.stat().st_size < 10_000
    with pytest.raises(DasError, match=why):
        read_recording(path)


def test_more_messages_than_a_recording_can_have_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "many.mcap"
    empty = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 1, 1)
    path.write_bytes(bomb(empty * 2000))
    monkeypatch.setattr(scanning, "MOST_MESSAGES", 1000)
    with pytest.raises(DasError, match="holds more than 1000 messages"):
        read_contents(path)


def test_a_file_that_would_fill_the_memory_is_refused(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "MOST_BYTES", whole.stat().st_size)
    assert read_recording(whole).complete
    (tmp_path / "more.mcap").write_bytes(whole.read_bytes() + b"!")
    with pytest.raises(DasError, match=r"more.mcap: is larger than 0 MiB: cut it into shorter recordings"):
        read_contents(tmp_path / "more.mcap")


def test_a_file_cut_while_it_is_read_does_not_end_the_process(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bytes of a file mapped into memory that are there no more end the process by a signal."""
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes())

    def cut_meanwhile(data: bytes) -> scanning.Scan:
        os.truncate(path, len(MAGIC))
        return scanning.Scan(data)

    monkeypatch.setattr(recording, "Scan", cut_meanwhile)
    assert messages_of(read_recording(path)) == messages_of(read_recording(whole))


def test_a_recording_is_never_empty(tmp_path: Path) -> None:
    """From the first moment on there is a file that can be told from an empty one."""
    path = tmp_path / "run.mcap"
    file = RecordingFile(path)
    assert path.read_bytes().startswith(MAGIC)
    with pytest.raises(DasError, match="holds no messages of a train before it was cut off"):
        read_recording(path)
    file.close()
    assert [one.name for one in tmp_path.iterdir()] == ["run.mcap"]


def rewritten(out: Path, *sources: Path, without: str = "", by_time: bool = False, merged: bool = False) -> Path:
    """Recordings copied into one file by the standard writer, which numbers the channels anew; without one topic.

    Channels lose their metadata, or are `merged` as `mcap merge` does: those with equal topics and metadata are one.
    """
    found, joined = [], {}
    with out.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for source in sources:
            raw, _ = read_raw(source)
            schemas = {key: writer.register_schema(x.name, x.encoding, x.data) for key, x in raw.schemas.items()}
            kept = [x for x in raw.channels.values() if x.topic != without]
            channels = {}
            for x in kept:
                entries = x.metadata if merged else {}
                key = (x.topic, *entries.items()) if merged else (source, x.id)
                if key not in joined:
                    joined[key] = writer.register_channel(x.topic, "protobuf", schemas[x.schema_id], entries)
                channels[x.id] = joined[key]
            found += [(channels[x.channel_id], x) for x in raw.messages if x.channel_id in channels]
            with source.open("rb") as one:
                for metadata in make_reader(one).iter_metadata():
                    writer.add_metadata(metadata.name, metadata.metadata)
        for channel, x in sorted(found, key=lambda each: each[1].log_time) if by_time else found:
            writer.add_message(channel, x.log_time, x.data, x.publish_time, x.sequence)
        writer.finish()
    return out


def drive(path: Path, train: str, first_s: int, driver: str) -> Path:
    """A recording of ten seconds, as the recorder writes it."""
    file = RecordingFile(path)
    file.add_metadata("run", {"train": train, "driver": driver, "kind": "run"})
    for t in range(first_s, first_s + 10):
        now_ns = START_NS + t * 1_000_000_000
        file.add(topics.DELAY, topics.DELAY.key(train), das_pb2.Delay(time_ns=now_ns, delay_s=t), now_ns)
        position = das_pb2.Position(time_ns=now_ns, s_m=20.0 * t, speed_mps=20.0)
        file.add(topics.POSITION, topics.POSITION.key(train), position, now_ns)
    file.close()
    return path


@pytest.mark.parametrize("gone", ["das/t1/position", "das/t1/advice"])
def test_a_file_rewritten_without_a_topic_is_read(whole: Path, tmp_path: Path, gone: str) -> None:
    """Its metadata still describe channels by their former numbers, which now belong to other topics."""
    found = read_recording(rewritten(tmp_path / "less.mcap", whole, without=gone), skip_damage=True)
    sound = read_recording(whole)
    (kept,) = set(sound.topics) - {gone.rpartition("/")[2]}
    assert found.topics == (kept,)
    assert found.of(kept) == sound.of(kept)
    assert found.health.damage == ()


def test_two_trains_of_merged_recordings_are_read_by_their_names(tmp_path: Path) -> None:
    one, other = drive(tmp_path / "1.mcap", "t1", 0, "anna"), drive(tmp_path / "2.mcap", "t2", 5, "ben")
    merged = rewritten(tmp_path / "merged.mcap", one, other)
    with pytest.raises(DasError, match="several trains or drives, t1, t2: name one"):
        read_recording(merged)
    for train, source in (("t1", one), ("t2", other)):
        found, alone = read_recording(merged, train=train), read_recording(source)
        assert found.messages == alone.messages
        assert found.metadata["run"] == alone.metadata["run"]
        assert found.health.damage == ()


def test_two_drives_of_one_train_in_a_merged_file_are_read_by_their_names(tmp_path: Path) -> None:
    one, other = drive(tmp_path / "1.mcap", "t1", 0, "anna"), drive(tmp_path / "2.mcap", "t1", 100, "ben")
    merged = rewritten(tmp_path / "merged.mcap", one, other)
    with pytest.raises(DasError, match="several trains or drives, t1, t1-drive-2: name one"):
        read_recording(merged)
    for train, source in (("t1", one), ("t1-drive-2", other)):
        found = read_recording(merged, train=train)
        assert found.messages == read_recording(source).messages
        assert found.metadata["run"] == {"train": "t1", "kind": "run"}


@pytest.mark.parametrize("later_s", [0, 5, 100])
def test_merged_drives_of_one_train_at_the_same_time_are_read_by_their_names(tmp_path: Path, later_s: int) -> None:
    """Channels name their recording, so that the standard tool keeps them apart; so do the metadata."""
    one, other = drive(tmp_path / "1.mcap", "t1", 0, "anna"), drive(tmp_path / "2.mcap", "t1", later_s, "ben")
    merged = rewritten(tmp_path / "merged.mcap", one, other, by_time=True, merged=True)
    with pytest.raises(DasError, match="several trains or drives, t1, t1-drive-2: name one"):
        read_recording(merged)
    for train, source in (("t1", one), ("t1-drive-2", other)):
        found, alone = read_recording(merged, train=train), read_recording(source)
        assert found.messages == alone.messages
        assert found.metadata["run"] == alone.metadata["run"]
        assert found.health.damage == ()


def test_a_recording_merged_with_itself_is_one_drive(tmp_path: Path) -> None:
    one = drive(tmp_path / "1.mcap", "t1", 0, "anna")
    merged = rewritten(tmp_path / "merged.mcap", one, one, by_time=True, merged=True)
    assert read_recording(merged, skip_damage=True).messages == read_recording(one).messages


def test_drives_that_run_through_each_other_in_channels_without_a_name_are_refused(tmp_path: Path) -> None:
    """Version 0.2 wrote such channels, and the standard tool joins them."""
    one, other = drive(tmp_path / "1.mcap", "t1", 0, "anna"), drive(tmp_path / "2.mcap", "t1", 5, "ben")
    merged = rewritten(tmp_path / "merged.mcap", one, other, by_time=True)
    with pytest.raises(DasError, match=r"2 drives of the train 't1' at the same time.*: read the files from which"):
        read_contents(merged)


@pytest.mark.parametrize(("places", "more"), [(5, []), (8, ["damaged: 3 more places"])])
def test_five_damaged_places_are_listed_and_the_others_counted(places: int, more: list[str]) -> None:
    damage = tuple(Damage(start_byte=10 * i, end_byte=10 * i + 5, what=f"place {i}") for i in range(places))
    listed = [f"damaged: place {i} (bytes {10 * i} to {10 * i + 5}); it is left out" for i in range(5)]
    assert Health(size_bytes=100, complete=True, damage=damage).warnings() == listed + more
