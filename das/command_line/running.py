"""What every command of the project does alike: one-line errors, exit codes, clean Ctrl-C."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.table import Table
from typer.exceptions import TyperException

from das.command_line.entry import EXIT_INTERRUPTED, STDERR
from das.domain.errors import DasError

if TYPE_CHECKING:
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle

PRINTED_WIDTH = 110
"""Least width of tables that go to a file or a pipe."""
WIDEST = 1000
EXIT_BAD_INPUT = 2
STOP_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGINT", "SIGHUP") if hasattr(signal, name)]

_warned: set[str] = set()
"""Warnings this process has printed."""

err = Console(stderr=True, highlight=False, soft_wrap=True)


def run_app(app: typer.Typer) -> None:
    """Run a command line; see `run_command`. What the user mistypes is one line as well."""
    run_command(lambda: app(standalone_mode=False))


def run_command(main: Callable[[], object]) -> None:
    """Run a command's main function; user errors become one line and exit code 2, Ctrl-C ends with 130."""
    _say_what_can_be_said()
    try:
        code = main()
        if code == EXIT_INTERRUPTED:  # typer turns Ctrl-C into this code
            raise KeyboardInterrupt
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except TyperException as error:
        message = error.format_message()
        print(message if message.startswith("Usage:") else f"error: {' '.join(message.split())}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except DasError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        for number in STOP_SIGNALS:  # who asks twice means the same
            signal.signal(number, signal.SIG_IGN)
        print("stopped", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone (`… | head`): nothing to say, nowhere to say it.
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EIO) or error.filename is not None:
            raise
        print(f"error: the output cannot be written ({error.strerror})", file=sys.stderr)
        os._exit(EXIT_BAD_INPUT)  # Python would try to write the rest once more, and say so


def _say_what_can_be_said() -> None:
    """Where the terminal's encoding lacks a letter (–, λ, ü), print a question mark rather than fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def print_table(table: Table) -> None:
    """Print a table with no figure or name cut: wider than a narrow terminal where it must be."""
    console = Console(highlight=False)
    needed = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    console.width = max(console.width if console.is_terminal else PRINTED_WIDTH, needed)
    console.print(table)


def typed(command: str) -> str:
    """How the user types a command of ours: with `uv run` where that started us."""
    return f"uv run {command}" if "UV_RUN_RECURSION_DEPTH" in os.environ else command


@contextlib.contextmanager
def busy(what: str) -> Iterator[None]:
    """Show on a terminal that something is under way."""
    with err.status(what):
        yield


def warn_unusual(*read: Vehicle | Route) -> None:
    """Print a line on standard error for every unusual value of trains and lines that were read, each once."""
    from das.domain.plausibility import warnings_of

    for line in (line for thing in read for line in warnings_of(thing)):
        if line not in _warned:
            _warned.add(line)
            say(f"warning: {line}")


def say(text: str) -> None:
    """Say a line on standard error, if it is taken at once.

    A log on a full disk, or read by nobody any more, must not end or hold up a process that has better things to do.
    """
    with contextlib.suppress(OSError):
        if select.select([], [STDERR], [], 0)[1]:
            os.write(STDERR, f"{text}\n".encode(sys.stderr.encoding, errors="replace"))


class StopFlag:
    """Set by SIGTERM, SIGINT or SIGHUP, so that a loop ends cleanly; `with_parent`: also when its parent ends.

    The parent's id is told, not asked for: the parent may end before its child can ask.
    """

    def __init__(self, *, with_parent: int | None = None) -> None:
        self._signalled = False
        self._parent = with_parent
        for number in STOP_SIGNALS:
            signal.signal(number, self._stop)

    @property
    def stopped(self) -> bool:
        """Whether to stop."""
        return self._signalled or (self._parent is not None and os.getppid() != self._parent)

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        self._signalled = True


def interrupt_on_termination() -> None:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does, so that its child processes are stopped."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    for number in STOP_SIGNALS:
        signal.signal(number, interrupt)


@contextlib.contextmanager
def signals_held(numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Let signals wait until a block of the main thread ends; processes started in it are born with them blocked.

    To block them is not enough: another thread would then hear them, and Python would interrupt the main one.
    """
    came: list[int] = []
    handlers = {number: signal.signal(number, lambda one, _frame: came.append(one)) for number in numbers}
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for heard in came:
            signal.raise_signal(heard)
