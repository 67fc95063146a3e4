"""Loading kept kernels without waking the compiler.

Numba loads a kept kernel only after it has imported all that it would need to compile one: its library of functions,
random numbers, linear algebra, C declarations. None of this is used to run machine code. It takes as long as all
our kernels take to load, and more where Python keeps no bytecode.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

_NumbaCache: Any = FunctionCache


class KeptKernels(_NumbaCache):  # type: ignore[misc]
    """Numba's cache of one function; what is found in it is loaded with numba's memory manager and nothing else.

    Where nothing is found numba compiles the function, and first imports by itself what it needs for that.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for the types `sig`; None where it was never compiled."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function; where the disk is full or taken away, the next start compiles it anew."""
        with suppress(OSError):
            super().save_overload(sig, data)
