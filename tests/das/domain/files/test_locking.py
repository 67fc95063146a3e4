"""A folder is held by one process at a time, and nobody's file is harmed by the lock."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from das.domain.errors import DasError
from das.domain.files.writing import LOCK, FolderTakenError, folder_held
from tests.support.making import REPOSITORY, das_precompute

VICTIM = "three years of measurements\n"


def link(lock: Path, victim: Path) -> None:
    lock.symlink_to(victim)


def hard_link(lock: Path, victim: Path) -> None:
    lock.hardlink_to(victim)


def dangling(lock: Path, victim: Path) -> None:
    lock.symlink_to(victim.with_name("nowhere"))


def pipe(lock: Path, _victim: Path) -> None:
    os.mkfifo(lock)


def folder(lock: Path, _victim: Path) -> None:
    lock.mkdir()


def anybodys(lock: Path, _victim: Path) -> None:
    lock.write_text(VICTIM)


STRANGERS = [link, hard_link, dangling, pipe, folder, anybodys]


@pytest.mark.parametrize("stranger", STRANGERS)
def test_what_is_no_lock_of_ours_is_left_alone(tmp_path: Path, stranger: Callable[[Path, Path], None]) -> None:
    place, victim = tmp_path / "tables", tmp_path / "victim"
    place.mkdir()
    victim.write_text(VICTIM)
    stranger(place / LOCK, victim)
    before = os.lstat(place / LOCK)
    with (
        pytest.raises(DasError, match=r"tables/\.lock: is not a lock file of ours; remove it"),
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
    assert done.stderr.splitlines()[-1] == "error: tables/.lock: is not a lock file of ours; remove it"
    assert (tmp_path / "victim").read_text() == VICTIM


@pytest.mark.more
@pytest.mark.processes
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
