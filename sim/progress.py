"""The progress of long work: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from das.command_line.printing import error_console

Progressed = Callable[[float, float], None]
"""Called with the amount done and the whole amount."""

SAID_EVERY_S = 2.0
"""Interval (s) between lines of progress where there is no terminal."""


@contextmanager
def progress_bar(title: str, first: str, unit: str) -> Iterator[Progressed]:
    """Show the progress as a bar on a terminal, as a line every few seconds elsewhere.

    `first` is the text until there is progress. Yields the function to call with the amount done and the whole amount.
    The bar estimates the remaining time from what has been done so far.
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
