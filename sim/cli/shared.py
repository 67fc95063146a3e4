"""What the commands of das-sim that take a while do alike: speed, progress, where the recording goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from das.domain.errors import DasError
from das.domain.files.writing import new_file

Kind = TypeVar("Kind", bound=StrEnum)


def chosen(kind: type[Kind], option: str, text: str) -> Kind:
    """The member of an enumeration with a name; DasError for any other text."""
    if text not in list(kind):
        raise DasError(f"{option} {text}: expected one of {', '.join(kind)}")
    return kind(text)


def new_recording(kind: str) -> Path:
    """A new file in ./recordings, named by its kind and the time."""
    folder = Path("recordings")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise DasError(f"{folder}: cannot be made ({error.strerror}); say where with --out") from error
    return new_file(folder / f"{kind}-{datetime.now(UTC):%Y%m%d-%H%M%S}.mcap")


@contextmanager
def removed_if_unused(reserved: Path | None) -> Iterator[None]:
    """Where a block fails before anything was recorded, take the empty file away that `new_recording` made for it."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if reserved is not None and reserved.stat().st_size == 0:
                reserved.unlink()
        raise
