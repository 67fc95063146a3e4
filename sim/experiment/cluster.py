"""Drives trials on an existing Dask cluster; how to start one: docs/how-to/build-on-a-cluster.md.

Workers need not share a disk with us: a trial's files come back with its measures. Files of the user's own (scenarios,
trains, populations) must be at the same path on every worker; bundled ones are found by their names.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cache
from threading import Lock
from typing import Final

from das.domain.errors import DasError
from precompute.tables.cluster import WorkerDiffersError, check_workers, connected, submitted_results
from precompute.tables.environment import differences, environment
from sim.experiment.freezing import setting_files
from sim.experiment.jobs import DrivenTrial, Keep, TrialJob, worked_off
from sim.experiment.setting import Setting
from sim.jobs.plan import code_sha256

ONE_AT_A_TIME: Final = Lock()
"""A worker with several threads drives one trial at a time, because its solved lines are shared."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a worker must have to drive as we do: the versions of its packages, and our source."""

    environment: dict[str, str]
    code_sha256: str


def worked_on_cluster(jobs: Sequence[TrialJob], address: str) -> Generator[DrivenTrial]:
    """What comes of each trial, as it ends; closing the iterator takes the trials back.

    Raises DasError where no scheduler answers, there are no workers, or one of them differs from us.
    """
    if any(job.keep is Keep.RECORDINGS for job in jobs):
        raise DasError("--recordings: expected without --scheduler, because recordings are written on this machine")
    with connected(address) as client:
        check_workers(client, address)
        expected = Expected(environment=environment(), code_sha256=code_sha256())
        for job, result in submitted_results(client, driven_there, jobs, expected):
            yield _given_up(job, result) if isinstance(result, BaseException) else result


def driven_there(job: TrialJob, expected: Expected) -> DrivenTrial:
    """On a worker: what comes of a trial. A worker that runs other code refuses."""
    differing = differences(expected.environment, _own_environment())
    if not differing and code_sha256() != expected.code_sha256:
        differing = "its source of the simulator is another one"
    if differing:
        raise WorkerDiffersError(f"a worker: {differing}")
    here = _files_here(job.trial.setting)
    missing = [name for name, digest in job.files if name in here and here[name] != digest]
    if missing:
        raise DasError(f"a worker has another file: {', '.join(missing)}; expected the same file at the same path")
    with ONE_AT_A_TIME:
        return worked_off(job)


@cache
def _files_here(setting: Setting) -> dict[str, str]:
    return setting_files(setting)


@cache
def _own_environment() -> dict[str, str]:
    return environment()


def _given_up(job: TrialJob, error: BaseException) -> DrivenTrial:
    """The row of a trial that the cluster could not drive."""
    said = f"on the cluster: {type(error).__name__}: {' '.join(str(error).split())}"
    return DrivenTrial(job.row | {"error": said}, {})
