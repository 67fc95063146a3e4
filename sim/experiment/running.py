"""Runs an experiment: what is not finished yet, on all workers, into the study's folder."""

from __future__ import annotations

import csv
import io
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from das import __version__
from das.domain.files.writing import write_whole
from precompute.workers import Workers, source_sha256
from sim.experiment.design import Design
from sim.experiment.files import CHECKSUMS, FAILED_TABLE, KEY_HASH, PROVENANCE, TRIALS_TABLE
from sim.experiment.freezing import resolved
from sim.experiment.jobs import TrialJob, in_order_of_work, make_trial
from sim.experiment.study_files import checksums, study_files, trials_table
from sim.jobs.runner import JobWords, Rows, Runner, write_files
from sim.recording.metadata import typed_command


@dataclass(frozen=True, kw_only=True)
class StudyRun:
    """What a run of a study came to: trials in all, those driven now, and the rows of those that failed."""

    folder: Path
    trials: int
    made: int
    failed: tuple[Mapping[str, Any], ...]

    def as_dict(self) -> dict[str, Any]:
        """The figures, for programs."""
        failed = [{name: one[name] for name in ("trial", "participant", "condition", "error")} for one in self.failed]
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
        write_whole(folder / FAILED_TABLE, _failures(failed))
    else:
        (folder / FAILED_TABLE).unlink(missing_ok=True)
    write_whole(folder / CHECKSUMS, checksums(folder))
    return failed


def _failures(failed: Sequence[Mapping[str, Any]]) -> bytes:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = ("trial", "participant", "condition", "error")
    writer.writerow(names)
    writer.writerows([row[name] for name in names] for row in failed)
    return out.getvalue().encode()


def _write_provenance(design: Design, folder: Path, workers: Workers, began: datetime) -> None:
    found = resolved(design)
    content = {
        "design_sha256": found[KEY_HASH],
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
