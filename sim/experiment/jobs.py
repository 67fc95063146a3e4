"""The work of an experiment, trial by trial: what a worker is given, what it gives back, and when it need not work."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, Final

from das import __version__
from das.domain.errors import DasError
from precompute.workers import source_sha256
from sim.drivers.population import load_population
from sim.experiment.design import Design
from sim.experiment.driving import LINES_KEPT, TrialCall, drive
from sim.experiment.freezing import setting_files
from sim.experiment.measures import measured
from sim.experiment.setting import Setting
from sim.experiment.trial_files import events_file, recording_file, series_file, setting_file, trial_files
from sim.experiment.trials import StudyTrial, trials_of
from sim.jobs.driving import JobRecording
from sim.jobs.runner import JobResult
from sim.recording.inputs import sha256
from sim.world.service import PLANNED

ONE_AT_A_TIME: Final = Lock()
"""A worker of a cluster with several threads drives one trial at a time, because its solved lines are shared."""


class Keep(StrEnum):
    """What is kept of a trial beside its measures."""

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
        of_trial = (events_file, setting_file, series_file)
        return () if self.keep is Keep.MEASURES else tuple(of(self.trial) for of in of_trial)

    @property
    def recording(self) -> JobRecording | None:
        """Where the trial is recorded; None where it is not."""
        if self.keep is not Keep.RECORDINGS:
            return None
        command = f"das-sim experiment run: trial {self.trial.number}, inputs {self.inputs_sha256}"
        return JobRecording(self.folder / recording_file(self.trial), command)


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

    It is also raised where a file of the trial is another one here than where the jobs were made: another machine has
    another file at the same path, or the file was changed since.
    """
    here = _files_here(job.trial.setting)
    # Version, source and population are no files of a setting.
    others = [name for name, digest in job.files if here.get(name, digest) != digest]
    if others:
        raise DasError(f"a worker has another file: {', '.join(others)}; expected the same file at the same path")
    with ONE_AT_A_TIME:
        driven = drive(TrialCall(trial=job.trial, population=job.population, record=job.recording))
        files = {} if job.keep is Keep.MEASURES else trial_files(job.trial, driven)
        return JobResult({"measures": measured(driven, list(job.measures)), "error": None}, files)


@cache
def _files_here(setting: Setting) -> dict[str, str]:
    return setting_files(setting)


def in_order_of_work(jobs: Sequence[TrialJob]) -> list[TrialJob]:
    """The jobs so that those of one solved line follow each other, and else in the order of the trials.

    A worker keeps the lines of a few loss levels. Up to so many of them are driven in turn, so that what is finished of
    a study that was stopped is balanced.
    """
    settings = {job.trial.setting for job in jobs}
    many_levels = len({setting.loss_level for setting in settings}) >= LINES_KEPT
    lines = {setting: _line_of(setting, by_level=many_levels) for setting in settings}
    return sorted(jobs, key=lambda job: (lines[job.trial.setting], job.trial.number))


def _line_of(setting: Setting, *, by_level: bool) -> str:
    """What the solved lines of a setting depend on: line, train and timetable, and the advice's losses."""
    scenario = setting.read_scenario()
    return repr([*(getattr(scenario, name) for name in PLANNED), setting.loss_level if by_level else None])
