"""A pool of processes on this machine: one process per worker, one job per worker at a time.

If a worker dies, only the attempt of its own job is lost. Other pools were found unsuitable:
`concurrent.futures` loses all jobs in flight if one worker dies, pebble 5.2 ends or hangs if a worker is killed between
two jobs, and `distributed.LocalCluster` takes three times the memory, starts ten times slower and listens on eight
ports.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final, Generic, TypeVar

from das.command_line.process import STOP_SIGNALS, signals_held
from das.domain.errors import DasError

Job = TypeVar("Job")
Result = TypeVar("Result")

ATTEMPTS: Final = 3
"""Number of workers that may die on a job before it is given up."""
FALSE_STARTS: Final = 3
"""Number of consecutive workers that may die before they are ready; then the work ends."""
OUT_OF_MEMORY_EXIT: Final = 71
_READY: Final = "ready"


class JobLostError(DasError):
    """A job was given up because its workers died."""


@dataclass(frozen=True, kw_only=True)
class Made(Generic[Job, Result]):
    """The outcome of a job: its result, or the error that prevented one, and the number of attempts."""

    job: Job
    attempts: int = 1
    result: Result | None = None
    error: Exception | None = None


def made_here(
    make: Callable[[Job], Result], jobs: Sequence[Job], count: int, prepare: Callable[[], object], *, finish: bool
) -> Generator[Made[Job, Result]]:
    """Yield the outcome of each job as it ends on a process of this machine; see `Workers.made`."""
    pool = _Pool(make, jobs, count, prepare)
    try:
        yield from pool.run()
    except KeyboardInterrupt:
        if finish:
            pool.give_no_more()
            yield from pool.run()
        raise
    finally:
        pool.stop()


@dataclass(eq=False)
class _Task(Generic[Job]):
    job: Job
    deaths: int = 0


@dataclass(eq=False)
class _Worker(Generic[Job]):
    process: SpawnProcess
    connection: Connection
    task: _Task[Job] | None = None
    ready: bool = False


class _Pool(Generic[Job, Result]):
    """The workers of one `made_here`, the waiting jobs, and their outcomes."""

    def __init__(
        self, make: Callable[[Job], Result], jobs: Sequence[Job], count: int, prepare: Callable[[], object]
    ) -> None:
        self._make, self._prepare, self._count = make, prepare, count
        self._waiting = deque(_Task(job) for job in jobs)
        self._made: deque[Made[Job, Result]] = deque()
        self._workers: list[_Worker[Job]] = []
        self._false_starts = 0

    def run(self) -> Generator[Made[Job, Result]]:
        """Yield outcomes until no job waits or is under way; after an interruption it can be called again."""
        yield from self._handed_out()
        while self._waiting or any(worker.task for worker in self._workers):
            while len(self._workers) < min(self._count, len(self._workers) + len(self._waiting)):
                self._start()
            heard = wait([worker.connection for worker in self._workers])  # an interruption takes effect here …
            with signals_held(STOP_SIGNALS):  # … and not in the middle of a message
                for worker in [worker for worker in self._workers if worker.connection in heard]:
                    self._listen(worker)
                self._give()
            yield from self._handed_out()

    def _handed_out(self) -> Generator[Made[Job, Result]]:
        while self._made:
            yield self._made.popleft()

    def give_no_more(self) -> None:
        """Drop the waiting jobs."""
        self._waiting.clear()

    def stop(self) -> None:
        """End the workers immediately."""
        for worker in self._workers:
            worker.process.kill()
            worker.connection.close()
        for worker in self._workers:
            worker.process.join()

    def _start(self) -> None:
        # Not forked: the solver's threads would not survive it.
        context = multiprocessing.get_context("spawn")
        mine, theirs = context.Pipe()
        resource_tracker.ensure_running()  # starting it unblocks SIGINT: it must run before we block it
        process = context.Process(target=serve, args=(theirs, self._make, self._prepare), daemon=True)
        # Ctrl-C reaches the whole process group, but only this process acts on it, and ends the workers.
        with signals_held(STOP_SIGNALS):
            process.start()
            theirs.close()
            self._workers.append(_Worker(process, mine))

    def _give(self) -> None:
        """Give a job to each worker that has none."""
        for worker in self._workers:
            if worker.ready and worker.task is None and self._waiting:
                worker.task = self._waiting.popleft()
                with suppress(OSError):  # it has just died, which `_listen` will notice
                    worker.connection.send(worker.task.job)

    def _listen(self, worker: _Worker[Job]) -> None:
        """Receive a message of a worker; a closed pipe means that the worker has died."""
        try:
            message = worker.connection.recv()
        except (EOFError, OSError):
            self._bury(worker)
            return
        if message == _READY:
            worker.ready, self._false_starts = True, 0
            return
        task, worker.task = worker.task, None
        assert task is not None
        result, error = message
        self._made.append(Made(job=task.job, attempts=1 + task.deaths, result=result, error=error))

    def _bury(self, worker: _Worker[Job]) -> None:
        """Remove a dead worker; its job waits for another attempt, or is given up."""
        self._workers.remove(worker)
        worker.connection.close()
        worker.process.join()
        end, task = _how_it_ended(worker.process.exitcode), worker.task
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= FALSE_STARTS:
                raise DasError(f"workers cannot be started: {FALSE_STARTS} in a row ended at once ({end})")
        if task is None:
            return
        task.deaths += 1
        if task.deaths < ATTEMPTS:
            self._waiting.append(task)
        else:
            error = JobLostError(f"its worker died {task.deaths} times, last {end}")
            self._made.append(Made(job=task.job, attempts=task.deaths, error=error))


def _how_it_ended(exit_code: int | None) -> str:
    """How a worker process ended, in words."""
    if exit_code == OUT_OF_MEMORY_EXIT:
        return "out of memory"
    if exit_code is not None and exit_code < 0:
        return f"by {signal.Signals(-exit_code).name}"
    return f"with exit code {exit_code}"


def serve(connection: Connection, make: Callable[[Any], Any], prepare: Callable[[], object]) -> None:
    """Do jobs as a worker process, and report each, until the parent closes the pipe or ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)  # else a worker's children could not be stopped
    prepare()
    connection.send(_READY)
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        connection.send(_attempted(make, job))


def _attempted(make: Callable[[Job], Result], job: Job) -> tuple[Result | None, Exception | None]:
    try:
        return make(job), None
    except MemoryError:
        os._exit(OUT_OF_MEMORY_EXIT)
    except Exception as error:
        return None, error


def _end_with_parent() -> None:
    """End a worker whose parent was killed: it must not continue to write, because the next command may have begun."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
