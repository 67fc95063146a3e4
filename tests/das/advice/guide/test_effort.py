"""The braking effort that is shown: enough for a late driver, and seldom another one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from das.advice.braking import BRAKED_MORE, LEAST_MPS2, BrakingAhead, NeededBrake
from das.advice.goal import TrainState
from das.advice.guide.guard import (
    LESS_RATIO,
    STEP_RATIO,
    rate_mps2,
    shown_effort,
    stepped,
    way_m,
)
from das.advice.guide.memory import Memory
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH
from das.solver.section import build_section
from tests.support.guide import flat
from tests.support.matrix_lines import Cell, Who, files_of

AHEAD = BrakingAhead(flat())
BOARD_M, TO_MPS = 4000.0, 60 * KMH


def board(effort: float) -> NeededBrake:
    return NeededBrake(effort, TO_MPS, BOARD_M)


def at(way_left_m: float, kmh: float) -> TrainState:
    return TrainState(0, BOARD_M - way_left_m, kmh * KMH)


def shows(needed: NeededBrake, state: TrainState, kept: float | None = None, begin_m: float = -math.inf) -> float:
    memory = Memory() if kept is None else Memory(efforts={needed.at_m: kept})
    return shown_effort(AHEAD, needed, memory, state, begin_m)


@pytest.mark.parametrize(("effort", "step"), [(0.41, 0.45), (0.45, 0.45), (0.0, STEP_RATIO), (1.0, 1.0), (1.11, 1.15)])
def test_efforts_are_shown_in_steps_that_are_enough(effort: float, step: float) -> None:
    assert stepped(effort) == pytest.approx(step)


def test_the_first_effort_for_a_lower_limit_is_enough_for_a_driver_who_acts_late() -> None:
    """At 100 km/h, 800 m before a board of 60; from 4 s later it takes a stronger brake, by v² = 2·a·s."""
    state = at(800.0, 100)
    needed = board(AHEAD.effort_to(state.s_m, state.v_mps, BOARD_M, TO_MPS))
    late = AHEAD.effort_to(state.s_m + 4.0 * state.v_mps, state.v_mps, BOARD_M, TO_MPS)
    assert shows(needed, state) == pytest.approx(stepped(late))
    assert shows(needed, state) > stepped(needed.effort)
    begin_m = BOARD_M - 700.0
    announced = board(AHEAD.effort_to(begin_m, state.v_mps, BOARD_M, TO_MPS))
    late = AHEAD.effort_to(begin_m + 2.0 * state.v_mps, state.v_mps, BOARD_M, TO_MPS)
    assert shows(announced, at(900.0, 100), begin_m=begin_m) == pytest.approx(stepped(late))
    assert stepped(late) > stepped(announced.effort), "an announced brake is begun up to 2 s late"
    stop = NeededBrake(0.5, 0.0, BOARD_M)
    assert shows(stop, state) == pytest.approx(0.5), "a stop has no board to pass too fast"


def test_an_effort_that_is_enough_stands_until_far_less_is_needed() -> None:
    state = at(900.0, 100)
    assert shows(board(0.5), state, kept=0.5) == 0.5
    assert shows(board(0.5 * LESS_RATIO + 0.01), state, kept=0.5) == 0.5
    assert shows(board(0.5 * LESS_RATIO - 0.01), state, kept=0.5) == pytest.approx(0.25)


def test_an_effort_does_not_fall_before_its_brake_begins_nor_shortly_before_its_speed() -> None:
    state = at(900.0, 100)
    assert shows(board(0.1), state, kept=0.5, begin_m=state.s_m + 50.0) == 0.5
    assert shows(board(0.1), at(60.0, 65), kept=0.8) == 0.8


def test_an_effort_that_is_too_small_grows_once_and_asks_for_friction_only_when_needed() -> None:
    state = at(500.0, 100)
    grown = shows(board(0.6), state, kept=0.5)
    assert grown >= 0.6
    assert shows(board(0.7), replace_state(state, 480.0), kept=grown) == grown
    assert shows(board(0.99), state, kept=0.5) == pytest.approx(1.0)
    near, limited = at(330.0, 100), BrakingAhead(flat((BOARD_M, 6_000.0, 60.0)))
    assert limited.effort_to(near.s_m, near.v_mps, BOARD_M, TO_MPS) > 1.1
    assert shows(board(1.1), near, kept=1.0) == pytest.approx(1.1), "no more than needed"


def test_friction_that_plans_exclude_serves_limits_and_the_stop_but_no_other_place() -> None:
    """The same brake from 100 to 60 km/h in 330 m, without a limit of 60 at its end and with one; and for the stop."""
    place = BOARD_M - 330.0, 100 * KMH, BOARD_M, TO_MPS
    limited = BrakingAhead(flat((BOARD_M, 6_000.0, 60.0)))
    needed = limited.effort_to(*place)
    assert AHEAD.effort_to(*place) == 1.0 < needed
    assert AHEAD.by_policy(1.5, *place[:2]) == 1.0
    assert limited.by_policy(9.0, *place[:2]) == pytest.approx(BRAKED_MORE * needed)
    end_m = AHEAD.section.end_m
    assert AHEAD.effort_to(end_m - 330.0, 100 * KMH, end_m, 0.0) > 1.0
    assert AHEAD.by_policy(1.5, end_m + 1.0, 5.0) == 1.5, "beyond the stop there is nothing to keep to"


def replace_state(state: TrainState, way_left_m: float) -> TrainState:
    return state._replace(s_m=BOARD_M - way_left_m)


def test_a_brake_that_is_nearly_done_keeps_its_effort() -> None:
    assert shows(board(0.9), at(5.0, 61), kept=0.4) == 0.4


def test_a_little_lacking_for_a_stop_is_left_to_the_eye() -> None:
    end_m = AHEAD.section.end_m
    for left_m, effort, same in ((600.0, 0.52, True), (600.0, 0.54, False)):
        needed = NeededBrake(effort, 0.0, end_m)
        found = shown_effort(AHEAD, needed, Memory(efforts={end_m: 0.5}), TrainState(0, end_m - left_m, 20.0))
        assert (found == 0.5) is same


def test_the_way_of_a_brake_is_that_of_its_deceleration() -> None:
    state = at(500.0, 72)
    rate = rate_mps2(AHEAD, 0.5, state)
    assert way_m(AHEAD, 0.5, 10.0, state) == pytest.approx((20.0**2 - 10.0**2) / (2.0 * rate))
    assert way_m(AHEAD, 0.5, 25.0, state) == 0.0
    assert rate_mps2(AHEAD, 0.0, state._replace(v_mps=0.1)) > 0.0, "so that every brake ends"


def test_each_place_has_its_own_effort() -> None:
    memory = replace(Memory(), efforts={BOARD_M: 0.5})
    other = NeededBrake(0.2, 0.0, BOARD_M + 500.0)
    assert shown_effort(AHEAD, other, memory, at(900.0, 100)) == pytest.approx(0.2)


def test_the_motors_of_a_heavy_train_do_not_slow_it_on_a_steep_descent(tmp_path: Path) -> None:
    """1600 t on -20 per mille pull with 314 kN; motors and drag together hold less than 200 kN at 70 km/h."""
    route, vehicle = files_of(Cell("descent", "freight1600", Who.OBEDIENT, 0), tmp_path)
    section = build_section(load_route(route), load_vehicle(vehicle))
    ahead = BrakingAhead(section)
    assert rate_mps2(ahead, 1.0, TrainState(0, 3000.0, 70 * KMH)) == LEAST_MPS2
    assert rate_mps2(ahead, 3.0, TrainState(0, 3000.0, 70 * KMH)) > LEAST_MPS2
    assert rate_mps2(ahead, 1.0, TrainState(0, 12_800.0, 40 * KMH)) > LEAST_MPS2, "on the flat"
