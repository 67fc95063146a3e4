"""Bars on a terminal that show how far long work has come; elsewhere nothing is printed."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from das.command_line.printing import error_console

Item = TypeVar("Item")
Show = Callable[[str, float, float | None], None]
"""What is being done, how much of it is done, and the whole; None while the whole is not known."""


@contextlib.contextmanager
def progress_bar(first: str) -> Iterator[Show]:
    """Show a bar while the block runs; yields what to call when something was done. `first` is shown until then."""
    if not sys.stderr.isatty():
        yield lambda _what, _done, _whole: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    text = TextColumn("{task.description}", markup=False)
    columns = (text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=error_console(), transient=True) as bar:
        task = bar.add_task(first, total=None)
        yield lambda what, done, whole: bar.update(task, description=what, completed=done, total=whole)


def shown(items: Sequence[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
    """Go through some items with a bar that names the one under way."""
    with progress_bar("") as show:
        for done, item in enumerate(items):
            show(name(item), done, len(items))
            yield item
