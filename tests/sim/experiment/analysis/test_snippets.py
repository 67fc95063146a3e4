"""The table of trials opens in one line of pandas, and the how-to page makes figures of the report again."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pandas
import pytest

from sim.experiment.analysis.comparing import analyse_study
from sim.experiment.analysis.page import as_dict
from sim.experiment.analysis.reading import read_study
from tests.support.made_up_study import LEVELS, MEASURE, Truth, compared, made_up_study, write_study

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


def r_of_the_page() -> str:
    """All R of the page, from the top."""
    return "\n".join(re.findall(r"```r\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))


TOLD = """
said <- function(name, values) cat(name, format(values, digits = 15), "\\n")
for (name in rownames(conditions)) said(name, unlist(conditions[name, ]))
said("difference", c(mean(drivers$difference), test$conf.int, nrow(drivers)))
said("model", c(effect + c(0, -1, 1) * qt(0.975, nrow(drivers) - 1) * sqrt(vcov(model)["condition", "condition"])))
said("spreads", as.numeric(VarCorr(model)[1:2, "StdDev"]))
"""


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is not installed")
def test_the_r_of_the_page_makes_the_tables_of_the_report_again(tmp_path: Path) -> None:
    study = read_study(write_study(made_up_study(Truth(), 1, (compared("vector", "none"),)), tmp_path / "study"))
    found = as_dict(analyse_study(study, resamples=999))
    (tmp_path / "page.R").write_text(r_of_the_page() + TOLD, encoding="utf-8")
    done = subprocess.run(
        ["Rscript", "--vanilla", "page.R"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    if "no package called" in done.stderr:
        pytest.skip("R has no nlme")
    assert done.returncode == 0, done.stderr
    lines = {name: rest for name, *rest in (line.split() for line in done.stdout.splitlines() if line.strip())}
    told = {name: [float(one) for one in lines[name]] for name in (*LEVELS, "difference", "model", "spreads")}
    for row in found["conditions"]:
        names = ("trials", "drivers", "mean", "sd_between_drivers", "sd_within_driver")
        assert told[row["condition"]][:5] == pytest.approx([row[name] for name in names])
    (row,) = found["differences"]
    assert told["difference"] == pytest.approx([row["mean"], *row["t_interval"], row["drivers"]])
    model = row["model"]
    # Two programs search for the best fit in different ways: they agree to the digits of the report.
    assert told["model"] == pytest.approx([model["effect"], *model["interval"]], abs=5e-6)
    assert told["spreads"] == pytest.approx([model["sd_of_levels"], model["sd_of_effects"]], rel=5e-3)


def test_the_table_has_columns_under_names_that_r_leaves_alone(tmp_path: Path) -> None:
    """`read.csv` changes names with other characters, and would stumble over quotes."""
    folder = write_study(made_up_study(Truth(), 1), tmp_path / "study")
    text = (folder / "trials.csv").read_text(encoding="utf-8")
    columns = set(pandas.read_csv(folder / "trials.csv").columns)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", name) for name in columns)
    assert not set(text) & set("\"'#\t")
    used = set(re.findall(r"\b(practice|participant|seed|presentation|position|\w+_ratio)\b", r_of_the_page()))
    assert used == {"practice", "participant", "seed", "presentation", "position", MEASURE}
    assert used <= columns
