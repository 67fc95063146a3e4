"""The study of what is known: two labels of one advice, a planted effect, and the share of studies that find it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from docs.studies.known_truth import (
    LABELS,
    PLANTED_RATIO,
    USUAL_RATIO,
    in_words,
    predictions,
    share_without,
    written_design,
)
from sim.experiment.design import read_design


def test_two_labels_are_of_one_advice_and_the_third_asks_more_of_the_friction_brake(tmp_path: Path) -> None:
    design = read_design(written_design(tmp_path, 6, first=1))
    assert [level.text for level in design.factors[0].levels] == list(LABELS)
    settings = list(design.settings())
    humans = [one.read_scenario().human.given["friction_ratio"] for one in settings]
    assert [(one.low, one.high) for one in humans] == [
        (ratio, ratio) for ratio in (USUAL_RATIO, USUAL_RATIO, PLANTED_RATIO)
    ]
    usual, same = (Path(one.scenario).read_text(encoding="utf-8").splitlines() for one in settings[:2])
    assert [pair for pair in zip(usual, same, strict=True) if pair[0] != pair[1]] == [
        ('id = "advice"', 'id = "same-advice"')
    ]


def test_labels_that_mean_nothing_are_told_apart_in_3_to_8_percent_of_studies() -> None:
    """Even where the drives happen to differ in the mean, because a coin decides which has which label."""
    values = np.random.default_rng(1).normal(0.3, 1.0, 200)
    share = share_without(values, 24, studies=1000)
    assert 0.03 <= share.found <= 0.08
    assert share.interval[0] < share.found < share.interval[1]
    assert in_words(share).startswith(f"{100 * share.found:.1f} % (")
    assert share_without(values, 24, studies=250) == share_without(values, 24, studies=250)


def test_halves_of_many_drivers_predict_the_power_of_each_other() -> None:
    values = np.random.default_rng(2).normal(0.4, 1.0, 2000)
    found = predictions(values, 24, splits=2)
    assert np.all((found.found > 0.2) & (found.found < 0.7))
    assert found.predicted == pytest.approx(found.found, abs=0.07)
    assert found.off.max() <= 0.07
