"""Where the commands start: Ctrl-C while the rest of the program is still being imported ends cleanly as well."""

from __future__ import annotations

import importlib
import os
import signal
from types import FrameType

EXIT_INTERRUPTED = 130
STDERR = 2
"""As a file descriptor."""


def start(module: str) -> None:
    """Import a module and run its `main()`."""
    # An exception in the midst of an import may end as anything, so there is none. Who started us may ignore Ctrl-C.
    heeded = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if heeded:
        signal.signal(signal.SIGINT, _end)
    imported = importlib.import_module(module)
    if heeded:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    imported.main()


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(STDERR, b"stopped\n")
    os._exit(EXIT_INTERRUPTED)
