"""What every command of the project does alike: one-line errors, exit codes, clean Ctrl-C."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from das.command_line.entry import EXIT_INTERRUPTED, STOP_SIGNALS
from das.command_line.printing import one_line
from das.domain.errors import DasError

EXIT_BAD_INPUT = 2


def run_app(app: TyperGroup | TyperCommand | typer.Typer, name: str | None = None) -> None:
    """Run a program; see `run_command`. A mistyped option ends in one line as well.

    `name` is the word with which the user starts the program; its own help uses it.
    """
    run_command(lambda: app(standalone_mode=False, prog_name=name))


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
        print(message if message.startswith("Usage:") else f"error: {one_line(message)}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except DasError as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
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
