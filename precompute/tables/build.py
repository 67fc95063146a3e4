"""A build solves the tables that are missing, keeps those that are whole, and reports on every section."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.writing import folder_held, write_whole
from das.solver.warm_up import warm_up
from das.table import OLD, Table
from precompute.tables.plan import BuildPlan
from precompute.tables.writing import Job
from precompute.workers import JobLostError, Made, Workers

REPORT = "build.json"
REPORT_VERSION = 2


class BuildStatus(StrEnum):
    """The status of a section in a build."""

    BUILT = "built"
    KEPT = "kept"
    """Built before, and nothing that it depends on has changed."""
    FAILED = "failed"
    POISON = "poison"
    """The worker process of the section died in every attempt."""
    PENDING = "pending"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The outcome of a job: `reason` is the cause of a failure (else empty), `seconds` the time of its last attempt.

    `size_bytes` is the size of its table, None if it has none.
    """

    name: str
    status: BuildStatus
    reason: str = ""
    seconds: float | None = None
    attempts: int = 0
    size_bytes: int | None = None


def remove_unfinished(folder: Path) -> None:
    """Remove the files that killed writers left unfinished."""
    for path in folder.glob(".*.json.*"):
        path.unlink(missing_ok=True)


def finished(folder: Path, job: Job) -> int | None:
    """The size of the job's table (bytes) if it is complete and equal to the one that the job would make, else None."""
    path = folder / job.name
    try:
        return path.stat().st_size if path.exists() and job.is_done(Table.read(path)) else None
    except DasError:
        return None


def table_files(folder: Path) -> list[Path]:
    """The tables in a folder, sorted by name, also those of earlier releases, which are folders; or the one table.

    Raises DasError if there is no such folder or file.
    """
    if folder.is_file() or (folder / "manifest.json").is_file():
        return [folder]
    if not folder.is_dir():
        raise DasError(f"{folder}: no such folder")
    files = (path for path in folder.glob("[!.]*.json") if path.name != REPORT)
    return sorted([*files, *(path.parent for path in folder.glob(OLD))])


def last_build(folder: Path) -> dict[str, dict[str, Any]]:
    """The entries of build.json for each section of the last build, by name; empty if it cannot be read."""
    try:
        report = json.loads((folder / REPORT).read_bytes())
        known = report["sections"] if report["schema_version"] == REPORT_VERSION else ()
        return {str(one["name"]): {**one, "status": BuildStatus(one["status"])} for one in known}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def missing_tables(folder: Path) -> list[str]:
    """Names of the tables that the last build finished and that are no longer there."""
    done = (BuildStatus.BUILT, BuildStatus.KEPT)
    names = [name for name, section in last_build(folder).items() if section["status"] in done]
    return [name for name in names if not (folder / name).is_file()]


REPORT_EVERY_S = 5.0
"""Least time (s) between two reports on the outcomes of a build."""


def build(plan: BuildPlan, folder: Path, workers: Workers, watch: Callable[[Outcome], None]) -> dict[str, Any]:
    """Build a plan into a folder; returns the report, which is written to build.json.

    `watch` is called with every outcome. The report shows the progress of the build, however it ends. Raises DasError
    if another build uses the folder.
    """
    with folder_held(folder, "another build is writing to it"):
        remove_unfinished(folder)
        state = _State(plan, folder, workers.facts)
        for outcome in state.outcomes.values():
            if outcome.status is BuildStatus.KEPT:
                watch(outcome)
        try:
            with closing(solve_jobs(state.pending(), folder, workers)) as coming:
                for outcome in coming:
                    state.take(outcome)
                    watch(outcome)
        finally:
            remove_unfinished(folder)
            state.look_again()
            report = state.report()
    return report


def solve_jobs(jobs: Sequence[Job], folder: Path, workers: Workers) -> Generator[Outcome]:
    """Solve jobs into tables in a folder; yields the outcome of each as it comes.

    A worker of this machine writes its tables itself; this process writes the tables of a cluster. Closing the iterator
    stops the workers. Raises DasError as `Workers.made` does.
    """
    make = partial(solved, folder=folder if workers.scheduler is None else None)
    with closing(workers.made(make, jobs, prepare=warm_up)) as coming:
        for made in coming:
            yield _outcome(made, folder)


def solved(job: Job, folder: Path | None) -> tuple[Outcome, bytes]:
    """Solve a job, as a worker does; returns its outcome, and the content of its table unless `folder` is given.

    A worker with a `folder` puts the table there itself.
    """
    began_s = time.perf_counter()

    def became(status: BuildStatus, reason: str = "", size_bytes: int | None = None) -> Outcome:
        seconds = time.perf_counter() - began_s
        return Outcome(name=job.name, status=status, reason=reason, seconds=seconds, size_bytes=size_bytes)

    try:
        content = job.solve()
        if folder is not None:
            write_whole(folder / job.name, content)
    except DasError as error:
        return became(BuildStatus.FAILED, " ".join(str(error).split())), b""
    except MemoryError:
        raise
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return became(BuildStatus.FAILED, f"a fault of the solver: {fault}"), b""
    built = became(BuildStatus.BUILT, size_bytes=len(content))
    return built, content if folder is None else b""


def _outcome(made: Made[Job, tuple[Outcome, bytes]], folder: Path) -> Outcome:
    error = made.error
    if made.result is not None:
        outcome, content = made.result
        try:
            if content:
                write_whole(folder / outcome.name, content)
            return replace(outcome, attempts=made.attempts)
        except DasError as failure:
            error = failure
    status = BuildStatus.POISON if isinstance(error, JobLostError) else BuildStatus.FAILED
    reason = str(error) if isinstance(error, DasError) else f"{type(error).__name__}: {error}"
    return Outcome(name=made.job.name, status=status, reason=" ".join(reason.split()), attempts=made.attempts)


class _State:
    def __init__(self, plan: BuildPlan, folder: Path, facts: Mapping[str, Any]) -> None:
        self._plan, self._folder, self._facts = plan, folder, facts
        self._began_s = self._reported_s = time.perf_counter()
        before = last_build(folder)
        self.outcomes = {job.name: _standing(job, folder, before.get(job.name, {})) for job in plan.jobs}

    def pending(self) -> list[Job]:
        """The jobs without an outcome."""
        return [job for job in self._plan.jobs if self.outcomes[job.name].status is BuildStatus.PENDING]

    def take(self, outcome: Outcome) -> None:
        self.outcomes[outcome.name] = outcome
        if time.perf_counter() - self._reported_s > REPORT_EVERY_S:
            self.report()

    def look_again(self) -> None:
        """Count the tables that workers put into place while the build was stopping, before their outcomes arrived."""
        for job in self.pending():
            size = finished(self._folder, job)
            if size is not None:
                self.outcomes[job.name] = Outcome(name=job.name, status=BuildStatus.BUILT, attempts=1, size_bytes=size)

    def report(self) -> dict[str, Any]:
        """Write build.json; returns its content."""
        self._reported_s = time.perf_counter()
        outcomes = self.outcomes.values()
        report = {
            "schema_version": REPORT_VERSION,
            "plan": str(self._plan.source),
            **self._facts,
            "seconds": self._reported_s - self._began_s,
            "counts": {str(status): sum(one.status is status for one in outcomes) for status in BuildStatus},
            "sections": [asdict(one) for one in outcomes],
        }
        write_whole(self._folder / REPORT, json.dumps(report, ensure_ascii=False, indent=1).encode() + b"\n")
        return report


def _standing(job: Job, folder: Path, before: Mapping[str, Any]) -> Outcome:
    """The outcome of a job before the build: kept, with the figures of the last report, or pending."""
    size = finished(folder, job)
    if size is None:
        return Outcome(name=job.name, status=BuildStatus.PENDING)
    seconds, attempts = before.get("seconds"), before.get("attempts") or 0
    return Outcome(name=job.name, status=BuildStatus.KEPT, seconds=seconds, attempts=attempts, size_bytes=size)
