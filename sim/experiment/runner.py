"""A runner of trials on all workers, with results in a folder; a stopped command resumes with unfinished jobs.

A job has an identity: the hash of everything on which its result depends. Its result is one row in the journal of the
folder, and optionally a recording. Results do not depend on the number or the place of the workers.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self

from das.cab.cab import warm_up
from das.command_line.printing import progress_bar
from das.command_line.process import interrupted_by_termination
from das.domain.errors import DasError
from das.domain.files.writing import folder_held, make_folder, write_whole
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind
from sim.experiment.driving import JobRecording, StudyTrial

Rows = Mapping[str, Mapping[str, Any]]
"""The rows of a journal by the hashes of the jobs' inputs."""


@dataclass(frozen=True, kw_only=True)
class TrialJob:
    """A trial to drive, the measures to compute for it, and the file for its recording (None: no recording).

    `files` has the name and hash of each input file, `measures` the names of the wanted measures.
    """

    trial: StudyTrial
    population: str
    measures: tuple[str, ...]
    files: tuple[tuple[str, str], ...]
    record: Path | None

    @property
    def inputs_sha256(self) -> str:
        """The hash of everything that affects the result; a trial with an equal hash need not be driven again.

        All drivers, except the simulated human and users' own drivers, drive identically for every participant.
        """
        trial, setting = self.trial, self.trial.setting
        human = not isinstance(setting.driver, DriverKind) or setting.driver is DriverKind.HUMAN
        decides = [
            *((trial.person, trial.stream, trial.trips) if human else (None, None, None)),
            *(trial.seed, setting.figures() | {"scenario": None, "train": None}, list(self.measures)),
            sorted(self.files),
        ]
        return hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()

    @property
    def row(self) -> dict[str, Any]:
        """The trial's entries in the journal that are known before it is driven."""
        trial = self.trial
        who = {"trial": trial.number, "participant": trial.participant, "condition": trial.condition}
        return {"inputs_sha256": self.inputs_sha256, **who}

    @property
    def recording(self) -> JobRecording | None:
        """The file in which the trial is recorded; None if it is not recorded."""
        command = f"das-sim experiment run: trial {self.trial.number}, inputs {self.inputs_sha256}"
        return None if self.record is None else JobRecording(self.record, command)


class JobWords(NamedTuple):
    """The words in messages for a command, its jobs, and the action on a job."""

    command: str
    jobs: str
    to_do: str


FINISHED: Final = "finished.jsonl"
"""The journal of the jobs in a folder."""


class HeldJournal(ABC):
    """A file of lines at `path`, whose folder one command holds at a time; use with `with`.

    Entering raises FolderTakenError with the text `taken` if another command holds the folder, and DasError for a file
    that cannot be read and written.
    """

    def __init__(self, path: Path, taken: str) -> None:
        self.path, self._taken = path, taken

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            opened.enter_context(folder_held(self.path.parent, self._taken))
            try:
                self._read()
                self._file = opened.enter_context(self.path.open("ab", buffering=0))
            except OSError as error:
                raise DasError(f"{self.path}: cannot be read and written ({error.strerror})") from error
            self._opened = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()

    def append(self, line: bytes) -> None:
        """Write a line to the disk at once; DasError if it cannot be written, and then no part of it remains."""
        length = os.fstat(self._file.fileno()).st_size
        try:
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(length)
            raise DasError(f"{self.path}: cannot be written ({error.strerror})") from error

    @abstractmethod
    def _read(self) -> None:
        """Read the lines in the file, and remove what a killed command has not written whole."""


class Journal(HeldJournal):
    """The finished rows in a folder, by the hash of their inputs; use with `with`.

    Only one command may use a folder at a time; a second command gets an error that names the first by `holds`. Every
    line has the hash of its row, so that a truncated or altered row is not used as a result.
    """

    def __init__(self, folder: Path, *, holds: str = "another run") -> None:
        super().__init__(folder / FINISHED, f"{holds} is at work here")
        self.rows: dict[str, dict[str, Any]] = {}

    def add(self, row: dict[str, Any]) -> None:
        """Write the row of a finished job to the disk immediately."""
        self.rows[row["inputs_sha256"]] = row
        self.append(_line(row))

    def _read(self) -> None:
        """Read the rows in the file; damaged lines are removed from the file before a new line is appended."""
        if not self.path.exists():
            return
        lines = self.path.read_bytes().splitlines()
        for line in lines:
            row = _row(line)
            if row is not None:
                self.rows[row["inputs_sha256"]] = row
        if len(self.rows) < len(lines) or not self.path.read_bytes().endswith(b"\n"):
            write_whole(self.path, b"".join(map(_line, self.rows.values())))


def _line(row: dict[str, Any]) -> bytes:
    return json.dumps({"row_sha256": _sha256(row), "row": row}, ensure_ascii=False).encode() + b"\n"


def _row(line: bytes) -> dict[str, Any] | None:
    """The row of a line; None if the line is damaged."""
    try:
        found = json.loads(line)
        row: dict[str, Any] = found["row"]
        return row if found["row_sha256"] == _sha256(row) else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _sha256(row: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Runner:
    """A runner of jobs on workers, with results in a folder; `make` must be a function at module level."""

    make: Callable[[TrialJob], dict[str, Any]]
    folder: Path
    workers: Workers
    words: JobWords

    def run(self, jobs: Sequence[TrialJob], write: Callable[[Rows, int], None]) -> int:
        """Do the unfinished jobs, in their order; returns their number.

        `write` is called at the end, even after an interruption, with the journal's rows and that number. Raises
        DasError if another command uses the folder, if files cannot be written, and as `Workers.made` does.
        """
        words = self.words
        with Journal(self.folder, holds=f"another {words.command}") as journal:
            left = [job for job in jobs if not is_finished(job, journal.rows)]
            try:
                with interrupted_by_termination():
                    self._make(left, len(jobs), journal)
            except KeyboardInterrupt:
                done = sum(is_finished(job, journal.rows) for job in jobs)
                said = f"{done} of {len(jobs)} {words.jobs} are finished; the same command goes on from there"
                print(said, file=sys.stderr)
                raise
            finally:
                write(journal.rows, len(left))
        return len(left)

    def _make(self, left: Sequence[TrialJob], of: int, journal: Journal) -> None:
        """Do the remaining jobs, and show progress; an interruption waits for the jobs under way on this machine."""
        if not left:
            return
        for job in left:
            if job.recording is not None:
                make_folder(job.recording.file.parent)
        words, make = self.words, partial(attempted, self.make)
        first = f"{len(left)} of {of} {words.jobs} to {words.to_do}"
        with (
            progress_bar(words.command, first, words.jobs) as progress,
            closing(self.workers.made(make, left, prepare=warm_up, finish=True)) as coming,
        ):
            for number, made in enumerate(coming, of - len(left) + 1):
                journal.add(made.result or _failed(made.job, str(made.error)))
                progress(number, of)


def attempted(make: Callable[[TrialJob], dict[str, Any]], job: TrialJob) -> dict[str, Any]:
    """The whole row of a job with its result. If the job fails, the row has the reason, and other jobs continue."""
    try:
        return job.row | make(job)
    except DasError as error:
        return _failed(job, str(error))
    except Exception as error:
        return _failed(job, f"{type(error).__name__}: {error}")


def _failed(job: TrialJob, why: str) -> dict[str, Any]:
    return job.row | {"error": " ".join(why.split())}


def is_finished(job: TrialJob, rows: Rows) -> bool:
    """Whether a job was done without error and its recording is whole; a failed job is done again."""
    row = rows.get(job.inputs_sha256)
    done = row is not None and row.get("error") is None
    return done and (job.recording is None or job.recording.is_whole)
