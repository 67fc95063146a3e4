"""Executors for long computations: in a background thread, so that advice continues meanwhile, or immediately."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class _AtOnce(Executor):
    """Does all work in the calling thread."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        answer: Future[T] = Future()
        try:
            answer.set_result(fn(*args, **kwargs))
        except Exception as error:
            answer.set_exception(error)
        return answer


AT_ONCE = _AtOnce()
"""An executor without a thread: work is done when `submit` returns, so that the same inputs give the same results."""


def worker(name: str, *, background: bool) -> Executor:
    """An executor that does one piece of work after the other: in a thread called `name`, or `AT_ONCE`."""
    return ThreadPoolExecutor(1, name) if background else AT_ONCE
