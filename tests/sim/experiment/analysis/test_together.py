"""Two studies of one design together: their drivers are compared, and designs that differ elsewhere are refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError, InputError
from sim.experiment.analysis.comparing import RunStudy, group_estimate, paired_trials, student
from sim.experiment.analysis.page import as_dict, group_row, group_words, hangs_on, page
from sim.experiment.analysis.together import analyse_both, joined, read_both
from tests.support.made_up_study import APART, MEASURE, Truth, made_up_study, write_study
from tests.support.making import das_sim, das_sim_json, refusal

ALL = "All trials"
ALIKE = Truth(drivers=10, days=2, means=(0.25, 0.24), noise=(0.01, 0.01), day_sd=0.0)
HIGHER = replace(ALIKE, means=(0.33, 0.32), drivers=14)


def named(study: RunStudy, name: str, folder: str) -> RunStudy:
    return replace(study, folder=Path(folder), design=replace(study.design, name=name, comparisons=(APART,)))


def one_and_other(first: Truth, second: Truth, seed: int = 1) -> tuple[RunStudy, RunStudy]:
    """Two studies of one design in memory."""
    studies = (made_up_study(first, 2 * seed), made_up_study(second, 2 * seed + 1))
    return named(studies[0], "first", "a"), named(studies[1], "second", "b")


def written(folder: Path, first: Truth = ALIKE, second: Truth = HIGHER) -> tuple[Path, Path]:
    one, other = one_and_other(first, second)
    return write_study(one, folder / "one"), write_study(other, folder / "other")


def changed(folder: Path, change: dict[str, Any]) -> Path:
    """A study's folder whose frozen design has other values of some tables."""
    path = folder / "design.json"
    design = json.loads(path.read_text())
    for key, value in change.items():
        design[key] = {**design[key], **value} if isinstance(value, dict) and key in design else value
    path.write_text(json.dumps(design))
    return folder


def test_a_planted_difference_of_the_drivers_is_found() -> None:
    """Means of 0.245 and 0.325: the interval holds −8 points, and it is that of Welch's t of the drivers' means."""
    one, other = one_and_other(ALIKE, HIGHER)
    found = analyse_both(joined(one, other))
    (row,) = found.tables[ALL]
    low, high = row.estimate.interval
    assert low < -0.08 < high < 0
    assert row.corrected < 0.001
    means = [
        np.array([study.trials.values[MEASURE][study.trials.participant == who].mean() for who in
                  np.unique(study.trials.participant)])
        for study in (one, other)
    ]  # fmt: skip
    assert row.estimate == group_estimate(*means)
    texts = group_row(row)
    low, high = student(means[0])
    assert low < 0.245 < high
    assert texts[1] == f"{means[0].mean():.2%} ({low:.2%} to {high:.2%})".replace("%", "")
    inside = (means[1] >= means[0].min()) & (means[1] <= means[0].max())
    assert texts[7] == f"{inside.sum()} of 14 ({14 * 9 / 11:.1f})"


def test_alike_drivers_are_called_different_as_often_as_stated() -> None:
    """Of 200 pairs of studies of the same drivers 5 % are expected, with a standard error of 1.5 %."""
    wrong = []
    for seed in range(200):
        pair = one_and_other(ALIKE, replace(ALIKE, drivers=14), seed)
        both = joined(*(replace(one, design=replace(one.design, comparisons=())) for one in pair))
        wrong.append(analyse_both(both).tables[ALL][0].corrected < 0.05)
    assert 0.01 <= np.mean(wrong) <= 0.095


def test_each_condition_is_compared_and_each_effect() -> None:
    """The effect of the condition is −1 point in the first study and −6 in the second."""
    one, other = one_and_other(ALIKE, replace(HIGHER, means=(0.33, 0.27)))
    found = analyse_both(joined(one, other))
    assert [row.comparison.where for row in found.tables["By condition"]] == [
        {"presentation": "none"}, {"presentation": "top-speed"},
    ]  # fmt: skip
    apart = [row.estimate.mean for row in found.tables["By condition"]]
    assert apart == pytest.approx([-0.08, -0.03], abs=0.035)
    (effect,) = found.tables["Effects of the planned comparisons on the drivers"]
    own = [paired_trials(study, APART).means for study in (one, other)]
    assert effect.estimate == group_estimate(*own)
    assert effect.estimate.mean == pytest.approx(0.05, abs=0.02)


def test_the_planned_comparisons_are_made_in_each_study_as_alone() -> None:
    one, other = one_and_other(ALIKE, HIGHER)
    found = analyse_both(joined(one, other)).findings
    means = [one.estimate.mean for one in found.differences]
    assert means == pytest.approx([paired_trials(study, APART).means.mean() for study in (one, other)])
    assert [one.comparison.where["driver"] for one in found.differences] == ["first", "second"]
    assert found.study.planned.total() == one.design.planned.total() + other.design.planned.total()
    assert found.study.missing.total() == 0


def test_missing_trials_are_named_with_their_study() -> None:
    one, other = one_and_other(ALIKE, HIGHER)
    kept = np.arange(len(other.trials)) > 0
    trials = other.trials
    fewer = replace(
        trials, participant=trials.participant[kept], position=trials.position[kept], practice=trials.practice[kept],
        day=trials.day[kept], levels={name: level[kept] for name, level in trials.levels.items()},
        values={name: value[kept] for name, value in trials.values.items()},
    )  # fmt: skip
    said = " ".join(hangs_on(analyse_both(joined(one, replace(other, trials=fewer))).findings))
    assert "1 of the 96 planned trials are missing (second sub-01: second none)" in said


def test_people_and_simulated_drivers_are_the_levels_where_people_drove(tmp_path: Path) -> None:
    one, other = written(tmp_path)
    changed(other, {"fixed": {"scenario": "clear-day", "driver": "desk"}, "experiment": {"name": "first"}})
    both = read_both(other, one)
    assert tuple(both.parts) == ("people", "simulated")
    said = hangs_on(analyse_both(both).findings)
    assert said[0].startswith("14 people made 56 trials at the desk")
    assert said[1].startswith("10 simulated drivers from the population “default” made 40 trials")
    assert tuple(read_both(one, other).parts) == ("simulated", "people")


def test_a_folder_of_people_makes_a_study_one_of_people(tmp_path: Path) -> None:
    one, other = written(tmp_path)
    (one / "people").mkdir()
    assert tuple(read_both(one, other).parts) == ("people", "simulated")


def test_a_measure_that_one_study_lacks_is_named() -> None:
    one, other = one_and_other(ALIKE, HIGHER)
    empty = {MEASURE: np.full(len(other.trials), np.nan)}
    found = analyse_both(joined(one, replace(other, trials=replace(other.trials, values=empty))))
    assert (found.tables[ALL], found.without) == ((), (MEASURE,))
    assert "Not compared" in page(found.findings, found)


def test_the_page_has_the_comparison_of_the_drivers(tmp_path: Path) -> None:
    one, other = written(tmp_path)
    path = tmp_path / "both.html"
    said = das_sim("experiment", "analyse", str(one), "--with", str(other), "-o", str(path), cwd=tmp_path).stdout
    html = re.sub(r"<[^>]+>|\s+", " ", path.read_text(encoding="utf-8"))
    found = analyse_both(read_both(one, other))
    words = group_words(found.tables[ALL][0], found.levels)
    assert re.sub(r"\s+", "", words) in re.sub(r"\s+", "", said)
    for part in ("First and second drivers", "Gap to the optimum", "By condition", "Effects of the planned"):
        assert part in html
    assert re.search(r"Gap to the optimum \(%; points\) +\d\d\.\d+ \(\d\d\.\d+ to \d\d\.\d+\)", html)
    alone = das_sim_json("experiment", "analyse", str(one), cwd=tmp_path)
    both = das_sim_json("experiment", "analyse", str(one), "--with", str(other), cwd=tmp_path)
    assert "together" not in alone
    assert both["together"]["tables"][ALL][0]["mean"] == pytest.approx(found.tables[ALL][0].estimate.mean)
    assert json.dumps(as_dict(found.findings, found), allow_nan=False)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"experiment": {"seed": 2}}, "experiment.seed = 2: expected 1, as in "),
        ({"procedure": {"repetitions": 3}}, "procedure.repetitions = 3: expected 2, as in "),
        ({"fixed": {"scenario": "signal-stop"}}, "fixed.scenario = 'signal-stop': expected 'clear-day', as in "),
        ({"fixed": {"hold_s": 5}}, "fixed.hold_s = 5: expected no such key, as in "),
        ({"comparisons": []}, "comparisons.0.name is missing: expected 'top-speed against none', as in "),
        ({"files": {"day: route": "b"}}, "files.day: route = 'b': expected 'a', as in "),
    ],
)
def test_designs_that_differ_elsewhere_are_refused_by_the_first_key(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    one, other = written(tmp_path)
    for folder in (one, other):
        changed(folder, {"files": {"day: route": "a", "population": str(folder)}})
    with pytest.raises(InputError, match=re.escape(said)):
        read_both(one, changed(other, change))
    assert said in refusal("experiment", "analyse", str(one), "--with", str(other), cwd=tmp_path)


def test_a_study_is_not_compared_with_itself(tmp_path: Path) -> None:
    first, _ = written(tmp_path)
    with pytest.raises(DasError, match="itself, expected another study"):
        read_both(first, first / ".." / first.name)


def test_participants_driver_and_desk_may_differ(tmp_path: Path) -> None:
    one, other = written(tmp_path)
    changed(one, {"files": {"population": "a", "desk: consent.md": "b"}, "participants": {"population": "other"}})
    changed(other, {"files": {"population": "c"}, "fixed": {"scenario": "clear-day", "driver": "fast"}})
    assert tuple(read_both(one, other).parts) == ("first", "second")


def test_a_design_with_the_factor_driver_is_refused(tmp_path: Path) -> None:
    one, other = one_and_other(ALIKE, HIGHER)
    factors = (replace(one.design.factors[0], name="driver"),)
    with pytest.raises(InputError, match="a design without the factor driver"):
        joined(replace(one, design=replace(one.design, factors=factors)), other)
