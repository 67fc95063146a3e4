"""Factors between participants: two groups are compared, modelled, checked, and their power is computed."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.experiment.analysis.comparing import analyse_study
from sim.experiment.analysis.differences import TwoGroups, group_estimate, group_size_interval, two_groups
from sim.experiment.analysis.mixed_model import fit_mixed_model
from sim.experiment.analysis.page import as_dict, page
from sim.experiment.analysis.power import (
    Asked,
    BellCurves,
    PowerQuestion,
    answer,
    normal_participants,
    normal_power,
    of_pilot_groups,
    power_of,
)
from sim.experiment.analysis.reading import Floats, RunStudy, read_study
from sim.experiment.analysis.resampling import resampled, weights
from tests.support.made_up_study import MEASURE, Truth, checked, compared, made_up_groups, write_study

SAME = Truth(means=(0.25, 0.25), noise=(0.01, 0.02), effect_sd=0.0)
APART = compared("top-speed", "none")


def holds(study: RunStudy, words: str) -> bool | None:
    (found,) = [one for one in checked(study, APART) if words in one.name]
    return found.holds


@pytest.mark.parametrize("skewed", [False, True])
def test_without_a_difference_3_to_8_percent_of_studies_find_one(skewed: bool) -> None:
    """The same test as of the analysis, on 1000 studies of two groups of 12 drivers."""
    rng = np.random.default_rng(1)
    a, b = (
        sd * (rng.gamma(3.0, size=(1000, 12)) - 3.0 if skewed else rng.normal(size=(1000, 12))) for sd in (1.0, 2.0)
    )
    found = resampled((a, b), (weights(12, 599, rng), weights(12, 599, rng))).probabilities
    assert 0.03 <= np.mean(found < 0.05) <= 0.08


def test_groups_tested_at_once_are_those_tested_alone() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(1.0, 1.0, (4, 10)), rng.normal(0.0, 2.0, (4, 14))
    drawn = np.random.default_rng(3)
    both = (weights(10, 499, drawn), weights(14, 499, drawn))
    alone = [group_estimate(a[i], b[i], 499, np.random.default_rng(3)).probability for i in range(4)]
    assert resampled((a, b), both).probabilities == pytest.approx(alone)


def test_the_interval_of_the_size_holds_the_truth_as_often_as_it_says() -> None:
    """Bonett's interval allows for groups that differ in variance: the true size is 1 over the root of 2.5."""
    rng = np.random.default_rng(4)
    truth = 1.0 / np.sqrt(0.5 * (1.0 + 4.0))
    held = [
        low <= truth <= high
        for low, high in (group_size_interval(rng.normal(1.0, 1.0, 20), rng.normal(0.0, 2.0, 30)) for _ in range(500))
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


def test_the_model_recovers_the_difference_and_the_spread_of_the_drivers() -> None:
    truth = Truth(drivers=100, days=4, means=(0.26, 0.24), noise=(0.01, 0.02), effect_sd=0.0, skewed=False)
    study = made_up_groups(truth, 2)
    fit, groups = fit_mixed_model(study, APART), two_groups(study, APART)
    assert fit.interval[0] < -0.02 < fit.interval[1]
    assert fit.effect == pytest.approx(groups.a.mean() - groups.b.mean(), abs=1e-3)
    welch = group_estimate(groups.a, groups.b, 199, np.random.default_rng(1)).t_interval
    assert fit.interval == pytest.approx(welch, abs=1.5e-3)
    assert fit.level_sd == pytest.approx(0.03, rel=0.15)
    assert fit.noise == pytest.approx((0.02, 0.01), rel=0.15)
    assert np.isnan(fit.effect_sd)
    assert (fit.converged, fit.singular, fit.remarks) == (True, False, ())


def test_drivers_with_one_trial_have_no_model() -> None:
    with pytest.raises(DasError, match="each driver made one trial"):
        fit_mixed_model(made_up_groups(replace(SAME, days=1), 1), APART)


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


def test_power_of_two_groups_is_that_of_the_noncentral_t_distribution() -> None:
    source = BellCurves(between_sd=2.0, within_sd=1.0, pairs=2, groups=True)
    sd = float(np.hypot(2.0, 1.0 / np.sqrt(2.0)))
    for each in (16, 60):
        found = power_of(PowerQuestion(effect=1.2, alpha=0.05, source=source, studies=1000), each).power
        assert found == pytest.approx(normal_power(1.2 / sd, each, 0.05, groups=True), abs=0.045)
    # Cohen (1988), table 2.4.1: d = 0.5 at a level of 0.05 and a power of 0.8 takes 64 in each group.
    assert normal_participants(0.5, 0.05, 0.8, groups=True) == 64


def test_a_planted_difference_of_groups_is_found_as_often_as_power_predicts() -> None:
    """Skewed drivers, one group twice as wide as the other; a pilot of 400 in each group."""
    rng = np.random.default_rng(5)

    def drawn(shape: tuple[int, ...], sd: float) -> Floats:
        return sd * (rng.gamma(3.0, size=shape) - 3.0) / np.sqrt(3.0)

    names = tuple(f"sub-{number}" for number in range(400))
    pilot = TwoGroups(a=drawn((400,), 2.0), b=drawn((400,), 1.0), a_names=names, b_names=names)
    predicted = power_of(PowerQuestion(effect=1.0, alpha=0.05, source=of_pilot_groups(pilot)), 40).power
    assert 0.6 < predicted < 0.95
    both = (1.0 + drawn((600, 40), 2.0), drawn((600, 40), 1.0))
    found = resampled(both, (weights(40, 999, rng), weights(40, 999, rng))).probabilities
    assert np.mean(found < 0.05) == pytest.approx(predicted, abs=0.07)


def asked(source: Path | None, **settings: object) -> Asked:
    usual = {
        "effect": 20.0, "comparison": None, "participants": (8,), "wanted": 0.8, "sd": None, "sd_of_pairs": 0.0,
        "pairs": None, "alpha": None, "seed": 0,
    }  # fmt: skip
    return Asked(source=source, **{**usual, **settings})  # type: ignore[arg-type]


def test_the_power_of_a_pilot_of_groups_is_for_each_group(tmp_path: Path) -> None:
    study = made_up_groups(replace(SAME, drivers=16), 1)
    study = replace(study, plan=replace(study.plan, comparisons=(APART,)))
    folder = write_study(study, tmp_path / "pilot")
    found = answer(asked(folder))
    assert found.groups
    assert "8 participants of the pilot with top-speed and 8 with none" in found.about
    assert "in each of the two groups" in found.sentences[0]
    with pytest.raises(DasError, match="is one of two groups, whose participants make no pairs"):
        answer(asked(folder, pairs=3))
    # A design tells whether its comparison is one of two groups.
    assert answer(asked(folder / "design.json", sd=2.0)).groups
    with pytest.raises(DasError, match="--groups: expected together with --sd"):
        answer(asked(folder, groups=True))


def test_the_page_has_model_checks_and_numbers_for_groups(tmp_path: Path) -> None:
    study = made_up_groups(replace(SAME, drivers=24), 1)
    study = replace(study, plan=replace(study.plan, comparisons=(APART,)))
    folder = write_study(study, tmp_path / "study")
    rows = [f"sub-{number:03d}\tdefault\t{number}\tnone\t{number % 7}" for number in range(1, 25)]
    head = "participant_id\tpopulation\tperson\tpresentation\treaction_median_s"
    (folder / "participants.tsv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    found = analyse_study(read_study(folder), (0.78,), resamples=999)
    text = re.sub(r"\s+", " ", page(found))
    for said in (
        "in each group",
        "alike in who they are",
        "reaction_median_s",
        "of one size",
        "two groups of 12 and 12",
    ):
        assert said in text
    (row,) = as_dict(found)["differences"]
    assert row["model"]["converged"]
    assert row["effect_size_interval"][0] < row["effect_size"] < row["effect_size_interval"][1]
    assert len(row["groups"]["a"]) == len(row["groups"]["b"]) == 12
    assert row["participants_needed"][0]["participants"] > 12
    assert json.dumps(as_dict(found), allow_nan=False)
