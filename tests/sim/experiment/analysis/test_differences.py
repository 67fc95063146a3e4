"""Pairs, groups and the estimates that they give: against other formulas, and as often right as they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sim.experiment.analysis.comparing import (
    RunStudy,
    corrected,
    group_estimate,
    paired_estimate,
    paired_trials,
    two_groups,
)
from tests.support.made_up_study import MEASURE, NOISE, SPEED_AND_EFFORT, Truth, made_up_study, positive, presentations


@pytest.mark.nightly
@pytest.mark.parametrize(
    "truth",
    [
        pytest.param(Truth(means=(0.25, 0.25), noise=(NOISE[2], NOISE[2]), effect_sd=0.0), id="one advice, two labels"),
        pytest.param(Truth(means=(0.25, 0.25), noise=(NOISE[0], NOISE[1]), effect_sd=0.0), id="noise differs 7-fold"),
        pytest.param(
            Truth(means=(0.25, 0.25), noise=(NOISE[0], NOISE[1]), effect_sd=0.02), id="skewed drivers as well"
        ),
    ],
)
def test_without_a_difference_3_to_8_percent_of_studies_find_one(truth: Truth) -> None:
    assert 0.03 <= positive(truth, "top-speed", "none") <= 0.08


def test_two_groups_are_compared_as_welch_does() -> None:
    rng = np.random.default_rng(7)
    a, b = rng.normal(1.0, 1.0, 30), rng.normal(0.0, 3.0, 40)
    found, welch = group_estimate(a, b), stats.ttest_ind(a, b, equal_var=False)
    assert found.probability == pytest.approx(welch.pvalue)
    assert found.size == pytest.approx((a.mean() - b.mean()) / np.sqrt(0.5 * (a.var(ddof=1) + b.var(ddof=1))))
    assert found.interval == found.t_interval == pytest.approx(tuple(welch.confidence_interval()))


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("holm", [0.04, 0.09, 0.09, 0.025, 0.7]),
        ("bonferroni", [0.05, 0.2, 0.15, 0.025, 1.0]),
        ("none", [0.01, 0.04, 0.03, 0.005, 0.7]),
    ],
)
def test_probabilities_are_corrected_for_their_number(method: str, expected: list[float]) -> None:
    assert corrected(np.array([0.01, 0.04, 0.03, 0.005, 0.7]), method) == pytest.approx(expected)


def test_a_comparison_without_probability_counts_among_those_planned() -> None:
    assert corrected(np.array([0.01, np.nan]), "holm") == pytest.approx([0.02, np.nan], nan_ok=True)


def test_drivers_who_do_not_differ_have_no_interval() -> None:
    rng = np.random.default_rng(1)
    same = paired_estimate(np.zeros(12), rng)
    assert (same.probability, same.known) == (1.0, False)
    shifted = paired_estimate(np.full(12, 0.3), rng)
    assert np.isnan(shifted.probability)
    assert not shifted.known
    assert not paired_estimate(np.array([0.3]), rng).known


def test_fewer_than_6_drivers_have_a_p_but_no_interval() -> None:
    found = paired_estimate(np.array([1.0, 2.0, 3.0, 2.5]), np.random.default_rng(1))
    assert found.probability == 2 / 2**4
    assert not found.known
    assert np.isfinite(found.t_interval).all()


def test_one_driver_who_differs_is_no_difference() -> None:
    """A measure such as the time above limits is 0 for nearly all."""
    found = paired_estimate(np.array([0.0] * 14 + [5.0]), np.random.default_rng(1))
    assert found.probability == 1.0
    assert found.interval[0] == 0.0
    assert found.interval[1] > 0.3


STUDY = made_up_study(Truth(drivers=7, days=3), 1)


def without(study: RunStudy, rows: list[int]) -> RunStudy:
    """A study without the values of some trials."""
    values = study.trials.values[MEASURE].copy()
    values[rows] = np.nan
    return replace(study, trials=replace(study.trials, values={MEASURE: values}))


def test_pairs_have_one_driver_and_one_day() -> None:
    trials = STUDY.trials
    pairs = paired_trials(STUDY, SPEED_AND_EFFORT)
    assert (len(pairs.participants), len(pairs.owner), pairs.unpaired, pairs.same_day) == (7, 21, 0, True)
    values = {
        (who, day, level): value
        for who, day, level, value in zip(
            trials.participant, trials.day, trials.levels["presentation"], trials.values[MEASURE], strict=True
        )
    }
    expected = [
        np.mean([values[who, day, "speed-and-effort"] - values[who, day, "none"] for day in ("0", "1", "2")])
        for who in pairs.participants
    ]
    assert pairs.means == pytest.approx(expected)


def test_a_trial_that_is_missing_takes_its_partner_with_it() -> None:
    pairs = paired_trials(without(STUDY, [0]), SPEED_AND_EFFORT)
    assert (len(pairs.owner), pairs.unpaired) == (20, 1)


def test_practice_is_left_out() -> None:
    practice = STUDY.trials.day == "0"
    pairs = paired_trials(replace(STUDY, trials=replace(STUDY.trials, practice=practice)), SPEED_AND_EFFORT)
    assert len(pairs.owner) == 14


def test_without_a_day_in_common_pairs_are_by_driver() -> None:
    """People may be given another day in each condition, so that they do not learn it."""
    day = np.array([str(i) for i in range(len(STUDY.trials))])
    pairs = paired_trials(replace(STUDY, trials=replace(STUDY.trials, day=day)), SPEED_AND_EFFORT)
    assert (len(pairs.owner), pairs.same_day) == (7, False)
    alike = paired_trials(STUDY, SPEED_AND_EFFORT)
    assert pairs.differences == pytest.approx(alike.means)


def test_groups_are_compared_by_the_means_of_their_drivers() -> None:
    study = made_up_study(Truth(drivers=10, days=3), 1)
    names = study.trials.participant
    level = np.where(names < "sub-06", "none", "speed-and-effort")
    factor = presentations("none", "speed-and-effort", within=False)
    study = replace(
        study,
        design=replace(study.design, factors=(factor,)),
        trials=replace(study.trials, levels={"presentation": level}),
    )
    groups = two_groups(study, SPEED_AND_EFFORT)
    assert (groups.a_names[0], len(groups.a), len(groups.b)) == ("sub-06", 5, 5)
    assert groups.b[0] == pytest.approx(study.trials.values[MEASURE][names == "sub-01"].mean())
