"""The page of an analysis says first what the answer hangs on, holds everything itself, and says what is missing."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sim.experiment.analysis.comparing import StudyFindings, analyse_study
from sim.experiment.analysis.page import as_dict, page
from sim.experiment.analysis.reading import RunStudy
from sim.experiment.analysis.words import hangs_on, in_short
from tests.support.made_up_study import MEASURE, Truth, compared, made_up_study, write_study
from tests.support.making import das_sim

COMPARISONS = (compared("vector", "none"), compared("vector", "top-speed"))


@cache
def found() -> StudyFindings:
    return analyse_study(made_up_study(Truth(drivers=12), 1, COMPARISONS), (0.78,))


@cache
def html() -> str:
    return page(found())


def analysed(study: RunStudy) -> StudyFindings:
    return analyse_study(study, resamples=999)


def test_the_page_needs_nothing_besides_itself() -> None:
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", html())
    assert not re.findall(r"url\(|@import|<script|http://|https://", html())
    assert html().count("<figure>") == 4  # the differences, two comparisons, the conditions


def test_what_the_answer_hangs_on_comes_before_every_figure() -> None:
    said = html()
    assert said.index("Nobody drove. 12 simulated drivers") < said.index("points lower")
    assert said.index("are assumptions") < said.index("interval is")
    people = replace(found(), study=replace(found().study, plan=replace(found().study.plan, simulated=False)))
    assert hangs_on(people) == [
        "12 people drove 108 trials. What they did holds for people like them, on this line and train."
    ]


def test_the_page_has_intervals_model_checks_and_design() -> None:
    for part in (
        "second opinion",
        "How many participants",
        "The conditions",
        "missing trials",
        "0" * 64,
        "corrected p",
    ):
        assert part in html()
    for term in ("Paired difference", "Resampled drivers", "Mixed model"):
        assert f">{term}</th>" in html()


def test_the_same_study_gives_the_same_page() -> None:
    assert page(analyse_study(made_up_study(Truth(drivers=12), 1, COMPARISONS), (0.78,))) == html()


def test_a_verdict_has_size_interval_and_chance() -> None:
    (name, said), _ = in_short(found())
    assert name == "vector against none"
    mean = 100 * found().differences[0].estimate.mean
    assert f"Gap to the optimum: {-mean:.2f} points lower with “vector” than with “none” (presentation)." in said
    assert (
        "points lower, from 12 drivers, 36 pairs. The difference stands out from chance (corrected p below 0.001)."
        in said
    )


def test_what_is_no_difference_is_not_called_one() -> None:
    truth = Truth(means=(0.25, 0.25, 0.25), drivers=12)
    ((_, said),) = in_short(analysed(made_up_study(truth, 3)))
    assert "does not stand out from chance" in said
    assert re.search(r"from \d\.\d\d points lower to \d\.\d\d points higher", said)


def test_a_comparison_that_cannot_be_made_is_said_and_counts_for_the_correction() -> None:
    study = made_up_study(Truth(drivers=12), 1, COMPARISONS)
    values = np.where(study.trials.levels["presentation"] == "top-speed", np.nan, study.trials.values[MEASURE])
    lacking = analysed(replace(study, trials=replace(study.trials, values={MEASURE: values})))
    assert [name for name, _ in lacking.failed] == ["vector against top-speed"]
    (one,) = lacking.differences
    assert one.corrected == pytest.approx(2 * one.estimate.probability)
    assert "no participant has finished trials with both presentation = vector and top-speed" in page(lacking)
    assert json.dumps(as_dict(lacking), allow_nan=False)


def test_missing_trials_are_counted_by_driver() -> None:
    study = made_up_study(Truth(drivers=12), 1)
    practice = study.trials.practice.copy()
    practice[:2] = True
    said = page(analysed(replace(study, trials=replace(study.trials, practice=practice))))
    assert "2, of sub-001, against drivers who finished 9" in said


def test_drivers_who_are_all_the_same_have_a_page_without_intervals() -> None:
    """A perfect driver has no spread: a difference, but nothing to judge it by."""
    truth = Truth(drivers=6, noise=(0.0, 0.0, 0.0), level_sd=0.0, effect_sd=0.0, day_sd=0.0)
    same = analysed(made_up_study(truth, 1))
    ((_, said),) = in_short(same)
    assert said.endswith("No interval can be given, because the drivers do not differ at all.")
    assert "points lower" in said
    assert "There is no comparison with a spread" in page(same)
    assert json.dumps(as_dict(same), allow_nan=False)


def test_one_driver_has_a_page() -> None:
    one = analysed(made_up_study(Truth(drivers=1), 1))
    assert "because only one driver took part" in page(one)


def test_a_study_without_comparisons_describes_its_conditions() -> None:
    study = made_up_study(Truth(drivers=6), 1)
    said = page(analysed(replace(study, plan=replace(study.plan, comparisons=()))))
    assert "No comparison was planned" in said
    assert "Gap to the optimum (%)" in said


def test_names_of_a_design_cannot_become_markup() -> None:
    study = made_up_study(Truth(drivers=6), 1, (compared("vector", "none", name="<script>x</script>"),))
    said = page(analysed(study))
    assert "<script>" not in said
    assert "&lt;script&gt;" in said


@pytest.mark.more
@pytest.mark.processes
def test_the_commands_analyse_a_folder_and_plan_the_next_study(tmp_path: Path) -> None:
    write_study(made_up_study(Truth(drivers=12), 1, COMPARISONS), tmp_path / "study")
    done = das_sim("experiment", "analyse", "study", "-o", "report.html", "--effect", "0.78", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["differences"]
    assert first["stands_out"]
    assert first["interval"][0] < first["mean"] < first["interval"][1] < 0
    assert second["participants_needed"][0]["effect"] == pytest.approx(0.0078)
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    words = ("--effect", "1", "--participants", "12,24", "--comparison", "vector against top-speed", "--json")
    asked = das_sim("experiment", "power", "study", *words, cwd=tmp_path)
    assert asked.returncode == 0, asked.stderr
    answer = json.loads(asked.stdout)
    assert [one["participants"] for one in answer["power"]] == [12, 24]
    assert answer["power_corrected"][1]["power"] < answer["power"][1]["power"]
    assert answer["participants_needed"] < answer["participants_needed_corrected"]
    words = ("--effect", "1", "--sd", "2", "--participants", "12", "--json")
    bundled = das_sim("experiment", "power", "presentations", *words, cwd=tmp_path)
    assert bundled.returncode == 0, bundled.stderr
    assert json.loads(bundled.stdout)["power_corrected"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("analyse", "nothing"), "nothing: expected the folder of a study that was run"),
        (("analyse", "nothing", "-o", "page.txt"), "page.txt: expected a file name that ends in .html or .htm"),
        (("analyse", "nothing", "--pdf", "page.html"), "page.html: expected a file name that ends in .pdf"),
        (("analyse", "nothing", "--effect", "-1"), "--effect -1: expected a number above 0"),
        (("power", "--effect", "1"), "--sd: expected the standard deviation between participants"),
        (("power", "--effect", "1", "--sd", "0"), "--sd 0: expected a number above 0"),
        (("power", "--effect", "1", "--sd", "2", "--participants", "a"), "--participants a: expected at most 50"),
        (("power", "--effect", "1", "--sd", "2", "--participants", "3"), "3 participants: expected 6 to 2000"),
        (("power", "--effect", "1", "--sd", "2", "--power", "2"), "--power 2: expected a number between 0 and 1"),
        (("power", "--effect", "1", "--sd-pairs", "2"), "--sd-pairs: expected together with --sd"),
    ],
)
def test_wrong_input_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = das_sim("experiment", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {message}")
    assert done.stderr.count("\n") == 1
