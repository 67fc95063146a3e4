"""Worth studies that are driven: the five steps of driven trials, a second run, and own scenarios."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.experiment import driving
from sim.experiment.trials import jobs_of, make_trial
from sim.experiment.worth.findings import findings
from sim.experiment.worth.study import load_worth
from tests.sim.experiment.worth.support import DESIGN, own_steps
from tests.support.making import das_sim, das_sim_json, refusal

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worth")
    (folder / "short.toml").write_text(DESIGN.replace("drivers = 4", "drivers = 3"))
    return folder


@pytest.fixture(scope="module")
def driven(place: Path) -> Path:
    """The folder of a whole run with three drivers."""
    das_sim_json("worth", "short.toml", "-o", "whole", "--workers", "1", cwd=place)
    return place / "whole"


def test_driven_trials_give_the_steps_of_an_own_analysis(place: Path, driven: Path) -> None:
    worth = load_worth(str(place / "short.toml"))
    steps = findings(worth, driven).steps
    for own, step in zip(own_steps(driven, worth.values), steps, strict=True):
        assert step.saved_kwh == pytest.approx(own["saved_kwh"], rel=1e-9)
        assert step.interval_kwh == pytest.approx(own["interval_kwh"], rel=1e-9, abs=1e-9)
    optimum, obedient, _, _, in_time = (step.saved_kwh for step in steps)
    assert optimum > obedient > 0
    assert obedient > in_time
    assert steps[0].before["late_s"] < 0


def test_a_second_run_drives_nothing_and_new_prices_are_read(place: Path, driven: Path) -> None:
    before = (driven / "trials.csv").read_bytes()
    text = (place / "short.toml").read_text().replace("value = 0.2", "value = 0.3").replace("Six flat", "6 flat")
    (place / "dear.toml").write_text(text)
    told = das_sim_json("worth", "dear.toml", "-o", "whole", cwd=place)
    assert told["inputs"]["price_eur_per_kwh"]["value"] == 0.3
    assert (driven / "trials.csv").read_bytes() == before
    assert (driven / "finished.jsonl").read_text().count("\n") == 3 * 8
    assert (driven / "design.toml").read_text() == text


def test_another_study_is_refused_in_the_folder(place: Path, driven: Path) -> None:
    said = refusal("worth", "short.toml", "--drivers", "5", "-o", "whole", cwd=place)
    assert "holds the frozen design" in said
    assert driven.is_dir()


@pytest.mark.nightly
def test_a_folder_is_a_study_that_can_be_analysed(place: Path, driven: Path) -> None:
    done = das_sim("experiment", "analyse", driven.name, "-o", "page.html", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "No comparison was planned" in done.stdout


@pytest.mark.nightly
def test_a_newcomers_own_line_gives_an_answer(tmp_path: Path) -> None:
    """The example files, as the page says: late departures and a restriction are part of the scenario."""
    assert das_sim("example", "my-line", cwd=tmp_path).returncode == 0
    done = das_sim("worth", "my-line/fleet.toml", "--drivers", "3", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "worth-my-fleet" / "worth.md").is_file()
    assert "1 optimum" in done.stdout


@pytest.mark.nightly
def test_fronts_kept_from_trial_to_trial_change_no_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of one process, against trials for each of which the line is solved again; to the last digit."""
    text = DESIGN.replace("receptivity_ratio = {value = 1.0, low = 1.0", "receptivity_ratio = {value = 0.8, low = 0.8")
    (tmp_path / "short.toml").write_text(text)
    jobs = jobs_of(load_worth(str(tmp_path / "short.toml")).study, tmp_path)
    some = [job for job in jobs if job.trial.levels[0] in ("today-guided", "receptivity_ratio-high", "all-out")][:5]
    kept = [make_trial(job) for job in some]
    for job, made in zip(some, kept, strict=True):
        monkeypatch.setattr(driving, "_services", [])
        assert make_trial(job) == made
