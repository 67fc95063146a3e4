"""The mixed model recovers what was planted and says where it cannot; the checks notice what breaks an assumption."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.experiment.analysis.checks import AssumptionCheck
from sim.experiment.analysis.differences import paired_trials, two_groups
from sim.experiment.analysis.mixed_model import fit_mixed_model
from sim.experiment.analysis.reading import RunStudy
from sim.experiment.plan import VariedFactor
from tests.support.made_up_study import MEASURE, NOISE, Truth, checked, compared, made_up_study

VECTOR = compared("vector", "none")


def without(study: RunStudy, rows: list[int]) -> RunStudy:
    """A study without the values of some trials."""
    values = study.trials.values[MEASURE].copy()
    values[rows] = np.nan
    return replace(study, trials=replace(study.trials, values={MEASURE: values}))


@pytest.mark.parametrize("shared", [True, False])
def test_the_mixed_model_recovers_effect_spreads_and_noises_that_differ(shared: bool) -> None:
    truth = Truth(drivers=100, days=4, effect_sd=0.02, skewed=False, shared_days=shared)
    fit = fit_mixed_model(made_up_study(truth, 2), VECTOR)
    assert fit.interval[0] < -0.02 < fit.interval[1]
    assert fit.effect_sd == pytest.approx(0.02, rel=0.2)
    assert fit.noise == pytest.approx((NOISE[2], NOISE[0]), rel=0.2)
    # The model's level is that between the two conditions: the driver's own, and half of his effect.
    assert fit.level_sd == pytest.approx(np.hypot(0.03, 0.01), rel=0.2)
    assert fit.converged
    assert not fit.singular


def test_the_mixed_model_agrees_with_the_pairs() -> None:
    study = made_up_study(Truth(), 4)
    pairs = paired_trials(study, VECTOR)
    assert fit_mixed_model(study, VECTOR).effect == pytest.approx(pairs.means.mean(), abs=1e-3)


def test_a_singular_fit_is_said_to_be() -> None:
    """Where drivers do not differ at all, some fits end at a variance of 0, or at a correlation of 1."""
    truth = Truth(level_sd=0.0, effect_sd=0.0, day_sd=0.0, noise=(0.02, 0.02, 0.02))
    fits = [fit_mixed_model(made_up_study(truth, seed), VECTOR) for seed in range(4)]
    singular = [fit for fit in fits if fit.singular]
    assert singular
    assert all(any(remark.startswith("Singular: ") for remark in fit.remarks) for fit in singular)


def test_with_one_trial_for_each_driver_the_model_is_simpler_and_says_so() -> None:
    fit = fit_mixed_model(made_up_study(Truth(days=1), 1), VECTOR)
    assert np.isnan(fit.effect_sd)
    assert "one trial in a condition" in fit.remarks[0]


def test_too_few_drivers_and_no_spread_have_no_model() -> None:
    with pytest.raises(DasError, match="fewer than 5 drivers"):
        fit_mixed_model(made_up_study(Truth(drivers=4), 1), VECTOR)
    flat = Truth(means=(0.2, 0.2, 0.2), noise=(0.0, 0.0, 0.0), level_sd=0.0, effect_sd=0.0, day_sd=0.0)
    with pytest.raises(DasError, match="all values are the same"):
        fit_mixed_model(made_up_study(flat, 1), VECTOR)


@cache
def found(name: str, seed: int = 1, **settings: float) -> AssumptionCheck:
    """The check whose name holds some words, on a made-up study."""
    study = made_up_study(Truth(drivers=40, days=6, extra=dict(settings)), seed)
    (check,) = [one for one in checked(study, VECTOR) if name in one.name]
    return check


def test_drift_from_trial_to_trial_is_noticed() -> None:
    assert found("tire").holds
    check = found("tire", drift=0.002)
    assert check.holds is False
    assert re.match(r"with each further trial, the measure is 0\.2\d points higher, p below 0\.001", check.found)


def test_what_a_trial_leaves_behind_is_noticed() -> None:
    assert found("trial before").holds
    assert found("trial before", carried=0.02).holds is False


def test_an_effect_of_what_came_first_is_noticed() -> None:
    """A drift makes whatever comes later larger, and so the difference depends on what came first."""
    assert found("came first").holds
    assert found("came first", drift=0.004).holds is False


def test_noise_that_differs_is_said() -> None:
    check = found("scatter alike")
    assert check.holds is False
    assert check.found.startswith("vector scatters ")


def test_few_shared_days_are_said_to_be_few() -> None:
    assert found("days").holds
    study = made_up_study(Truth(days=2), 1)
    check = checked(study, VECTOR)[-1]
    assert check.holds is False
    assert "2 days that drivers share" in check.found


def test_pairs_have_one_driver_and_one_day() -> None:
    study = made_up_study(Truth(drivers=7, days=3), 1)
    trials = study.trials
    pairs = paired_trials(study, VECTOR)
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
    study = without(made_up_study(Truth(drivers=7, days=3), 1), [0])
    pairs = paired_trials(study, VECTOR)
    assert (len(pairs.owner), pairs.unpaired) == (20, 1)


def test_practice_is_left_out() -> None:
    study = made_up_study(Truth(drivers=7, days=3), 1)
    practice = study.trials.day == "0"
    pairs = paired_trials(replace(study, trials=replace(study.trials, practice=practice)), VECTOR)
    assert len(pairs.owner) == 14


def test_without_a_day_in_common_pairs_are_by_driver() -> None:
    """People may be given another day in each condition, so that they do not learn it."""
    study = made_up_study(Truth(drivers=7, days=3), 1)
    day = np.array([str(i) for i in range(len(study.trials))])
    pairs = paired_trials(replace(study, trials=replace(study.trials, day=day)), VECTOR)
    assert (len(pairs.owner), pairs.same_day) == (7, False)
    alike = paired_trials(study, VECTOR)
    assert pairs.differences == pytest.approx(alike.by_participant(alike.differences))


def test_groups_are_compared_by_the_means_of_their_drivers() -> None:
    study = made_up_study(Truth(drivers=10, days=3), 1)
    names = study.trials.participant
    level = np.where(names < "sub-006", "none", "vector")
    factor = VariedFactor(name="presentation", levels=("none", "vector"), within=False)
    study = replace(
        study,
        plan=replace(study.plan, factors=(factor,)),
        trials=replace(study.trials, levels={"presentation": level}),
    )
    groups = two_groups(study, VECTOR)
    assert (groups.a_names[0], len(groups.a), len(groups.b)) == ("sub-006", 5, 5)
    assert groups.b[0] == pytest.approx(study.trials.values[MEASURE][names == "sub-001"].mean())
