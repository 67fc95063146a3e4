"""Output of commands: harmless text, tables with legends, warnings, and progress.

Text from files, from the bus or from the user is never read as markup, and control characters in it become escapes.
"""

from __future__ import annotations

import contextlib
import functools
import os
import select
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar, cast

from das.command_line.process import STDERR, ended_by_signals, start_beside
from das.domain.errors import seen

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PRINTED_WIDTH = 80
"""Width (columns) of text for a file or a pipe; text for a terminal has the width of the terminal."""
WIDEST_TABLE = 1000
WIDEST_PARAGRAPH = 110
"""Widest lines of running text (columns), however wide the terminal."""
LONGEST_LINE = 600
"""Longest message (characters) that is printed whole; a longer one loses its middle."""

LOADING = "loading the solver …"
COMPILING = "compiling the solver (up to half a minute, and only the first time) …"
SCIPYS_BLAS = "scipy.linalg.cython_blas"


def visible(text: str) -> str:
    """The text with control characters as escapes, so that it cannot control a terminal; newlines and tabs remain."""
    if text.isprintable():
        return text
    return "".join(one if one in "\n\t" else seen(one) for one in text)


def one_line(text: str) -> str:
    """The text in one line that is safe to print; beyond `LONGEST_LINE` characters it loses its middle."""
    if len(text) > 2 * LONGEST_LINE:  # do not walk through a hundred megabytes
        text = f"{text[:LONGEST_LINE]} … {text[-LONGEST_LINE:]}"
    line = visible(" ".join(text.split()))
    if len(line) <= LONGEST_LINE:
        return line
    half = LONGEST_LINE // 2 - 2
    return f"{line[:half]} … {line[-half:]}"


@functools.cache
def _plain_console() -> type[Console]:
    """A console that prints every string unchanged: without markup, emoji codes, highlighting or control characters."""
    from rich.console import Console
    from rich.text import Text

    class PlainConsole(Console):
        """A console that never reads markup in a string."""

        def render_str(self, text: str, **settings: Any) -> Text:
            """Turn a string into text without looking for markup in it."""
            return super().render_str(visible(text), **{**settings, "markup": False, "emoji": False})

    return PlainConsole


def error_console() -> Console:
    """A console on standard error, for progress and status lines."""
    return _plain_console()(stderr=True, highlight=False, markup=False, emoji=False, soft_wrap=True)


def new_table(
    title: str,
    texts: Iterable[str],
    figures: Iterable[str] = (),
    *,
    whole: Iterable[str] = (),
    lines: bool = False,
) -> Table:
    """A table without rows: columns by name, those of `whole` texts first, then of `texts`, then of `figures`.

    Figures are on the right. Figures and whole texts are not wrapped. With `lines` the columns have lines around them.
    """
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.HEAVY_HEAD if lines else box.SIMPLE_HEAD)
    for name in whole:
        table.add_column(name, no_wrap=True)
    for name in texts:
        table.add_column(name)
    for name in figures:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def print_table(table: Table, legend: Mapping[str, str] | None = None) -> None:
    """Print a table, and below it a legend that explains the abbreviations in it.

    Columns that do not wrap are never cut: the table becomes wider than the terminal if necessary.
    """
    console = _plain_console()(highlight=False, markup=False, emoji=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = PRINTED_WIDTH
    unbounded = console.options.update(max_width=WIDEST_TABLE)
    table.pad_edge, table.collapse_padding = False, True
    for column in table.columns:
        if column.no_wrap:
            cells = (column.header, *column.cells)
            column.min_width = max(console.measure(cell, options=unbounded).maximum for cell in cells)
    console.width = max(console.width, console.measure(table, options=unbounded).minimum)
    console.print(table)
    if legend:
        paragraph("; ".join(f"{name}: {meaning}" for name, meaning in legend.items()) + ".")


def paragraph(text: str, hanging: str = "") -> None:
    """Print text on standard output, wrapped to the terminal's width; `hanging` begins every line but the first."""
    width = shutil.get_terminal_size((PRINTED_WIDTH, 24)).columns
    tell(textwrap.fill(text, min(width, WIDEST_PARAGRAPH), break_on_hyphens=False, subsequent_indent=hanging))


def tell(text: str) -> None:
    """Print text on standard output; control characters in it are shown as escapes."""
    print(visible(text))


def warn(text: str) -> None:
    """Print one line on standard error that begins with "warning:"."""
    print(f"warning: {one_line(text)}", file=sys.stderr)


def busy(what: str) -> contextlib.AbstractContextManager[object]:
    """A block in which a terminal shows that something is under way; elsewhere nothing is printed."""
    return error_console().status(what) if sys.stderr.isatty() else contextlib.nullcontext()


def say(text: str) -> None:
    """Write a line to standard error if that does not block; otherwise drop it.

    A full disk, or a closed pipe, must neither end nor block a process that advises or records.
    """
    with contextlib.suppress(OSError):
        if select.select([], [STDERR], [], 0)[1]:
            os.write(STDERR, f"{visible(text)}\n".encode(sys.stderr.encoding or "utf-8", errors="replace"))


def typed(command: str) -> str:
    """A command of ours as the user types it: after `uv run` if that started this process."""
    return f"uv run {command}" if "UV_RUN_RECURSION_DEPTH" in os.environ else command


Item = TypeVar("Item")
Progressed = Callable[[float, float], None]
"""Called with the amount done and the whole amount."""
Show = Callable[[str, float, float | None], None]
"""Updates a bar: what is being done, how much is done, and the total (None while unknown)."""
SAID_EVERY_S = 2.0
"""Interval (s) between lines of progress without a terminal."""


@contextlib.contextmanager
def progress_bar(title: str, first: str, unit: str) -> Iterator[Progressed]:
    """Show the progress: on a terminal as a bar, elsewhere as a line every few seconds.

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
    """Progress as lines on standard error, without consecutive repetitions."""
    said, said_s = "", time.monotonic()

    def line(done: float, whole: float) -> None:
        nonlocal said, said_s
        text = f"{title}: {done:.0f} of {whole:.0f} {unit}"
        if text != said and (time.monotonic() - said_s > SAID_EVERY_S or done == whole):
            print(text, file=sys.stderr)
            said, said_s = text, time.monotonic()

    print(f"{title}: {first}", file=sys.stderr)
    return line


@contextlib.contextmanager
def steps_bar(first: str) -> Iterator[Show]:
    """Show on a terminal a bar that names each step; yields the function that updates it. `first` is its first text."""
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
    """Iterate over items and show a bar that names the current one."""
    with steps_bar("") as show:
        for done, item in enumerate(items):
            show(name(item), done, len(items))
            yield item


@contextlib.contextmanager
def loading_solver(late: str = "") -> Iterator[None]:
    """Report that kernels are being loaded (on a terminal) or compiled; first calls of kernels belong in this block.

    From then on the process also reports compilation outside the block, once in total. `late` names a module that
    compiles what the command needs last; it runs in a second process if anything is compiled.

    A signal to end the process ends it immediately, with one line and exit code 130, because an exception during a
    compilation may turn into any other error. Nothing that must be cleaned up may therefore be open in the block.
    """
    with ended_by_signals(), _without_scipy():
        listener = _compiling_listener()
        listener.late = late
        if not sys.stderr.isatty():
            yield
            return
        try:
            with error_console().status(LOADING) as status:
                listener.status = status
                yield
        finally:
            listener.status = None


@functools.cache
def _compiling_listener() -> Any:
    """The listener that numba calls when it begins to compile a function (not when it loads one from the cache)."""
    from numba.core import event

    class Listener(event.Listener):
        """Reports once that the solver is being compiled, in the line of `status` or else in a new line.

        The listener also starts the process that compiles what is needed late.
        """

        status: Any = None
        said = False
        late = ""

        def on_start(self, event: Any) -> None:
            if self.late:
                late, self.late = self.late, ""
                start_beside(late)
            if self.status is not None:
                self.status.update(COMPILING)
            elif not self.said:
                self.said = True
                say(COMPILING)

        def on_end(self, event: Any) -> None:
            pass

    listener, numba_event = Listener(), cast(Any, event)
    numba_event.register("numba:compile", listener)
    return listener


@contextlib.contextmanager
def _without_scipy() -> Iterator[None]:
    """Let numba start without scipy, which takes a quarter of a second to load: no kernel here uses linear algebra.

    At its first call numba imports `SCIPYS_BLAS` to see whether `numpy.cov` in a kernel can use BLAS. Without that
    module, numba's `numpy.cov` sums up without BLAS. If scipy has been imported already, it stays.
    """
    hidden = SCIPYS_BLAS not in sys.modules
    if hidden:
        sys.modules[SCIPYS_BLAS] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules[SCIPYS_BLAS]
