"""Compiling kernels with numba, and storing the compiled code under a hash of the source text that it depends on.

Numba keeps compiled code on disk, but it checks only the file of a kernel to tell whether the code is still valid. A
kernel also contains the kernels that it calls and the constants that it reads, whatever file they are in. Therefore the
folder with a module's compiled code is named by a hash of that module and of all our modules that it imports.

Time saved of the 40 s that a cold `solve` took before (numba 0.68, two cores, 23 November 2026): 9 s by leaving out
wrappers for C and by loops in place of assignments to slices; 11 s by compiling parts (`_Part`); 8 s by a second
process that compiles other kernels meanwhile (`_claim`).
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import re
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

import llvmlite
import numba
import numpy as np

try:
    import fcntl
except ImportError:  # not on this system: two processes may then compile one kernel twice
    fcntl = None  # type: ignore[assignment]

FOLDER = "das-kernels"
KEPT_VERSIONS = 4
"""Number of versions of a module's compiled code that are kept; older ones are removed when a new one is made."""
HASH_DIGITS = 16
LONGEST_WAIT_S, LOOK_AGAIN_S = 60.0, 0.02
"""Longest wait (s) for another process that compiles the needed kernel, and the interval (s) of the checks."""
_numba: Any = numba  # its functions have no types
OUR_PACKAGES = frozenset({"das", "precompute", "sim"})
_FROM = re.compile(rb"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n#]*)", re.MULTILINE)
_IMPORT = re.compile(rb"^[ \t]*import[ \t]+([^\n#]*)", re.MULTILINE)


def compiled(**options: Any) -> Callable[[Any], Any]:
    """A decorator that compiles a function to run without the GIL, with IEEE 754 division, and keeps the code on disk.

    `options` are further options of `numba.njit`. If no folder is writable, every start compiles the function again.
    """

    def decorated(function: Any) -> Any:
        if _numba.config.DISABLE_JIT:
            return function
        chosen = {"nopython": True, "nogil": True, "error_model": "numpy", "boundscheck": None, **options}
        return _Kernel(function, targetoptions=chosen)

    return decorated


class _Part(_numba.core.codegen.JITCodeLibrary):  # type: ignore[misc]
    """A kernel as LLVM IR, for the kernels that call it; each caller compiles it together with its own code.

    Numba by itself would also generate machine code, which is never called, and wrappers for calls from outside. The
    code is optimised exactly as by numba: with less optimisation trajectories would take 1.1 times as long, and
    `fastmath` would round differently.
    """

    def finalize(self) -> None:
        """Add the code of the kernels that this one calls, and optimise it all."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._optimize_final_module()
        self._finalize_dynamic_globals()
        self._finalized = True


class _PartCompiler(_numba.core.dispatcher._FunctionCompiler):  # type: ignore[misc]
    """Compiles a function for the kernels that call it."""

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        context, target = self.targetdescr.typing_context, self.targetdescr.target_context
        flags = _numba.core.compiler.Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        library = _Part(target.codegen(), self.py_func.__qualname__)
        given = (context, target, self.py_func, args, return_type, flags, self.locals)
        part = _numba.core.compiler.compile_extra(*given, library=library, pipeline_class=self.pipeline_class)
        part = part._replace(entry_point=object())  # numba uses it to find the part for a call
        target.insert_user_function(part.entry_point, part.fndesc, [library])
        return part


class _WholeCompiler(_numba.core.dispatcher._FunctionCompiler):  # type: ignore[misc]
    """Compiles a function for calls from Python, together with all kernels that it calls."""

    def _customize_flags(self, flags: Any) -> Any:
        flags.no_cfunc_wrapper = True  # only C would call it
        return flags

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        whole = super()._compile_core(args, return_type)
        for environment in whole._find_referenced_environments():  # of its parts
            whole.library.codegen.set_env(environment.env_name, environment)
        return whole


class _Kernel(_numba.core.registry.CPUDispatcher):  # type: ignore[misc]
    """A compiled function. Python calls it as a whole, kernels call it as a part; both are compiled when first needed.

    Kernels never call the version for Python, even if it exists, so that the order of calls cannot change what is
    compiled.
    """

    _compiler: Any

    def __init__(self, *given: Any, **settings: Any) -> None:
        super().__init__(*given, **settings)
        mine = (self.py_func, self.targetdescr, self.targetoptions, self.locals, self._compiler.pipeline_class)
        self._compiler, self._part_compiler = _WholeCompiler(*mine), _PartCompiler(*mine)
        self._parts: dict[Any, Any] = {}
        with suppress(RuntimeError):  # no folder can keep the code
            self._cache = _KeptKernels(self.py_func)

    def compile(self, sig: Any) -> Any:
        """The compiled function for the types `sig`, loaded from disk or newly compiled; where files can be locked,
        other processes wait for it for at most `LONGEST_WAIT_S`."""
        try:
            return super().compile(sig)
        finally:
            if isinstance(self._cache, _KeptKernels):
                self._cache.release()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The call template of this kernel for these argument types; numba requests it while it compiles the caller."""
        pysig, args = self._part_compiler.fold_argument_types(args, kws)
        args = tuple(_numba.core.types.unliteral(given) for given in args)  # else a part is compiled for each constant
        if args not in self._parts:
            self._parts[args] = self._part_compiler.compile(args, None)
        name, signatures = self.py_func.__name__, [part.signature for part in self._parts.values()]
        return _numba.core.typing.templates.make_concrete_template(name, name, signatures), pysig, args, {}

    def get_overload(self, sig: Any) -> Any:
        """The key by which numba finds the part with this signature."""
        return self._parts[tuple(_numba.core.sigutils.normalize_signature(sig)[0])].entry_point


class _Place(_numba.core.caching.InTreeCacheLocator):  # type: ignore[misc]
    """The place of a function's compiled code for numba; each version of a module has its own folder."""

    def __init__(self, function: Any, source_path: str) -> None:
        super().__init__(function, source_path)
        self._cache_path = str(_folder(function.__module__))

    @classmethod
    def from_function(cls, function: Any, source_path: str) -> Self | None:
        """The place for a function; None if nothing can be kept."""
        return None if _folder(function.__module__) is None else cls(function, source_path)


class _KeptForm(_numba.core.caching.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: ClassVar = [_Place]


class _KeptKernels(_numba.core.caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function; it is in our folder, and it loads kept code without loading the compiler.

    Before it loads a kept function, numba imports everything that it would need to compile one: its library of
    functions, random numbers, linear algebra, C declarations. Machine code needs none of this, and importing it takes
    as long as loading all our kernels. If no kept code is found, numba itself imports what it needs to compile.
    """

    _impl_class = _KeptForm
    _claimed: int

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for the types `sig`; None if it was never compiled.

        If another process is compiling the function, the call waits. If the result is None, this process must
        compile the function.
        """
        _numba.core.runtime.nrt.rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
            if found is None:
                self._claim()
                found = self._load_overload(sig, target_context)  # made by another process meanwhile
            return found

    def _claim(self) -> None:
        """Wait for a process that compiles this function, at most `LONGEST_WAIT_S`, and claim the compilation."""
        if fcntl is None:
            return
        with suppress(OSError):
            self._claimed = os.open(f"{self._cache_file._index_path}.lock", os.O_CREAT | os.O_WRONLY)
            until_s = time.monotonic() + LONGEST_WAIT_S
            while time.monotonic() < until_s:
                with suppress(BlockingIOError):
                    fcntl.flock(self._claimed, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return
                time.sleep(LOOK_AGAIN_S)

    def release(self) -> None:
        """Let other processes compile this function, or load the code just made."""
        claimed = self.__dict__.pop("_claimed", None)  # in one step: another thread may do the same
        if claimed is not None:
            os.close(claimed)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function; if the disk is full or gone, the next start compiles it again."""
        with suppress(OSError):
            super().save_overload(sig, data)


kernel = compiled()


@cache
def cache_root() -> Path | None:
    """The folder in which compiled code is kept; None, with a warning, if no folder can be written to.

    The folder is inside NUMBA_CACHE_DIR if the user has set it, else next to our compiled modules, else in the user's
    cache folder.
    """
    for place in _places():
        folder = place / FOLDER
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    warnings.warn(
        "compiled kernels cannot be kept, so every start compiles them again (10 to 15 s): "
        "set NUMBA_CACHE_DIR to a folder that can be written to",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def _places() -> Iterator[Path]:
    if _numba.config.CACHE_DIR:
        yield Path(_numba.config.CACHE_DIR)
    yield Path(__file__).parent / "__pycache__"
    yield Path(_numba.misc.appdirs.AppDirs(appname="numba", appauthor=False).user_cache_dir)


@cache
def _folder(module: str) -> Path | None:
    """The folder for the compiled code of the present version of a module; None if nothing can be kept."""
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
    """The hash of everything that a module's compiled code depends on; None if a source file is not installed."""
    try:
        sources = sources_of(module)
    except (ImportError, AttributeError, OSError):
        return None
    # Numba's own key has the processor and the versions of Python and numba, but not what follows.
    settings = f"{llvmlite.__version__} {np.__version__} {_numba.config.BOUNDSCHECK} {_numba.config.OPT}"
    digest = hashlib.sha256(settings.encode())
    for name, text in sources.items():
        digest.update(f"{name} {len(text)}\n".encode() + text)
    return digest.hexdigest()[:HASH_DIGITS]


def _remove_old_versions(folder: Path) -> None:
    with suppress(OSError):  # another process may be removing the same ones
        versions = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for path in versions[KEPT_VERSIONS:]:
            shutil.rmtree(path, ignore_errors=True)


def sources_of(module: str) -> dict[str, bytes]:
    """The source text of a module, and of all modules of its package or ours that it imports, directly or not, by name.

    Imports inside functions count as well. `from package import name` counts as an import of the package, and of the
    module `package.name` if there is one. Raises FileNotFoundError if a source file is not installed.
    """
    packages = OUR_PACKAGES | {module.partition(".")[0]}
    found: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found[name], imported = _read(name)
        waiting += [one for one in imported if one.partition(".")[0] in packages]
    return dict(sorted(found.items()))


@cache
def _read(name: str) -> tuple[bytes, tuple[str, ...]]:
    """The source text of a module, and the modules that it may import."""
    path = _path(name)
    if path is None:
        raise FileNotFoundError(f"{name}: its source file is not installed")
    text = path.read_bytes()
    return text, tuple(_imported(text, name if path.name == "__init__.py" else name.rpartition(".")[0]))


def _imported(text: bytes, package: str) -> Iterator[str]:
    """Names of modules that a text imports; `from a import b` may mean the module a.b, if there is one."""
    for match in _FROM.finditer(text):
        base = match[1].decode()
        if base.startswith("."):
            base = importlib.util.resolve_name(base, package)
        yield base
        if base.partition(".")[0] in OUR_PACKAGES | {package.partition(".")[0]}:
            for name in re.findall(r"\w+", match[2].decode()):
                if _path(f"{base}.{name}") is not None:
                    yield f"{base}.{name}"
    for match in _IMPORT.finditer(text):
        for name in match[1].decode().split(","):
            yield from name.split()[:1]


@cache
def _path(name: str) -> Path | None:
    """The source file of a module; None if there is none."""
    root, *inner = name.split(".")
    for folder in importlib.import_module(root).__path__:
        place = Path(folder, *inner)
        for path in (place / "__init__.py", place.with_name(f"{place.name}.py")):
            if path.is_file():
                return path
    return None
