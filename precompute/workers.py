"""Workers for many jobs: processes of this machine, or the workers of an existing Dask cluster.

How to start a cluster: docs/how-to/build-on-a-cluster.md. Its workers need no common disk. If a process of this machine
dies, only its attempt is lost. (`concurrent.futures` would lose all jobs in flight, pebble 5.2 ends or hangs,
`distributed.LocalCluster` takes three times the memory, starts ten times slower and opens eight ports.)
"""

from __future__ import annotations

import hashlib
import importlib
import multiprocessing
import os
import platform
import re
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import das
from das.command_line.process import STOP_SIGNALS, available_cores
from das.domain.errors import DasError

Job = TypeVar("Job")
Result = TypeVar("Result")

ATTEMPTS: Final = 3
"""Number of workers that may die on a job before it is abandoned."""
FALSE_STARTS: Final = 3
"""Number of consecutive workers that may die before they are ready; then the work ends."""
OUT_OF_MEMORY_EXIT: Final = 71
_READY: Final = "ready"


class JobLostError(DasError):
    """A job was given up because its workers died."""


@dataclass(frozen=True, kw_only=True)
class Made(Generic[Job, Result]):
    """The outcome of a job: its result, or the error that prevented it, and the number of attempts."""

    job: Job
    attempts: int = 1
    result: Result | None = None
    error: Exception | None = None


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


@contextmanager
def signals_held(numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Hold signals back until a block of the main thread ends; processes started in it begin with them blocked.

    Blocking them is not enough: another thread would then receive them, and Python would interrupt the main one.
    """
    came: list[int] = []
    handlers = {number: signal.signal(number, lambda one, _frame: came.append(one)) for number in numbers}
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for heard in came:
            signal.raise_signal(heard)


class _Pool(Generic[Job, Result]):
    """The workers of this machine, the waiting jobs, and their outcomes."""

    def __init__(
        self, make: Callable[[Job], Result], jobs: Sequence[Job], count: int, prepare: Callable[[], object]
    ) -> None:
        self._make, self._prepare, self._count = make, prepare, count
        self.waiting = deque(_Task(job) for job in jobs)
        self._made: deque[Made[Job, Result]] = deque()
        self._workers: list[_Worker[Job]] = []
        self._false_starts = 0

    def run(self) -> Generator[Made[Job, Result]]:
        """Yield outcomes until no job waits or is under way; after an interruption it can be called again."""
        while True:
            while self._made:
                yield self._made.popleft()
            if not self.waiting and not any(worker.task for worker in self._workers):
                return
            while self.waiting and len(self._workers) < self._count:
                self._start()
            heard = wait([worker.connection for worker in self._workers])  # an interruption takes effect here …
            with signals_held(STOP_SIGNALS):  # … and not in the middle of a message
                for worker in [worker for worker in self._workers if worker.connection in heard]:
                    self._listen(worker)
                self._give()

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
        for worker in self._workers:
            if worker.ready and worker.task is None and self.waiting:
                worker.task = self.waiting.popleft()
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
            self.waiting.append(task)
        else:
            error = JobLostError(f"its worker died {task.deaths} times, last {end}")
            self._made.append(Made(job=task.job, attempts=task.deaths, error=error))


def _how_it_ended(exit_code: int | None) -> str:
    if exit_code == OUT_OF_MEMORY_EXIT:
        return "out of memory"
    if exit_code is not None and exit_code < 0:
        return f"by {signal.Signals(-exit_code).name}"
    return f"with exit code {exit_code}"


def serve(connection: Connection, make: Callable[[Any], Any], prepare: Callable[[], object]) -> None:
    """Do jobs as a worker process, and report the outcome of each, until the parent closes the pipe or ends."""
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


CONNECT_WITHIN_S = 10.0
JOBS_PER_THREAD: Final = 2
"""Number of jobs on the cluster for each of its threads: one is under way, one waits."""
PACKAGES: Final = ("numpy", "numba", "llvmlite", "distributed", "dask")
"""Packages whose versions must be the same wherever jobs are done."""
OURS: Final = ("das", "precompute", "sim")
"""Packages of the program, whose source must be the same wherever jobs are done."""
_ADDRESS: Final = re.compile(r"(tcp|tls|wss?)://[^/\s]+:\d{1,5}/?")


class WorkerDiffersError(DasError):
    """A worker runs other versions than we do; its results could differ from this machine's."""


@dataclass(frozen=True, kw_only=True)
class Workers:
    """The workers that do jobs: `count` processes on this machine, or the Dask cluster of a `scheduler`."""

    count: int
    scheduler: str | None = None

    @classmethod
    def asked(cls, count: int | None, scheduler: str | None = None) -> Workers:
        """The workers that the user chose, by default one process a core; DasError if both are given."""
        if count is not None and scheduler is not None:
            raise DasError("give either --workers or --scheduler: a cluster has its own workers")
        return cls(count=count or available_cores(), scheduler=scheduler)

    @property
    def facts(self) -> dict[str, Any]:
        """The entry on workers in reports."""
        return {"workers": self.count} if self.scheduler is None else {"scheduler": self.scheduler}

    def made(
        self,
        make: Callable[[Job], Result],
        jobs: Sequence[Job],
        *,
        prepare: Callable[[], object],
        finish: bool = False,
    ) -> Generator[Made[Job, Result]]:
        """Yield the result of `make` for each job as it ends; closing the iterator stops the work on all others.

        `make` and `prepare` must be module-level. Local workers call `prepare` once before their first job.
        With `finish`, an interruption waits for the jobs that local workers have under way, and yields them too.

        Raises DasError if local workers cannot be started, if no scheduler answers or has workers, or if a worker runs
        other code than we do.
        """
        if self.scheduler is not None:
            yield from _made_on_cluster(make, jobs, self.scheduler)
            return
        pool = _Pool(make, jobs, min(self.count, len(jobs)), prepare)
        try:
            yield from pool.run()
        except KeyboardInterrupt:
            if finish:
                pool.waiting.clear()
                yield from pool.run()
            raise
        finally:
            pool.stop()


def _made_on_cluster(make: Callable[[Job], Result], jobs: Sequence[Job], address: str) -> Generator[Made[Job, Result]]:
    """Yield the outcome of each job that a cluster does.

    A job whose worker dies is tried again by the scheduler (its `allowed-failures`). A job that the scheduler gives up
    is tried once more alone, because dask also gives up jobs that only waited on a dying worker.
    """
    with connected(address) as client:
        check_workers(client, address)
        suspects: list[Job] = []
        with closing(_submitted(client, make, jobs)) as coming:
            for made in coming:
                if isinstance(made.error, _distributed().KilledWorker):
                    suspects.append(made.job)
                else:
                    yield made
        for job in suspects:
            with closing(_submitted(client, make, [job])) as coming:
                for made in coming:
                    killed = isinstance(made.error, _distributed().KilledWorker)
                    error = JobLostError("its workers died, also when it ran alone") if killed else made.error
                    yield replace(made, error=error)


def connected(address: str) -> Any:
    """A client of the scheduler at an address, to be used with `with`; DasError if there is no answer."""
    if not _ADDRESS.fullmatch(address):
        raise DasError(f"--scheduler {address}: expected an address like tcp://HOST:8786")
    client = _distributed().Client
    try:
        return client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise DasError(f"{address}: no Dask scheduler answers ({' '.join(str(error).split())})") from error


def check_workers(client: Any, address: str) -> None:
    """Raise DasError, which names the worker and the difference, unless all workers run the same code as we do."""
    here = environment()
    answers = client.run(environment, on_error="return")
    if not answers:
        how = "docs/how-to/build-on-a-cluster.md says how to start them"
        raise DasError(f"{address}: the scheduler has no workers ({how})")
    for worker, there in answers.items():
        if isinstance(there, BaseException):
            raise WorkerDiffersError(f"worker {worker}: cannot import our code ({type(there).__name__}: {there})")
        differing = differences(here, there)
        if differing:
            raise WorkerDiffersError(f"worker {worker}: {differing}")


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise DasError("--scheduler needs distributed: install the extra, pip install '.[cluster]'") from None


def _submitted(client: Any, make: Callable[[Job], Result], jobs: Sequence[Job]) -> Generator[Made[Job, Result]]:
    """Yield the outcome of each job that is submitted to a cluster; closing the iterator withdraws the jobs.

    Raises WorkerDiffersError for a worker that joined late and differs, and DasError if the scheduler is lost.
    """
    waiting, here = list(reversed(jobs)), environment()
    submitted: dict[Any, Job] = {}
    distributed = _distributed()
    coming = distributed.as_completed(loop=client.loop)

    def submit() -> None:
        future = client.submit(_made_there, make, waiting[-1], here, pure=False)
        submitted[future] = waiting.pop()
        coming.add(future)

    try:
        for _ in range(min(len(waiting), JOBS_PER_THREAD * max(sum(client.nthreads().values()), 1))):
            submit()
        for future in coming:
            made: Made[Job, Result] = Made(job=submitted.pop(future))
            try:
                made = replace(made, result=future.result())
            except WorkerDiffersError:
                raise
            except (distributed.client.FutureCancelledError, distributed.comm.CommClosedError) as error:
                raise DasError(f"the scheduler has gone ({' '.join(str(error).split())})") from error
            except Exception as error:
                made = replace(made, error=error)
            future.release()
            if waiting:
                submit()
            yield made
    finally:
        client.cancel(list(submitted), force=True)


def _made_there(make: Callable[[Job], Result], job: Job, expected: Mapping[str, str]) -> Result:
    """Do a job on a worker of a cluster, after checking the worker in case it joined late."""
    differing = differences(expected, _own_environment())
    if differing:
        raise WorkerDiffersError(f"a worker that joined later: {differing}")
    return make(job)


@cache
def _own_environment() -> dict[str, str]:
    return environment()


def environment() -> dict[str, str]:
    """Versions of Python, of `PACKAGES` and of this program, and the hash of our source."""
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "driver-advisory-system": das.__version__,
        "source": source_sha256()[:12],
    }


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """The differences of another environment from this one, in words; empty if there are none."""
    return "; ".join(
        f"{name} {there.get(name, 'missing')}, here {value}" for name, value in here.items() if there.get(name) != value
    )


@cache
def source_sha256() -> str:
    """SHA-256 over the names and contents of all our Python files; other source may give other results."""
    digest = hashlib.sha256()
    for package in OURS:
        root = Path(str(files(package)))
        for path in sorted(root.rglob("*.py")):
            content = path.read_bytes()
            digest.update(f"{package}/{path.relative_to(root).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
