"""Pairs, groups and the estimates that they give: against other formulas, and as often right as they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sim.experiment.analysis.differences import (
    DifferenceEstimate,
    corrected,
    group_estimate,
    group_size_interval,
    paired_estimate,
    paired_trials,
    size_interval,
    two_groups,
)
from sim.experiment.analysis.reading import RunStudy
from sim.experiment.analysis.resampling import resampled, weights
from sim.experiment.plan import VariedFactor
from tests.support.made_up_study import MEASURE, NOISE, RESAMPLES, VECTOR, Truth, made_up_study, positive


@pytest.mark.slow
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


def test_resampling_by_weights_is_resampling_one_by_one() -> None:
    """Second witness: drivers drawn one by one, with the textbook's formula for every single resample."""
    values = np.random.default_rng(2).gamma(2.0, size=15) - 1.2
    found = paired_estimate(values, 20_000, np.random.default_rng(1))
    rng = np.random.default_rng(9)
    distances = []
    for _ in range(20_000):
        again = rng.choice(values, size=15)
        distances.append((again.mean() - values.mean()) / (again.std(ddof=1) / np.sqrt(15)))
    error = values.std(ddof=1) / np.sqrt(15)
    low, high = np.quantile(distances, (0.025, 0.975))
    assert found.interval == pytest.approx((values.mean() - high * error, values.mean() - low * error), abs=0.06)
    assert found.t_probability == pytest.approx(stats.ttest_1samp(values, 0.0).pvalue)
    assert found.t_interval == pytest.approx(tuple(stats.ttest_1samp(values, 0.0).confidence_interval()))


def test_probability_and_interval_say_the_same() -> None:
    rng = np.random.default_rng(3)
    for _ in range(60):
        values = rng.gamma(2.0, size=12) - 1.4
        found = paired_estimate(values, RESAMPLES, rng)
        away = not found.interval[0] <= 0.0 <= found.interval[1]
        assert away == (found.probability < 0.05) or abs(found.probability - 0.05) < 0.003


@pytest.mark.parametrize("sizes", [(14,), (10, 14)])
def test_studies_tested_at_once_are_those_tested_alone(sizes: tuple[int, ...]) -> None:
    """Paired differences of 14 drivers, and groups of 10 and 14 drivers."""
    rng, drawn = np.random.default_rng(6), np.random.default_rng(8)
    groups = [rng.normal(0.4 * len(sizes), 1.0, (4, size)) for size in sizes]
    found = resampled(groups, [weights(size, RESAMPLES, drawn) for size in sizes]).probabilities
    estimate: Callable[..., DifferenceEstimate] = paired_estimate if len(sizes) == 1 else group_estimate
    alone = [estimate(*rows, RESAMPLES, np.random.default_rng(8)).probability for rows in zip(*groups, strict=True)]
    assert found == pytest.approx(alone)


def test_the_interval_of_an_effect_size_holds_what_it_should() -> None:
    """Second witness: the definition. At the bounds, what was found has 2.5 % and 97.5 %."""
    for size in (-1.4, -0.2, 0.0, 0.6, 2.5):
        low, high = size_interval(size, 24)
        root = np.sqrt(24)
        found = abs(size) * root
        near, far = (low, high) if size >= 0 else (-high, -low)
        assert stats.nct.sf(found, 23, near * root) == pytest.approx(0.025, abs=1e-6)
        assert stats.nct.cdf(found, 23, far * root) == pytest.approx(0.025, abs=1e-6)


def test_two_groups_are_compared_as_welch_does() -> None:
    rng = np.random.default_rng(7)
    a, b = rng.normal(1.0, 1.0, 30), rng.normal(0.0, 3.0, 40)
    found, welch = group_estimate(a, b, 4000, rng), stats.ttest_ind(a, b, equal_var=False)
    assert found.t_probability == pytest.approx(welch.pvalue)
    assert found.t_interval == pytest.approx(tuple(welch.confidence_interval()))
    assert found.interval == pytest.approx(found.t_interval, abs=0.3)


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
    same = paired_estimate(np.zeros(12), RESAMPLES, rng)
    assert (same.probability, same.known) == (1.0, False)
    shifted = paired_estimate(np.full(12, 0.3), RESAMPLES, rng)
    assert np.isnan(shifted.probability)
    assert not shifted.known
    assert not paired_estimate(np.array([0.3]), RESAMPLES, rng).known


@pytest.mark.parametrize("values", [[1.0, 2.0, 3.0, 2.5], [0.0] * 19 + [5.0]])
def test_few_drivers_and_few_who_differ_are_judged_by_students_t_alone(values: list[float]) -> None:
    """A measure such as the time above limits is 0 for nearly all; a third of the resamples would be of zeros only."""
    found = paired_estimate(np.array(values), RESAMPLES, np.random.default_rng(1))
    assert not found.resampled
    assert found.interval == found.t_interval


def test_where_enough_drivers_differ_they_are_resampled() -> None:
    values = np.array([0.0] * 12 + [5.0, 3.0, 1.0, 2.0, 4.0, 1.0, 2.0, 6.0])
    found = paired_estimate(values, RESAMPLES, np.random.default_rng(1))
    assert found.resampled
    assert np.isfinite(found.interval).all()


@pytest.mark.parametrize("skewed", [False, True])
def test_without_a_difference_of_groups_3_to_8_percent_of_studies_find_one(skewed: bool) -> None:
    """The same test as of the analysis, on 1000 studies of two groups of 12 drivers."""
    rng = np.random.default_rng(1)
    a, b = (
        sd * (rng.gamma(3.0, size=(1000, 12)) - 3.0 if skewed else rng.normal(size=(1000, 12))) for sd in (1.0, 2.0)
    )
    found = resampled((a, b), (weights(12, 599, rng), weights(12, 599, rng))).probabilities
    assert 0.03 <= np.mean(found < 0.05) <= 0.08


def test_the_interval_of_the_size_holds_the_truth_as_often_as_it_says() -> None:
    """Bonett's interval allows for groups that differ in variance: the true size is 1 over the root of 2.5."""
    rng = np.random.default_rng(4)
    truth = 1.0 / np.sqrt(0.5 * (1.0 + 4.0))
    held = [
        low <= truth <= high
        for low, high in (group_size_interval(rng.normal(1.0, 1.0, 20), rng.normal(0.0, 2.0, 30)) for _ in range(500))
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


STUDY = made_up_study(Truth(drivers=7, days=3), 1)


def without(study: RunStudy, rows: list[int]) -> RunStudy:
    """A study without the values of some trials."""
    values = study.trials.values[MEASURE].copy()
    values[rows] = np.nan
    return replace(study, trials=replace(study.trials, values={MEASURE: values}))


def test_pairs_have_one_driver_and_one_day() -> None:
    trials = STUDY.trials
    pairs = paired_trials(STUDY, VECTOR)
    assert (len(pairs.participants), len(pairs.owner), pairs.unpaired, pairs.same_day) == (7, 21, 0, True)
    values = {
        (who, day, level): value
        for who, day, level, value in zip(
            trials.participant, trials.day, trials.levels["presentation"], trials.values[MEASURE], strict=True
        )
    }
    expected = [
        np.mean([values[who, day, "vector"] - values[who, day, "none"] for day in ("0", "1", "2")])
        for who in pairs.participants
    ]
    assert pairs.means == pytest.approx(expected)


def test_a_trial_that_is_missing_takes_its_partner_with_it() -> None:
    pairs = paired_trials(without(STUDY, [0]), VECTOR)
    assert (len(pairs.owner), pairs.unpaired) == (20, 1)


def test_practice_is_left_out() -> None:
    practice = STUDY.trials.day == "0"
    pairs = paired_trials(replace(STUDY, trials=replace(STUDY.trials, practice=practice)), VECTOR)
    assert len(pairs.owner) == 14


def test_without_a_day_in_common_pairs_are_by_driver() -> None:
    """People may be given another day in each condition, so that they do not learn it."""
    day = np.array([str(i) for i in range(len(STUDY.trials))])
    pairs = paired_trials(replace(STUDY, trials=replace(STUDY.trials, day=day)), VECTOR)
    assert (len(pairs.owner), pairs.same_day) == (7, False)
    alike = paired_trials(STUDY, VECTOR)
    assert pairs.differences == pytest.approx(alike.by_participant(alike.differences))


def test_groups_are_compared_by_the_means_of_their_drivers() -> None:
    study = made_up_study(Truth(drivers=10, days=3), 1)
    names = study.trials.participant
    level = np.where(names < "sub-006", "none", "vector")
    factor = VariedFactor(name="presentation", levels=("none", "vector"), within=False)
    study = replace(
        study, plan=replace(study.plan, factors=(factor,)), trials=replace(study.trials, levels={"presentation": level})
    )
    groups = two_groups(study, VECTOR)
    assert (groups.a_names[0], len(groups.a), len(groups.b)) == ("sub-006", 5, 5)
    assert groups.b[0] == pytest.approx(study.trials.values[MEASURE][names == "sub-001"].mean())
