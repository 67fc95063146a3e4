"""Work that the advice need not wait for: done in a thread of its own, or at once where time stands still meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class Worker:
    """Does one piece of work after the other.

    `background`: in a thread of that name; else each is done when `submit` returns, so that what follows from it
    depends on what was asked alone. Use `close` at the end.
    """

    def __init__(self, name: str = "worker", *, background: bool = False) -> None:
        self._pool = ThreadPoolExecutor(1, name) if background else None

    @property
    def in_background(self) -> bool:
        """Whether the work is done in a thread of its own."""
        return self._pool is not None

    def submit(self, work: Callable[[], T]) -> Future[T]:
        """Do this work; the answer, or what went wrong, is in the future."""
        if self._pool is not None:
            return self._pool.submit(work)
        answer: Future[T] = Future()
        try:
            answer.set_result(work())
        except Exception as error:
            answer.set_exception(error)
        return answer

    def close(self) -> None:
        """End the thread; what waits for its turn is given up."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


AT_ONCE = Worker()
"""Does everything at once."""
