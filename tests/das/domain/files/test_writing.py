"""Writing files whole, whatever stands at the path."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from das.bus.recorder import RecordingFile
from das.domain.errors import DasError
from das.domain.files import writing
from sim.recording.opening import whole_recording


def test_a_device_is_written_to(tmp_path: Path) -> None:
    """Renaming into place would put a regular file where the device was."""
    full = Path("/dev/full")
    if full.is_char_device():
        with pytest.raises(DasError, match="No space left"):
            writing.write_whole(full, b"x")
        assert full.is_char_device()


@pytest.mark.parametrize("dangling", [False, True])
def test_a_link_is_neither_followed_nor_replaced(dangling: bool, tmp_path: Path) -> None:
    link, target = tmp_path / "link", tmp_path / "target"
    link.symlink_to(target)
    if not dangling:
        target.write_bytes(b"mine")
    writers: list[Callable[[Path], object]] = [
        lambda path: writing.check_writable(path, overwrite=True),
        lambda path: writing.write_whole(path, b"x"),
        RecordingFile,
        lambda path: whole_recording(path, 1).__enter__(),
    ]
    for write in writers:
        with pytest.raises(DasError, match="link: is a symbolic link, expected the file itself or a new name"):
            write(link)
    assert link.is_symlink()
    assert (target.read_bytes() == b"mine") if not dangling else not target.exists()
    assert len(list(tmp_path.iterdir())) == (1 if dangling else 2)


def test_a_file_that_is_there_is_replaced_only_if_that_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    writing.check_writable(path, overwrite=False)
    path.write_bytes(b"mine")
    with pytest.raises(DasError, match=r"out\.csv: is there already, expected a new file \(--overwrite replaces it\)"):
        writing.check_writable(path, overwrite=False)
    writing.check_writable(path, overwrite=True)


def test_a_block_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_bytes(b"mine")

    def half() -> None:
        with writing.whole_file(path) as file:
            file.write(b"half of it")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
    assert path.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [path]
