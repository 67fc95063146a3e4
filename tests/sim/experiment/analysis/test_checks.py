"""The checks notice what breaks an assumption."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sim.experiment.analysis.checks import AssumptionCheck
from sim.experiment.analysis.reading import RunStudy
from tests.support.made_up_study import (
    APART,
    MEASURE,
    SAME,
    SPEED_AND_EFFORT,
    Truth,
    checked,
    made_up_groups,
    made_up_study,
)


def holds(study: RunStudy, words: str) -> bool | None:
    (found,) = [one for one in checked(study, APART) if words in one.name]
    return found.holds


def test_the_checks_of_good_groups_hold() -> None:
    study = made_up_groups(replace(SAME, means=(0.3, 0.25), drivers=40, skewed=False), 3)
    assert [one.name for one in checked(study, APART) if one.holds is not True] == []


def test_a_group_that_lacks_drivers_is_noticed() -> None:
    study = made_up_groups(replace(SAME, drivers=24), 1)
    values = study.trials.values[MEASURE].copy()
    values[np.isin(study.trials.participant, ["sub-001", "sub-003", "sub-005", "sub-007"])] = np.nan
    assert holds(replace(study, trials=replace(study.trials, values={MEASURE: values})), "of one size") is False
    assert holds(study, "of one size") is True


def test_groups_that_differ_in_spread_or_days_or_people_are_noticed() -> None:
    study = made_up_groups(replace(SAME, drivers=40, skewed=False), 3)
    mean = study.trials.values[MEASURE].mean()
    group = study.trials.levels["presentation"] == "none"
    wide = np.where(group, mean + 5.0 * (study.trials.values[MEASURE] - mean), study.trials.values[MEASURE])
    assert (
        holds(replace(study, trials=replace(study.trials, values={MEASURE: wide})), "Drivers differ as much") is False
    )
    assert holds(made_up_groups(replace(SAME, shared_days=False), 1), "same days") is None
    rng = np.random.default_rng(2)
    names = list(np.unique(study.trials.participant))
    people = {one: {"haste_ratio": rng.random() + i % 2, "other": rng.random()} for i, one in enumerate(names)}
    assert holds(replace(study, people=people), "alike in who they are") is False
    alike = {one: {"haste_ratio": rng.random()} for one in names}
    assert holds(replace(study, people=alike), "alike in who they are") is True


@cache
def found(name: str, seed: int = 1, **settings: float) -> AssumptionCheck:
    """The check whose name holds some words, on a made-up study."""
    study = made_up_study(Truth(drivers=40, days=6, extra=dict(settings)), seed)
    (check,) = [one for one in checked(study, SPEED_AND_EFFORT) if name in one.name]
    return check


def test_drift_from_trial_to_trial_is_noticed() -> None:
    assert found("tire").holds
    check = found("tire", drift=0.002)
    assert check.holds is False
    assert re.match(r"with each further trial, the measure is 0\.2\d points higher, p below 0\.001", check.found)


@pytest.mark.parametrize(("name", "settings"), [("trial before", {"carried": 0.02}), ("came first", {"drift": 0.004})])
def test_what_a_trial_leaves_behind_and_what_came_first_are_noticed(name: str, settings: dict[str, float]) -> None:
    """A drift makes whatever comes later larger, and so the difference depends on what came first."""
    assert found(name).holds
    assert found(name, **settings).holds is False


def test_noise_that_differs_is_said() -> None:
    check = found("scatter alike")
    assert check.holds is False
    assert check.found.startswith("speed-and-effort scatters ")


def test_few_shared_days_are_said_to_be_few() -> None:
    assert found("days").holds
    study = made_up_study(Truth(days=2), 1)
    check = checked(study, SPEED_AND_EFFORT)[-1]
    assert check.holds is False
    assert "2 days that drivers share" in check.found
