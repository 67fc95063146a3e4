"""The search for a time: it hits the time, brackets it, and stops as its settings say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.solver import front
from das.solver import tolerances as tol
from das.solver.front import Front, TimeSearch
from das.solver.kernels.policy_values import blended_values
from das.solver.kernels.tuples import Policies, Policy
from das.solver.solution import Fit
from das.solver.state import State


def search(hilly: Front, buffer_ratio: float) -> TimeSearch:
    state = State.at(hilly.section)
    return TimeSearch(hilly.policies, state, state.fastest().time_s * (1 + buffer_ratio), tol.TIME_TOLERANCE_S)


@pytest.mark.parametrize("buffer_ratio", [0.001, 0.02, 0.1, 0.4])
def test_the_time_is_hit(hilly: Front, buffer_ratio: float) -> None:
    wanted = search(hilly, buffer_ratio)
    found, lambda_w, fit = wanted.run()
    assert fit is Fit.ON_TIME
    assert abs(found.time_s - wanted.time_s) <= wanted.tolerance_s
    same = hilly.trajectory(wanted.time_s)
    assert np.array_equal(found.speeds_mps, same.trajectory.v_mps)
    assert lambda_w == same.lambda_w


def test_a_policy_at_a_place_of_the_ladder_lies_between_its_neighbours(hilly: Front) -> None:
    wanted, ladder = search(hilly, 0.1), hilly.lambda_w
    whole, between = wanted.policy(20.0), wanted.policy(20.25)
    assert whole == (ladder[20], 20, 0.0, 0.0)
    assert between.ladder_index == 20
    assert between.gap_w == ladder[21] - ladder[20]
    assert between.price_w == pytest.approx(0.75 * ladder[20] + 0.25 * ladder[21])
    assert wanted.price_w(20.25) == pytest.approx(between.price_w)


def test_a_higher_price_of_time_gives_a_quicker_run(hilly: Front) -> None:
    wanted = search(hilly, 0.1)
    trials = [wanted.attempt(place) for place in (5.0, 15.0, 25.5, 40.0, 60.0)]
    times_s = [trial.run.time_s for trial in trials]
    assert times_s == sorted(times_s, reverse=True)
    assert [trial.miss_s for trial in trials] == [time_s - wanted.time_s for time_s in times_s]


@pytest.mark.parametrize(("late_s", "early_s", "share"), [(1.0, -3.0, 0.25), (1.0, -1e6, 0.02), (1e6, -1.0, 0.98)])
def test_the_next_trial_is_placed_by_the_misses_and_keeps_off_both_ends(
    hilly: Front, late_s: float, early_s: float, share: float
) -> None:
    assert search(hilly, 0.1)._share(late_s, early_s) == pytest.approx(share)


def test_one_trial_is_the_most_where_no_more_are_allowed(monkeypatch: pytest.MonkeyPatch, hilly: Front) -> None:
    """With one multiplier tried and no blend the run is what that multiplier gives: the time is missed."""
    wanted = search(hilly, 0.1)
    exact, _, fit = wanted.run()
    monkeypatch.setattr(front, "MAX_ROLL_OUTS", 1)
    monkeypatch.setattr(front, "MAX_BLENDS", 0)
    rough, _, _ = search(hilly, 0.1).run()
    assert fit is Fit.ON_TIME
    assert abs(rough.time_s - wanted.time_s) > abs(exact.time_s - wanted.time_s)


def test_blends_lie_between_their_runs(hilly: Front) -> None:
    wanted = search(hilly, 0.1)
    slow, quick = wanted.attempt(10.0).run, wanted.attempt(40.0).run
    state = wanted.state
    middle = state.blend(0.5, quick, slow)
    assert quick.time_s < middle.time_s < slow.time_s
    assert state.blend(0.0, quick, slow).time_s == pytest.approx(slow.time_s, rel=1e-6)
    assert state.blend(1.0, quick, slow).time_s == pytest.approx(quick.time_s, rel=1e-6)


@pytest.mark.parametrize("offset_w", [0.0, 1000.0, 3000.0])
def test_values_between_two_multipliers_are_those_of_the_cubic_with_their_times_as_slopes(offset_w: float) -> None:
    """Of four values and slopes that are those of a cubic, every value between is its own."""
    cubic = np.polynomial.Polynomial([9e6, 300.0, 0.02, -1e-6])
    ladder_w = np.array([2000.0, 6000.0])
    value_j, time_s = (np.tile(of(ladder_w), (1, 3, 1)) for of in (cubic, cubic.deriv()))
    policies = Policies(lambda_w=ladder_w, value_j=value_j, time_to_go_s=time_s.astype(np.float32))
    row = np.full(3, np.nan)
    blended_values(policies, Policy(2000.0 + offset_w, 0, offset_w, 4000.0), 0, 1, 2, row)
    assert row[1:] == pytest.approx(cubic(2000.0 + offset_w), rel=1e-9)
    assert math.isnan(row[0])
