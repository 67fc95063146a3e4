"""Where the commands start: Ctrl-C while the rest of the program is still being imported ends cleanly as well."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType

EXIT_INTERRUPTED = 130
STDERR = 2
"""Standard error as a file descriptor."""
STOP_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGINT", "SIGHUP") if hasattr(signal, name)]
"""Signals that ask a process to end: a request of the system, Ctrl-C, the terminal that is closed."""
CLEAR_LINE_AND_SHOW_CURSOR = b"\r\x1b[2K\x1b[?25h"
"""Ends a spinner on a terminal, which nothing else would do once the process is gone."""


def start(module: str) -> None:
    """Import a module and run its `main()`; Ctrl-C while it is imported ends the process in one line."""
    with ended_by_signals():
        imported = importlib.import_module(module)
    imported.main()


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let the signals of `STOP_SIGNALS` end the process at once, in one line, as long as the block runs.

    For imports and compilations: an exception in the midst of one may end as anything, so none is raised. Signals that
    the process ignores stay ignored. Nothing that must be cleaned up may be open in the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    heeded = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    for number in heeded:
        signal.signal(number, _end_at_once)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, before[number])


def _end_at_once(_number: int, _frame: FrameType | None) -> None:
    os.write(STDERR, (CLEAR_LINE_AND_SHOW_CURSOR if os.isatty(STDERR) else b"") + b"stopped\n")
    os._exit(EXIT_INTERRUPTED)
