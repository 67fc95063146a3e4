"""Lookup, creation and checking of a user's own driver: a class named `package.module:Class`."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import sys
import sysconfig
import traceback
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from das.domain.errors import DasError
from sim.drivers.cab import CabView, DriverEvent, kept_by
from sim.drivers.kinds import DriverName, OwnClass
from sim.plant.kernels import Command
from sim.plant.plant import checked

if TYPE_CHECKING:
    from sim.drivers.knowledge import LineKnowledge

EXPECTED = "expected a class with a method command(self, cab) that returns a Command"


class OwnDriver:
    """Adapter for a user's class; raises DasError for exceptions and invalid answers of the class. It is called with
    the line (`LineKnowledge`) and `seed=…`, with one of these, or with neither, as it accepts.
    """

    def __init__(self, own: OwnClass, line: LineKnowledge, seed: int) -> None:
        self._own = own
        self._driver = _made(own, load_class(own), line, seed)

    @property
    def events(self) -> Sequence[DriverEvent]:
        """The events recorded by the user's class, if it keeps a diary like the bundled human driver."""
        return kept_by(self._driver)

    def command(self, cab: CabView) -> Command:
        """The checked answer of the user's class."""
        try:
            answer = self._driver.command(cab)
        except (Exception, SystemExit) as error:
            raise _raised(self._own, error, f" at {cab.time_s:.1f} s") from error
        return checked(answer, f"--driver {self._own}", cab.time_s)


def load_class(own: OwnClass) -> type:
    """The class named by the user; raises DasError if it does not exist or is not a driver.

    Its module may be in an installed package or in the current folder.
    """
    found = getattr(_module(own), own.name, None)
    if found is None:
        raise DasError(f"--driver {own}: {source_of(own)} has no class {own.name}")
    if not inspect.isclass(found):
        raise DasError(f"--driver {own}: {own.name} is a {type(found).__name__}; {EXPECTED}")
    method = getattr(found, "command", None)
    if not callable(method):
        raise DasError(f"--driver {own}: {own.name} has no method command; {EXPECTED}")
    if not _takes(method, object(), object()):
        raise DasError(f"--driver {own}: command{inspect.signature(method)}: {EXPECTED}")
    return found


def driver_versions(driver: DriverName) -> dict[str, str]:
    """The hash of the source file of a user's class, as `driver_sha256`; empty for other drivers.

    Raises DasError if the class does not exist or is not a driver.
    """
    if not isinstance(driver, OwnClass):
        return {}
    load_class(driver)
    return {"driver_sha256": hashlib.sha256(source_of(driver).read_bytes()).hexdigest()}


def source_of(own: OwnClass) -> Path:
    """The file of the class's module; raises DasError if the module has no file."""
    module = _module(own)
    if not getattr(module, "__file__", None):
        raise DasError(f"--driver {own}: {own.module} is not a module with a file")
    return Path(str(module.__file__))


def _module(own: OwnClass) -> ModuleType:
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)  # last, so that no file in the current folder hides an installed package
    try:
        return importlib.import_module(own.module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{own.module}.".startswith(f"{error.name}."):
            raise DasError(
                f"--driver {own}: no module {error.name} among the installed packages or in {here}"
            ) from error
        raise _raised(own, error) from error
    except SyntaxError as error:
        raise DasError(f"--driver {own}: {error.filename}, line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise _raised(own, error) from error


def _made(own: OwnClass, driver: type, line: LineKnowledge, seed: int) -> Any:
    for arguments, named in product(((line,), ()), ({"seed": seed}, {})):
        if _takes(driver, *arguments, **named):
            try:
                return driver(*arguments, **named)
            except (Exception, SystemExit) as error:
                raise _raised(own, error) from error
    raise DasError(f"--driver {own}: expected to make a {own.name} with (line, seed=…), (line), (seed=…) or nothing")


def _takes(called: Any, *arguments: Any, **named: Any) -> bool:
    try:
        inspect.signature(called).bind(*arguments, **named)
    except (TypeError, ValueError):
        return False
    return True


def _raised(own: OwnClass, error: BaseException, when: str = "") -> DasError:
    words = " ".join(str(error).split())
    said = f"{type(error).__name__}: {words}" if words else type(error).__name__
    return DasError(f"--driver {own}: {_place(error)}raised{when}: {said}")


def _place(error: BaseException) -> str:
    """File and line of the user's code nearest to where an exception was raised."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    own = [frame for frame in frames if not _of_others(Path(frame.filename))] or frames[-1:]
    return f"{own[-1].filename}, line {own[-1].lineno}, " if own else ""


def _of_others(file: Path) -> bool:
    ours = [Path(__file__).parents[2] / package for package in ("das", "precompute", "sim")]
    installed = [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]
    return any(file.is_relative_to(folder) for folder in (*ours, *installed))
