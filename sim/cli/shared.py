"""What the commands of das-sim that take a while do alike: speed, progress, where the recording goes."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from das.command_line.printing import error_console
from das.domain.errors import DasError
from das.domain.files.writing import new_file

Kind = TypeVar("Kind", bound=StrEnum)
Progressed = Callable[[float, float], None]
"""Called with how much is done and with the whole."""

SAID_EVERY_S = 2.0
"""Without a terminal, one line of progress is printed this often (s)."""
SLOWEST, FASTEST = 0.01, 1e6
"""Range of `--speed` in times real time."""


def chosen(kind: type[Kind], option: str, text: str) -> Kind:
    """The member of an enumeration with a name; DasError for any other text."""
    if text not in list(kind):
        raise DasError(f"{option} {text}: expected one of {', '.join(kind)}")
    return kind(text)


def speed_factor(text: str) -> float | None:
    """Times real time (`real` is 1); None for as fast as it goes."""
    if text == "max":
        return None
    try:
        value = 1.0 if text == "real" else float(text)
    except ValueError:
        value = float("nan")
    if not SLOWEST <= value <= FASTEST:
        raise DasError(f"--speed {text}: expected max, real or a number of times real time, 0.01 to 1000000")
    return value


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


def typed_command() -> str:
    """The command as the user typed it."""
    return shlex.join(["das-sim", *sys.argv[1:]])


@contextmanager
def progress_bar(title: str, first: str, unit: str) -> Iterator[Progressed]:
    """A bar on a terminal, a line every few seconds elsewhere; `first` is shown until something is done.

    The time that is left is estimated from what was done so far and is not shown before that. Yields what to call with
    how much is done and the whole.
    """
    if not sys.stderr.isatty():
        yield _lines(title, first, unit)
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        *(BarColumn(), TaskProgressColumn(), TimeRemainingColumn()),
    )
    with Progress(*columns, console=error_console(), transient=True) as bar:
        task = bar.add_task(f"{title}: {first}", total=None)
        yield lambda done, whole: bar.update(task, completed=done, total=whole, description=title)


def _lines(title: str, first: str, unit: str) -> Progressed:
    """Progress as lines on standard error."""
    said = time.monotonic()

    def line(done: float, whole: float) -> None:
        nonlocal said
        if time.monotonic() - said > SAID_EVERY_S or done == whole:
            print(f"{title}: {done:.0f} of {whole:.0f} {unit}", file=sys.stderr)
            said = time.monotonic()

    print(f"{title}: {first}", file=sys.stderr)
    return line
