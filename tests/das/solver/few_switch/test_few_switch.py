"""Few-switch trajectories: against the dual bound of the optimum, the independent verifier, and the price of a
change."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from das.domain.files.load import locate_route, locate_vehicle
from das.solver.few_switch.few_switch import (
    FewSwitchFront,
    FewSwitchTrajectory,
    NotchRegime,
    goals,
    solve_few_switch_ahead,
)
from das.solver.solution import trajectory_on
from das.solver.solve import BEHIND_M
from das.solver.state import State
from tests.support.few_switch import BUFFERS, BUNDLED, Which, asked_s, excess_ratio, few_switch_of, front_of, section_of
from tests.support.making import csv_rows
from tests.support.raw_data import Line, Train
from tests.support.verifier import verify

BOUND_RATIO = 5e-4
"""A run is integrated more finely than the table behind the bound, and may be below it by this share."""
PRICES_S = (0.003, 0.03, 0.3)
RUNS = [(which, buffer) for which in BUNDLED for buffer in BUFFERS]


def run_of(which: Which, buffer_ratio: float) -> FewSwitchTrajectory:
    front = few_switch_of(which)
    return front.run(asked_s(which, buffer_ratio), front.section.start_m, 0.0)


def changes(run: FewSwitchTrajectory) -> int:
    return sum(a != b for a, b in pairwise(run.notch.tolist()))


@pytest.mark.parametrize(("which", "buffer_ratio"), RUNS)
def test_a_few_switch_trajectory_is_in_time_and_within_a_hundredth_above_the_dual_bound(
    which: Which, buffer_ratio: float
) -> None:
    """Measured: 0.15 to 0.46 % above the bound of the optimum in the run's own time."""
    run = run_of(which, buffer_ratio)
    assert run.time_s <= asked_s(which, buffer_ratio)
    assert -BOUND_RATIO <= excess_ratio(which, run.energy_j, run.time_s) <= 0.01


@pytest.mark.parametrize("which", BUNDLED)
def test_a_higher_price_of_change_makes_no_more_changes_and_costs_no_less(which: Which) -> None:
    """At one price of time; with the highest price there are fewer changes than with the lowest, somewhere."""
    counts = []
    for step in range(2, 32, 6):
        runs = [few_switch_of(which, price).roll_out(State.at(section_of(which)), step, step, 0) for price in PRICES_S]
        costs = [run.energy_j + run.lambda_w * run.time_s for run in runs]
        for (quiet, busy), (more, less) in zip(pairwise(map(changes, runs)), pairwise(costs), strict=True):
            assert busy <= quiet
            assert less >= more * (1.0 - 1e-3)
        counts.append([changes(run) for run in runs])
    assert np.array(counts)[:, 0].sum() > np.array(counts)[:, -1].sum() + 4


@pytest.mark.parametrize(("which", "buffer_ratio"), RUNS[1::2])
def test_nothing_is_wrong_with_a_few_switch_trajectory(which: Which, buffer_ratio: float) -> None:
    """A verifier that shares no code with the solver: limits, forces, brakes, accelerations, motion."""
    run, section = run_of(which, buffer_ratio), section_of(which)
    line, train = Line.read(locate_route(which[0])), Train.read(locate_vehicle("re460-ic"))
    rows = csv_rows(trajectory_on(section, section, run.speeds_mps))
    assert verify(rows, line, train, section.loss.loss_w, ends_m=(section.start_m, section.end_m)) == []
    assert (run.speeds_mps <= section.envelope_mps + 1e-9).all()


@pytest.mark.parametrize("which", BUNDLED)
def test_time_and_energy_of_a_run_are_those_of_its_trajectory(which: Which) -> None:
    """Second witness: times and energy balance of `trajectory_on`, with the loss model in Python."""
    run, section = run_of(which, 0.08), section_of(which)
    trajectory = trajectory_on(section, section, run.speeds_mps)
    assert run.time_s == pytest.approx(trajectory.time_s, abs=1e-6)
    assert run.energy_j == pytest.approx(trajectory.balance(section.vehicle, section.loss).input, rel=1e-9)


@pytest.mark.parametrize("which", BUNDLED)
def test_with_less_time_than_there_is_it_runs_as_fast_as_it_can(which: Which) -> None:
    """A buffer of nothing is met to within 1 %, and no run is faster than the fastest."""
    front, least_s = few_switch_of(which), front_of(which).fastest().time_s
    run = front.run(0.5 * least_s, front.section.start_m, 0.0)
    assert least_s - 1e-6 <= run.time_s <= 1.01 * least_s


@pytest.mark.parametrize("which", BUNDLED)
def test_from_any_state_there_is_a_few_switch_trajectory_in_time(which: Which) -> None:
    """Random states within the envelope, in any notch; where there is 10 % more time than the least, it is kept to."""
    front, section, random = few_switch_of(which), section_of(which), np.random.default_rng(3)
    for _ in range(40):
        s_m = float(random.uniform(section.start_m, section.end_m - 300.0))
        v_mps = float(np.interp(s_m, section.node_m, section.envelope_mps) * random.uniform(0.0, 0.98))
        asked = 1.1 * front_of(which).least_time_s(s_m, v_mps) + 5.0
        run = front.run(asked, s_m, v_mps, int(random.integers(len(front.notches.kind))))
        assert run.time_s <= asked
        assert run.speeds_mps[-1] == pytest.approx(0.0, abs=1e-6)
        assert (run.speeds_mps <= run.state.envelope_mps + 1e-9).all()


def test_a_train_in_a_notch_keeps_it_where_a_change_is_not_worth_its_price() -> None:
    """The same state in two notches: the price of change keeps a run in the one that it is in."""
    front = few_switch_of(BUNDLED[1], 0.3)
    section = front.section
    kinds = front.notches.kind.tolist()
    coast, hold = kinds.index(NotchRegime.COAST), kinds.index(NotchRegime.HOLD)
    state = State.at(section, section.start_m + 3000.0, 25.0)
    kept = [
        notch
        for notch in (coast, hold)
        if any(front.roll_out(state, i, i, 0, notch).notch[0] == notch for i in range(len(front.lambda_w)))
    ]
    assert kept == [coast, hold]


def test_goals_are_the_speeds_to_which_the_envelope_falls() -> None:
    """By hand: falling to 10, level, rising, falling to the stop."""
    envelope = np.array([20.0, 15.0, 10.0, 10.0, 25.0, 12.0, 0.0])
    assert goals(envelope).tolist() == [10.0, 10.0, 10.0, 10.0, 0.0, 0.0, 0.0]


AHEAD_RATIO = 0.6
"""Share of the section that lies behind a train under way, for which only the rest is solved."""


@pytest.fixture(scope="module")
def whole() -> FewSwitchFront:
    return few_switch_of(BUNDLED[3])


@pytest.fixture
def ahead(whole: FewSwitchFront) -> FewSwitchFront:
    return solve_few_switch_ahead(whole.section, at_m(whole, AHEAD_RATIO))


def at_m(front: FewSwitchFront, ratio: float) -> float:
    return front.section.start_m + ratio * (front.section.end_m - front.section.start_m)


def same_rows(one: FewSwitchFront, other: FewSwitchFront, first: int) -> bool:
    return np.array_equal(one.policy.choice[first:], other.policy.choice[first:]) and np.array_equal(
        one.policy.stay[first:], other.policy.stay[first:]
    )


def test_what_is_ahead_has_the_same_bits_and_nothing_behind_is_solved(
    whole: FewSwitchFront, ahead: FewSwitchFront
) -> None:
    assert ahead.sweep is not None
    first = ahead.sweep.known_from
    node_m = float(whole.section.node_m[whole.section.decision[first]])
    assert node_m == pytest.approx(at_m(whole, AHEAD_RATIO) - BEHIND_M, abs=150.0)
    assert same_rows(ahead, whole, first)
    for ratio in (AHEAD_RATIO - 0.01, AHEAD_RATIO, 0.8, 0.97):
        one, other = (front.run(600.0, at_m(whole, ratio), 15.0) for front in (whole, ahead))
        assert np.array_equal(one.speeds_mps, other.speeds_mps)
        assert np.array_equal(one.notch, other.notch)
    assert ahead.sweep.known_from == first


def test_a_question_from_further_back_solves_the_rest(whole: FewSwitchFront, ahead: FewSwitchFront) -> None:
    one, other = (front.run(1_200.0, at_m(whole, 0.1), 20.0) for front in (whole, ahead))
    assert np.array_equal(one.speeds_mps, other.speeds_mps)
    assert ahead.sweep is not None
    assert ahead.sweep.known_from == 0
    assert same_rows(ahead, whole, 0)


def test_covering_the_begin_solves_the_rest(whole: FewSwitchFront, ahead: FewSwitchFront) -> None:
    ahead.cover(whole.section.start_m)
    assert same_rows(ahead, whole, 0)
