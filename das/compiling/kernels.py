"""How kernels are compiled, and where the compiled code is kept.

Numba keeps compiled code on disk, but looks only at the file of a kernel to tell whether it is still valid. A kernel
also contains the kernels that it calls and the constants that it reads, whatever file they are in. Therefore the folder
that keeps a module's compiled code is named by the hash of the module and of all our modules that it imports.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

import llvmlite
import numba
import numpy as np
from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator
from numba.core.runtime.nrt import rtsys
from numba.misc.appdirs import AppDirs

from das.compiling.sources import OUR_PACKAGES, SourcesMissingError, sources_of, text_sha256

FOLDER = "das-kernels"
KEPT_VERSIONS = 4
"""Versions of a module's compiled code that are kept; older ones are removed when a new one is made."""
HASH_DIGITS = 16
_numba_settings: Any = numba.config
_NumbaCache: Any = FunctionCache
_NumbaForm: Any = CompileResultCacheImpl
_NumbaPlace: Any = InTreeCacheLocator


def compiled(**options: Any) -> Callable[[Any], Any]:
    """A decorator that compiles a function once, without the GIL, with IEEE 754 division, and keeps the code on disk.

    `options` are further options of `numba.njit`. Where no folder can keep the code, every start compiles it anew.
    """

    def decorated(function: Any) -> Any:
        dispatcher = njit(nogil=True, error_model="numpy", **options)(function)
        with suppress(RuntimeError):  # there is no folder that can keep the code
            dispatcher._cache = _KeptKernels(function)
        return dispatcher

    return decorated


class _Place(_NumbaPlace):  # type: ignore[misc]
    """Tells numba where the compiled code of a function is kept: in the folder of its module as it now is."""

    def __init__(self, function: Any, source_path: str) -> None:
        super().__init__(function, source_path)
        self._cache_path = str(_folder(function.__module__))

    @classmethod
    def from_function(cls, function: Any, source_path: str) -> Self | None:
        """The place for a function; None where nothing can be kept."""
        return None if _folder(function.__module__) is None else cls(function, source_path)


class _KeptForm(_NumbaForm):  # type: ignore[misc]
    _locator_classes: ClassVar = [_Place]


class _KeptKernels(_NumbaCache):  # type: ignore[misc]
    """Numba's cache of one function, in our folder, which loads kept code without waking the compiler.

    Before it loads a kept function, numba imports all that it would need to compile one: its library of functions,
    random numbers, linear algebra, C declarations. None of this is used to run machine code, and it takes as long as
    all our kernels take to load. Where nothing is found, numba imports by itself what it needs to compile.
    """

    _impl_class = _KeptForm

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for the types `sig`; None where it was never compiled."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function; where the disk is full or taken away, the next start compiles it anew."""
        with suppress(OSError):
            super().save_overload(sig, data)


kernel = compiled()


@cache
def cache_root() -> Path | None:
    """The folder in which compiled code is kept; None, with a warning, where none can be written to.

    The folder is inside NUMBA_CACHE_DIR where the user has set it, else beside our compiled modules, else in the user's
    folder of caches.
    """
    for place in _places():
        folder = place / FOLDER
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    warnings.warn(
        "compiled kernels cannot be kept, so every start compiles them anew (some 15 s): "
        "set NUMBA_CACHE_DIR to a folder that can be written to",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def _places() -> Iterator[Path]:
    if _numba_settings.CACHE_DIR:
        yield Path(_numba_settings.CACHE_DIR)
    yield Path(__file__).parents[1] / "__pycache__"
    user_dirs: Any = AppDirs
    yield Path(user_dirs(appname="numba", appauthor=False).user_cache_dir)


@cache
def _folder(module: str) -> Path | None:
    """The folder for the compiled code of a module as its source now is; None where nothing can be kept."""
    root = cache_root()
    key = _key(module)
    if root is None or key is None:
        return None
    folder = root / module / key
    try:
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # the versions used last are kept
        if is_new:
            _remove_old_versions(folder.parent)
    except OSError:
        return None
    return folder


def _key(module: str) -> str | None:
    """The hash of all that a module's compiled code depends on; None where a source file is not installed."""
    try:
        text = text_sha256(sources_of([module], packages=OUR_PACKAGES | {module.partition(".")[0]}))
    except (SourcesMissingError, ImportError, AttributeError, OSError):
        return None
    # Numba's own key has the processor and the versions of Python and numba, and leaves these out.
    versions = f"{llvmlite.__version__} {np.__version__}"
    settings = f"{text} {versions} {_numba_settings.BOUNDSCHECK} {_numba_settings.OPT}"
    return hashlib.sha256(settings.encode()).hexdigest()[:HASH_DIGITS]


def _remove_old_versions(folder: Path) -> None:
    with suppress(OSError):  # another process may be removing the same ones
        versions = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for path in versions[KEPT_VERSIONS:]:
            shutil.rmtree(path, ignore_errors=True)
