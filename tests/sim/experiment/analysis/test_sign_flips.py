"""Sign flips: against scipy and the definition, and as often wrong as they say."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import stats

from docs.studies.null_experiments import NULLS, SIZES, false_alarms
from sim.experiment.analysis.comparing import (
    FLIPS,
    SOME_FLIPS,
    Floats,
    interval,
    paired_estimate,
    probabilities,
    signs_of,
)
from tests.support.made_up_study import EIGHT_POINTS

EIGHT = np.array(EIGHT_POINTS)


@cache
def signs(drivers: int, patterns: int = 2**15) -> Floats:
    return signs_of(drivers, np.random.default_rng(1), patterns)


def p(values: Floats) -> float:
    return float(probabilities(values[None], signs(len(values)))[0])


@pytest.mark.parametrize("drivers", [3, 8, 12])
def test_p_is_that_of_scipy(drivers: int) -> None:
    values = np.random.default_rng(drivers).gamma(2.0, size=drivers) - 1.2
    witness = stats.permutation_test(
        (values,),
        lambda one, axis: one.mean(axis=axis),
        permutation_type="samples",
        n_resamples=np.inf,
        vectorized=True,
    )
    assert p(values) == pytest.approx(witness.pvalue)


@pytest.mark.parametrize("drivers", [6, 8, 12, 24])
def test_the_interval_holds_what_the_test_does_not_reject(drivers: int) -> None:
    values = np.random.default_rng(drivers).gamma(2.0, size=drivers) - 1.2
    for bound, outwards in zip(interval(values, signs(drivers), 0.95), (-1e-6, 1e-6), strict=True):
        assert p(values - bound - outwards) < 0.05 <= p(values - bound + outwards)


def test_eight_drivers_are_judged_by_the_exact_test_alone() -> None:
    found = paired_estimate(EIGHT, np.random.default_rng(1))
    assert (found.probability, found.method) == (8 / 256, FLIPS)
    assert found.interval == pytest.approx((0.95, 15.5))
    assert found.t_interval == pytest.approx((-0.84, 14.76), abs=0.01)


def test_patterns_drawn_at_random_come_near_to_all_patterns() -> None:
    values = np.random.default_rng(2).normal(0.5, 1.0, 16)
    some = signs(16, 20_000)
    assert len(some) < len(signs(16)) == 2**15
    assert (some[0] == 1).all()
    assert len(np.unique(some[1:] @ 2.0 ** np.arange(16))) > 10_000
    assert probabilities(values[None], some)[0] == pytest.approx(p(values), abs=0.005)
    assert interval(values, some, 0.95) == pytest.approx(interval(values, signs(16), 0.95), abs=0.03)
    assert paired_estimate(np.append(values, 0.1), np.random.default_rng(1)).method == SOME_FLIPS


@pytest.mark.slow
@pytest.mark.parametrize("drivers", SIZES)
@pytest.mark.parametrize("name", list(NULLS)[:3])
def test_without_a_difference_3_5_to_6_5_percent_of_studies_find_one(name: str, drivers: int) -> None:
    found, _ = false_alarms(NULLS[name], drivers, seed=0, studies=20_000, patterns=1024)
    assert 0.035 <= found <= 0.065
