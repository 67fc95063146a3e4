"""The decorators that make a Python function a kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(**options: Any) -> Callable[[Any], Any]:
    """Compile once, release the GIL, and divide as IEEE 754 does; `options` are further options of numba's `njit`."""

    def decorated(function: Any) -> Any:
        try:
            return njit(cache=True, nogil=True, error_model="numpy", **options)(function)
        except RuntimeError:  # no folder can hold the cache (a read-only installation): compile at every start
            return njit(nogil=True, error_model="numpy", **options)(function)

    return decorated


kernel = compiled()
"""The decorator of every kernel that needs no further options."""
