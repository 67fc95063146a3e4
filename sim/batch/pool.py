"""Workers of a batch: processes that do one job after another, and end cleanly at Ctrl-C."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from typing import TypeVar

from das.command_line.entry import STOP_SIGNALS
from das.command_line.running import signals_held
from das.domain.errors import DasError

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def results(work: Callable[[_Job], _Result], jobs: Sequence[_Job], workers: int) -> Iterator[_Result]:
    """Yield results as they are finished; after an interruption, also those of the jobs that were under way.

    `work` must be a function of a module, for it runs in another process. Raises DasError if a worker is killed.
    """
    from sim.batch.worker import begin

    # Not forked: the solver's threads would not survive it.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin, initargs=(os.getpid(),))
    running: set[Future[_Result]] = set()
    waiting = iter(jobs)
    try:
        while True:
            _submit(pool, work, islice(waiting, workers - len(running)), running)
            if not running:
                return
            finished, still = wait(running, return_when=FIRST_COMPLETED)
            running.intersection_update(still)
            yield from (future.result() for future in finished)
    except BrokenProcessPool:
        raise DasError("a worker of the batch was killed (out of memory?); the same command goes on") from None
    except KeyboardInterrupt:
        with contextlib.suppress(BrokenProcessPool):
            yield from (future.result() for future in running)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(
    pool: ProcessPoolExecutor, work: Callable[[_Job], _Result], jobs: Iterable[_Job], running: set[Future[_Result]]
) -> None:
    """Hand jobs to the pool, which may start workers.

    Ctrl-C waits meanwhile: a worker that is being started does not ignore it yet and would be killed.
    """
    with signals_held(STOP_SIGNALS):
        running.update(pool.submit(work, job) for job in jobs)
