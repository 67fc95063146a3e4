"""Workers for many runs: processes that make one run after another and that end with the command."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from typing import TypeVar

from das.command_line.entry import STOP_SIGNALS
from das.command_line.running import signals_held
from das.domain.errors import DasError

PARENT_CHECKED_EVERY_S = 1.0
Job = TypeVar("Job")
Made = TypeVar("Made")


def worked(work: Callable[[Job], Made], jobs: Sequence[Job], workers: int) -> Generator[Made]:
    """Yield what `work` makes of each job as it ends; after an interruption, also of the jobs that were under way.

    `work` must be a function of a module. Raises DasError where a worker is killed.
    """
    # Not forked: the solver's threads would not survive it.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin, initargs=(os.getpid(),))
    running: set[Future[Made]] = set()
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
        raise DasError("a worker was killed (out of memory?); the same command goes on from there") from None
    except KeyboardInterrupt:
        with contextlib.suppress(BrokenProcessPool):
            yield from (future.result() for future in running)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(
    pool: ProcessPoolExecutor, work: Callable[[Job], Made], jobs: Iterable[Job], running: set[Future[Made]]
) -> None:
    """Hand jobs to the pool, which may start workers.

    Ctrl-C waits meanwhile: a worker that is being started does not ignore it yet and would be killed.
    """
    with signals_held(STOP_SIGNALS):
        running.update(pool.submit(work, job) for job in jobs)


def begin(parent: int) -> None:
    """Make this process a worker: it ends only with its parent process, even if that is killed."""
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)  # or what a worker starts could not be stopped
    from das.cab.warm_up import warm_up

    warm_up()


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECKED_EVERY_S)
    os._exit(1)
