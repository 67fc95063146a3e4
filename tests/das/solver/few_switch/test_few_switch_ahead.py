"""Few-switch trajectories of a train under way: solved for what is ahead alone, with the bits of the whole."""

from __future__ import annotations

import numpy as np
import pytest

from das.solver.few_switch.few_switch import FewSwitchFront, solve_few_switch, solve_few_switch_ahead
from das.solver.solve import BEHIND_M
from tests.support.few_switch import section_of

WHICH = ("zurich-luzern", 2)
AHEAD_RATIO = 0.6


@pytest.fixture(scope="module")
def whole() -> FewSwitchFront:
    return solve_few_switch(section_of(WHICH))


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
