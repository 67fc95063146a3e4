"""A build solves the tables that are missing, keeps those that are whole, and reports on every section."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.locking import folder_held
from precompute.pool import JobLostError, Made
from precompute.tables.job import Job, warm_up
from precompute.tables.plan import BuildPlan
from precompute.tables.store import (
    BuildStatus,
    Outcome,
    finished,
    read_report,
    remove_superseded,
    remove_unfinished,
    write_report,
)
from precompute.tables.writing import write_table
from precompute.workers import Workers

REPORT_EVERY_S = 5.0
"""While a build goes on, its report on disk is never older than this."""


def build(plan: BuildPlan, folder: Path, workers: Workers, watch: Callable[[Outcome], None]) -> dict[str, Any]:
    """Build a plan into a folder; `watch` hears every outcome. Returns the report, which is written to build.json.

    Whatever ends the build, the report says how far it came. Raises DasError where another build has the folder.
    """
    with folder_held(folder, "another build is writing to it"):
        remove_unfinished(folder)
        state = _State(plan, folder, workers.facts)
        for outcome in state.outcomes_that_are(BuildStatus.KEPT):
            watch(outcome)
        try:
            with closing(solve_jobs(state.jobs_that_are(BuildStatus.PENDING), folder, workers)) as coming:
                for outcome in coming:
                    state.take(outcome)
                    watch(outcome)
            state.superseded = remove_superseded(folder, state.jobs_that_are(BuildStatus.BUILT, BuildStatus.KEPT))
        finally:
            remove_unfinished(folder)
            state.look_again()
            report = state.report()
    return report


def solve_jobs(jobs: Sequence[Job], folder: Path, workers: Workers) -> Generator[Outcome]:
    """Solve jobs into tables in a folder; yields the outcome of each as it comes.

    A worker of this machine writes its tables itself; those of a cluster are written here. Closing the iterator stops
    the workers. Raises DasError as `Workers.made` does.
    """
    make = partial(solved, folder=folder if workers.scheduler is None else None)
    with closing(workers.made(make, jobs, prepare=warm_up)) as coming:
        for made in coming:
            yield _outcome(made, folder)


def solved(job: Job, folder: Path | None) -> tuple[Outcome, dict[str, bytes]]:
    """What becomes of a job, as a worker solves it: with a folder its table is put there, else its files come back."""
    began_s = time.perf_counter()

    def became(status: BuildStatus, reason: str = "", size_bytes: int | None = None) -> Outcome:
        seconds = time.perf_counter() - began_s
        return Outcome(name=job.name, status=status, reason=reason, seconds=seconds, size_bytes=size_bytes)

    try:
        files = job.solve()
        if folder is not None:
            write_table(folder / job.name, files)
    except DasError as error:
        return became(BuildStatus.FAILED, " ".join(str(error).split())), {}
    except MemoryError:
        raise
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        fault = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        return became(BuildStatus.FAILED, f"a fault of the solver: {fault}"), {}
    built = became(BuildStatus.BUILT, size_bytes=sum(map(len, files.values())))
    return built, files if folder is None else {}


def _outcome(made: Made[Job, tuple[Outcome, dict[str, bytes]]], folder: Path) -> Outcome:
    """What became of a job, its table written where its worker did not."""
    error = made.error
    if made.result is not None:
        outcome, files = made.result
        try:
            if files:
                write_table(folder / outcome.name, files)
            return replace(outcome, attempts=made.attempts)
        except DasError as failure:
            error = failure
    status = BuildStatus.POISON if isinstance(error, JobLostError) else BuildStatus.FAILED
    reason = str(error) if isinstance(error, DasError) else f"{type(error).__name__}: {error}"
    return Outcome(name=made.job.name, status=status, reason=" ".join(reason.split()), attempts=made.attempts)


class _State:
    """How far a build has come."""

    def __init__(self, plan: BuildPlan, folder: Path, facts: Mapping[str, Any]) -> None:
        self._plan, self._folder, self._facts = plan, folder, facts
        self._began_s = self._reported_s = time.perf_counter()
        self.superseded: list[str] = []
        before = {section["name"]: section for section in read_report(folder).get("sections", [])}
        self._outcomes = {job.name: _standing(job, folder, before.get(job.name, {})) for job in plan.jobs}

    def outcomes_that_are(self, *statuses: BuildStatus) -> list[Outcome]:
        return [outcome for outcome in self._outcomes.values() if outcome.status in statuses]

    def jobs_that_are(self, *statuses: BuildStatus) -> list[Job]:
        return [job for job in self._plan.jobs if self._outcomes[job.name].status in statuses]

    def take(self, outcome: Outcome) -> None:
        self._outcomes[outcome.name] = outcome
        if time.perf_counter() - self._reported_s > REPORT_EVERY_S:
            self.report()

    def look_again(self) -> None:
        """Find the tables that were put into place while the build was being stopped, before anybody heard of them."""
        for job in self.jobs_that_are(BuildStatus.PENDING):
            size = finished(self._folder, job)
            if size is not None:
                self._outcomes[job.name] = Outcome(name=job.name, status=BuildStatus.BUILT, attempts=1, size_bytes=size)

    def report(self) -> dict[str, Any]:
        """Write build.json; returns what it holds."""
        self._reported_s = time.perf_counter()
        facts = {
            "plan": str(self._plan.source),
            **self._facts,
            "seconds": self._reported_s - self._began_s,
            "superseded": self.superseded,
        }
        return write_report(self._folder, facts, list(self._outcomes.values()))


def _standing(job: Job, folder: Path, before: Mapping[str, Any]) -> Outcome:
    """A job as kept, with what the last report says of it, or pending."""
    size = finished(folder, job)
    if size is None:
        return Outcome(name=job.name, status=BuildStatus.PENDING)
    seconds, attempts = before.get("seconds"), before.get("attempts") or 0
    return Outcome(name=job.name, status=BuildStatus.KEPT, seconds=seconds, attempts=attempts, size_bytes=size)
