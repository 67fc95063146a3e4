"""Reading the files of a table: regular files only, and never more of one than it should hold."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from das.table.format import TableError


def read_regular(path: Path, most_bytes: int) -> bytes:
    """What a file holds; it is opened without waiting, so that a pipe holds nobody up.

    Raises FileNotFoundError where there is no such file, and TableError where it is no regular file, is larger than
    `most_bytes` or cannot be read.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(path) from None
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise TableError(f"{path}: is not a regular file")
        if status.st_size > most_bytes:
            raise TableError(f"{path}: {status.st_size} bytes, expected at most {most_bytes}")
        with open(handle, "rb", closefd=False) as file:
            return file.read(status.st_size)
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    finally:
        os.close(handle)


def regular_size_bytes(path: Path) -> int:
    """The size of a regular file; raises as `read_regular` does."""
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(path) from None
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    if not stat.S_ISREG(status.st_mode):
        raise TableError(f"{path}: is not a regular file")
    return status.st_size
