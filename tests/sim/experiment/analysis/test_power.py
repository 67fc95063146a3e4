"""Power: against the noncentral t distribution, and against how often made-up studies find what is planted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from das.domain.errors import DasError
from sim.experiment.analysis.differences import TwoGroups, paired_trials
from sim.experiment.analysis.power import (
    BellCurves,
    PilotGroups,
    PowerQuestion,
    answer,
    normal_participants,
    normal_power,
    of_pilot,
    of_pilot_groups,
    participants_needed,
    power_of,
)
from sim.options import PowerAsked
from tests.support.made_up_study import (
    APART,
    SAME,
    Truth,
    compared,
    drawn,
    made_up_groups,
    made_up_study,
    positive,
    write_study,
)


@pytest.mark.nightly
def test_a_planted_point_is_found_as_often_as_power_predicts() -> None:
    """The prediction comes from a pilot of 400 drivers, so that it is not off because its pilot was small."""
    truth = Truth(drivers=48, means=(0.26, 0.25, 0.25), effect_sd=0.02)
    pilot = made_up_study(Truth(drivers=400, means=truth.means, effect_sd=truth.effect_sd), 10_000)
    source = of_pilot(paired_trials(pilot, compared("speed-and-effort", "none")), None)
    predicted = power_of(PowerQuestion(effect=-0.01, alpha=0.05, source=source), truth.drivers).power
    assert 0.6 < predicted < 0.9
    assert positive(truth, "speed-and-effort", "none") == pytest.approx(predicted, abs=0.07)


@pytest.mark.parametrize(("groups", "effect", "numbers"), [(False, 0.8, (16, 40, 90)), (True, 1.2, (16, 60))])
def test_power_of_bell_curves_is_that_of_the_noncentral_t_distribution(
    groups: bool, effect: float, numbers: tuple[int, ...]
) -> None:
    source = BellCurves(between_sd=2.0, within_sd=1.5, pairs=3, groups=groups)
    sd = float(np.hypot(2.0, 1.5 / np.sqrt(3.0)))
    for participants in numbers:
        found = power_of(PowerQuestion(effect=effect, alpha=0.05, source=source), participants)
        assert found.power == pytest.approx(normal_power(effect / sd, participants, 0.05, groups=groups), abs=0.035)
        assert found.interval[0] < found.power < found.interval[1]


def test_published_and_first_estimates_are_found_again() -> None:
    """L2 less L3 through a person: 0.78 points, where persons differ by 2.4 points (issue 17)."""
    assert normal_participants(0.78 / 2.4, 0.05, 0.8) == 77
    # Cohen (1988), table 2.4.1: d = 0.5 at a level of 0.05 and a power of 0.8 takes 64 in each group.
    assert normal_participants(0.5, 0.05, 0.8, groups=True) == 64
    question = PowerQuestion(effect=0.78, alpha=0.05, source=BellCurves(between_sd=2.4), studies=800)
    assert participants_needed(question, 0.8) == pytest.approx(77, abs=8)


def test_what_no_number_of_participants_finds_is_said() -> None:
    question = PowerQuestion(effect=1e-6, alpha=0.05, source=BellCurves(between_sd=1.0), studies=20)
    assert participants_needed(question, 0.8) is None
    assert normal_participants(0.0, 0.05, 0.8) is None


def test_a_pilot_has_the_spread_between_drivers_and_between_their_pairs() -> None:
    """More pairs for each driver take away noise, but not the differences between drivers."""
    truth = Truth(drivers=600, days=4, effect_sd=0.02, noise=(0.0, 0.0, 0.03), skewed=False)
    pairs = paired_trials(made_up_study(truth, 3), compared("speed-and-effort", "none"))
    rng = np.random.default_rng(1)
    for each in (1, 4, 16):
        values = of_pilot(pairs, each).draw(200, 100, rng)
        assert values.std() == pytest.approx(np.hypot(0.02, 0.03 / np.sqrt(each)), rel=0.06)
        assert values.mean() == pytest.approx(0.0, abs=0.001)


@pytest.mark.slow
def test_a_planted_difference_of_groups_is_found_as_often_as_power_predicts() -> None:
    """Skewed drivers, one group twice as wide as the other; a pilot of 400 in each group."""
    rng = np.random.default_rng(5)

    names = tuple(f"sub-{number}" for number in range(400))
    pilot = TwoGroups(a=2.0 * drawn(rng, (400,), True), b=drawn(rng, (400,), True), a_names=names, b_names=names)
    predicted = power_of(PowerQuestion(effect=1.0, alpha=0.05, source=of_pilot_groups(pilot)), 40).power
    assert 0.6 < predicted < 0.95
    found = stats.ttest_ind(
        1.0 + 2.0 * drawn(rng, (600, 40), True), drawn(rng, (600, 40), True), axis=1, equal_var=False
    ).pvalue
    assert np.mean(found < 0.05) == pytest.approx(predicted, abs=0.07)


@pytest.mark.slow
@pytest.mark.parametrize("skewed", [False, True])
def test_without_a_difference_of_groups_3_5_to_6_5_percent_of_studies_find_one(skewed: bool) -> None:
    """One group is twice as wide as the other; its drivers are those of a pilot of 4000."""
    rng = np.random.default_rng(1)
    a, b = (sd * drawn(rng, (4000,), skewed) for sd in (1.0, 2.0))
    source = PilotGroups(a=a - a.mean(), b=b - b.mean())
    assert 0.035 <= power_of(PowerQuestion(effect=0.0, alpha=0.05, source=source), 12).power <= 0.065


def asked(source: Path | None, **settings: Any) -> PowerAsked:
    return PowerAsked(source=source, effect=20.0, participants="8", **settings)


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
