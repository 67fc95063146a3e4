"""The page of an analysis says first what the answer hangs on, and what is missing; the how-to page makes it again."""

from __future__ import annotations

import io
import json
import re
import subprocess
from contextlib import chdir, redirect_stdout
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas
import pytest

from sim.experiment.analysis.comparing import RunStudy, StudyFindings, analyse_study, read_study
from sim.experiment.analysis.page import as_dict, hangs_on, in_short, page, trial_rows
from tests.support.made_up_study import (
    APART,
    LEVELS,
    MEASURE,
    SAME,
    Truth,
    compared,
    eight_drivers,
    made_up_groups,
    made_up_study,
    write_study,
)
from tests.support.making import das_sim_json, refusal
from tests.support.needs import need_r

COMPARISONS = (compared("speed-and-effort", "none"), compared("speed-and-effort", "top-speed"))
PAGE = Path(__file__).parents[4] / "docs" / "how-to" / "analyse-an-experiment.md"
TOLD = """
said <- function(name, values) cat(name, format(values, digits = 15), "\\n")
for (name in rownames(conditions)) said(name, unlist(conditions[name, ]))
said("difference", c(mean(drivers$difference), test$conf.int, nrow(drivers)))
"""


def test_two_groups_are_compared_on_the_page(tmp_path: Path) -> None:
    study = made_up_groups(replace(SAME, drivers=24), 1)
    study = replace(study, design=replace(study.design, comparisons=(APART,)))
    found = analyse_study(read_study(write_study(study, tmp_path / "study")))
    assert "two groups of 12 and 12" in re.sub(r"\s+", " ", page(found))
    (row,) = as_dict(found)["differences"]
    assert (row["method"], row["pairs"]) == ("Welch's t", None)
    assert len(row["groups"]["a"]) == len(row["groups"]["b"]) == 12
    assert json.dumps(as_dict(found), allow_nan=False)


@cache
def found() -> StudyFindings:
    return analyse_study(made_up_study(Truth(drivers=12), 1, COMPARISONS))


@cache
def html() -> str:
    return page(found())


def test_the_page_needs_nothing_besides_itself() -> None:
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", html())
    assert not re.findall(r"url\(|@import|<script|http://|https://", html())
    assert html().count("<figure>") == 1  # the forest plot of the only measure


def test_what_the_answer_hangs_on_comes_before_every_figure() -> None:
    said = html()
    assert said.index("No person drove. 12 simulated drivers") < said.index("points lower")
    assert said.index("are assumptions") < said.index("interval is")


def test_the_page_has_conditions_design_and_terms() -> None:
    for part in ("The conditions", "missing trials", "0" * 64, "corrected p", ">d</th>"):
        assert part in html()
    for term in ("Paired difference", "Sign flips"):
        assert f">{term}</th>" in html()


def test_the_same_study_gives_the_same_page() -> None:
    assert page(analyse_study(made_up_study(Truth(drivers=12), 1, COMPARISONS))) == html()


def test_a_verdict_has_size_interval_and_chance() -> None:
    (name, said), _ = in_short(found())
    assert name == "speed-and-effort against none"
    mean = 100 * found().differences[0].estimate.mean
    assert (
        f"Gap to the optimum: {-mean:.2f} points lower with “speed-and-effort” than with “none” (presentation)." in said
    )
    assert (
        "points lower, from 12 drivers, 36 pairs. "
        "The difference is statistically significant (corrected p below 0.001)." in said
    )


def test_one_method_decides_and_student_who_disagrees_is_named() -> None:
    of_eight = analyse_study(eight_drivers())
    ((_, said),) = in_short(of_eight)
    assert "The difference is statistically significant (corrected p 0.031). Student's t disagrees (" in said
    (row,) = as_dict(of_eight)["differences"]
    assert (row["method"], row["disagrees"]) == ("exact sign flips", True)
    (agreed, _) = as_dict(found())["differences"]
    assert agreed["disagrees"] is False


def test_what_is_no_difference_is_not_called_one() -> None:
    truth = Truth(means=(0.25, 0.25, 0.25), drivers=12)
    ((_, said),) = in_short(analyse_study(made_up_study(truth, 3)))
    assert "is not statistically significant" in said
    assert re.search(r"from \d\.\d\d points lower to \d\.\d\d points higher", said)


def test_a_comparison_that_cannot_be_made_is_said_and_counts_for_the_correction() -> None:
    study = made_up_study(Truth(drivers=12), 1, COMPARISONS)
    values = np.where(study.trials.levels["presentation"] == "top-speed", np.nan, study.trials.values[MEASURE])
    lacking = analyse_study(replace(study, trials=replace(study.trials, values={MEASURE: values})))
    assert [name for name, _ in lacking.failed] == ["speed-and-effort against top-speed"]
    (one,) = lacking.differences
    assert one.corrected == pytest.approx(2 * one.estimate.probability)
    assert "no participant has finished trials with both presentation = speed-and-effort and top-speed" in page(lacking)
    assert json.dumps(as_dict(lacking), allow_nan=False)


def test_missing_trials_are_counted_by_driver() -> None:
    study = made_up_study(Truth(drivers=12), 1)
    practice = study.trials.practice.copy()
    practice[:2] = True
    said = dict(trial_rows(analyse_study(replace(study, trials=replace(study.trials, practice=practice)))))
    assert said["missing trials"].startswith("2 of 108 planned: sub-01: ")


def stopped_study() -> RunStudy:
    """A study whose design says what was planned; driver 1 did not finish three trials, driver 4 none."""
    study = made_up_study(Truth(drivers=4), 1)
    trials = study.trials
    names = trials.participant
    kept = (names != "sub-04") & ~((names == "sub-01") & (trials.position > 6))
    return replace(
        study,
        trials=replace(
            trials, participant=names[kept], position=trials.position[kept], practice=trials.practice[kept],
            day=trials.day[kept], levels={name: one[kept] for name, one in trials.levels.items()},
            values={name: one[kept] for name, one in trials.values.items()},
        ),
    )  # fmt: skip


def test_a_stopped_study_says_which_trials_are_missing() -> None:
    study = stopped_study()
    assert study.missing.total() == 3 + 9
    assert {name for name, _ in study.missing} == {"sub-01", "sub-04"}
    found = analyse_study(study)
    said = hangs_on(found)[-1]
    assert said.startswith("12 of the 36 planned trials are missing (sub-01: ")
    assert "; sub-04: all 9)" in said
    lacking = dict(trial_rows(found))["missing trials"]
    assert lacking.startswith("12 of 36 planned: sub-01: ")
    assert "sub-04: all 9" in lacking


@pytest.mark.nightly
def test_drivers_who_are_all_the_same_have_a_page_without_intervals() -> None:
    """A perfect driver has no spread: a difference, but nothing to judge it by."""
    truth = Truth(drivers=6, noise=(0.0, 0.0, 0.0), level_sd=0.0, effect_sd=0.0, day_sd=0.0)
    same = analyse_study(made_up_study(truth, 1))
    ((_, said),) = in_short(same)
    assert said.endswith("No interval can be given, because the drivers do not differ at all.")
    assert "points lower" in said
    assert "points lower" in page(same)
    assert json.dumps(as_dict(same), allow_nan=False)


SIX = made_up_study(Truth(drivers=6), 1)
SMALL = {
    "one driver": (made_up_study(Truth(drivers=1), 1), ["because only one driver took part"]),
    "no comparison": (
        replace(SIX, design=replace(SIX.design, comparisons=())),
        ["No comparison was planned", "Gap to the optimum (%)"],
    ),
    "markup": (
        made_up_study(Truth(drivers=6), 1, (compared("speed-and-effort", "none", name="<script>x</script>"),)),
        ["&lt;script&gt;"],
    ),
}


@pytest.mark.parametrize(("study", "expected"), SMALL.values(), ids=SMALL)
def test_a_small_study_has_a_page_and_names_cannot_become_markup(study: RunStudy, expected: list[str]) -> None:
    said = page(analyse_study(study))
    assert all(one in said for one in expected)
    assert "<script>" not in said


@pytest.mark.nightly
def test_the_command_analyses_a_folder(tmp_path: Path) -> None:
    write_study(made_up_study(Truth(drivers=12), 1, COMPARISONS), tmp_path / "study")
    first, second = das_sim_json("experiment", "analyse", "study", "-o", "report.html", cwd=tmp_path)["differences"]
    assert first["stands_out"]
    assert first["interval"][0] < first["mean"] < first["interval"][1] < 0
    assert second["drivers"] == 12
    assert (tmp_path / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("analyse", "nothing"), "nothing: expected the folder of a study that was run"),
        (("analyse", "nothing", "-o", "page.txt"), "page.txt: expected a file name that ends in .html or .htm"),
        (("analyse", "nothing", "--pdf", "page.html"), "page.html: expected a file name that ends in .pdf"),
        (
            ("power", "study", "--effect", "1"),
            "power is no longer a command of this program; run",
        ),
    ],
)
def test_wrong_input_is_one_line(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    assert refusal("experiment", *words, cwd=tmp_path).startswith(f"error: {message}")


def test_the_python_of_the_page_makes_a_row_of_the_report_again(tmp_path: Path) -> None:
    study = read_study(
        write_study(made_up_study(Truth(), 1, (compared("speed-and-effort", "none"),)), tmp_path / "study")
    )
    (row,) = as_dict(analyse_study(study))["differences"]
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    with chdir(tmp_path), redirect_stdout(io.StringIO()):
        exec(compile(code, PAGE.name, "exec"), names)
    test, student, drivers = names["test"], names["student"], names["drivers"]
    assert len(drivers) == row["drivers"]
    assert drivers.mean() == pytest.approx(row["mean"])
    assert test.pvalue == pytest.approx(row["p"], abs=0.003)
    assert list(student.confidence_interval()) == pytest.approx(row["t_interval"])
    assert dict(drivers) == pytest.approx(row["by_driver"])


def r_of_the_page() -> str:
    """The script that the page shows."""
    return (PAGE.parents[1] / "examples" / "analyse.R").read_text(encoding="utf-8")


@pytest.mark.nightly
def test_the_r_of_the_page_makes_the_tables_of_the_report_again(tmp_path: Path) -> None:
    need_r()
    study = read_study(
        write_study(made_up_study(Truth(), 1, (compared("speed-and-effort", "none"),)), tmp_path / "study")
    )
    found = as_dict(analyse_study(study))
    (tmp_path / "page.R").write_text(r_of_the_page() + TOLD, encoding="utf-8")
    done = subprocess.run(
        ["Rscript", "--vanilla", "page.R"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = {name: rest for name, *rest in (line.split() for line in done.stdout.splitlines() if line.strip())}
    told = {name: [float(one) for one in lines[name]] for name in (*LEVELS, "difference")}
    for row in found["conditions"]:
        names = ("trials", "drivers", "mean", "sd_between_drivers")
        assert told[row["condition"]][:4] == pytest.approx([row[name] for name in names])
    (row,) = found["differences"]
    assert told["difference"] == pytest.approx([row["mean"], *row["t_interval"], row["drivers"]])


def test_the_table_has_columns_under_names_that_r_leaves_alone(tmp_path: Path) -> None:
    """`read.csv` changes names with other characters, and would stumble over quotes."""
    folder = write_study(made_up_study(Truth(), 1), tmp_path / "study")
    text = (folder / "trials.csv").read_text(encoding="utf-8")
    columns = set(pandas.read_csv(folder / "trials.csv").columns)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in columns)
    assert not set(text) & set("\"'#\t")
    used = set(re.findall(r"\b(practice|participant|seed|presentation|\w+_ratio)\b", r_of_the_page()))
    assert used == {"practice", "participant", "seed", "presentation", MEASURE}
    assert used <= columns
