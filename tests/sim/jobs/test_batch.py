"""Batches of runs: the table, what is not run again, and what a kill leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.bus.recording import read_recording
from das.domain.errors import DasError
from das.domain.levels import Level
from docs.studies.reference import as_markdown
from precompute.pool import Made
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind, Presentation
from sim.jobs.batch import COLUMNS, Batch, BatchJob, make_run, parse_seeds, write_table
from sim.jobs.report import summary
from sim.jobs.runner import attempted
from sim.world import loop
from sim.world.outcome import SHARES
from tests.support.flat_days import FLAT
from tests.support.making import das_sim, refusal, wait_until

parquet = pytest.importorskip("pyarrow.parquet")

LATE = "[[disturbances]]\nkind = 'departure-delay'\nstop = 'A'\ndelay_s = {min = 0, max = 20}\n"
STUCK = "[[disturbances]]\nkind = 'signal-stop'\nat_km = 3\nseen_m = 1500\nclears_after_s = 86_400\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    for name, text in (
        ("late", FLAT + LATE),
        ("stuck", FLAT + STUCK),
        ("broken", FLAT.replace("re460-ic", "train.toml")),
    ):
        (folder / f"{name}.toml").write_text(text.replace('"flat"', f'"{name}"'))
    (folder / "train.toml").write_text("losses = [")
    return folder


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "sim.cli", "batch", *arguments]


def batch(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return das_sim("batch", *arguments, cwd=cwd)


def made(*arguments: str, cwd: Path) -> dict[str, Any]:
    """The JSON object of a batch that ended well."""
    done = batch(*arguments, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def rows(path: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    return found


ASKED = ("late.toml", "--seeds", "0-3", "--drivers", "perfect", "--advice", "speed-and-effort,none")


@dataclass(frozen=True)
class First:
    """The first batch of all, as printed and as written."""

    found: dict[str, Any]
    table: list[dict[str, Any]]
    content: bytes

    def row(self, advice: str, seed: int) -> dict[str, Any]:
        return next(row for row in self.table if (row["advice"], row["seed"]) == (advice, seed))


@pytest.fixture(scope="module")
def first(folder: Path) -> First:
    found = made(*ASKED, "-o", "a", "--workers", "2", cwd=folder)
    path = folder / "a" / "runs.parquet"
    return First(found, rows(path), path.read_bytes())


@pytest.mark.slow
def test_the_table_has_a_row_for_every_run(first: First) -> None:
    assert (first.found["runs"], first.found["made"]) == (8, 8)
    keys = [(row["scenario"], row["driver"], row["advice"], row["seed"]) for row in first.table]
    assert keys == [("late", "perfect", shown, seed) for shown in ("speed-and-effort", "none") for seed in range(4)]
    for row in first.table:
        assert row["error"] is None
        assert row["stops"] == ["A", "B"]
        assert row["stop_late_s"][-1] == row["late_s"]
        assert row["stop_arrived_s"][0] is None
        gone = sum(row[f"{name}_kwh"] for name in ("component_loss", "resistance", "friction_brake", "unreturned"))
        assert row["energy_kwh"] == pytest.approx(gone + row["potential_kwh"], rel=1e-6)
        assert all(len(row[f"{name}_sha256"]) == 64 for name in ("code", "scenario", "route", "vehicle", "inputs"))
        assert row["loss_map_sha256"] is None
        assert row["version"]
        assert row["drawn"] == first.row("speed-and-effort", row["seed"])["drawn"]  # by seed, whatever is shown
    assert len({row["drawn"] for row in first.table}) == 4
    for group in first.found["groups"]:
        mean = np.mean([row["energy_kwh"] for row in first.table if row["advice"] == group["advice"]])
        assert group["energy_kwh"] == pytest.approx(mean)
        assert (group["runs"], group["failed"], group["error"]) == (4, 0, None)


def test_every_column_is_documented() -> None:
    said = as_markdown("batch").replace("`_ratio`", ", ".join(f"`{name}_ratio`" for name in SHARES))
    assert [name for name in COLUMNS if f"`{name}`" not in said] == []


@pytest.mark.slow
def test_a_run_that_fails_is_a_row_with_its_error(folder: Path, first: First, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "LONGEST_S", 60.0)
    monkeypatch.setattr(loop, "LONGEST_RATIO", 1.0)
    failed = attempted(make_run, jobs(folder, scenarios=[str(folder / "stuck.toml")])[0]).row
    write_table(folder / "failed.parquet", [failed, first.table[0]])
    row, other = rows(folder / "failed.parquet")
    assert row["error"].startswith("the simulated train did not arrive within")
    assert row["energy_kwh"] is None
    assert row["stops"] is None
    assert other == first.table[0]
    groups = summary([failed, first.table[0]])
    assert [(group["failed"], group["error"]) for group in groups] == [(1, row["error"]), (0, None)]


@pytest.mark.slow
def test_finished_runs_are_not_made_again_unless_an_input_changed(
    folder: Path, first: First, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process: `first` has been made by workers."""
    monkeypatch.setattr(Workers, "made", lambda _, make, jobs, **__: (Made(job=job, result=make(job)) for job in jobs))
    table, scenario = folder / "a" / "runs.parquet", folder / "late.toml"
    assert made(*ASKED, "-o", "a", "--workers", "1", cwd=folder)["made"] == 0
    assert table.read_bytes() == first.content
    more = ["late.toml", "--seeds", "2-4", "--drivers", "perfect", "--advice", "speed-and-effort", "-o", "a"]
    assert made(*more, cwd=folder)["made"] == 1
    assert [row["seed"] for row in rows(table)] == [2, 3, 4]
    text = scenario.read_text()
    try:
        scenario.write_text(text.replace("buffer_percent = 10", "buffer_percent = 20"))
        assert made(*more, cwd=folder)["made"] == 3
    finally:
        scenario.write_text(text)
    assert min(row["stop_due_s"][1] for row in rows(table)) > first.table[0]["stop_due_s"][1]


def finished(folder: Path) -> int:
    path = folder / "finished.jsonl"
    return len(path.read_bytes().splitlines()) if path.exists() else 0


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_stopped_batch_goes_on_where_it_was(folder: Path, first: First, number: int) -> None:
    name = f"stopped-{number}"
    asked = [
        "late.toml",
        "--seeds",
        "0-39",
        "--drivers",
        "perfect",
        "--advice",
        "speed-and-effort",
        "--workers",
        "1",
        "-o",
        name,
    ]
    child = subprocess.Popen(command(*asked), cwd=folder, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: finished(folder / name) >= 2)
    workers = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
    child.send_signal(number)
    _, said = child.communicate(timeout=60)
    assert "Traceback" not in said
    if number == signal.SIGINT:
        assert child.returncode == 130
        assert "of 40 runs are finished; the same command goes on from there" in said
        assert 2 <= len(rows(folder / name / "runs.parquet")) < 40
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 20.0)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]
    kept = finished(folder / name)
    asked[2] = f"0-{max(kept, 3)}"
    found = made(*asked, cwd=folder)
    assert found["made"] == found["runs"] - kept <= 2
    # What two workers made at once, and one in two goes, is the same to the last bit.
    theirs = {row["seed"]: row for row in rows(folder / name / "runs.parquet")}
    assert all(theirs[seed] == first.row("speed-and-effort", seed) for seed in range(4))


@pytest.mark.nightly
def test_recordings_are_kept_and_the_figures_are_the_same(folder: Path, first: First) -> None:
    asked = ("late.toml", "--seeds", "1", "--drivers", "perfect", "--advice", "speed-and-effort", "--record", "-o", "b")
    assert made(*asked, cwd=folder)["made"] == 1
    (row,) = rows(folder / "b" / "runs.parquet")
    recording = read_recording(folder / row["recording"])
    assert recording.complete
    assert recording.metadata["run"]["seed"] == "1"
    assert {**row, "recording": None} == first.row("speed-and-effort", 1)
    assert made(*asked, cwd=folder)["made"] == 0
    path = folder / row["recording"]
    path.write_bytes(path.read_bytes()[:-100])
    job = replace(jobs(folder, seeds=[1], drivers=[DriverKind.PERFECT])[0], record=path)
    assert not recorded(job)  # cut off
    assert made(*asked, cwd=folder)["made"] == 1
    assert recorded(job)
    assert not recorded(replace(job, level=Level.L1))  # it is of other inputs


def recorded(job: BatchJob) -> bool:
    assert job.recording is not None
    return job.recording.is_whole


def jobs(folder: Path, **changes: Any) -> list[Any]:
    asked: dict[str, Any] = {
        "scenarios": [str(folder / "late.toml")], "drivers": [DriverKind.HUMAN],
        "advice": [Presentation.SPEED_AND_EFFORT],
        "seeds": [1, 2], "level": None, "record": False, "folder": folder, **changes,
    }  # fmt: skip
    return list(Batch(**asked).jobs())


def test_identity_of_a_run_is_everything_it_depends_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same = [job.inputs_sha256 for job in jobs(folder)]
    assert same == [job.inputs_sha256 for job in jobs(folder)]
    others = [
        *jobs(folder, seeds=[3]),
        *jobs(folder, drivers=[DriverKind.FAST]),
        *jobs(folder, advice=[Presentation.NONE]),
        *jobs(folder, scenarios=[str(folder / "stuck.toml")]),
        *jobs(folder, level="l1"),
    ]
    monkeypatch.setattr("sim.jobs.batch.source_sha256", lambda: "another program")
    others += jobs(folder)
    assert not set(same) & {job.inputs_sha256 for job in others}
    with pytest.raises(DasError, match="late, late: two have the same id"):
        jobs(folder, scenarios=[str(folder / "late.toml")] * 2)


def test_seeds() -> None:
    assert parse_seeds("0-3") == [0, 1, 2, 3]
    assert parse_seeds("7, 1,5-6,1") == [7, 1, 5, 6]
    for bad in ("", "a", "3-1", "1-", "-1", "0-9999999999", "0-9999999"):
        with pytest.raises(DasError, match="--seeds"):
            parse_seeds(bad)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing", "-o", "x"], "nothing: not a bundled scenario"),
        (["late.toml", "-o", "x", "--drivers", "human,nobody"], "--drivers nobody: expected one of perfect"),
        (["late.toml", "-o", "x", "--advice", "all"], "--advice all: expected one of none"),
        (["late.toml", "-o", "late.toml"], "late.toml: is a file, expected a folder"),
        (["broken.toml", "-o", "x"], "train.toml: not valid TOML"),
        (["late.toml", "-o", "x", "--level", "own"], "no data for level own"),
        (["late.toml"], "--out"),
    ],
)
def test_bad_input_of_batch_is_one_line(folder: Path, arguments: list[str], message: str) -> None:
    assert message in refusal("batch", *arguments, cwd=folder)
    assert not (folder / "x").exists()


@pytest.mark.slow
def test_the_table_printed_at_the_end(folder: Path, first: First) -> None:
    done = batch(*ASKED, "-o", "a", cwd=folder)
    for text in ("8 runs, 0 of them made now", "late, perfect, speed-and-effort", "written: a/runs.parquet", "comfort"):
        assert text in done.stdout
    assert "…" not in done.stdout


@pytest.mark.nightly
def test_ctrl_c_at_a_terminal_spares_workers_that_are_being_started(folder: Path) -> None:
    """It goes to all processes of the command; a worker must not die of it before it knows to ignore it."""
    asked = ["late.toml", "--seeds", "0-9", "--drivers", "perfect", "--workers", "1", "-o", "started"]
    child = subprocess.Popen(command(*asked), cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    wait_until(lambda: any(_is_worker(pid) for pid in children.read_text().split()), 60.0)
    os.killpg(child.pid, signal.SIGINT)
    _, said = child.communicate(timeout=120)
    assert child.returncode == 130
    assert "Traceback" not in said
    assert "of 10 runs are finished" in said


def _is_worker(pid: str) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
