"""The study preview-of-advice: its kept run is that of the bundled design, its page says what it found, and the printed
sheet is the one that simulated drivers follow."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from scipy import stats

from das.domain.files.load import load_journey, load_route, load_vehicle
from das.offline.journey import JourneyPlanner
from docs.studies.preview_of_advice import KEPT, PAGE, SIZES, WORTH, power, power_table
from precompute.sheet import sheets_of
from sim.drivers.kinds import Presentation
from sim.experiment.analysis.comparing import analyse_study, read_study
from sim.experiment.design import load_design
from sim.experiment.driving import drive, service_of
from sim.experiment.measures import measured
from sim.experiment.trials import imbalances, trials_of
from sim.world.service import make_day
from sim.world.simpler import PaperSheet

STUDY, DESIGN = read_study(KEPT), load_design("preview-of-advice")
SAID = PAGE.read_text(encoding="utf-8")
FOLDER = DESIGN.source.with_suffix("")
MEASURES = ["gap_to_optimum_ratio", "effort_rmse_ratio", "late_s"]


def test_the_kept_run_is_of_the_bundled_design() -> None:
    kept = STUDY.design
    assert (kept.people, kept.procedure, kept.seed) == (DESIGN.people, DESIGN.procedure, DESIGN.seed)
    assert (kept.measures, kept.comparisons) == (DESIGN.measures, DESIGN.comparisons)
    assert kept.planned == DESIGN.planned
    assert not STUDY.missing
    assert imbalances(DESIGN, trials_of(DESIGN)) == []


@pytest.mark.parametrize("display", ["guide-without-preview", "sheet"])
def test_a_trial_is_still_driven_as_kept(display: str) -> None:
    with (KEPT / "trials.csv").open(encoding="utf-8", newline="") as file:
        row = next(one for one in csv.DictReader(file) if (one["participant"], one["display"]) == ("sub-01", display))
    trial = trials_of(DESIGN)[int(row["trial"]) - 1]
    assert trial.condition == display
    found = measured(drive(trial, DESIGN.people.population), MEASURES)
    assert found == pytest.approx({name: float(row[name]) for name in MEASURES}, rel=0.05, abs=2.0)


def test_preview_and_reason_are_what_the_levels_take_away() -> None:
    settings = {one.text: DESIGN.setting({"display": one}) for one in DESIGN.factors[0].levels}
    shown = {name: (one.presentation, one.preview_s > 0, one.reason) for name, one in settings.items()}
    assert shown == {
        "none": (Presentation.NONE, True, True),
        "guide": (Presentation.GUIDE, True, True),
        "guide-without-preview": (Presentation.GUIDE, False, True),
        "guide-without-reason": (Presentation.GUIDE, True, False),
        "sheet": (Presentation.SHEET, True, True),
    }


def test_the_page_says_what_the_kept_run_found() -> None:
    found = {one.title: one for one in analyse_study(STUDY).differences}
    said = re.findall(r"[−+]?\d+(?:\.\d+)?", SAID.split("![")[1].split("## ")[0].partition(")\n")[2])
    for name, digits in (("advice: gap", 0), ("preview: gap", 1), ("preview: following", 1), ("paper: gap", 1)):
        for value in found[name].estimate.interval:
            assert f"{abs(100.0 * value):.{digits}f}" in [one.lstrip("−+") for one in said], (name, value)
    assert [name for name, one in found.items() if one.corrected < 0.05] == ["advice: gap"]


def test_power_is_that_of_students_t_for_bell_curves_and_corrected_for_the_number() -> None:
    rng, drivers, effect = np.random.default_rng(3), 24, 0.6
    found = rng.normal(size=(4000, 1))
    found = (found - found.mean()) / found.std(ddof=1)
    critical = stats.t.ppf(0.975, drivers - 1)
    expected = stats.nct.sf(critical, drivers - 1, effect * np.sqrt(drivers))
    (alone,) = power(found, np.array([effect]), drivers, "none", 0.05)
    assert alone == pytest.approx(expected, abs=0.03)
    (none,) = power(found, np.zeros(1), drivers, "none", 0.05)
    assert none == pytest.approx(0.05, abs=0.02)
    among = power(np.column_stack([found, found[::-1]]), np.array([effect, 0.0]), drivers, "bonferroni", 0.05)
    assert among[0] < alone - 0.05


def test_the_table_of_power_has_a_row_for_each_comparison() -> None:
    head, _, *rows = power_table(STUDY)
    assert [row.split(":")[0].strip("| ") for row in rows] == [name.split(":")[0] for name in WORTH]
    assert len(head.split("|")) == len(SIZES) + 5
    shares = [int(cell.strip(" %")) for cell in rows[-1].split("|")[4:-1]]
    assert shares == sorted(shares)
    assert shares[-1] > 95
    registered = [int(row.split("|")[4 + SIZES.index(DESIGN.people.count)].strip(" %")) for row in rows[:2]]
    assert min(registered) >= 75  # "four of five such studies" in the preregistration


def test_the_sheet_on_paper_is_that_of_the_simulated_drivers() -> None:
    trial = trials_of(DESIGN)[0]
    service = service_of(trial.setting)
    paper = PaperSheet(make_day(service, trial.seed, None))
    route, vehicle = load_route(FOLDER / "line.toml"), load_vehicle("re460-ic")
    planner = JourneyPlanner(load_journey(FOLDER / "journey.toml", route), route, vehicle, level=service.level)
    printed = [one.sheet.lines for one in sheets_of(planner, planner.plan())]
    assert printed == [paper._sheet(number).lines for number in range(2)]
