"""Displays of one top speed and of four modes, computed from the node's message and the line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.advice.advice import Advice, Timetable
from das.advice.display import VALID_FOR_S
from das.advice.goal import LONGEST_RATIO, TrainState
from das.advice.planner import Planner
from das.advice.regimes import Regime
from das.domain.braking import USUAL
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH
from das.estimate.estimate import PositionFix
from das.solver.front import Front
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from sim.drivers.presentations.presenter import FOUR_MODES, SimplerLook
from sim.world.simpler import BEFORE_S, FourModes, ReducedSpeed, SimplerDisplay, brakes_late
from tests.support.fixes import ns
from tests.support.making import make_route
from tests.support.one_section import OneSection
from tests.support.small_trips import TRAIN

OPTIONS = SectionOptions(braking=USUAL.of(TRAIN), point_mass=True)
SECTION = build_section(make_route(8_000.0, [(0.0, 30.0), (4_000.0, 15.0)]), TRAIN, options=OPTIONS)
PLANNER = Planner(SECTION)


@pytest.fixture(scope="module")
def front() -> Front:
    return solve_front(build_section(load_route("zurich-luzern"), load_vehicle("re460-ic"), end_m=29_000.0))


def advised(
    advisor: OneSection, display: SimplerDisplay, s_m: float, v_mps: float, now_s: float
) -> tuple[Advice, SimplerLook]:
    """The advice at a place and a time, and what the display shows of it."""
    advisor.set_position(PositionFix(time_ns=ns(now_s), s_m=s_m, speed_mps=v_mps))
    advice, goal = advisor.update(ns(now_s)), advisor.leg.goal
    return advice, display.look(advice, goal.departure_ns, goal.arrival_ns)


def at_place(
    front: Front, s_m: float, v_mps: float, now_s: float, arrival_s: float = 1_250.0
) -> tuple[Advice, SimplerLook]:
    """The advice to a train that departs at 0 s, and what the display shows of it."""
    advisor = OneSection(front)
    advisor.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(arrival_s)))
    return advised(advisor, SimplerDisplay(front.section), s_m, v_mps, now_s)


def test_a_display_of_four_modes_brakes_in_time_for_full_brakes_that_build_up() -> None:
    """Every 20 m before a lower limit: full braking is shown 4 s before it would be too late, and not earlier."""
    v_mps = 28.0
    for s_m in np.arange(3000.0, 4000.0, 20.0).tolist():
        state = TrainState(0, s_m, v_mps)
        four = FourModes(VALID_FOR_S, PLANNER, state, v_mps, 0.0)
        shown = four.safe(Regime.CRUISE, Regime.CRUISE) is Regime.FULL_BRAKE
        assert shown is brakes_late(PLANNER, state, v_mps, BEFORE_S)
        if shown:
            break
    assert brakes_late(PLANNER, state, v_mps, BEFORE_S)
    assert not brakes_late(PLANNER, state, v_mps, VALID_FOR_S), "an advice is valid for 3 s"


def test_four_modes_are_those_of_the_advice_and_their_next_change(front: Front) -> None:
    advice, look = at_place(front, 5_000.0, 25.0, 200.0)
    assert look.four_mode == FOUR_MODES.get(advice.mode, advice.mode)
    assert look.next_four_mode == FOUR_MODES.get(advice.next_mode, advice.next_mode)
    assert look.next_four_change_s == advice.next_change_s


@pytest.mark.parametrize(("s_m", "over_mps"), [(0.2, 1.0), (0.5, 2.0), (0.9, 1.0)])
def test_a_train_too_fast_is_shown_a_brake_or_the_limit(front: Front, s_m: float, over_mps: float) -> None:
    """If coasting would not bring the train down to the limit, the four modes show the limit or a brake."""
    at_m = s_m * front.section.end_m
    allowed = float(np.sqrt(np.interp(at_m, front.section.node_m, front.section.envelope_mps**2)))
    advice, look = at_place(front, at_m, allowed + over_mps, 0.0, 100.0)
    brakes = (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
    assert look.four_mode in ((Regime.FULL_BRAKE,) if advice.mode in brakes else (advice.mode, Regime.CRUISE))


def test_the_reduced_maximum_speed_keeps_the_time(front: Front) -> None:
    """A train that accelerates fully, holds that speed and brakes gently is on time; 1 km/h less would be late."""
    reduced = ReducedSpeed(front.section)
    top = reduced.judged_mps(0.0, 0.0, ns(0), ns(1_250))
    assert top < 0.95 * float(front.section.limit_mps.max())
    assert reduced.time_s(0.0, 0.0, top) == pytest.approx(1_250.0, abs=0.5)
    assert reduced.time_s(0.0, 0.0, top - 1 * KMH) > 1_255.0
    # It is shown in whole km/h, stays the same for a while, and is as fast as allowed if no time is left.
    _, look = at_place(front, 8_470.0, 20.0, 420.0)
    judged_kmh = ReducedSpeed(front.section).judged_mps(8_470.0, 20.0, ns(420), ns(1_250)) / KMH
    assert look.top_speed_mps / KMH == pytest.approx(round(judged_kmh))
    advisor, display = OneSection(front), SimplerDisplay(front.section)
    advisor.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(1_250)))
    _, first = advised(advisor, display, 5_000.0, 25.0, 200.0)
    _, later = advised(advisor, display, 5_300.0, 35.0, 210.0)
    assert later.top_speed_mps == first.top_speed_mps
    late = ReducedSpeed(front.section).judged_mps(0.0, 0.0, ns(0), ns(800))
    assert late == pytest.approx(float(front.section.limit_mps.max()), abs=1.0)


def test_the_reduced_maximum_speed_is_not_absurdly_slow_where_time_is_ample(front: Front) -> None:
    """As with the plan, it is at first that for 2.5 times the least time; and it does not fall on the way."""
    reduced = ReducedSpeed(front.section)
    fast = float(front.section.limit_mps.max())
    top = reduced.judged_mps(0.0, 0.0, ns(0), ns(9_000))
    assert reduced.time_s(0.0, 0.0, top) == pytest.approx(LONGEST_RATIO * reduced.time_s(0.0, 0.0, fast), abs=2.0)
    for second in range(60, 1_800, 60):
        assert reduced.judged_mps(10.0 * second, top, ns(second), ns(9_000)) == top


def test_before_the_departure_the_reduced_speed_of_the_way_is_known_and_after_the_arrival_none(front: Front) -> None:
    advice, waiting = at_place(front, 0.0, 0.0, -42.0)
    _, leaving = at_place(front, 0.0, 0.0, 0.0)
    assert advice.mode is Regime.STOP
    assert waiting.top_speed_mps == leaving.top_speed_mps
    arrived, there = at_place(front, 29_000.0, 0.0, 1_240.0)
    assert arrived.mode is Regime.STOP
    assert math.isnan(there.top_speed_mps)
