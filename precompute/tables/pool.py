"""Solving jobs on this machine: one process a worker, one job a worker at a time.

A worker that dies costs only the attempt of its own job. Each worker writes its tables itself; the parent hears how it
went. (`concurrent.futures` loses all jobs in flight with one worker and does not say whose fault it was.)
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path

from das.command_line.running import signals_held
from das.domain.errors import DasError
from precompute.tables.job import Job, warm_up
from precompute.tables.store import BuildStatus, Outcome
from precompute.tables.writing import write_table

ATTEMPTS = 3
"""A job is given up after its worker has died this many times."""
FALSE_STARTS = 3
"""The build ends after this many workers in a row have died before they were ready."""
OUT_OF_MEMORY_EXIT = 71
STOP_WITHIN_S = 2.0
_READY = "ready"


@dataclass(eq=False)
class _Worker:
    process: SpawnProcess
    connection: Connection
    job: Job | None = None
    ready: bool = False
    began_s: float = field(default_factory=time.perf_counter)


def solve_locally(jobs: Sequence[Job], folder: Path, workers: int) -> Generator[Outcome]:
    """Solve jobs into tables in a folder; yields the outcome of each as it comes.

    Closing the iterator stops the workers. Raises DasError where workers cannot be started.
    """
    pool = _Pool(jobs, folder)
    try:
        yield from pool.run(min(workers, len(jobs)))
    finally:
        pool.stop()


class _Pool:
    def __init__(self, jobs: Sequence[Job], folder: Path) -> None:
        self._waiting = deque(jobs)
        self._deaths: dict[str, int] = {}
        self._folder = folder
        self._workers: list[_Worker] = []
        self._false_starts = 0
        self._context: SpawnContext = multiprocessing.get_context("spawn")

    def run(self, count: int) -> Generator[Outcome]:
        for _ in range(count):
            self._start()
        while self._waiting or any(worker.job for worker in self._workers):
            for worker in self._heard():
                outcome = self._listen(worker)
                if outcome is not None:
                    yield outcome
            for worker in self._workers:
                if worker.ready and worker.job is None and self._waiting:
                    self._give(worker, self._waiting.popleft())

    def stop(self) -> None:
        for worker in self._workers:
            worker.process.terminate()
            worker.connection.close()
        for worker in self._workers:
            worker.process.join(STOP_WITHIN_S)
            worker.process.kill()
            worker.process.join()

    def _start(self) -> None:
        mine, theirs = self._context.Pipe()
        resource_tracker.ensure_running()  # its start lets SIGINT through again, in the middle of ours
        process = self._context.Process(target=serve, args=(theirs, str(self._folder)), daemon=True)
        # Ctrl-C reaches the whole group: only we shall hear it, and tell the workers to end.
        with signals_held([signal.SIGINT]):
            process.start()
            theirs.close()
            self._workers.append(_Worker(process, mine))

    def _heard(self) -> list[_Worker]:
        heard = wait([worker.connection for worker in self._workers])
        return [worker for worker in self._workers if worker.connection in heard]

    def _give(self, worker: _Worker, job: Job) -> None:
        worker.job, worker.began_s = job, time.perf_counter()
        with suppress(OSError):  # it has just died: that is heard next
            worker.connection.send(job)

    def _listen(self, worker: _Worker) -> Outcome | None:
        """Take a message of a worker; a closed pipe means that the worker has died."""
        try:
            said = worker.connection.recv()
        except (EOFError, OSError):
            return self._bury(worker)
        if said == _READY:
            worker.ready, self._false_starts = True, 0
            return None
        job, worker.job = worker.job, None
        assert job is not None
        status, reason, size = said
        return Outcome(
            name=job.name,
            status=status,
            reason=reason,
            seconds=time.perf_counter() - worker.began_s,
            attempts=1 + self._deaths.get(job.name, 0),
            size_bytes=size,
        )

    def _bury(self, worker: _Worker) -> Outcome | None:
        """Replace a dead worker; its job waits for another attempt, or is given up."""
        self._workers.remove(worker)
        worker.connection.close()
        worker.process.join()
        end = _said(worker.process.exitcode)
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= FALSE_STARTS:
                raise DasError(f"workers cannot be started: {FALSE_STARTS} in a row ended at once ({end})")
        outcome = self._blame(worker, end) if worker.job else None
        if self._waiting:
            self._start()
        return outcome

    def _blame(self, worker: _Worker, end: str) -> Outcome | None:
        job = worker.job
        assert job is not None
        deaths = self._deaths[job.name] = self._deaths.get(job.name, 0) + 1
        if deaths < ATTEMPTS:
            self._waiting.append(job)
            return None
        return Outcome(
            name=job.name,
            status=BuildStatus.POISON,
            reason=f"its worker died {deaths} times, last {end}",
            seconds=time.perf_counter() - worker.began_s,
            attempts=deaths,
        )


def _said(exit_code: int | None) -> str:
    if exit_code == OUT_OF_MEMORY_EXIT:
        return "out of memory"
    if exit_code is not None and exit_code < 0:
        return f"by {signal.Signals(-exit_code).name}"
    return f"with exit code {exit_code}"


def serve(connection: Connection, folder: str) -> None:
    """Solve jobs as a worker process, and report each, until the parent closes the pipe or ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    warm_up()
    connection.send(_READY)
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        connection.send(_attempt(job, Path(folder)))


def _attempt(job: Job, folder: Path) -> tuple[BuildStatus, str, int | None]:
    """BuildStatus, reason and size of a job's table."""
    try:
        files = job.solve()
        write_table(folder / job.name, files)
    except DasError as error:
        return BuildStatus.FAILED, " ".join(str(error).split()), None
    except MemoryError:
        os._exit(OUT_OF_MEMORY_EXIT)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return BuildStatus.FAILED, f"a fault of the solver: {fault}", None
    return BuildStatus.BUILT, "", sum(map(len, files.values()))


def _end_with_parent() -> None:
    """A worker whose parent was killed must not go on writing: the next build may have begun."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
