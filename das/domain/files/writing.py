"""Atomic writing of files and folders: written under a temporary name, then renamed, so that readers see them whole."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from das.domain.errors import DasError

try:
    import fcntl
except ImportError:  # not on Windows, where no folder can be locked
    fcntl = None  # type: ignore[assignment]

MOST_OF_A_NAME = 1000
"""Largest number of files whose names differ only in the number at the end."""
UNFINISHED = ".unfinished-"
"""Beginning of the names of folders that are being written; such a folder remains if its writer is killed."""


def toml_string(text: str) -> str:
    """A text as a TOML string on one line. JSON and TOML strings differ only in the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def check_writable(path: Path, *, overwrite: bool) -> None:
    """Raise DasError unless a file can be created at `path`; a command checks this before long work.

    An existing file is rejected unless `overwrite` is set. A symbolic link is always rejected.
    """
    refuse_link(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        return
    folder = path.resolve().parent
    if path.is_dir():
        raise DasError(f"{path}: is a folder, expected a file to write")
    if path.exists() and not overwrite:
        raise DasError(f"{path}: exists already; --overwrite replaces it")
    if not folder.is_dir():
        raise DasError(f"{path}: no such folder {path.parent}")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise DasError(f"{path}: cannot be written ({error.strerror})") from error


def refuse_link(path: Path) -> None:
    """Raise DasError for a symbolic link: writing to it would change a file that the user did not name."""
    if path.is_symlink():
        raise DasError(f"{path}: is a symbolic link, expected the file itself or a new name")


def make_folder(folder: Path) -> None:
    """Create a folder and its parents if they are missing; DasError if one cannot be created."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise DasError(f"{folder}: is a file, expected a folder to write to") from None
    except OSError as error:
        raise DasError(f"{folder}: cannot be created ({error.strerror})") from error


def new_file(path: Path, content: bytes = b"") -> Path:
    """Create a file with `content` and return its path: `path`, or the first free one with the suffix `-2`, `-3`, ….

    The file never appears without its content. Raises DasError if none can be created.
    """
    for i in range(1, MOST_OF_A_NAME + 1):
        numbered = path if i == 1 else path.with_stem(f"{path.stem}-{i}")
        try:
            _make_new(numbered, content)  # two processes that call this at the same time get two files
        except FileExistsError:
            continue
        except OSError as error:
            raise DasError(f"{numbered}: cannot be written ({error.strerror})") from error
        return numbered
    raise DasError(f"{path}: {MOST_OF_A_NAME} files with this name exist already")


def _make_new(path: Path, content: bytes) -> None:
    """Create a file that has its content from the start; FileExistsError or OSError if that fails."""
    if path.exists():
        raise FileExistsError(path)
    file, beside = temporary_file(path)
    try:
        with file:
            file.write(content)
        os.link(beside, path)
    except FileExistsError:
        raise
    except OSError:  # File system without links: for a moment the file exists without its content.
        with path.open("xb") as file:
            file.write(content)
    finally:
        beside.unlink()


def write_whole(path: Path, content: bytes) -> None:
    """Write `content` to a new file in the folder of `path` and rename it to `path`; errors as in `whole_file`."""
    with whole_file(path) as file:
        file.write(content)


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """A file to write to, which replaces `path` when the block ends; if the block fails, nothing changes.

    A device or a pipe is written to, not replaced. Raises DasError for a symbolic link, and if writing fails.
    """
    refuse_link(path)
    try:
        if path.exists() and not path.is_file():
            content = io.BytesIO()  # a pipe has no file position, which some writers need
            yield content
            path.write_bytes(content.getvalue())
            return
        file, beside = temporary_file(path)
        try:
            with file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
        except BaseException:
            beside.unlink()
            raise
    except OSError as error:
        raise DasError(f"{path}: cannot be written ({error.strerror})") from error


def write_folder_whole(folder: Path, files: Mapping[str, bytes], private: Collection[str] = ()) -> None:
    """Write files to a new folder next to `folder` and rename it to `folder`, replacing an existing one.

    All data are on the disk when the function returns. Only the owner can read the files named in `private`. A killed
    writer leaves a folder whose name begins with `UNFINISHED`. Raises DasError if writing fails.
    """
    try:
        beside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=UNFINISHED))
        try:
            for name, content in files.items():
                with (beside / name).open("xb") as file:
                    if name in private:
                        os.fchmod(file.fileno(), 0o600)
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
            beside.chmod(0o777 & ~_umask())
            _sync_folder(beside)
            if folder.exists():
                folder.rename(beside.with_name(f"{beside.name}-replaced"))
            beside.rename(folder)
            _sync_folder(folder.parent)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
            shutil.rmtree(beside.with_name(f"{beside.name}-replaced"), ignore_errors=True)
    except OSError as error:
        raise DasError(f"{folder}: cannot be written ({error.strerror})") from error


def temporary_file(path: Path) -> tuple[IO[bytes], Path]:
    """A new file next to `path`, open for writing, and its path; it has the permissions of any new file.

    The caller renames or removes it. Raises OSError if it cannot be created.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    file, beside = os.fdopen(handle, "wb"), Path(name)
    with suppress(OSError):  # Some network file systems keep the permissions of a private file.
        beside.chmod(0o666 & ~_umask())
    return file, beside


def _umask() -> int:
    """The permission bits that are cleared for new files of this process."""
    umask = os.umask(0)
    os.umask(umask)
    return umask


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


LOCK = ".lock"
_RECORD_BYTES = 20
"""Longest content (bytes) of a lock file: the id of the process that holds the lock."""


class FolderTakenError(DasError):
    """Another process has locked the folder."""


@contextmanager
def folder_held(folder: Path, taken: str) -> Iterator[None]:
    """Create the folder and lock it until the block ends or the process dies.

    Raises FolderTakenError, with the text `taken` and the id of the process, if another process has locked it, and
    DasError if the folder is not writable. A `.lock` that is a link, a pipe or another file is rejected and not
    changed.
    """
    if fcntl is None:
        raise DasError(f"{folder}: cannot be locked on this system: expected Linux or macOS")
    make_folder(folder)
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
    """Open or create a lock file. Links are not followed, no file is truncated, and a pipe does not block."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        handle = os.open(path, flags, 0o666)
    except OSError as error:
        if path.is_symlink() or path.is_dir():
            raise DasError(f"{path}: is not a lock file of this program; remove it") from None
        raise DasError(f"{path.parent}: cannot be written to ({error.strerror})") from error
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1 or status.st_size > _RECORD_BYTES:
        os.close(handle)
        raise DasError(f"{path}: is not a lock file of this program; remove it")
    return handle
