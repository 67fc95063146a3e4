"""Every command that reads recordings says what is damaged in one, and goes on with the rest."""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest
import typer

from das.bus.recorder import RecordingFile
from das.bus.recording import read_contents, read_recording
from das.domain.errors import DasError
from sim.cli.recordings import check, export, reproduce
from sim.cli.review import view
from sim.cli.trips import bundled_recording, trip
from sim.options import NodeSaid, ReplayOptions
from sim.recording import opening
from sim.runs.replay import prepare
from tests.support.reference_recordings import FOLDER

FLIPS = 100
Command = Callable[[Path, Path], object]
OF_A_TRIP: dict[str, Command] = {
    "view --save": lambda file, folder: view(file, save=folder / "view.rrd"),
    "trip": lambda file, folder: trip(file, ReplayOptions().trip),
    "replay": lambda file, folder: prepare(file, ReplayOptions(), folder / "replay.mcap", "test"),
    "check": lambda file, folder: check(file),
    "check --save": lambda file, folder: check(file, save=folder / "new.mcap"),
    "export": lambda file, folder: export(file, folder / "tables", kind="csv"),
}


def damaged(source: Path, out: Path) -> Path:
    """A recording in many chunks, one of them in the middle with a byte that is not as it was written."""
    contents = read_contents(source)
    file = RecordingFile(out)
    for attached in contents.attachments:
        file.add_attachment(attached.name, attached.media_type, attached.data)
    for name, entries in contents.metadata.items():
        file.add_metadata(name, entries)
    for i, one in enumerate(contents.messages):
        file.add(one.topic, one.topic.key(one.train), one.message, one.log_time_ns)
        if i % 20 == 0:
            file.flush()
    file.close()
    content = bytearray(out.read_bytes())
    data = content.index(b"\x0f\x04\0\0\0\0\0\0\0")  # the end of the data
    content[content.index(b"\x04\0\0\0zstd", data // 2) + 40] ^= 0x10
    out.write_bytes(content)
    return out


@pytest.fixture(scope="module")
def trip_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return damaged(bundled_recording(), tmp_path_factory.mktemp("trip") / "damaged.mcap")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("view --save", marks=pytest.mark.slow),
        *("trip", "replay", "check", "check --save", "export"),
    ],
)
def test_damage_is_told_by(name: str, trip_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    opening._warned.clear()
    exits = pytest.raises(typer.Exit) if name.startswith("check") else nullcontext()
    with exits:
        OF_A_TRIP[name](trip_file, tmp_path)
    said = "".join(capfd.readouterr())
    assert "a chunk" in said
    assert "bytes" in said
    assert "left out" in said
    assert "20 messages are missing" in said


@pytest.mark.slow
def test_damage_is_told_by_reproduce(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Without what it heard in the damaged chunk, the cab says something else: that is told as well."""
    opening._warned.clear()
    with pytest.raises(typer.Exit):
        reproduce(damaged(FOLDER / "clear-day.mcap", tmp_path / "damaged.mcap"), NodeSaid())
    said = "".join(capfd.readouterr())
    assert "it is left out" in said
    assert "messages differ" in said


@pytest.mark.slow
def test_flipped_bytes_of_a_real_recording_change_no_value_in_silence(tmp_path: Path) -> None:
    """100 flips of the bundled recording: each is told, and nothing that is read differs from what was written."""
    content, sound = bundled_recording().read_bytes(), read_recording(bundled_recording())
    written = {(name, x.log_time_ns, x.message.SerializeToString()) for name in sound.topics for x in sound.of(name)}
    random.seed(100)
    for _ in range(FLIPS):
        flipped = bytearray(content)
        flipped[random.randrange(len(content))] ^= 1 << random.randrange(8)
        (tmp_path / "flipped.mcap").write_bytes(flipped)
        try:
            found = read_recording(tmp_path / "flipped.mcap", skip_damage=True)
        except DasError:  # refused in one line
            continue
        assert found.health.warnings()
        read = {(name, x.log_time_ns, x.message.SerializeToString()) for name in found.topics for x in found.of(name)}
        assert read <= written
        if "run" in found.metadata:
            assert found.metadata["run"] == sound.metadata["run"]
