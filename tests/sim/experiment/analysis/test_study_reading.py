"""A study's folder is read as it was written, and what is wrong in it is named by file, key and value."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.experiment.analysis.comparing import ShownMeasure, read_study
from tests.support.made_up_study import MEASURE, Truth, compared, made_up_study, write_study

STUDY = made_up_study(
    Truth(drivers=3, days=2), 1, (compared("speed-and-effort", "none"), compared("speed-and-effort", "top-speed"))
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_study(STUDY, tmp_path / "study")


def test_a_study_is_read_as_it_was_written(folder: Path) -> None:
    read = read_study(folder)
    assert read.design.comparisons == STUDY.design.comparisons
    assert read.design.people == STUDY.design.people
    assert {name: level.text for name, level in read.design.fixed.items()} == {"scenario": "clear-day"}
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
    design["factors"].append({"name": "update_interval_s", "levels": [1, 2.5], "within": True})
    design["comparisons"][0] |= {"where": {"update_interval_s": 1.0}}
    (folder / "design.json").write_text(json.dumps(design))
    table = folder / "trials.csv"
    head, *rows = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join([f"{head},update_interval_s", *(f"{row},1.0" for row in rows)]), encoding="utf-8")
    study = read_study(folder)
    assert set(study.trials.levels["update_interval_s"]) == {"1"}
    assert study.chosen(study.design.comparisons[0]).sum() == 12


def test_a_column_of_another_program_is_shown_by_the_unit_in_its_name() -> None:
    shown = ShownMeasure.of("heart_rate_per_min", np.array([60.0, 70.0]))
    assert (shown.name, shown.unit) == ("heart rate per", "per minute")
    known = ShownMeasure.of(MEASURE, np.array([0.2, 0.3]))
    assert (known.name, known.unit, known.difference_unit) == ("Gap to the optimum", "%", "points")


def test_a_design_of_an_earlier_version_is_refused(folder: Path) -> None:
    (folder / "design.json").write_text(json.dumps({"name": "old", "hash": "0", "factors": {}}))
    with pytest.raises(DasError, match="frozen by an earlier version: run the design again"):
        read_study(folder)


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
    "alpha": (of_design(lambda one: one["analysis"].update(alpha=5)), "analysis.alpha = 5.0: expected a number from"),
    "seed": (of_design(lambda one: one["experiment"].update(seed=-1)), "experiment.seed = -1: expected a whole number"),
    "measures": (of_design(lambda one: one["analysis"].update(measures=[3])), "analysis.measures = 3: expected each"),
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


def test_a_design_may_have_no_comparisons(folder: Path) -> None:
    of_design(lambda one: one.pop("comparisons"))(folder)
    assert read_study(folder).design.comparisons == ()
