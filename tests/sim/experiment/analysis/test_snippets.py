"""The table of trials opens in one line of pandas, and the how-to page makes figures of the report again."""

from __future__ import annotations

import io
import re
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pandas
import pytest

from sim.experiment.analysis.comparing import analyse_study
from sim.experiment.analysis.page import as_dict
from sim.experiment.analysis.reading import read_study
from tests.support.made_up_study import MEASURE, Truth, compared, made_up_study, write_study

PAGE = Path(__file__).parents[4] / "docs" / "how-to" / "analyse-an-experiment.md"


def test_the_python_of_the_page_makes_a_row_of_the_report_again(tmp_path: Path) -> None:
    study = read_study(write_study(made_up_study(Truth(), 1, (compared("vector", "none"),)), tmp_path / "study"))
    (row,) = as_dict(analyse_study(study, resamples=999))["differences"]
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    with chdir(tmp_path), redirect_stdout(io.StringIO()):
        exec(compile(code, PAGE.name, "exec"), names)
    test, drivers = names["test"], names["drivers"]
    assert len(drivers) == row["drivers"]
    assert drivers.mean() == pytest.approx(row["mean"])
    assert list(test.confidence_interval()) == pytest.approx(row["t_interval"])
    assert dict(drivers) == pytest.approx(row["by_driver"])


def test_the_r_of_the_page_uses_columns_that_are_there_under_names_that_r_leaves_alone(tmp_path: Path) -> None:
    """R is not run here; `read.csv` changes names with other characters, and would stumble over quotes."""
    folder = write_study(made_up_study(Truth(), 1), tmp_path / "study")
    text = (folder / "trials.csv").read_text(encoding="utf-8")
    columns = set(pandas.read_csv(folder / "trials.csv").columns)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in columns)
    assert not set(text) & set("\"'#\t")
    blocks = "\n".join(re.findall(r"```r\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    used = set(re.findall(r"\b(practice|participant|seed|presentation|position|\w+_ratio)\b", blocks))
    assert used == {"practice", "participant", "seed", "presentation", "position", MEASURE}
    assert used <= columns
