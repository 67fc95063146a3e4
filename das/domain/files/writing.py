"""Writing files whole: beside, then renamed into place, so that a reader never sees half of one."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from das.domain.errors import DasError


def check_writable(path: Path) -> None:
    """Raise DasError unless a file can be created at `path`; to be asked before long work starts."""
    if path.exists() and not path.is_file() and not path.is_dir():
        return
    folder = path.resolve().parent
    if path.is_dir():
        raise DasError(f"{path}: is a folder, expected a file to write")
    if not folder.is_dir():
        raise DasError(f"{path}: no such folder {path.parent}")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DasError(f"{path}: cannot be written ({error.strerror})") from error


def write_whole(path: Path, content: bytes) -> None:
    """Write `content` beside `path` and rename it into place; DasError where that fails.

    A link is followed; what is not a regular file (a device, a pipe) is written to, not replaced.
    """
    try:
        path = path.resolve()
        if path.exists() and not path.is_file():
            path.write_bytes(content)
            return
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(name, 0o666 & ~umask)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
    except OSError as error:
        raise DasError(f"{path}: cannot be written ({error.strerror})") from error
