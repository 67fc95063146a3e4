"""Runs an experiment: what is not finished yet, on all workers, into the study's folder."""

from __future__ import annotations

import csv
import io
import json
import platform
import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from das import __version__
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from sim.experiment.cluster import worked_on_cluster
from sim.experiment.design import Design
from sim.experiment.files import CHECKSUMS, FAILED_TABLE, KEY_HASH, PROVENANCE, TRIALS_TABLE
from sim.experiment.freezing import resolved
from sim.experiment.jobs import DrivenTrial, TrialJob, in_order_of_work, is_finished, worked_off
from sim.experiment.study_files import checksums, study_files, trials_table
from sim.jobs.journal import Journal
from sim.jobs.plan import code_sha256
from sim.jobs.pool import worked
from sim.progress import progress_bar
from sim.recording.metadata import typed_command


@dataclass(frozen=True, kw_only=True)
class Workers:
    """The workers that drive the trials: a number of processes on this machine, or those of a Dask cluster."""

    count: int
    scheduler: str | None = None

    def work(self, jobs: Sequence[TrialJob]) -> Generator[DrivenTrial]:
        """What comes of each trial, as it ends."""
        if self.scheduler is not None:
            return worked_on_cluster(jobs, self.scheduler)
        return worked(worked_off, jobs, min(self.count, len(jobs)))


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
    _write(folder, study_files(design, [job.trial for job in jobs]))
    began = datetime.now(UTC)
    with Journal(folder, holds="another experiment") as journal:
        left = in_order_of_work([job for job in jobs if not is_finished(job, journal.rows)])
        interrupt_on_termination()
        try:
            _work(left, len(jobs), folder, workers, journal)
        except KeyboardInterrupt:
            done = sum(is_finished(job, journal.rows) for job in jobs)
            print(f"{done} of {len(jobs)} trials are finished; the same command goes on from there", file=sys.stderr)
            raise
        finally:
            rows = {job.trial.number: journal.rows.get(job.inputs_sha256) for job in jobs}
            failed = _write_results(design, jobs, folder, rows)
            if left:
                _write_provenance(design, folder, workers, began)
    return StudyRun(folder=folder, trials=len(jobs), made=len(left), failed=tuple(failed))


def _work(left: Sequence[TrialJob], of: int, folder: Path, workers: Workers, journal: Journal) -> None:
    """Drive what is left; a trial's files are written before the journal says that it is finished."""
    if not left:
        return
    done = of - len(left)
    for job in left:
        if job.record is not None:
            job.record.file.parent.mkdir(parents=True, exist_ok=True)
    with (
        progress_bar("experiment", f"{len(left)} of {of} trials to drive", "trials") as progress,
        closing(workers.work(left)) as results,
    ):
        for driving in results:
            _write(folder, driving.files)
            journal.add(driving.row)
            done += 1
            progress(done, of)


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        path = folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DasError(f"{path.parent}: cannot be made ({error.strerror})") from error
        write_whole(path, content)


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
    where = {"workers": workers.count} if workers.scheduler is None else {"scheduler": workers.scheduler}
    content = {
        "design_sha256": found[KEY_HASH],
        "files": found["files"],
        "program": "das-sim",
        "version": __version__,
        "code_sha256": code_sha256(),
        "python": platform.python_version(),
        "machine": platform.platform(),
        "command": typed_command(),
        **where,
        "began_utc": began.isoformat(timespec="seconds"),
        "ended_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    write_whole(folder / PROVENANCE, json.dumps(content, indent=2).encode() + b"\n")
