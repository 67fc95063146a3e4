"""Runs an experiment: drives its unfinished trials on all workers, and writes the files in the study's folder."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, Final

from das import __version__
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from precompute.workers import Workers, source_sha256
from sim.drivers.parameters import load_population
from sim.experiment.design import Design, resolved
from sim.experiment.driving import LINES_KEPT, StudyTrial, drive
from sim.experiment.factors import Setting, setting_files
from sim.experiment.measures import measured
from sim.experiment.plan import CHECKSUMS, FAILED_TABLE, PROVENANCE, TRIALS_TABLE
from sim.experiment.study_files import (
    EVENTS,
    RECORDING,
    SERIES,
    SETTING,
    checksums,
    study_files,
    table_text,
    trial_file,
    trial_files,
    trials_table,
)
from sim.experiment.trials import trials_of
from sim.jobs.runner import JobRecording, JobResult, JobWords, Rows, Runner, write_files
from sim.options import typed_command
from sim.recording.inputs import sha256
from sim.world.service import PLANNED

FAILED: Final = ("trial", "participant", "condition", "error")
"""What the list of failed trials says of each."""
ONE_AT_A_TIME: Final = Lock()
"""A worker of a cluster with several threads drives one trial at a time, because its solved lines are shared."""


class Keep(StrEnum):
    """What is kept of a trial besides its measures."""

    MEASURES = "measures"
    SERIES = "series"
    RECORDINGS = "recordings"


@dataclass(frozen=True, kw_only=True)
class TrialJob:
    """A trial to be driven: `files` are the hashes of its input files, `measures` what is to be found of it.

    `folder` is the study's.
    """

    trial: StudyTrial
    population: str
    measures: tuple[str, ...]
    files: tuple[tuple[str, str], ...]
    keep: Keep
    folder: Path

    @property
    def inputs_sha256(self) -> str:
        """The hash of everything that decides the result; a trial with an equal hash need not be driven again."""
        trial = self.trial
        decides = [
            *(trial.number, trial.person, trial.position, list(trial.levels), trial.seed, trial.stream, trial.trips),
            *(trial.setting.figures() | {"scenario": None, "train": None}, list(self.measures), sorted(self.files)),
        ]
        return hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()

    @property
    def row(self) -> dict[str, Any]:
        """What the journal says of the trial before it is driven."""
        trial = self.trial
        who = {"trial": trial.number, "participant": trial.participant, "condition": trial.condition}
        return {"inputs_sha256": self.inputs_sha256, **who}

    @property
    def kept_files(self) -> tuple[str, ...]:
        """The files that are to be there when the trial is finished, without its recording."""
        wanted = () if self.keep is Keep.MEASURES else (EVENTS, SETTING, SERIES)
        return tuple(trial_file(self.trial, what) for what in wanted)

    @property
    def recording(self) -> JobRecording | None:
        """Where the trial is recorded; None where it is not."""
        if self.keep is not Keep.RECORDINGS:
            return None
        command = f"das-sim experiment run: trial {self.trial.number}, inputs {self.inputs_sha256}"
        return JobRecording(self.folder / trial_file(self.trial, RECORDING), command)


def jobs_of(design: Design, keep: Keep, folder: Path) -> list[TrialJob]:
    """The jobs of a design in the order of its trials; raises DasError for files that cannot be used."""
    population = design.people.population
    common = {"version": __version__, "code": source_sha256(), "population": sha256(load_population(population).source)}
    by_setting: dict[Any, dict[str, str]] = {}
    found = []
    for trial in trials_of(design):
        files = by_setting.setdefault(trial.setting, {})
        if not files:
            files |= common | setting_files(trial.setting)
        found.append(
            TrialJob(
                trial=trial,
                population=population,
                measures=design.plan.measures,
                files=tuple(files.items()),
                keep=keep,
                folder=folder,
            )
        )
    return found


def make_trial(job: TrialJob) -> JobResult:
    """Drive a trial, find its measures and make its files; raises DasError where it cannot be driven.

    It is also raised if a file of the trial is not the one with which the jobs were made: it was changed since, or this
    is another machine, with another file at the same path.
    """
    here = _files_here(job.trial.setting)
    # Version, source and population are no files of a setting.
    others = [name for name, digest in job.files if here.get(name, digest) != digest]
    if others:
        raise DasError(f"a worker has another file: {', '.join(others)}; expected the same file at the same path")
    with ONE_AT_A_TIME:
        driven = drive(job.trial, job.population, job.recording)
        files = {} if job.keep is Keep.MEASURES else trial_files(job.trial, driven)
        return JobResult({"measures": measured(driven, list(job.measures)), "error": None}, files)


@cache
def _files_here(setting: Setting) -> dict[str, str]:
    return setting_files(setting)


def in_order_of_work(jobs: Sequence[TrialJob]) -> list[TrialJob]:
    """The jobs in the order of the trials, but with those of one solved line after each other.

    A worker keeps the lines of a few loss levels. Trials of up to that many levels are driven in turn, so that a study
    that is stopped has a balanced set of finished trials.
    """
    settings = {job.trial.setting for job in jobs}
    many_levels = len({setting.loss_level for setting in settings}) >= LINES_KEPT
    lines = {setting: _line_of(setting, by_level=many_levels) for setting in settings}
    return sorted(jobs, key=lambda job: (lines[job.trial.setting], job.trial.number))


def _line_of(setting: Setting, *, by_level: bool) -> str:
    """What the solved lines of a setting depend on: line, train and timetable, and the advice's losses."""
    scenario = setting.read_scenario()
    return repr([*(getattr(scenario, name) for name in PLANNED), setting.loss_level if by_level else None])


@dataclass(frozen=True, kw_only=True)
class StudyRun:
    """A finished run of a study: how many trials it has, how many were driven now, and the rows of failed ones."""

    folder: Path
    trials: int
    made: int
    failed: tuple[Mapping[str, Any], ...]

    def as_dict(self) -> dict[str, Any]:
        """The figures, for programs."""
        failed = [{name: one[name] for name in FAILED} for one in self.failed]
        return {"folder": str(self.folder), "trials": self.trials, "made": self.made, "failed": failed}


def run_study(design: Design, jobs: Sequence[TrialJob], folder: Path, workers: Workers) -> StudyRun:
    """Drive all trials that are not finished, and write the study's files, even if the run is interrupted.

    Raises DasError where files cannot be written, a worker is killed or a cluster cannot be used.
    """
    write_files(folder, study_files(design, [job.trial for job in jobs]))
    began = datetime.now(UTC)
    failed: list[Mapping[str, Any]] = []

    def write(rows: Rows, made: int) -> None:
        of_trials = {job.trial.number: rows.get(job.inputs_sha256) for job in jobs}
        failed.extend(_write_results(design, jobs, folder, of_trials))
        if made:
            _write_provenance(design, folder, workers, began)

    words = JobWords("experiment", "trials", "drive")
    runner = Runner(make=make_trial, folder=folder, workers=workers, words=words)
    made = runner.run(in_order_of_work(jobs), write)
    return StudyRun(folder=folder, trials=len(jobs), made=made, failed=tuple(failed))


def _write_results(
    design: Design, jobs: Sequence[TrialJob], folder: Path, rows: Mapping[int, Mapping[str, Any] | None]
) -> list[Mapping[str, Any]]:
    """Write the table of trials, the list of those that failed and the checksums; returns the rows that failed."""
    known = {number: row for number, row in rows.items() if row is not None}
    good = {number: row["measures"] for number, row in known.items() if row.get("error") is None}
    failed = [row for row in known.values() if row.get("error") is not None]
    write_whole(folder / TRIALS_TABLE, trials_table(design, [job.trial for job in jobs], good))
    if failed:
        write_whole(folder / FAILED_TABLE, table_text(FAILED, ([row[name] for name in FAILED] for row in failed)))
    else:
        (folder / FAILED_TABLE).unlink(missing_ok=True)
    write_whole(folder / CHECKSUMS, checksums(folder))
    return failed


def _write_provenance(design: Design, folder: Path, workers: Workers, began: datetime) -> None:
    found = resolved(design)
    content = {
        "design_sha256": found["hash"],
        "files": found["files"],
        "program": "das-sim",
        "version": __version__,
        "code_sha256": source_sha256(),
        "python": platform.python_version(),
        "machine": platform.platform(),
        "command": typed_command(),
        **workers.facts,
        "began_utc": began.isoformat(timespec="seconds"),
        "ended_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    write_whole(folder / PROVENANCE, json.dumps(content, indent=2).encode() + b"\n")
