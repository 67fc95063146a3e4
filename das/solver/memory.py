"""Memory for large arrays that is kept after an array and used again for the next.

The system hands out fresh memory page by page and clears it first: of the front of a line of 31 km (57 MB) that was 7 %
of the work. A front that is solved when an earlier one is no longer used takes over its memory.
"""

from __future__ import annotations

import math
import weakref
from threading import RLock
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", bound=np.generic)

KEPT_BYTES = 128_000_000
"""At most this much memory that no array uses is kept (bytes): two fronts of 30 km, or one of 57 km."""
LARGEST_RATIO = 2.0
"""A kept block is used only for an array that needs at least half of it: it is at most this many times as large."""

ALIGNED_BYTES = 64
"""Arrays begin at a multiple of this (bytes): a line of the cache, so that no vector lies across two."""


class KeptMemory:
    """Blocks of memory that arrays have left, for the next arrays; safe in threads."""

    def __init__(self, kept_bytes: int = KEPT_BYTES) -> None:
        self.kept_bytes = kept_bytes
        self._free: list[NDArray[np.uint8]] = []
        # The garbage collector may give a block back in the very thread that is taking one.
        self._lock = RLock()

    def empty(self, shape: tuple[int, ...], dtype: type[Number]) -> NDArray[Number]:
        """An array with undefined content; its memory comes back here once the array and all views of it are gone."""
        kind = np.dtype(dtype)
        size = math.prod(shape) * kind.itemsize
        if size == 0:
            return np.empty(shape, kind)
        block = self._taken(size + ALIGNED_BYTES)
        array = np.frombuffer(block.data, kind, count=math.prod(shape), offset=-block.ctypes.data % ALIGNED_BYTES)
        # Every view of the array refers to this memoryview: when it goes, nobody can see the block any more.
        weakref.finalize(array.base, self._give_back, block).atexit = False
        return array.reshape(shape)

    def free_bytes(self) -> int:
        """How much memory is kept that no array uses."""
        with self._lock:
            return sum(block.nbytes for block in self._free)

    def _taken(self, size: int) -> NDArray[np.uint8]:
        """The smallest kept block that is large enough and not much too large, else a new one."""
        with self._lock:
            fitting = [block for block in list(self._free) if size <= block.nbytes <= LARGEST_RATIO * size]
            if fitting:
                chosen = min(fitting, key=lambda block: block.nbytes)
                self._free = [block for block in self._free if block is not chosen]
                return chosen
        return np.empty(size, np.uint8)

    def _give_back(self, block: NDArray[np.uint8]) -> None:
        """Keep a block; the ones kept longest go where there are too many."""
        with self._lock:
            self._free.append(block)
            while sum(one.nbytes for one in self._free) > self.kept_bytes:
                self._free.pop(0)


KEPT = KeptMemory()
"""The memory that fronts of this process share."""
