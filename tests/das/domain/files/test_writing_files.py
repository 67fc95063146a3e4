"""Writing files whole, whatever stands at the path."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from das.bus.recorder import RecordingFile
from das.domain.errors import DasError
from das.domain.files import writing
from das.domain.files.writing import LOCK, FolderTakenError, folder_held, toml_string
from sim.runs.what_if.open_loop import whole_recording
from tests.support.making import REPOSITORY, das_precompute


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
    with pytest.raises(DasError, match=r"out\.csv: exists already; --overwrite replaces it"):
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


def test_a_file_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    for content in (b"first, longer", b"second"):
        writing.write_whole(path, content)
        assert path.read_bytes() == content
        assert os.listdir(tmp_path) == ["out.csv"]
    assert path.stat().st_mode & 0o111 == 0


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "out.csv"
    path.write_bytes(b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(DasError, match=rf"^{re.escape(str(path))}: cannot be written \(No space left on device\)$"):
        writing.write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["out.csv"]


@pytest.mark.parametrize(
    "check",
    [lambda path: writing.check_writable(path, overwrite=True), lambda path: writing.write_whole(path, b"x")],
    ids=["check", "write"],
)
@pytest.mark.parametrize("place", ["a-file/out.csv", "no-folder/out.csv", "a-folder"])
def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path, check: Callable[[Path], None], place: str) -> None:
    (tmp_path / "a-file").write_text("")
    (tmp_path / "a-folder").mkdir()
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(
        DasError, match=rf"^{re.escape(str(tmp_path / place))}: (is a folder|no such folder|cannot be wr)"
    ):
        check(tmp_path / place)
    assert sorted(os.listdir(tmp_path)) == before


@contextmanager
def as_nobody() -> Iterator[None]:
    """Root may write anywhere: it acts as another user meanwhile."""
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65_534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)


def test_a_read_only_folder_is_refused() -> None:
    with tempfile.TemporaryDirectory() as name:  # Another user may not look into the folders of pytest.
        Path(name).chmod(0o555)
        with as_nobody(), pytest.raises(DasError, match=r"cannot be written \(Permission denied\)"):
            writing.check_writable(Path(name) / "out.csv", overwrite=False)


VICTIM = "three years of measurements\n"


STRANGERS: dict[str, Callable[[Path, Path], object]] = {
    "link": lambda lock, victim: lock.symlink_to(victim),
    "hard link": lambda lock, victim: lock.hardlink_to(victim),
    "dangling link": lambda lock, victim: lock.symlink_to(victim.with_name("nowhere")),
    "pipe": lambda lock, _: os.mkfifo(lock),
    "folder": lambda lock, _: lock.mkdir(),
    "anybody's file": lambda lock, _: lock.write_text(VICTIM),
}


@pytest.mark.parametrize("stranger", STRANGERS.values(), ids=STRANGERS)
def test_what_is_no_lock_of_ours_is_left_alone(tmp_path: Path, stranger: Callable[[Path, Path], object]) -> None:
    place, victim = tmp_path / "tables", tmp_path / "victim"
    place.mkdir()
    victim.write_text(VICTIM)
    stranger(place / LOCK, victim)
    before = os.lstat(place / LOCK)
    with (
        pytest.raises(DasError, match=r"tables/\.lock: is not a lock file of this program; remove it"),
        folder_held(place, "x"),
    ):
        pass
    assert victim.read_text() == VICTIM
    assert not (tmp_path / "nowhere").exists()
    after = os.lstat(place / LOCK)
    assert (after.st_mode, after.st_size, after.st_ino) == (before.st_mode, before.st_size, before.st_ino)


def test_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(LOCK)
        with pytest.raises(DasError, match=r"cannot be written to|not a lock file"), folder_held(tmp_path, "x"):
            pass


def test_the_build_refuses_a_link_as_a_lock(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "victim").write_text(VICTIM)
    (tmp_path / "tables" / LOCK).symlink_to(tmp_path / "victim")
    (tmp_path / "plan.toml").write_text(
        'schema_version = 1\n[[routes]]\nroute = "flat-6km"\n[[trains]]\nvehicle = "re460-ic"\n'
    )
    done = das_precompute(tmp_path, "build", "plan.toml", "--out", "tables")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "error: tables/.lock: is not a lock file of this program; remove it"
    assert (tmp_path / "victim").read_text() == VICTIM


@pytest.mark.nightly
def test_the_other_process_is_named_and_its_end_frees_the_folder(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from das.domain.files.writing import folder_held\n"
        "with folder_held(Path(sys.argv[1]), 'at work'):\n    print('held', flush=True)\n    time.sleep(600)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "new" / "folder")]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, encoding="utf-8") as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(FolderTakenError, match=rf"new/folder: at work \(process {other.pid}\)"):
            folder_held(tmp_path / "new" / "folder", "at work").__enter__()
        other.kill()
    with folder_held(tmp_path / "new" / "folder", "at work"):
        assert (tmp_path / "new" / "folder" / LOCK).read_text().split() == [str(os.getpid())]


def test_a_lock_of_an_older_version_is_taken(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text("4242\n")
    with folder_held(tmp_path, "x"):
        assert (tmp_path / LOCK).read_text().split() == [str(os.getpid())]


def test_where_no_folder_can_be_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DasError, match="is a file, expected a folder to write to"), folder_held(place, "x"):
            pass


@pytest.mark.parametrize("text", ["Zürich HB", 'a "b"', "two\nlines", "\x7f\x00", "\\"])
def test_any_text_is_read_back_from_its_toml_string(text: str) -> None:
    assert tomllib.loads(f"a = {toml_string(text)}") == {"a": text}
