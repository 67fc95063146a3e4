"""A study's folder is read as it was written, and what is wrong in it is named by file, key and value."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.experiment.analysis.reading import read_study
from sim.experiment.plan import read_plan
from sim.experiment.study_files import checksums
from sim.recording.inputs import sha256
from tests.support.made_up_study import MEASURE, Truth, compared, made_up_study, write_study
from tests.support.making import das_sim

STUDY = made_up_study(
    Truth(drivers=3, days=2), 1, (compared("speed-and-effort", "none"), compared("speed-and-effort", "top-speed"))
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_study(STUDY, tmp_path / "study")


def test_a_study_is_read_as_it_was_written(folder: Path) -> None:
    read = read_study(folder)
    assert read.plan.comparisons == STUDY.plan.comparisons
    assert read.plan.setting == (
        ("drivers drawn from the population", "default"),
        ("not varied", "scenario: clear-day"),
    )
    assert read.meanings == STUDY.meanings
    assert read.trials.values[MEASURE] == pytest.approx(STUDY.trials.values[MEASURE])
    assert read.trials.participant.tolist() == STUDY.trials.participant.tolist()
    assert read.trials.levels["presentation"].tolist() == STUDY.trials.levels["presentation"].tolist()
    assert read.trials.position.tolist() == STUDY.trials.position.tolist()


def test_a_missing_value_is_empty_or_as_pandas_and_r_write_it(folder: Path) -> None:
    table = folder / "trials.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    for line, text in ((1, ""), (2, "NA"), (3, "nan")):
        lines[line] = f"{lines[line].rpartition(',')[0]},{text}"
    table.write_text("\n".join(lines), encoding="utf-8")
    values = read_study(folder).trials.values[MEASURE]
    assert np.isnan(values).tolist() == [True] * 3 + [False] * (len(values) - 3)


def test_levels_that_are_numbers_may_be_written_in_several_ways(folder: Path) -> None:
    """An update interval of 1 s in the design is 1.0 in the table of a program that reads numbers."""
    design = json.loads((folder / "design.json").read_text())
    design["factors"]["update_interval_s"] = {"levels": [1, 2.5], "within": True}
    design["comparisons"][0] |= {"where": {"update_interval_s": 1.0}}
    (folder / "design.json").write_text(json.dumps(design))
    table = folder / "trials.csv"
    head, *rows = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join([f"{head},update_interval_s", *(f"{row},1.0" for row in rows)]), encoding="utf-8")
    study = read_study(folder)
    assert set(study.trials.levels["update_interval_s"]) == {"1"}
    assert study.chosen(study.plan.comparisons[0]).sum() == 12


@pytest.mark.parametrize("table", ["trials.csv", "participants.tsv"])
def test_a_table_that_was_altered_after_the_run_is_refused(folder: Path, table: str) -> None:
    (folder / "participants.tsv").write_text("participant_id\tperson\nsub-001\t1\n")
    (folder / "checksums.json").write_bytes(checksums(folder))
    assert len(read_study(folder).trials) == len(STUDY.trials)
    wanted, path = sha256(folder / table), folder / table
    path.write_text(path.read_text().replace("1", "2", 1))
    done = das_sim("experiment", "analyse", "study", "-o", "report.html", cwd=folder.parent)
    said = f"study/{table}: SHA-256 = {sha256(path)!r}: expected {wanted} (checksums.json): the file was altered"
    assert (done.returncode, said in done.stderr, len(done.stderr.splitlines())) == (2, True, 1), done.stderr
    path.unlink()
    with pytest.raises(DasError, match=f"{table}: SHA-256 is missing"):
        read_study(folder)


def test_without_a_sidecar_the_names_of_columns_must_do(folder: Path) -> None:
    (folder / "trials.json").unlink()
    meaning = read_study(folder).meanings[MEASURE]
    assert (meaning.name, meaning.unit) == ("gap to optimum", "ratio")


def of_design(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        design = json.loads((folder / "design.json").read_text())
        change(design)
        (folder / "design.json").write_text(json.dumps(design))

    return spoil


def of_table(change: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        table = folder / "trials.csv"
        lines = change(table.read_text(encoding="utf-8").splitlines())
        table.write_text("\n".join(lines), encoding="utf-8")

    return spoil


def cell(column: int, text: str) -> Callable[[list[str]], list[str]]:
    """Change one cell of the second trial."""

    def change(lines: list[str]) -> list[str]:
        cells = lines[2].split(",")
        cells[column] = text
        return [*lines[:2], ",".join(cells), *lines[3:]]

    return change


BAD = {
    "no design": (lambda folder: (folder / "design.json").unlink(), "design.json: cannot be read"),
    "no table": (lambda folder: (folder / "trials.csv").unlink(), "trials.csv: cannot be read"),
    "alpha": (of_design(lambda one: one.update(alpha=5)), "alpha = 5.0: expected a probability between 0 and 1"),
    "seed": (of_design(lambda one: one.update(seed=-1)), "seed = -1: expected a whole number of at least 0"),
    "measures": (of_design(lambda one: one.update(measures=[3])), "measures = 3: expected a string"),
    "column": (of_table(lambda lines: [lines[0].replace("participant", "who"), *lines[1:]]), "column participant"),
    "two columns": (
        of_table(lambda lines: [lines[0].replace("session", "trial"), *lines[1:]]),
        "one column of this name",
    ),
    "short row": (of_table(lambda lines: [*lines[:2], lines[2].rpartition(",")[0]]), r"line 3 = 8: expected 9 values"),
    "text": (of_table(cell(8, "much")), r"line 3, gap_to_optimum_ratio = 'much': expected a finite number"),
    "infinite": (of_table(cell(8, "inf")), "expected a finite number"),
    "level": (of_table(cell(6, "loud")), r"line 3, presentation = 'loud': expected one of the design's levels"),
    "practice": (of_table(cell(4, "2")), r"line 3, practice = '2': expected a whole number from 0 to 1"),
    "position": (of_table(cell(3, "first")), r"line 3, position = 'first': expected a whole number"),
    "twice": (of_table(cell(0, "1")), r"line 3, trial = '1': expected each trial once"),
    "empty": (of_table(lambda lines: lines[:1]), "no finished trial that is not practice"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_named(case: str, folder: Path) -> None:
    spoil, message = BAD[case]
    spoil(folder)
    with pytest.raises(DasError, match=message):
        read_study(folder)


def test_a_plan_may_have_no_comparisons(folder: Path) -> None:
    of_design(lambda one: one.pop("comparisons"))(folder)
    plan = read_plan(folder)
    assert plan.comparisons == ()
    with pytest.raises(DasError, match="none is planned"):
        plan.chosen(None)
