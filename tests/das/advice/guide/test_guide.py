"""The guide in a cab: its reasons, restrictions and targets, and standing trains."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from das.advice.advice import Advice, Guidance, ReplanCause, Timetable
from das.advice.goal import Goal, PassingTarget, SpeedsAllowed, TrainState
from das.advice.guide.guide import Guide, falling_limits
from das.advice.reason import Reason, ReasonCode
from das.advice.regimes import BRAKES, Regime
from das.cab.leg import Leg
from das.cab.preparation import Fronts, Preparation
from das.cab.situation import Situation
from das.domain.restriction import Restriction
from das.domain.units import KMH, NS
from das.estimate.estimate import Estimate
from tests.support.bundled_sections import BUNDLED, asked_s, guide_of, section_of
from tests.support.guide import kept, reference
from tests.support.keeping import Keeping, goal_of, ns, started

LINE = BUNDLED[2]
FREE = SpeedsAllowed(60.0, 60.0)


def new_guide() -> Guide:
    return Guide(section_of(LINE), guide_of(LINE))


def train_of() -> Keeping:
    """A train that keeps the reference of its section with a buffer of 10 %."""
    return started(LINE, goal_of(LINE, 0.1))[2]


def shown(guide: Guide, state: TrainState, goal: Goal, place: SpeedsAllowed = FREE) -> Guidance | None:
    """What a guide shows to the driver of a train that is on time."""
    return guide.show(guide.plan(state, goal), state, goal, place)


def said(guide: Guide, state: TrainState, place: SpeedsAllowed = FREE) -> Guidance:
    guidance = shown(guide, state, goal_of(LINE, 0.1), place)
    assert guidance is not None
    return guidance


@cache
def said_on_the_way() -> list[tuple[TrainState, Guidance]]:
    """What a guide says every second to a train that keeps its reference over the whole section."""
    guide, train = new_guide(), train_of()
    states = [train.at(second) for second in range(6, int(train.end_s) - 3)]
    return [(state, said(guide, state)) for state in states]


def test_a_reason_never_repeats_the_instruction_and_names_limits_and_stops_of_the_line() -> None:
    section = section_of(LINE)
    falls_m, falls_to = falling_limits(section.route)
    limits = {*zip(falls_m.tolist(), falls_to.tolist(), strict=True)}
    codes = set()
    for state, guidance in said_on_the_way():
        reason, mode = guidance.reason, guidance.now.mode
        codes.add(reason.code)
        assert not reason.text, "a text would have a language"
        if reason.code is ReasonCode.LIMIT:
            assert (reason.at_m, reason.speed_mps) in limits
            assert reason.at_m > state.s_m
        if mode not in BRAKES and mode is not Regime.COAST:
            assert reason.code in (ReasonCode.NONE, ReasonCode.ARRIVAL)
    assert codes <= {ReasonCode.NONE, ReasonCode.ARRIVAL, ReasonCode.LIMIT, ReasonCode.STOP}
    assert {ReasonCode.NONE, ReasonCode.LIMIT, ReasonCode.STOP} <= codes


def test_the_last_brake_names_the_stop() -> None:
    _, last = said_on_the_way()[-1]
    assert (last.reason.code, last.reason.stop) == (ReasonCode.STOP, "Zug")


def test_a_stop_is_named_from_4_km_on() -> None:
    """To a driver who coasts, and then brakes for it."""
    schedule = reference(("H", 0.0, 0.0, 100), ("C", 0.0, 1000.0, 60), ("B", 0.0, 4700.0, 0), at_kmh=100)
    for left_m, code in ((4100.0, ReasonCode.NONE), (3900.0, ReasonCode.STOP)):
        state = TrainState(ns(100), schedule.section.end_m - left_m, 95 * KMH)
        standing = kept(schedule, state)
        goal = Goal(due_ns=state.now_ns + round(standing.forecast.time_s / NS))
        found = Guide(schedule.section, None).show(standing, state, goal, FREE)
        assert found is not None
        assert (found.now.mode, found.reason.code) == (Regime.COAST, code)


def test_a_train_that_is_too_fast_is_told_so() -> None:
    guide, state = new_guide(), train_of().at(200)
    guidance = said(guide, state, SpeedsAllowed(state.v_mps - 5.0, 60.0, too_fast=True))
    assert (guidance.reason.code, guidance.reason.speed_mps) == (ReasonCode.TOO_FAST, 5.0)
    assert guidance.now.mode in BRAKES
    assert guidance.now.effort_ratio <= -1.0


def test_a_standing_train_is_told_to_stand_and_for_how_long() -> None:
    guidance = new_guide().stands(42.0)
    assert (guidance.now.mode, guidance.now.speed_mps, guidance.target_s) == (Regime.STOP, 0.0, 42.0)


def test_a_standing_train_that_has_to_go_on_is_told_how_to_depart_when_it_is_cleared() -> None:
    """The advice has the effort and speed of the departure, and no force until then."""
    section = section_of(LINE)
    guide, state = new_guide(), TrainState(ns(0), section.start_m, 0.0)
    goal = goal_of(LINE, 0.1)
    told = guide.departs(guide.plan(state, goal), state, goal, FREE)
    assert told is not None
    gone = said(new_guide(), state)
    assert gone.now.mode is Regime.FULL_TRACTION
    assert told.now == replace(gone.now, mode=Regime.DEPART)
    assert (told.force_n, told.reference_force_n) == (0.0, 0.0)
    assert told.reason == gone.reason
    assert told.following == gone.following


def test_a_standing_train_without_a_reference_or_whose_reference_brakes_is_not_told_to_depart() -> None:
    schedule = reference(("H", 0.0, 0.0, 60), ("B", 0.0, 5500.0, 0), at_kmh=60)
    guide, state = Guide(schedule.section, None), TrainState(ns(0), schedule.section.end_m - 5.0, 0.0)
    goal = Goal(due_ns=ns(60))
    assert guide.departs(None, state, goal, FREE) is None
    assert guide.departs(kept(schedule, state), state, goal, FREE) is None


def test_a_state_that_cannot_go_on_has_no_guidance() -> None:
    """Outside the section there is no reference."""
    state = TrainState(ns(10), section_of(LINE).end_m + 100.0, 10.0)
    assert shown(new_guide(), state, goal_of(LINE, 0.1)) is None


def test_a_train_that_must_not_pass_yet_is_told_when_it_may() -> None:
    guide, train = new_guide(), train_of()
    state = train.at(60)
    point = PassingTarget(s_m=section_of(LINE).start_m + 9000.0, earliest_ns=ns(420.0), reason="train ahead")
    guidance = shown(guide, state, replace(goal_of(LINE, 0.1), passing=point))
    assert guidance is not None
    assert guidance.reason == Reason(
        code=ReasonCode.POINT_EARLIEST, at_m=point.s_m, time_ns=ns(420.0), text="train ahead"
    )


def test_a_point_that_a_train_passes_late_enough_anyway_is_not_named() -> None:
    guide, state = new_guide(), train_of().at(60)
    point = PassingTarget(s_m=section_of(LINE).start_m + 9000.0, earliest_ns=ns(65.0))
    guidance = shown(guide, state, replace(goal_of(LINE, 0.1), passing=point))
    assert guidance is not None
    assert guidance.reason.code is not ReasonCode.POINT_EARLIEST


@pytest.mark.parametrize(("later_s", "expected_s"), [(0.0, None), (-40.0, None), (-72.0, 40.0), (40.0, -40.0)])
def test_a_reason_says_how_late_or_early_the_train_arrives(later_s: float, expected_s: float | None) -> None:
    """The timetable is moved after the guide has made its reference; the arrival is the forecast of that reference."""
    guide, state = new_guide(), train_of().at(100)
    kept = guide.plan(state, goal_of(LINE, 0.1))
    goal = goal_of(LINE, 0.1)
    moved = replace(goal, due_ns=goal.due_ns + round(later_s * 1e9))
    guidance = guide.show(kept, state, moved, FREE)
    assert guidance is not None
    if expected_s is None:
        assert guidance.reason.code is ReasonCode.NONE
    else:
        assert guidance.reason.code is ReasonCode.ARRIVAL
        assert guidance.reason.late_s == pytest.approx(expected_s, abs=3.0)


class Cab:
    """A leg with its preparation, as in a cab, without a background thread; the tests say where the train is."""

    def __init__(self) -> None:
        section = section_of(LINE)
        start, end = (x for x in section.route.stops if x.position_m in (section.start_m, section.end_m))
        self.situation = Situation(route=section.route, vehicle=section.vehicle)
        self.preparation = Preparation(Fronts(threads=1), background=False, guide=True)
        self.leg = Leg(start, end, section, Guide(section, None))
        self.preparation.take_over([self.leg], self.situation)
        self.leg.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(asked_s(LINE, 0.15))))

    def advice(self, state: TrainState) -> Advice:
        here = Estimate(
            time_ns=state.now_ns,
            s_m=state.s_m,
            speed_mps=state.v_mps,
            position_sd_m=1.0,
            speed_sd_mps=0.1,
            problem=None,
        )
        self.leg.see(here)
        self.preparation.prepare([self.leg], 0, self.situation, state.now_ns, changed=False)
        return self.leg.advise(here)

    def guidance(self, state: TrainState) -> Guidance:
        guidance = self.advice(state).guide
        assert guidance is not None
        return guidance


def test_what_is_told_on_the_way_makes_one_other_reference_each() -> None:
    """A restriction, then a target at the stop, then one at a point, received by a train that keeps its reference."""
    cab, train = Cab(), train_of()
    causes, times = [cab.guidance(train.at(30)).replan.cause], set()
    section = section_of(LINE)
    for second in range(31, 40):
        times.add(cab.guidance(train.at(second)).replan.time_ns)
    assert times == {ns(30)}
    one = Restriction(start_m=section.start_m + 9000.0, end_m=section.start_m + 9600.0, limit_mps=15.0)
    cab.situation = replace(cab.situation, restrictions=(one,))
    causes.append(cab.guidance(train.at(40)).replan.cause)
    assert cab.guidance(train.at(41)).replan.time_ns == ns(40)
    cab.leg.arrival_ns = ns(asked_s(LINE, 0.3))
    causes.append(cab.guidance(train.at(42)).replan.cause)
    assert cab.guidance(train.at(43)).replan.time_ns == ns(42)
    cab.leg.points = [PassingTarget(s_m=section.start_m + 8000.0, earliest_ns=ns(500.0))]
    causes.append(cab.guidance(train.at(44)).replan.cause)
    assert causes[:3] == [ReplanCause.START, ReplanCause.LINE, ReplanCause.GOAL]
    assert causes[3] in (ReplanCause.POINT, ReplanCause.LINE)
    assert cab.guidance(train.at(45)).replan.time_ns == ns(44)


def test_a_train_at_a_restriction_is_shown_no_more_than_it_allows() -> None:
    cab, train = Cab(), train_of()
    state = train.at(150)
    one = Restriction(start_m=state.s_m + 100.0, end_m=state.s_m + 900.0, limit_mps=15.0)
    cab.guidance(state)
    cab.situation = replace(cab.situation, restrictions=(one,))
    guidance = cab.guidance(state)
    assert guidance.now.mode in BRAKES
    assert guidance.now.speed_mps <= cab.leg.planner.allowed_mps(state.s_m) < state.v_mps
    inside = cab.guidance(TrainState(ns(160), state.s_m + 200.0, 16.0))
    assert inside.now.speed_mps <= 15.0 + 0.3


def test_a_brake_for_a_restriction_names_the_restriction_and_not_another_limit() -> None:
    cab, state = Cab(), train_of().at(150)
    one = Restriction(start_m=state.s_m + 1500.0, end_m=state.s_m + 2300.0, limit_mps=15.0)
    cab.guidance(state)
    cab.situation = replace(cab.situation, restrictions=(one,))
    for second in range(1, 90):
        here = TrainState(ns(150.0 + second), state.s_m + state.v_mps * second, state.v_mps)
        guidance = cab.guidance(here)
        if guidance.now.mode in BRAKES:
            break
    assert here.s_m < one.start_m
    assert guidance.reason == Reason(code=ReasonCode.RESTRICTION, speed_mps=15.0, at_m=one.start_m)


def test_a_restriction_received_on_the_way_is_named_at_once_and_for_20_s() -> None:
    """The train is so far from it that nothing slows down yet."""
    cab, train = Cab(), train_of()
    assert cab.guidance(train.at(30)).reason.code is not ReasonCode.RESTRICTION
    one = Restriction(
        start_m=section_of(LINE).start_m + 9000.0, end_m=section_of(LINE).start_m + 9600.0, limit_mps=15.0
    )
    cab.situation = replace(cab.situation, restrictions=(one,))
    news = Reason(code=ReasonCode.RESTRICTION, speed_mps=15.0, at_m=one.start_m)
    assert [cab.guidance(train.at(second)).reason == news for second in (40, 50, 60, 61)] == [True, True, True, False]


def test_without_a_guide_there_is_none() -> None:
    section = section_of(LINE)
    start, end = (x for x in section.route.stops if x.position_m in (section.start_m, section.end_m))
    leg = Leg(start, end, section)
    leg.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(asked_s(LINE, 0.15))))
    here = Estimate(
        time_ns=ns(50), s_m=section.start_m + 500.0, speed_mps=15.0, position_sd_m=1.0, speed_sd_mps=0.1, problem=None
    )
    leg.see(here)
    leg.refresh_goal()
    assert leg.advise(here).guide is None
