"""What advice saves, split: the parts sum to the difference, and a planted cause is found in its part."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from sim.experiment.one_line import mean_interval, print_savings, savings, student_975, with_interval


def row(driver: str, advice: str, seed: int, *, optimum: float, blending: float, profile: float) -> dict[str, Any]:
    energy = optimum + blending + profile
    return {
        "scenario": "day", "driver": driver, "advice": advice, "seed": seed, "energy_kwh": energy,
        "above_optimum_kwh": blending + profile,
        "energy_optimum_kwh": optimum, "energy_blending_kwh": blending, "energy_profile_kwh": profile,
    }  # fmt: skip


NONE = [row("human", "none", seed, optimum=100.0, blending=20.0 + seed, profile=10.0) for seed in range(3)]
ADVISED = [row("human", "speed-and-effort", seed, optimum=97.0, blending=4.0 + seed, profile=6.0) for seed in range(3)]
PERFECT = [row("perfect", "speed-and-effort", seed, optimum=98.0, blending=0.0, profile=1.0) for seed in range(3)]


def test_the_parts_are_those_planted_and_sum_to_the_difference() -> None:
    (found,) = savings([*NONE, *ADVISED])
    assert (found.advice, found.pairs, found.tracking_kwh) == ("speed-and-effort", 3, None)
    assert found.saved_kwh == pytest.approx(16.0 + 4.0)  # the 3 kWh that the later arrival is worth are not saved
    assert found.saved_ratio == pytest.approx(20.0 / 98.5)  # of the optimum, the mean for both times
    assert (found.time_shift_kwh, found.blending_kwh, found.profile_kwh) == pytest.approx((3.0, 16.0, 4.0))
    assert found.interval_kwh == pytest.approx(0.0, abs=1e-9)
    assert found.optimum_kwh == pytest.approx(98.5)


def test_beside_a_perfect_driver_the_profile_is_that_of_the_advice_and_the_rest_is_tracking() -> None:
    found = next(one for one in savings([*NONE, *ADVISED, *PERFECT]) if one.driver == "human")
    assert found.tracking_kwh is not None
    assert (found.profile_kwh, found.tracking_kwh) == pytest.approx((9.0, -5.0))
    parts = found.blending_kwh + found.profile_kwh + found.tracking_kwh
    assert parts == pytest.approx(found.saved_kwh)


def test_only_seeds_that_both_have_are_compared_and_failed_runs_are_left_out() -> None:
    failed = {**ADVISED[1], "error": "stalled"}
    (found,) = savings([NONE[0], NONE[1], ADVISED[0], failed, ADVISED[2]])
    assert found.pairs == 1
    assert math.isnan(found.interval_kwh)
    assert savings(ADVISED) == []


def test_what_cannot_be_compared_and_who_brakes_otherwise_with_advice_saved_nothing_that_can_be_said() -> None:
    faster = {**ADVISED[1], "above_optimum_kwh": None}
    (found,) = savings([*NONE, ADVISED[0], faster])
    assert found.pairs == 1
    assert savings([{**one, "friction_policy": "by-advice"} for one in (*NONE, *ADVISED)]) == []


def test_a_day_is_compared_with_the_same_day_of_the_same_person() -> None:
    """Two persons on one day; the perfect driver of the day belongs to both."""
    persons = [
        {**row, "participant": k, "energy_kwh": row["energy_kwh"] + 10 * k} for row in (NONE[0],) for k in (1, 2)
    ]
    persons += [{**ADVISED[0], "participant": k, "energy_kwh": ADVISED[0]["energy_kwh"] + 10 * k} for k in (1, 2)]
    found = next(one for one in savings([*persons, PERFECT[0]]) if one.driver == "human")
    assert (found.pairs, found.saved_kwh) == pytest.approx((2, 20.0))
    assert math.isnan(found.interval_kwh)
    assert found.tracking_kwh == pytest.approx(-5.0)


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 9, 10, 49, 400])
def test_the_edge_of_students_t_is_that_of_scipy(freedom: int) -> None:
    assert student_975(freedom) == pytest.approx(float(stats.t.ppf(0.975, freedom)), rel=1e-9)


def test_a_mean_has_students_interval_and_none_of_two_values() -> None:
    """t(0.975) with 2 degrees of freedom is 4.303; the standard error of 1, 2, 3 is 1/√3."""
    values = np.array([1.0, 2.0, 3.0])
    assert mean_interval(values) == pytest.approx(4.302653 / math.sqrt(3.0))
    assert with_interval(values) == "+2.0 ± 2.5"
    assert math.isnan(mean_interval(values[:2]))
    assert with_interval(values[:2]) == "+1.5"


def test_two_days_print_a_saving_without_an_interval(capsys: pytest.CaptureFixture[str]) -> None:
    more = [{**row, "energy_kwh": row["energy_kwh"] + row["seed"]} for row in NONE]
    print_savings(savings([*more[:2], *ADVISED[:2]]))
    assert savings([*more[:2], *ADVISED[:2]])[0].as_dict()["interval_kwh"] is None
    two = capsys.readouterr().out
    print_savings(savings([*more, *ADVISED]))
    three = capsys.readouterr().out
    assert "+20.5 " in two
    assert "±" not in two
    assert "+21.0 ± 2.5" in three
