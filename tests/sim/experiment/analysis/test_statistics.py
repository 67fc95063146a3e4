"""Made-up studies whose truth is known: how often the analysis errs, finds, and recovers what was planted."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import stats

from sim.experiment.analysis.comparing import generator
from sim.experiment.analysis.differences import corrected, group_estimate, paired_estimate, paired_trials, size_interval
from sim.experiment.analysis.power import (
    BellCurves,
    PowerQuestion,
    normal_participants,
    normal_power,
    of_pilot,
    participants_needed,
    power_of,
)
from sim.experiment.analysis.reading import Floats, RunStudy
from sim.experiment.analysis.resampling import resampled, sd_interval, spread_of, weights
from tests.support.made_up_study import MEASURE, NOISE, Truth, compared, made_up_study

STUDIES = 200
RESAMPLES = 999


def probability(study: RunStudy, a: str, b: str) -> float:
    """What the analysis says on one comparison of a study."""
    pairs = paired_trials(study, compared(a, b))
    rng = generator(study, "made-up")
    return paired_estimate(pairs.means, RESAMPLES, rng).probability


def positive(truth: Truth, a: str, b: str, studies: int = STUDIES) -> float:
    """The share of made-up studies in which a difference stands out from chance."""
    return float(np.mean([probability(made_up_study(truth, seed), a, b) < 0.05 for seed in range(studies)]))


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


@pytest.mark.slow
def test_a_planted_point_is_found_as_often_as_power_predicts() -> None:
    """The prediction comes from a pilot of 400 drivers, so that it is not off because its pilot was small."""
    truth = Truth(drivers=48, means=(0.26, 0.25, 0.25), effect_sd=0.02)
    pilot = made_up_study(Truth(drivers=400, means=truth.means, effect_sd=truth.effect_sd), 10_000)
    source = of_pilot(paired_trials(pilot, compared("vector", "none")), None)
    predicted = power_of(PowerQuestion(effect=-0.01, alpha=0.05, source=source), truth.drivers).power
    assert 0.6 < predicted < 0.9
    assert positive(truth, "vector", "none") == pytest.approx(predicted, abs=0.07)


def test_power_of_bell_curves_is_that_of_the_noncentral_t_distribution() -> None:
    source = BellCurves(between_sd=2.0, within_sd=1.5, pairs=3)
    sd = float(np.hypot(2.0, 1.5 / np.sqrt(3.0)))
    for participants in (16, 40, 90):
        found = power_of(PowerQuestion(effect=0.8, alpha=0.05, source=source), participants)
        assert found.power == pytest.approx(normal_power(0.8 / sd, participants, 0.05), abs=0.035)
        assert found.interval[0] < found.power < found.interval[1]


def test_the_first_estimate_of_76_pairs_is_found_again() -> None:
    """L2 less L3 through a person: 0.78 points, where persons differ by 2.4 points (issue 17)."""
    assert normal_participants(0.78 / 2.4, 0.05, 0.8) == 77
    question = PowerQuestion(effect=0.78, alpha=0.05, source=BellCurves(between_sd=2.4), studies=800)
    assert participants_needed(question, 0.8) == pytest.approx(77, abs=8)


def test_what_no_number_of_participants_finds_is_said() -> None:
    question = PowerQuestion(effect=1e-6, alpha=0.05, source=BellCurves(between_sd=1.0), studies=20)
    assert participants_needed(question, 0.8) is None
    assert normal_participants(0.0, 0.05, 0.8) is None


def test_a_pilot_has_the_spread_between_drivers_and_between_their_pairs() -> None:
    """More pairs for each driver take away noise, but not the differences between drivers."""
    truth = Truth(drivers=600, days=4, effect_sd=0.02, noise=(0.0, 0.0, 0.03), skewed=False)
    pairs = paired_trials(made_up_study(truth, 3), compared("vector", "none"))
    rng = np.random.default_rng(1)
    for each in (1, 4, 16):
        values = of_pilot(pairs, each).draw(200, 100, rng)
        assert values.std() == pytest.approx(np.hypot(0.02, 0.03 / np.sqrt(each)), rel=0.06)
        assert values.mean() == pytest.approx(0.0, abs=0.001)


@cache
def planted(skewed: bool) -> Floats:
    """What studies of 60 drivers estimate of their spread, as a share of what was planted."""
    truth = Truth(drivers=60, means=(0.26, 0.25), noise=NOISE[:2], level_sd=0.03, effect_sd=0.0, skewed=skewed)
    found = []
    for seed in range(STUDIES):
        study = made_up_study(truth, seed)
        trials = study.trials
        mine = trials.levels["presentation"] == "top-speed"  # the noisy condition: 2.3 points against 3
        values = trials.values[MEASURE][mine]
        spread = spread_of(values, trials.participant[mine], trials.day[mine], np.random.default_rng(seed))
        assert spread.separate
        found.append(
            (spread.between / 0.03, spread.within / NOISE[1], spread.interval[0] / 0.03, spread.interval[1] / 0.03)
        )
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(("skewed", "share"), [(False, 0.87), (True, 0.8)])
def test_the_planted_spread_of_drivers_is_recovered_within_a_fifth(skewed: bool, share: float) -> None:
    """On average it is recovered. How often in a single study is bounded by what 60 drivers can tell: 0.93 at best."""
    between, within, low, high = planted(skewed).T
    assert np.mean(np.abs(between - 1.0) <= 0.2) >= share
    assert between.mean() == pytest.approx(1.0, abs=0.03)
    assert within.mean() == pytest.approx(1.0, abs=0.02)
    assert np.mean((low <= 1.0) & (high >= 1.0)) >= 0.88


def test_a_study_without_spread_between_drivers_finds_little() -> None:
    truth = Truth(drivers=60, means=(0.26, 0.25), noise=(0.01, 0.01), level_sd=0.0, effect_sd=0.0)
    trials = made_up_study(truth, 5).trials
    spread = spread_of(trials.values[MEASURE], trials.participant, trials.day, np.random.default_rng(1))
    assert spread.between < 0.002
    assert spread.interval[0] == 0.0


def test_one_trial_for_each_driver_cannot_tell_drivers_from_noise() -> None:
    values = np.random.default_rng(1).normal(size=20)
    names = np.array([f"sub-{i}" for i in range(20)])
    spread = spread_of(values, names, names, np.random.default_rng(1))
    assert not spread.separate
    assert np.isnan(spread.within)
    assert spread.between == pytest.approx(values.std(ddof=1))


def test_the_interval_of_a_standard_deviation_is_the_textbooks_on_bell_curves() -> None:
    """Second witness: the chi-squared interval, which is exact there."""
    values = np.random.default_rng(4).normal(size=200)
    low, high = sd_interval(values, np.random.default_rng(1))
    sd, freedom = values.std(ddof=1), 199
    exact = [sd * np.sqrt(freedom / stats.chi2.ppf(share, freedom)) for share in (0.975, 0.025)]
    assert (low, high) == pytest.approx(exact, rel=0.05)


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


def test_studies_tested_at_once_are_those_tested_alone() -> None:
    values = np.random.default_rng(6).normal(0.4, 1.0, size=(5, 14))
    drawn = weights(14, RESAMPLES, np.random.default_rng(8))
    alone = [paired_estimate(row, RESAMPLES, np.random.default_rng(8)).probability for row in values]
    assert resampled((values,), (drawn,)).probabilities == pytest.approx(alone)


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


def test_few_drivers_are_judged_by_students_t_alone() -> None:
    found = paired_estimate(np.array([1.0, 2.0, 3.0, 2.5]), RESAMPLES, np.random.default_rng(1))
    assert not found.resampled
    assert found.interval == found.t_interval


def test_where_hardly_any_driver_differs_resampling_is_not_used() -> None:
    """A measure such as the time above limits is 0 for nearly all; a third of the resamples would be of zeros only."""
    found = paired_estimate(np.array([0.0] * 19 + [5.0]), RESAMPLES, np.random.default_rng(1))
    assert not found.resampled
    assert found.interval == found.t_interval
    enough = paired_estimate(
        np.array([0.0] * 12 + [5.0, 3.0, 1.0, 2.0, 4.0, 1.0, 2.0, 6.0]), RESAMPLES, np.random.default_rng(1)
    )
    assert enough.resampled
    assert np.isfinite(enough.interval).all()
