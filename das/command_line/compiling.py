"""Loading the compiled solver, or compiling it where that was never done on this machine.

`with loading_solver():` stands around the first calls of kernels. It says that something is compiled only when it is,
and lets Ctrl-C end the process at once: an exception in the midst of a compilation may end as anything.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from das.command_line.entry import ended_by_signals
from das.command_line.printing import error_console

LOADING = "loading the solver …"
COMPILING = "compiling the solver (once on a machine, about half a minute) …"
SCIPYS_BLAS = "scipy.linalg.cython_blas"


@contextlib.contextmanager
def loading_solver() -> Iterator[None]:
    """Show on a terminal that kernels are loaded, or compiled from the moment when one is; nothing elsewhere.

    A signal that asks the process to end does so at once with one line and exit code 130. Nothing that must be cleaned
    up may be open meanwhile.
    """
    with ended_by_signals(), _without_scipy():
        if not sys.stderr.isatty():
            yield
            return
        with error_console().status(LOADING) as status, _told_of_compiling(lambda: status.update(COMPILING)):
            yield


@contextlib.contextmanager
def _told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` whenever numba begins to compile a function; code that is taken from its cache is not compiled."""
    from numba.core import event

    class Teller(event.Listener):
        def on_start(self, event: Any) -> None:
            tell()

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Teller()):
        yield


@contextlib.contextmanager
def _without_scipy() -> Iterator[None]:
    """Let numba start without scipy: none of our kernels uses linear algebra, and to load scipy takes a quarter second.

    At its first call numba imports `SCIPYS_BLAS` to see whether `numpy.cov` in a kernel can use BLAS; where it is
    missing, that function adds up by itself. Where scipy is imported already, it stays.
    """
    hidden = SCIPYS_BLAS not in sys.modules
    if hidden:
        sys.modules[SCIPYS_BLAS] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules[SCIPYS_BLAS]
