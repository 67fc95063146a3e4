"""Days that the command line describes: the table, what is not driven again, what a kill leaves, what is printed."""

from __future__ import annotations

import csv
import json
import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from precompute.workers import Made, Workers
from sim.drivers.kinds import DriverKind, Presentation
from sim.experiment import trials
from sim.experiment.one_line import DaysAsked, parse_participants, parse_seeds
from sim.experiment.runner import TrialJob, attempted
from sim.experiment.trials import jobs_of, make_trial
from sim.world import loop
from tests.support.flat_days import FLAT
from tests.support.making import das_sim, refusal, started, wait_until

LATE = "[[disturbances]]\nkind = 'departure-delay'\nstop = 'A'\ndelay_s = {min = 0, max = 20}\n"
SHOWN = Presentation.SPEED_AND_EFFORT
STUCK = "[[disturbances]]\nkind = 'signal-stop'\nat_km = 3\nseen_m = 1500\nclears_after_s = 86_400\n"
RUN = ("experiment", "run", "--scenario")
ASKED = ("late.toml", "--seeds", "0-1", "--driver", "perfect", "--advice", "speed-and-effort,none")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("days")
    for name, text in (
        ("late", FLAT + LATE),
        ("stuck", FLAT + STUCK),
        ("broken", FLAT.replace("re460-ic", "train.toml")),
    ):
        (folder / f"{name}.toml").write_text(text.replace('"flat"', f'"{name}"'))
    (folder / "train.toml").write_text("losses = [")
    return folder


def made(*arguments: str, cwd: Path) -> dict[str, Any]:
    """The JSON object of days that ended well."""
    done = das_sim(*RUN, *arguments, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class First:
    """The first days of all, as printed and as written."""

    found: dict[str, Any]
    table: list[dict[str, str]]
    content: bytes


@pytest.fixture(scope="module")
def first(folder: Path) -> First:
    found = made(*ASKED, "-o", "a", "--workers", "2", cwd=folder)
    return First(found, rows(folder / "a"), (folder / "a" / "trials.csv").read_bytes())


@pytest.mark.slow
def test_the_table_has_a_row_for_every_run(first: First) -> None:
    assert (first.found["trials"], first.found["made"], first.found["failed"]) == (4, 4, [])
    keys = [(row["scenario"], row["driver"], row["presentation"], row["seed"]) for row in first.table]
    assert keys == [
        ("late", "perfect", shown, str(seed)) for seed in range(2) for shown in ("speed-and-effort", "none")
    ]
    for row in first.table:
        parts = ("component_loss", "resistance", "friction_brake", "unreturned", "potential")
        assert float(row["energy_kwh"]) == pytest.approx(sum(float(row[f"{name}_kwh"]) for name in parts), rel=1e-6)
    for group in first.found["groups"]:
        mean = np.mean([float(row["energy_kwh"]) for row in first.table if row["presentation"] == group["advice"]])
        assert group["energy_kwh"] == pytest.approx(mean)
        assert (group["runs"], group["failed"], group["error"]) == (2, 0, None)


@pytest.mark.slow
def test_a_run_that_fails_has_its_error(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "LONGEST_S", 60.0)
    monkeypatch.setattr(loop, "LONGEST_RATIO", 1.0)
    row = attempted(make_trial, jobs(folder, scenarios=[str(folder / "stuck.toml")])[0])
    assert row["error"].startswith("the simulated train did not arrive within")


@pytest.mark.slow
def test_finished_runs_are_not_made_again_unless_an_input_changed(
    folder: Path, first: First, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process: `first` has been made by workers."""
    monkeypatch.setattr(Workers, "made", lambda _, make, jobs, **__: (Made(job=job, result=make(job)) for job in jobs))
    scenario = folder / "late.toml"
    assert made(*ASKED, "-o", "a", "--workers", "1", cwd=folder)["made"] == 0
    assert (folder / "a" / "trials.csv").read_bytes() == first.content
    more = ["late.toml", "--seeds", "1-2", "--driver", "perfect", "--advice", SHOWN, "-o", "a"]
    assert made(*more, cwd=folder)["made"] == 1
    assert [row["seed"] for row in rows(folder / "a")] == ["1", "2"]
    text = scenario.read_text()
    try:
        scenario.write_text(text.replace("buffer_percent = 10", "buffer_percent = 20"))
        trials._files_here.cache_clear()  # each worker would be a new process
        assert made(*more, cwd=folder)["made"] == 2
    finally:
        scenario.write_text(text)
        trials._files_here.cache_clear()


def finished(folder: Path) -> int:
    path = folder / "finished.jsonl"
    return len(path.read_bytes().splitlines()) if path.exists() else 0


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_days_that_were_stopped_go_on_where_they_were(folder: Path, first: First, number: int) -> None:
    name = f"stopped-{number}"
    asked = [
        "late.toml",
        "--seeds",
        "0-39",
        "--driver",
        "perfect",
        "--advice",
        "speed-and-effort",
        "--workers",
        "1",
        "-o",
        name,
    ]
    child = started("-m", "sim.cli", *RUN, *asked, cwd=folder)
    wait_until(lambda: finished(folder / name) >= 2)
    workers = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
    child.send_signal(number)
    _, said = child.communicate(timeout=60)
    assert "Traceback" not in said
    if number == signal.SIGINT:
        assert child.returncode == 130
        assert "of 40 trials are finished; the same command goes on from there" in said
        assert 2 <= len(rows(folder / name)) < 40
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 20.0)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]
    kept = finished(folder / name)
    asked[2] = f"0-{kept}"
    found = made(*asked, cwd=folder)
    assert found["made"] == found["trials"] - kept <= 2
    # What two workers made at once, and one in two goes, is the same to the last bit.
    theirs = {row["seed"]: row["energy_kwh"] for row in rows(folder / name)}
    ours = {row["seed"]: row["energy_kwh"] for row in first.table if row["presentation"] == "speed-and-effort"}
    assert theirs | ours == theirs


def jobs(folder: Path, **changes: Any) -> list[TrialJob]:
    asked: dict[str, Any] = {
        "scenarios": [str(folder / "late.toml")], "drivers": [DriverKind.HUMAN], "advice": [SHOWN],
        "seeds": [1, 2], **changes,
    }  # fmt: skip
    return jobs_of(DaysAsked(**asked).design(), folder)


def test_identity_of_a_run_is_everything_it_depends_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    same = [job.inputs_sha256 for job in jobs(folder)]
    assert same == [job.inputs_sha256 for job in jobs(folder)]
    assert same == [job.inputs_sha256 for job in jobs(folder, seeds=[0, 1, 2])][1:]
    others = [
        *jobs(folder, seeds=[3]),
        *jobs(folder, drivers=[DriverKind.FAST]),
        *jobs(folder, advice=[Presentation.NONE]),
        *jobs(folder, scenarios=[str(folder / "stuck.toml")]),
        *jobs(folder, participants=(1, 2)),
    ]
    monkeypatch.setattr(trials, "source_sha256", lambda: "another program")
    others += jobs(folder)
    assert not set(same) & {job.inputs_sha256 for job in others}
    with pytest.raises(DasError, match="late, late: two have the same id"):
        jobs(folder, scenarios=[str(folder / "late.toml")] * 2)


def test_a_driver_without_habits_is_driven_once_for_all_participants(folder: Path) -> None:
    both = jobs(folder, drivers=[DriverKind.HUMAN, DriverKind.PERFECT], participants=(1, 3), seeds=[1])
    assert len(both) == 6
    assert len({job.inputs_sha256 for job in both}) == 4


def test_seeds_and_participants() -> None:
    assert parse_seeds("0-3") == [0, 1, 2, 3]
    assert parse_seeds("7, 1,5-6,1") == [7, 1, 5, 6]
    for bad in ("", "a", "3-1", "1-", "-1", "0-9999999999", "0-9999999"):
        with pytest.raises(DasError, match="--seeds"):
            parse_seeds(bad)
    assert parse_participants("4-6") == (4, 3)
    with pytest.raises(DasError, match="--participants 1,3: expected one range"):
        parse_participants("1,3")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing", "-o", "x"], "nothing: not a bundled scenario"),
        (["late.toml", "-o", "x", "--driver", "human,nobody"], "--driver nobody: expected one of perfect"),
        (["late.toml", "-o", "x", "--driver", "external"], "cannot use an external driver"),
        (["late.toml", "-o", "x", "--advice", "all"], "--advice all: expected one of none"),
        (["late.toml", "-o", "late.toml"], "late.toml: is a file, expected a folder"),
        (["broken.toml", "-o", "x"], "train.toml: not valid TOML"),
        (["late.toml", "smoke", "-o", "x"], "--scenario late.toml: not together with a design (smoke)"),
        (["late.toml"], "--out"),
    ],
)
def test_bad_input_is_one_line(folder: Path, arguments: list[str], message: str) -> None:
    assert message in refusal(*RUN, *arguments, cwd=folder)
    assert not (folder / "x").exists()


def test_former_commands_name_what_to_run(folder: Path) -> None:
    assert "run instead: das-sim experiment run --scenario" in refusal("batch", "clear-day", "-o", "x", cwd=folder)
    assert "human_ factors" in refusal("sensitivity", "clear-day", cwd=folder)


@pytest.mark.slow
def test_the_table_printed_at_the_end(folder: Path, first: First) -> None:
    done = das_sim(*RUN, *ASKED, "-o", "a", cwd=folder)
    for text in (
        "4 runs, ",
        "simulated now",
        "late, perfect,",
        "speed-and-effort",
        "written: a/trials.csv",
        "saved by advice",
        "comfort",
    ):
        assert text in done.stdout
    assert "…" not in done.stdout


@pytest.mark.nightly
def test_ctrl_c_at_a_terminal_spares_workers_that_are_being_started(folder: Path) -> None:
    """It goes to all processes of the command; a worker must not die of it before it knows to ignore it."""
    asked = ["late.toml", "--seeds", "0-9", "--driver", "perfect", "--workers", "1", "-o", "started"]
    child = started("-m", "sim.cli", *RUN, *asked, cwd=folder, start_new_session=True)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    wait_until(lambda: any(_is_worker(pid) for pid in children.read_text().split()), 60.0)
    os.killpg(child.pid, signal.SIGINT)
    _, said = child.communicate(timeout=120)
    assert child.returncode == 130
    assert "Traceback" not in said
    assert "of 10 trials are finished" in said


def _is_worker(pid: str) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
