"""How commands load a route, a vehicle or the compiled solver.

Unusual values of a route or a vehicle are reported once, on standard error. The first calls of kernels belong inside
`with loading_solver():`. It announces a compilation only if there is one, and lets Ctrl-C end the process at once: an
exception in the midst of a compilation may turn into any other error.
"""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from das.command_line.entry import ended_by_signals
from das.command_line.printing import error_console, warn

if TYPE_CHECKING:
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle

_warned: set[str] = set()
"""Warnings that this process has printed."""


def load_route(name_or_path: str) -> Route:
    """A route by its bundled name or file; raises DasError for anything unusable."""
    from das.domain.files import load

    route = load.load_route(name_or_path)
    warn_unusual(route)
    return route


def load_vehicle(name_or_path: str) -> Vehicle:
    """A vehicle by its bundled name or file; raises DasError for anything unusable."""
    from das.domain.files import load

    vehicle = load.load_vehicle(name_or_path)
    warn_unusual(vehicle)
    return vehicle


def warn_of_braking(vehicle: Vehicle) -> None:
    """Print a line about a train whose plans may brake with friction and whose file does not say how hard.

    Plans then assume that all brakes act with full force at once. But a friction brake takes some seconds to build up
    (4 s in position P, UIC 540): a driver who follows such advice runs past his stop.
    """
    from das.domain.vehicle import BrakePolicy

    rubs = vehicle.brake_policy is not BrakePolicy.ELECTRIC and vehicle.friction_brake_force_n > 0
    line = (
        f"{vehicle.source}: max_deceleration is missing: plans brake with all of the friction brake at once, which "
        "takes some seconds to build up; state the deceleration that drivers use"
    )
    if rubs and math.isinf(vehicle.max_deceleration_mps2) and line not in _warned:
        _warned.add(line)
        warn(line)


def warn_unusual(*read: Vehicle | Route) -> None:
    """Print a line for every unusual value of vehicles and routes that were read, each line once in a process."""
    from das.domain.plausibility import warnings_of

    for line in (line for thing in read for line in warnings_of(thing)):
        if line not in _warned:
            _warned.add(line)
            warn(line)


LOADING = "loading the solver …"
COMPILING = "compiling the solver (once on a machine, about half a minute) …"
SCIPYS_BLAS = "scipy.linalg.cython_blas"


@contextlib.contextmanager
def loading_solver() -> Iterator[None]:
    """Show on a terminal that kernels are being loaded, and that they are being compiled once that begins.

    Without a terminal nothing is shown. A signal to end the process does so at once, with one line and exit code 130.
    So nothing that must be cleaned up may be open meanwhile.
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
