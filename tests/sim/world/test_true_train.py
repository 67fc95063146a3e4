"""A true train that cannot be driven is refused before it sets off, whoever drives it: one line names what to change.

The figures of a run need its optimum; before, they were lost after the whole drive.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from sim.drivers.kinds import DriverKind, Presentation
from sim.experiment.checking import check_design
from sim.experiment.design import read_design
from sim.experiment.one_line import DaysAsked
from sim.experiment.runner import attempted
from sim.experiment.trials import jobs_of, make_trial
from sim.world.scenario import read_scenario
from sim.world.service import lay_out
from tests.support.freight import FREIGHT
from tests.support.making import refusal

LINE = """
schema_version = 1
route = {id = "steep", name = "steep", length_km = 9}
stops = [{name = "Top", position_km = 0}, {name = "Bottom", position_km = 9}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0, 60]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0, 0], [0.5, -30], [7.5, 0]]}
"""
DAY = """
schema_version = 1
[scenario]
id = "steep"
title = "Steep"
route = "line.toml"
vehicle = "train.toml"
[truth]
"""
DRAWN = "mass_ratio = {min = 0.9, max = 1.9}"
HELD, TOO_HEAVY = 1, 2
"""Seeds whose mass the brakes hold, and do not hold, if it is `DRAWN`."""
PLACE = r"the true train: \S*line.toml: the train cannot brake on the descent at \d+ m \(-\d\d.\d ‰\)"
KEY = r"\S*.toml: friction_brake.max_force_kn = 320: expected at least \d+"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / "train.toml").write_text(FREIGHT)
    (tmp_path / "heavy.toml").write_text(FREIGHT.replace("mass_t = 1350", "mass_t = 2025"))
    return tmp_path


def day(folder: Path, truth: str) -> Path:
    path = folder / "day.toml"
    path.write_text(DAY + truth)
    return path


def of_days(scenario: Path, seeds: tuple[int, ...]) -> DaysAsked:
    return DaysAsked(
        scenarios=[str(scenario)], drivers=[DriverKind.PERFECT], advice=[Presentation.NONE], seeds=seeds
    )  # fmt: skip


def never(*_: Any, **__: Any) -> None:
    raise AssertionError("driven")


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        ("mass_ratio = 1.5", "truth.mass_ratio = 1.5"),
        ('vehicle = "heavy.toml"', r"truth.vehicle = \S*heavy.toml"),
        (
            'vehicle = "heavy.toml"\nmass_percent = 99',
            r"truth.mass_ratio = 0.99, truth.vehicle = \S*heavy.toml",
        ),
    ],
)
def test_a_train_too_heavy_for_its_brakes_is_refused_with_place_and_keys(folder: Path, truth: str, said: str) -> None:
    with pytest.raises(DasError, match=rf"day.toml: {said}: {PLACE}: {KEY}$"):
        lay_out(read_scenario(day(folder, truth)))


def test_a_train_on_ice_or_one_that_stalls_is_refused(folder: Path) -> None:
    with pytest.raises(DasError, match=rf"day.toml: truth.adhesion_ratio = 0.01: {PLACE}: {KEY}$"):
        lay_out(read_scenario(day(folder, "adhesion_ratio = 0.01\nadhesive_mass_t = 90")))
    (folder / "line.toml").write_text(LINE.replace("-30", "12"))
    with pytest.raises(DasError, match=r"truth.mass_ratio = 9: the true train: \S*line.toml: the train stalls at"):
        lay_out(read_scenario(day(folder, "mass_ratio = 9")))


def test_run_refuses_it_in_one_line_before_the_drive(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.world.driving.drive_day", never)
    for truth, said in (("mass_ratio = 1.5", "mass_ratio = 1.5: "), (DRAWN, ", drawn from 0.9 to 1.9: ")):
        line = refusal("run", str(day(folder, truth)), "--seed", str(TOO_HEAVY), "--in-process", cwd=folder)
        assert said in line
        assert "cannot brake on the descent at" in line


def test_days_are_refused_if_none_can_be_driven_else_the_day_is_an_error(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DasError, match=PLACE):
        of_days(day(folder, "mass_ratio = 1.5"), (1,)).design()
    monkeypatch.setattr("sim.experiment.driving.drive_day", never)
    bad, good = (
        attempted(make_trial, job)["error"]
        for job in jobs_of(of_days(day(folder, DRAWN), (TOO_HEAVY, HELD)).design(), folder)
    )
    assert re.search(PLACE, bad)
    assert good == "AssertionError: driven"


@pytest.mark.parametrize("truth", ["mass_ratio = 1.5", DRAWN])
def test_an_experiment_is_refused_before_any_trial(folder: Path, truth: str) -> None:
    day(folder, truth)
    design = folder / "design.toml"
    factor = "[[factors]]\nname = 'presentation'\nlevels = ['none', 'speed-and-effort']\n"
    head = "schema_version = 1\n[experiment]\nname = 'try'\ntitle = 'T'\nseed = 7\n[participants]\ncount = 8\n"
    design.write_text(f"{head}[fixed]\nscenario = 'day.toml'\n[procedure]\ndays = 'own'\n{factor}")
    with pytest.raises(DasError, match=PLACE):
        check_design(read_design(design))
