"""Work on the parts of a range, distributed among threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise


def in_parts(
    pool: ThreadPoolExecutor, threads: int, size: int, work: Callable[..., None], *args: object, of: int = 1
) -> None:
    """Call work(first, last, *args) for parts of range(size), each in a thread; they begin at multiples of `of`."""
    edges = [min(of * round(size * i / (threads * of)), size) for i in range(threads)] + [size]
    for future in [pool.submit(work, first, last, *args) for first, last in pairwise(edges)]:
        future.result()
