"""A worker for long computations: in a background thread, so that advice continues meanwhile, or immediately."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class Worker:
    """Executes one piece of work after the other.

    With `background` a thread called `name` does the work until `close`. Otherwise `submit` returns only when the work
    is done, so that the same inputs always give the same results.
    """

    def __init__(self, name: str = "worker", *, background: bool = False) -> None:
        self._pool = ThreadPoolExecutor(1, name) if background else None
        self.in_background = background
        """Whether the work is done in a background thread."""

    def submit(self, work: Callable[[], T]) -> Future[T]:
        """Submit work; the future holds its result, or the exception that it raised."""
        if self._pool is not None:
            return self._pool.submit(work)
        answer: Future[T] = Future()
        try:
            answer.set_result(work())
        except Exception as error:
            answer.set_exception(error)
        return answer

    def close(self) -> None:
        """End the thread after its present work; work still waiting is cancelled."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


AT_ONCE = Worker()
"""A worker without a thread: all work is done when `submit` returns."""
