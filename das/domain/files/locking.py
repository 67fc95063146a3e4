"""A lock file: one process at a time works in a folder."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from das.domain.errors import DasError

LOCK = ".lock"
_RECORD_BYTES = 20
"""A lock file holds the number of the process that has it, and nothing longer than this."""


class FolderTakenError(DasError):
    """Another process holds the folder."""


@contextmanager
def folder_held(folder: Path, taken: str) -> Iterator[None]:
    """Create the folder and hold it until the block ends, or the process, however that ends.

    Raises FolderTakenError, which says `taken` and the number of the process, where another one holds it, and DasError
    where the folder cannot be written to. A `.lock` that is a link, a pipe or anybody's file is refused and left as it
    is.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise DasError(f"{folder}: is a file, expected a folder to write to") from None
    except OSError as error:
        raise DasError(f"{folder}: cannot be written to ({error.strerror})") from error
    handle = _opened(folder / LOCK)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = os.pread(handle, _RECORD_BYTES, 0).decode(errors="replace").strip() or "unknown"
            raise FolderTakenError(f"{folder}: {taken} (process {pid})") from None
        os.pwrite(handle, f"{os.getpid():<{_RECORD_BYTES - 1}}\n".encode(), 0)
        yield
    finally:
        os.close(handle)


def _opened(path: Path) -> int:
    """Open a lock file, or make it; no link is followed, nothing is cut off, and a pipe does not hold us up."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        handle = os.open(path, flags, 0o666)
    except OSError as error:
        if path.is_symlink() or path.is_dir():
            raise DasError(f"{path}: is not a lock file of ours; remove it") from None
        raise DasError(f"{path.parent}: cannot be written to ({error.strerror})") from error
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1 or status.st_size > _RECORD_BYTES:
        os.close(handle)
        raise DasError(f"{path}: is not a lock file of ours; remove it")
    return handle
