"""Start and end of the processes of commands: imports that Ctrl-C ends cleanly, kept bytecode, and signals.

Commands import this module first, so it imports nothing but small modules of Python.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import importlib.util
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

EXIT_INTERRUPTED = 130
STDERR = 2
"""Standard error as a file descriptor."""
STOP_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGINT", "SIGHUP") if hasattr(signal, name)]
"""Signals that ask a process to end: from the system, by Ctrl-C, or because the terminal was closed."""
CLEAR_LINE_AND_SHOW_CURSOR = b"\r\x1b[2K\x1b[?25h"
"""Escape codes that remove a spinner, which would otherwise remain after the process has ended."""
BYTECODE = Path(__file__).parents[1] / "__pycache__" / "das-bytecode"
"""Folder for bytecode that Python may not write next to its sources. Compiled kernels are kept next to the folder."""


def start(module: str) -> None:
    """Import a module and run its `main()`; Ctrl-C while it is imported ends the process in one line."""
    keep_bytecode()
    with ended_by_signals():
        imported = importlib.import_module(module)
    imported.main()


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start_beside(module: str) -> None:
    """Run a module's `main()` in a second process, if a processor is free for it; it ends with the present process.

    A failure of the second process is not reported, because the present process would then do its work later.
    """
    if available_cores() < 2:
        return
    program = f"from das.command_line.process import start; start({module!r})"
    with contextlib.suppress(OSError):
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", program],  # -P: modules in the user's folder are not ours
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        atexit.register(child.kill)


def keep_bytecode() -> None:
    """Keep bytecode in a folder of our own if Python was told to write none next to its sources.

    With PYTHONDONTWRITEBYTECODE, which containers often set, every start would compile the sources of numpy and numba
    again, which takes longer than everything else. Nothing changes if PYTHONPYCACHEPREFIX names a folder for bytecode,
    if numba was installed with its bytecode, or if the folder cannot be written to.
    """
    if not sys.dont_write_bytecode or sys.pycache_prefix is not None or _has_bytecode():
        return
    with contextlib.suppress(OSError):
        BYTECODE.mkdir(parents=True, exist_ok=True)
    if BYTECODE.is_dir() and os.access(BYTECODE, os.W_OK):
        sys.pycache_prefix, sys.dont_write_bytecode = str(BYTECODE), False


def _has_bytecode() -> bool:
    """Whether numba, the largest of the packages that are imported, was installed with its bytecode."""
    numba = importlib.util.find_spec("numba")
    return numba is not None and numba.cached is not None and Path(numba.cached).exists()


def ended_by_signals() -> contextlib.AbstractContextManager[None]:
    """A block in which the signals of `STOP_SIGNALS` end the process immediately, in one line.

    For imports and compilations: an exception during one may turn into any other, so none is raised. Signals that the
    process ignores remain ignored. Nothing that must be cleaned up may be open in the block.
    """
    heeded = [number for number in STOP_SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    return _handled(heeded, _end_at_once)


def interrupted_by_termination() -> contextlib.AbstractContextManager[None]:
    """A block that SIGTERM and SIGHUP end as Ctrl-C does, so that its child processes are stopped."""
    return _handled(STOP_SIGNALS, _interrupt)


@contextlib.contextmanager
def _handled(numbers: list[signal.Signals], handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Let a function handle signals as long as the block runs; afterwards they are handled as before.

    In another thread nothing changes, as Python signals the main one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _end_at_once(_number: int, _frame: FrameType | None) -> None:
    os.write(STDERR, (CLEAR_LINE_AND_SHOW_CURSOR if os.isatty(STDERR) else b"") + b"stopped\n")
    os._exit(EXIT_INTERRUPTED)


class StopFlag:
    """Set by SIGTERM, SIGINT or SIGHUP, so that a loop ends cleanly; with `with_parent`, also when the parent ends.

    `with_parent` is the process id that the parent passes, because it may end before its child can query it.
    """

    def __init__(self, *, with_parent: int | None = None) -> None:
        self._signalled = False
        self._parent = with_parent
        for number in STOP_SIGNALS:
            signal.signal(number, self._stop)

    @property
    def stopped(self) -> bool:
        """Whether a loop should end."""
        return self._signalled or (self._parent is not None and os.getppid() != self._parent)

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        self._signalled = True
