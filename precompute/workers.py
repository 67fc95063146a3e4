"""Workers for many jobs: processes of this machine, or the workers of an existing Dask cluster.

They make tables (`precompute/tables`) and simulated days (`sim/experiment`). How to start a cluster:
docs/how-to/build-on-a-cluster.md. Its workers need not share a disk with us: results travel to this machine. Only a few
jobs are submitted at a time, so that few results wait there.
"""

from __future__ import annotations

import hashlib
import importlib
import platform
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeVar

import das
from das.command_line.process import available_cores
from das.domain.errors import DasError
from precompute.pool import JobLostError, Made, made_here

Job = TypeVar("Job")
Result = TypeVar("Result")

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
        """The workers that a user asks for, by default one process a core; DasError if both are given."""
        if count is not None and scheduler is not None:
            raise DasError("give either --workers or --scheduler: a cluster has its own workers")
        return cls(count=count or available_cores(), scheduler=scheduler)

    @property
    def facts(self) -> dict[str, Any]:
        """What reports say about the workers."""
        return {"workers": self.count} if self.scheduler is None else {"scheduler": self.scheduler}

    def made(
        self,
        make: Callable[[Job], Result],
        jobs: Sequence[Job],
        *,
        prepare: Callable[[], object],
        finish: bool = False,
    ) -> Generator[Made[Job, Result]]:
        """Yield what `make` makes of each job, as it ends; closing the iterator stops the work on all others.

        `make` and `prepare` must be functions of modules. Local workers call `prepare` once before their first job.
        With `finish`, an interruption waits for the jobs that local workers have under way, and yields them too.

        Raises DasError if local workers cannot be started, if no scheduler answers or has workers, or if a worker runs
        other code than we do.
        """
        if self.scheduler is None:
            return made_here(make, jobs, min(self.count, len(jobs)), prepare, finish=finish)
        return _made_on_cluster(make, jobs, self.scheduler)


def _made_on_cluster(make: Callable[[Job], Result], jobs: Sequence[Job], address: str) -> Generator[Made[Job, Result]]:
    """Yield the outcome of each job that a cluster does.

    A job whose worker dies is tried again by the scheduler (its `allowed-failures`). A job that the scheduler gives up
    is tried once more alone, because dask also blames jobs that only waited on a dying worker.
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
                    error = JobLostError("it took its workers down, alone as well") if killed else made.error
                    yield replace(made, error=error)


def connected(address: str) -> Any:
    """A client of the scheduler at an address, to be used with `with`; DasError if none answers."""
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
    """How another environment differs from this one, in words; empty if it does not."""
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
