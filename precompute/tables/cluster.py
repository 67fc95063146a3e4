"""Solving jobs on an existing Dask cluster; how to start one: docs/how-to/build-on-a-cluster.md.

Workers need not share a disk with us: the files of a table come back as the result, one table at a time, and are
written here. Only so many jobs are on the cluster at once that the results waiting there stay few.
"""

from __future__ import annotations

import importlib
import re
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from das.domain.errors import DasError
from precompute.tables.environment import differences, environment
from precompute.tables.job import Job
from precompute.tables.store import BuildStatus, Outcome
from precompute.tables.writing import write_table

CONNECT_WITHIN_S = 10.0
ADDRESS = re.compile(r"(tcp|tls|wss?)://[^/\s]+:\d{1,5}/?")
Work = TypeVar("Work")
JOBS_PER_THREAD = 2
"""Number of jobs on the cluster for each of its threads: one is solved, one waits."""


class WorkerDiffersError(DasError):
    """A worker runs other versions than we do; its tables would not be those of this machine."""


def solve_on_cluster(jobs: Sequence[Job], folder: Path, address: str) -> Generator[Outcome]:
    """Solve jobs on a cluster into tables in a folder here; yields the outcome of each as it comes.

    A job whose worker dies is tried again by the scheduler (its `allowed-failures`). One that is given up is tried once
    more alone, because dask also blames jobs that only waited on a dying worker. Closing the iterator takes the jobs
    back. Raises DasError where no scheduler answers, there are no workers, or one of them differs from us.
    """
    with connected(address) as client:
        check_workers(client, address)
        suspects: list[Job] = []
        yield from _solve(client, jobs, folder, suspects)
        for job in suspects:
            alone: list[Job] = []
            yield from _solve(client, [job], folder, alone)
            if alone:
                yield Outcome(
                    name=job.name, status=BuildStatus.POISON, reason="it took its workers down, alone as well"
                )


def check_workers(client: Any, address: str) -> None:
    """Raise DasError, which names the worker and the difference, unless all workers run what we run."""
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


def solve_there(job: Job, expected: dict[str, str]) -> tuple[BuildStatus, str, dict[str, bytes], float]:
    """On a worker: status, reason, files and seconds of a job's table. A worker that joined late is checked here."""
    differing = differences(expected, _own_environment())
    if differing:
        raise WorkerDiffersError(f"a worker that joined later: {differing}")
    began = time.perf_counter()
    try:
        files = job.solve()
    except DasError as error:
        return BuildStatus.FAILED, " ".join(str(error).split()), {}, time.perf_counter() - began
    return BuildStatus.BUILT, "", files, time.perf_counter() - began


@cache
def _own_environment() -> dict[str, str]:
    return environment()


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise DasError("--scheduler needs distributed: install the extra, pip install '.[cluster]'") from None


def connected(address: str) -> Any:
    """A client of the scheduler at an address, to be used with `with`; DasError where none answers."""
    if not ADDRESS.fullmatch(address):
        raise DasError(f"--scheduler {address}: expected an address like tcp://HOST:8786")
    client = _distributed().Client
    try:
        return client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise DasError(f"{address}: no Dask scheduler answers ({' '.join(str(error).split())})") from error


def submitted_results(
    client: Any, function: Callable[[Work, Any], Any], jobs: Sequence[Work], expected: Any
) -> Generator[tuple[Work, Any]]:
    """Each job with what `function(job, expected)` makes of it on the cluster, or with the exception that it raised.

    Closing the iterator takes the jobs back. Raises WorkerDiffersError as the function does, and DasError where the
    scheduler goes.
    """
    waiting = list(reversed(jobs))
    submitted: dict[Any, Work] = {}
    distributed = _distributed()
    coming = distributed.as_completed(loop=client.loop)

    def submit() -> None:
        future = client.submit(function, waiting[-1], expected, pure=False)
        submitted[future] = waiting.pop()
        coming.add(future)

    try:
        for _ in range(min(len(waiting), JOBS_PER_THREAD * max(sum(client.nthreads().values()), 1))):
            submit()
        for future in coming:
            job = submitted.pop(future)
            try:
                result = future.result()
            except WorkerDiffersError:
                raise
            except (distributed.client.FutureCancelledError, distributed.comm.CommClosedError) as error:
                raise DasError(f"the scheduler has gone ({' '.join(str(error).split())})") from error
            except Exception as error:
                result = error
            future.release()
            if waiting:
                submit()
            yield job, result
    finally:
        client.cancel(list(submitted), force=True)


def _solve(client: Any, jobs: Sequence[Job], folder: Path, suspects: list[Job]) -> Generator[Outcome]:
    """Outcomes of jobs; those the scheduler gave up are put among the suspects instead."""
    with closing(submitted_results(client, solve_there, jobs, environment())) as results:
        for job, result in results:
            if isinstance(result, _distributed().KilledWorker):
                suspects.append(job)
            else:
                yield _outcome(result, job, folder)


def _outcome(result: Any, job: Job, folder: Path) -> Outcome:
    """What became of a job, its table written."""
    try:
        if isinstance(result, Exception):
            raise result
        status, reason, files, seconds = result
        if status is BuildStatus.BUILT:
            write_table(folder / job.name, files)
    except Exception as error:
        reason = str(error) if isinstance(error, DasError) else f"{type(error).__name__}: {error}"
        return Outcome(name=job.name, status=BuildStatus.FAILED, reason=" ".join(reason.split()), attempts=1)
    size = sum(map(len, files.values())) or None
    return Outcome(name=job.name, status=status, reason=reason, seconds=seconds, attempts=1, size_bytes=size)
