"""Runs of an experiment: the table, what a kill leaves, failed trials, the data folder, and a cluster."""

from __future__ import annotations

import csv
import io
import os
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from das.bus.recording import read_recording
from precompute.workers import Workers
from sim.drivers.screen import ScreenSettings, screen_metadata
from sim.experiment.design import Design, read_design
from sim.experiment.runner import Journal, TrialJob, attempted
from sim.experiment.study_files import FAILED_TABLE, README, TRIALS_TABLE, column_meanings
from sim.experiment.trials import jobs_of, make_trial, run_study
from tests.support.dask_cluster import running_cluster
from tests.support.making import REPOSITORY, das_sim, das_sim_json, refusal
from tests.support.needs import need_r

pytestmark = pytest.mark.slow

pandas = pytest.importorskip("pandas")

DESIGN = """
schema_version = 1
experiment = {name = "small", title = "A small study", seed = 4}
participants = {count = 2, learning = true}
procedure = {practice_trials = 1, break_after = 2}
fixed = {scenario = "flat-6km", hold_s = 5, preview_s = 600}
factors = [{name = "presentation", levels = ["none", "speed-and-effort"]}]
analysis.measures = ["gap_to_optimum_ratio", "speed_rmse_mps", "power_brake_reversals"]
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("experiment")
    (folder / "small.toml").write_text(DESIGN)
    idle = DESIGN.replace('"presentation"', '"reason"').replace('["none", "speed-and-effort"]', "[true, false]")
    (folder / "idle.toml").write_text(idle)
    return folder


@pytest.fixture(scope="module")
def study(place: Path) -> Path:
    """The folder of a whole run."""
    told = das_sim_json("experiment", "run", "small.toml", "-o", "whole", "--workers", "1", cwd=place)
    assert told == {"folder": "whole", "trials": 6, "made": 6, "failed": []}
    return place / "whole"


def designed(place: Path) -> Design:
    return read_design(place / "small.toml")


def test_the_table_has_a_row_for_every_trial(study: Path) -> None:
    table = pandas.read_csv(study / TRIALS_TABLE)
    assert list(table.columns) == [
        *("trial", "participant", "session", "position", "practice", "braked", "condition", "presentation", "seed"),
        *("gap_to_optimum_ratio", "speed_rmse_mps", "power_brake_reversals"),
    ]
    assert list(table.trial) == [1, 2, 3, 4, 5, 6]
    assert list(table.participant) == ["sub-01"] * 3 + ["sub-02"] * 3
    assert list(table.position) == [1, 2, 3] * 2
    assert list(table.session) == ["ses-01", "ses-01", "ses-02"] * 2
    assert list(table.practice) == [1, 0, 0] * 2
    assert list(table.presentation[table.practice == 1]) == ["speed-and-effort"] * 2
    assert not table.braked.any()
    assert table.gap_to_optimum_ratio.between(0.0, 2.0).all()
    assert list(table.speed_rmse_mps.isna()) == list(table.presentation == "none")


def test_what_is_finished_is_not_driven_again_and_the_bytes_are_the_same(place: Path, study: Path) -> None:
    before = (study / TRIALS_TABLE).read_bytes()
    (study / TRIALS_TABLE).unlink()
    told = das_sim_json("experiment", "run", "small.toml", "-o", "whole", cwd=place)
    assert told["made"] == 0
    assert (study / TRIALS_TABLE).read_bytes() == before


def test_the_folder_has_the_table_the_design_and_a_readme(place: Path, study: Path) -> None:
    kept = {path.name for path in study.iterdir() if not path.name.startswith(".")}
    assert kept == {TRIALS_TABLE, "design.toml", "design.json", README, "finished.jsonl"}
    assert (study / "design.toml").read_text() == DESIGN
    readme = (study / README).read_text(encoding="utf-8")
    assert readme.startswith("A small study\n")
    with (study / TRIALS_TABLE).open(newline="", encoding="utf-8") as file:
        columns = next(csv.reader(file))
    assert list(column_meanings(designed(place))) == columns
    assert all(f"\n{name}: " in readme for name in (*columns, "command", "version", "begun (UTC)"))


@pytest.mark.nightly
def test_the_table_opens_in_one_line_of_r(study: Path) -> None:
    """The line is that of the page."""
    need_r()
    page = (REPOSITORY / "docs" / "how-to" / "run-an-experiment.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```r\n(.*?)```", page, re.DOTALL)
    done = subprocess.run(
        ["Rscript", "--vanilla", "-e", code.replace("study/", f"{study.name}/") + "cat(dim(trials), names(trials))"],
        cwd=study.parent, capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    table = pandas.read_csv(study / TRIALS_TABLE)
    assert done.stdout.split() == [*map(str, table.shape), *table.columns]


@pytest.mark.nightly
def test_failed_trials_are_listed_and_driven_again(place: Path, study: Path, tmp_path: Path) -> None:
    design = designed(place)
    jobs = jobs_of(design, tmp_path)
    lost = replace(jobs[1], population="martians")
    assert lost.inputs_sha256 == jobs[1].inputs_sha256
    with Journal(tmp_path) as journal:
        for job in jobs[:1]:
            journal.add(attempted(make_trial, job))
        journal.add(attempted(make_trial, lost))
        assert "martians: not a bundled population" in journal.rows[lost.inputs_sha256]["error"]
    found = run_study(design, [jobs[0], lost], tmp_path, Workers(count=1))
    assert (found.trials, found.made, len(found.failed)) == (2, 1, 1)
    listed = list(csv.DictReader(io.StringIO((tmp_path / FAILED_TABLE).read_text())))
    assert [(row["trial"], row["participant"], row["condition"]) for row in listed] == [
        ("2", "sub-01", lost.trial.condition)
    ]
    assert (tmp_path / TRIALS_TABLE).read_text().count("\n") == 2
    again = run_study(design, jobs[:2], tmp_path, Workers(count=1))
    assert (again.made, again.failed) == (1, ())
    assert not (tmp_path / FAILED_TABLE).exists()
    whole = (study / TRIALS_TABLE).read_text().splitlines()
    assert (tmp_path / TRIALS_TABLE).read_text().splitlines() == whole[:3]
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.nightly
def test_a_cluster_drives_the_same(place: Path, study: Path, tmp_path: Path) -> None:
    with running_cluster(tmp_path, 1) as address:
        done = das_sim(
            "experiment", "run", "small.toml", "-o", "far", "--scheduler", address, "--json", cwd=place
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (place / "far" / TRIALS_TABLE).read_bytes() == (study / TRIALS_TABLE).read_bytes()


@pytest.mark.nightly
def test_recordings_are_kept_and_the_measures_are_the_same(place: Path, study: Path, tmp_path: Path) -> None:
    jobs = jobs_of(designed(place), tmp_path, record=True)
    some: list[TrialJob] = [job for job in jobs if job.trial.levels == ("speed-and-effort",)][:1]
    found = run_study(designed(place), some, tmp_path, Workers(count=1))
    assert found.failed == ()
    (path,) = tmp_path.rglob("*.mcap")
    recording = read_recording(path)
    assert recording.complete
    shown = {name: text for name, text in recording.metadata["run"].items() if name.startswith("screen_")}
    assert shown == screen_metadata(ScreenSettings(hold_s=5.0, preview_s=600.0))
    whole = {row["trial"]: row for row in csv.DictReader(io.StringIO((study / TRIALS_TABLE).read_text()))}
    (own,) = csv.DictReader(io.StringIO((tmp_path / TRIALS_TABLE).read_text()))
    assert own == whole[own["trial"]]  # to the last bit: the node on the bus is the same cab
    assert run_study(designed(place), some, tmp_path, Workers(count=1)).made == 0
    path.write_bytes(path.read_bytes()[:-100])  # cut off
    assert run_study(designed(place), some, tmp_path, Workers(count=1)).made == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "idle.toml", "-o", "x"), "factor reason: human drivers ignore reasons"),
        (("run", "nonsense", "-o", "x"), "nonsense: not a bundled study (level-through-a-driver, pacing"),
        (("run", "smoke", "-o", "small.toml"), "small.toml: is a file, expected a folder"),
        (("run", "smoke", "-o", "x", "--workers", "2", "--scheduler", "tcp://a:1"), "either --workers or --scheduler"),
        (("run", "smoke", "-o", "x", "--recordings", "--scheduler", "tcp://a:1"), "not together with --scheduler"),
        (("check", "nonsense.toml"), "nonsense.toml: no such file"),
    ],
)
def test_nonsense_on_the_command_line(place: Path, words: tuple[str, ...], said: str) -> None:
    assert said in refusal("experiment", *words, cwd=place)
    assert not (place / "x").exists()
