"""The runner of many jobs: what a worker's death costs, what is made again, and that workers change nothing."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from das.command_line.process import STOP_SIGNALS
from das.domain.errors import DasError
from precompute.workers import Workers
from sim.experiment import runner
from sim.experiment.driving import JobRecording
from sim.experiment.runner import JobWords, Journal, Runner

WORDS = JobWords("test", "jobs", "make")


@dataclass(frozen=True)
class NumberJob:
    """A job that squares its number; its worker dies so many times before."""

    number: int
    folder: Path
    deaths: int = 0
    recording: JobRecording | None = None

    @property
    def inputs_sha256(self) -> str:
        return f"hash of {self.number}"

    @property
    def row(self) -> dict[str, Any]:
        return {"inputs_sha256": self.inputs_sha256, "number": self.number}


def squared(job: NumberJob) -> dict[str, Any]:
    """The square of a job's number; odd faults for numbers 5 and 6."""
    deaths = job.folder / f"deaths-{job.number}"
    before = len(deaths.read_text()) if deaths.exists() else 0
    if before < job.deaths:
        deaths.write_text("x" * (before + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    if job.number == 5:
        raise DasError("five is\nrefused")
    if job.number == 6:
        raise ZeroDivisionError("of all things")
    return {"square": job.number**2}


def ran(folder: Path, jobs: list[NumberJob], workers: Workers) -> tuple[int, list[Mapping[str, Any]]]:
    """How many jobs were made, and their rows in the order of the jobs."""
    found: list[Mapping[str, Any]] = []

    def write(rows: Mapping[str, Mapping[str, Any]], _made: int) -> None:
        found.extend(rows[job.inputs_sha256] for job in jobs if job.inputs_sha256 in rows)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "warm_up", tuple)  # squares need no kernel of the advice
        made = Runner(make=squared, folder=folder, workers=workers, words=WORDS).run(jobs, write)
    return made, found


@pytest.mark.slow
def test_a_worker_that_dies_costs_only_its_own_job(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Once it is made again; a job that kills every worker is given up, and all others come to what they should."""
    deaths = {2: 1, 3: 99}
    jobs = [NumberJob(number, tmp_path, deaths.get(number, 0)) for number in range(8)]
    made, rows = ran(tmp_path, jobs, Workers(count=2))
    assert made == 8
    assert [row.get("square") for row in rows] == [0, 1, 4, None, 16, None, None, 49]
    assert [row["error"] for row in rows if "error" in row] == [
        "its worker died 3 times, last by SIGKILL",
        "five is\\nrefused",
        "ZeroDivisionError: of all things",
    ]
    assert "test: 8 of 8 jobs to make" in capfd.readouterr().err
    # The same with one worker and another order; what failed is tried again.
    healed = [NumberJob(job.number, tmp_path) for job in reversed(jobs)]
    made, again = ran(tmp_path, healed, Workers(count=1))
    assert made == 3
    assert [row.get("square") for row in again] == [49, None, None, 16, 9, 4, 1, 0]


def test_a_run_from_python_leaves_the_handlers_of_signals_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A notebook kept the runner's handlers before, and Ctrl-C in it did something else."""
    before = [signal.getsignal(number) for number in STOP_SIGNALS]
    during: list[object] = []
    monkeypatch.setattr(Runner, "_make", lambda *_: during.extend(signal.getsignal(number) for number in STOP_SIGNALS))
    ran(tmp_path, [NumberJob(1, tmp_path)], Workers(count=1))
    assert len(during) == len(before)
    assert not set(during) & set(before)
    assert [signal.getsignal(number) for number in STOP_SIGNALS] == before


def test_a_folder_in_use_is_refused_in_one_line(tmp_path: Path) -> None:
    with Journal(tmp_path), pytest.raises(DasError, match="another test is at work here"):
        ran(tmp_path, [NumberJob(1, tmp_path)], Workers(count=1))


def test_a_line_cut_off_by_a_kill_is_dropped(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.add({"inputs_sha256": "a", "late_s": 1.0})
        journal.add({"inputs_sha256": "b", "late_s": 2.0})
    path = tmp_path / "finished.jsonl"
    path.write_bytes(path.read_bytes()[:-9])
    with Journal(tmp_path) as journal:
        assert list(journal.rows) == ["a"]
        journal.add({"inputs_sha256": "c", "late_s": 3.0})
    with Journal(tmp_path) as journal:
        assert [row["late_s"] for row in journal.rows.values()] == [1.0, 3.0]


def test_an_altered_line_is_no_result(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        for name in "abc":
            journal.add({"inputs_sha256": name, "late_s": 1.0})
    path = tmp_path / "finished.jsonl"
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([lines[0].replace(b"1.0", b"9.0"), b"\xff{}", b"[1]", lines[2]]))
    with Journal(tmp_path) as journal:
        assert journal.rows == {"c": {"inputs_sha256": "c", "late_s": 1.0}}
    assert path.read_bytes() == lines[2] + b"\n"
