"""The advice on a section: what it says, when it is withdrawn, and that it is never above a limit or braking curve."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from das.advice.advice import Advice, Cause, Source, Timetable, Withdrawal
from das.advice.display import Display
from das.advice.goal import UNHURRIED_S
from das.advice.kernels import interval, without_ripples, without_short
from das.advice.plan import HOLD_S, IDLE_EFFORT_RATIO, RIPPLE_MPS, Plan, classify_modes
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.advice.wording import words
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH, NS
from das.domain.vehicle import BrakePolicy
from das.estimate.estimate import PositionFix, Quality
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from tests.support.followed import after_a_second_mps
from tests.support.one_section import OneSection

T0 = 1_800_000_000_000_000_000


def ns(seconds: float) -> int:
    return T0 + round(seconds / NS)


@pytest.fixture(scope="module")
def front() -> Front:
    return solve_front(build_section(load_route("zurich-luzern"), load_vehicle("re460-ic"), end_m=29_000.0))


def advisor_at(
    front: Front, s_m: float, v_mps: float, *, now_s: float, arrival_s: float, departure_s: float = 0.0
) -> tuple[OneSection, Advice]:
    advisor = OneSection(front)
    advisor.set_timetable(Timetable(departure_ns=ns(departure_s), arrival_ns=ns(arrival_s)))
    advisor.set_position(PositionFix(time_ns=ns(now_s), s_m=s_m, speed_mps=v_mps))
    return advisor, advisor.update(ns(now_s))


def test_the_interval_of_a_position_is_the_one_that_begins_at_or_before_it() -> None:
    nodes = np.array([0.0, 1.0, 1.0, 2.5, 7.0])
    for x in (-1.0, 0.0, 0.5, 1.0, 2.4999, 2.5, 6.9, 7.0, 9.0):
        assert interval(nodes, x) == min(max(np.searchsorted(nodes, x, side="right") - 1, 0), 3)
    assert interval(nodes[:2], 5.0) == 0


def test_following_the_advice_arrives_on_time_with_the_planned_energy(front: Front) -> None:
    """A train that has exactly the advised speed every second arrives at the predicted time."""
    least = front.fastest().time_s
    arrival_s = round(least * 1.1)
    advisor = OneSection(front)
    advisor.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(arrival_s)))
    s, v, first = 0.0, 0.0, None
    for second in range(2 * arrival_s):
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=s, speed_mps=v))
        advice = advisor.update(ns(second))
        if advice.mode is Regime.STOP:
            break
        first = first or advice
        after = after_a_second_mps(advice)
        s, v = s + 0.5 * (v + after), after
    assert advice.mode is Regime.STOP
    assert s == pytest.approx(29_000.0, abs=30.0)
    assert second == pytest.approx(arrival_s, abs=5)
    assert first is not None
    assert first.energy_to_go_j == pytest.approx(front.trajectory(arrival_s + UNHURRIED_S).balance.input, rel=1e-3)
    assert first.predicted_deviation_s == pytest.approx(UNHURRIED_S, abs=0.25)
    assert first.buffer_ratio == pytest.approx(arrival_s / least - 1, abs=1e-3)


@settings(max_examples=150, deadline=None)
@given(place=st.floats(0.0, 0.9999), speed=st.floats(0.0, 1.2))
def test_the_least_time_is_that_of_the_fastest_run(front: Front, place: float, speed: float) -> None:
    """The least time is cut short where the train meets the section's fastest run; the whole run takes as long."""
    s_m = 29_000.0 * place
    v_mps = speed * float(np.interp(s_m, front.section.node_m, front.section.envelope_mps))
    assert front.least_time_s(s_m, v_mps) == pytest.approx(front.fastest(s_m, v_mps).time_s, abs=1e-6)


@settings(max_examples=150, deadline=None)
@given(
    place=st.floats(0.0, 0.9999),
    speed=st.floats(0.0, 1.2),
    left_ratio=st.floats(-0.5, 2.0),
)
def test_never_above_limit_or_brake_curve(front: Front, place: float, speed: float, left_ratio: float) -> None:
    section = front.section
    s_m = place * section.end_m
    v_mps = min(speed * float(np.interp(s_m, section.node_m, section.envelope_mps)), 60.0)
    _, advice = advisor_at(front, s_m, v_mps, now_s=0.0, arrival_s=1_100.0 * left_ratio + 600.0, departure_s=-2_000.0)
    if advice.mode in (Regime.NONE, Regime.STOP):
        return

    def allowed(x: float) -> float:
        limit = section.limit_mps[max(int(np.searchsorted(section.node_m, x, side="right")) - 1, 0)]
        return min(math.sqrt(float(np.interp(x, section.node_m, section.envelope_mps**2))), float(limit))

    assert advice.advised_speed_mps <= allowed(s_m) + 1e-6
    assert advice.advised_speed_mps <= advice.limit_mps + 1e-6
    assert len(advice.horizon_speed_mps) == len(advice.horizon_force_n) == 30
    highest = max(section.limit_mps)
    assert max(advice.horizon_speed_mps) <= highest + 1e-6
    assert -1.0 - 1e-3 <= advice.advised_force_ratio <= 1.0 + 1e-3
    assert advice.valid_until_ns > advice.time_ns


def test_the_next_change_is_as_far_away_as_the_train_gets_until_then(front: Front) -> None:
    """On the whole section it is never faster than 44.4 m/s, and from 25 m/s on never slower than 15."""
    _, advice = advisor_at(front, 5_000.0, 25.0, now_s=200.0, arrival_s=1_250.0)
    assert 0.0 < 15.0 * advice.next_change_s < advice.next_change_m < 44.5 * advice.next_change_s


def test_above_the_brake_curve_it_says_brake(front: Front) -> None:
    section = front.section
    drop = int(np.flatnonzero(np.diff(section.limit_mps) < -5)[0])
    s_m, limit = float(section.node_m[drop + 1]), float(section.limit_mps[drop])
    _, advice = advisor_at(front, s_m - 5.0, limit, now_s=0.0, arrival_s=900.0)
    assert advice.mode in (Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
    assert advice.advised_force_n < -1e5


@pytest.mark.parametrize("over_mps", [0.6, 0.9, 1.1, 2.0, 6.0])
@pytest.mark.parametrize("place", [0.2, 0.5, 0.8])
def test_who_is_too_fast_is_never_told_to_pull_nor_to_coast_for_a_brake(
    front: Front, place: float, over_mps: float
) -> None:
    s_m = place * front.section.end_m
    allowed = float(np.sqrt(np.interp(s_m, front.section.node_m, front.section.envelope_mps**2)))
    _, advice = advisor_at(front, s_m, allowed + over_mps, now_s=0.0, arrival_s=100.0)
    assert advice.reason.code is ReasonCode.TOO_FAST
    assert advice.advised_force_n <= 0
    brakes = (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
    assert advice.mode in (Regime.CRUISE, Regime.COAST, *brakes)


def test_a_brake_as_hard_as_the_train_may_is_full() -> None:
    """The motors could brake twice as hard, but the train may not: this is no weak brake."""
    train = replace(load_vehicle("re460-ic"), max_deceleration_mps2=0.3)
    late = solve_front(build_section(load_route("flat-6km"), train))
    plan = Plan.of(late.fastest(), late.section, 0)
    assert plan.modes[-1] == Regime.FULL_BRAKE
    assert -plan.force_n[-1] < 0.5 * 300e3


def test_same_inputs_same_advice(front: Front) -> None:
    a = advisor_at(front, 5_000.0, 25.0, now_s=200.0, arrival_s=1_250.0)[1]
    b = advisor_at(front, 5_000.0, 25.0, now_s=200.0, arrival_s=1_250.0)[1]
    assert a == b


def test_too_late_gives_the_fastest_run_and_says_how_late(front: Front) -> None:
    _, advice = advisor_at(front, 0.0, 0.0, now_s=0.0, arrival_s=900.0)
    least = front.fastest().time_s
    assert advice.predicted_deviation_s == pytest.approx(least - 900.0, abs=0.1)
    assert words(advice.reason) == f"fastest, {least - 900:.0f} s late"
    assert advice.buffer_ratio < 0


def test_an_arrival_in_the_past_still_gives_the_fastest_run(front: Front) -> None:
    _, advice = advisor_at(front, 20_000.0, 20.0, now_s=2_000.0, arrival_s=1_000.0)
    assert advice.mode is not Regime.NONE
    assert advice.reason.code is ReasonCode.FASTEST


def test_never_departs_early(front: Front) -> None:
    _, advice = advisor_at(front, 0.0, 0.0, now_s=0.0, arrival_s=1_500.0, departure_s=42.0)
    assert (advice.mode, advice.advised_speed_mps, advice.reason.code) == (Regime.STOP, 0.0, ReasonCode.DEPARTURE)


@pytest.mark.parametrize("s_m", [0.0, 14_000.0, 28_900.0])
def test_a_train_that_stands_before_its_stop_is_told_to_depart_when_cleared_and_how(front: Front, s_m: float) -> None:
    """At its stop or under way: the advice does not move the train, but says all that is needed to depart."""
    advisor, advice = advisor_at(front, s_m, 0.0, now_s=0.0, arrival_s=1_250.0)
    assert advice.mode is Regime.DEPART
    moving = (advice.advised_speed_mps, advice.display_speed_mps, advice.advised_force_n, advice.advised_force_ratio)
    assert moving == (0.0, 0.0, 0.0, 0.0)
    assert set(advice.horizon_speed_mps) == set(advice.horizon_force_n) == {0.0}
    assert advice.next_mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION)
    assert math.isnan(advice.next_change_s)
    assert 0.0 < advice.departure_speed_mps <= max(front.section.limit_mps)
    assert 0.0 < advice.departure_force_ratio <= 1.0
    advisor.set_position(PositionFix(time_ns=ns(1), s_m=s_m + 1.0, speed_mps=1.5))
    gone = advisor.update(ns(1))
    assert gone.mode is advice.next_mode
    assert gone.advised_force_n > 0.0
    assert (gone.departure_speed_mps, gone.departure_force_ratio) == (0.0, 0.0)


def test_a_train_that_comes_to_stand_where_the_plan_brakes_is_told_how_to_depart(front: Front) -> None:
    """The plan brakes to the stop, and the train is still near enough to the plan to count as following it."""
    states = [(28_935.0 - 0.5 * (5.0 - 0.5 * t) ** 2 / 0.5, 5.0 - 0.5 * t) for t in range(11)]
    told = driven(front, states, arrival_s=1_250.0)
    assert Regime.DEPART in {advice.mode for advice in told}
    for advice in told:
        if advice.mode is Regime.DEPART:
            assert advice.departure_force_ratio >= 0.0
            assert advice.next_mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION, Regime.COAST)


@pytest.mark.parametrize(("cause", "kept"), [(Cause.DRIVER_BRAKES, True), (Cause.NO_PLAN, False)])
def test_a_quiet_display_keeps_the_plan_and_other_withdrawals_forget_it(front: Front, cause: Cause, kept: bool) -> None:
    advisor, advice = advisor_at(front, 10_000.0, 30.0, now_s=400.0, arrival_s=1_250.0)
    plan = advisor.plan
    assert plan is not None
    told = advisor.leg.withdraw(advisor.localisation.at(ns(400.0)), Withdrawal(cause))
    assert (told.mode, told.cause) == (Regime.NONE, cause)
    assert (advisor.plan is plan) is kept
    assert advisor.update(ns(400.0)).mode is advice.mode


def test_standing_at_the_end_is_arrived(front: Front) -> None:
    _, advice = advisor_at(front, 28_990.0, 0.0, now_s=1_260.0, arrival_s=1_250.0)
    assert (advice.mode, words(advice.reason)) == (Regime.STOP, "arrived, 10 s late")


def test_who_stands_at_the_end_is_not_later_every_second(front: Front) -> None:
    advisor, first = advisor_at(front, 28_999.0, 0.0, now_s=1_220.0, arrival_s=1_250.0)
    assert words(first.reason) == "arrived, 30 s early"
    for second in range(1_221, 1_400):
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=28_999.0, speed_mps=0.0))
        assert advisor.update(ns(second)).reason == first.reason
    for second in range(1_400, 1_410):  # The train moves up, because it stopped short of the mark.
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=28_999.0 + (second - 1_400) * 0.5, speed_mps=0.5))
        advisor.update(ns(second))
    for second in range(1_410, 1_415):
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=29_003.5, speed_mps=0.0))
    assert words(advisor.update(ns(1_414)).reason) == "arrived, 164 s late"


def test_a_train_that_moves_up_to_its_stop_is_not_told_to_depart(front: Front) -> None:
    """A train that stopped short of the mark has kept the stop; creeping up to it is not the next section."""
    _, advice = advisor_at(front, -31.0, 2.0, now_s=-60.0, arrival_s=1_250.0)
    assert (advice.mode, advice.reason.text) == (Regime.NONE, "moving up to the stop")
    _, advice = advisor_at(front, -31.0, 2.0, now_s=1.0, arrival_s=1_250.0)
    assert advice.mode is Regime.FULL_TRACTION


def test_full_brake_is_no_more_than_the_train_brakes_with() -> None:
    """The vehicle bounds its deceleration, but not the force of its brakes; the resistance counts as braking too."""
    brakes = {"friction_brake_force_n": 5e6, "brake_policy": BrakePolicy.BLENDED, "max_deceleration_mps2": 1.1}
    train = replace(load_vehicle("re460-ic"), **brakes)
    section = build_section(load_route("flat-6km"), train)
    fast = solve_front(section)
    _, advice = advisor_at(fast, 5_999.5, 3.0, now_s=200.0, arrival_s=240.0)
    assert words(advice.reason) == "stop at B"
    slowed_n = section.resistance_n(5_999.5, 3.0)
    assert -advice.advised_force_n + slowed_n == pytest.approx(1.1 * train.inertial_mass_kg)
    all_n = float(train.electric_brake_effort_n(3.0)) + 5e6
    assert advice.advised_force_ratio == pytest.approx(advice.advised_force_n / all_n)


def test_position_is_extrapolated_to_now(front: Front) -> None:
    advisor, _ = advisor_at(front, 5_000.0, 20.0, now_s=100.0, arrival_s=1_250.0)
    assert advisor.update(ns(101.5)).s_m == pytest.approx(5_030.0)


@pytest.mark.parametrize(
    ("fix", "now_s", "reason"),
    [
        ({"s_m": 5_000.0, "speed_mps": 20.0, "time_s": 0.0}, 3.5, "the position is 3.5 s old"),
        ({"s_m": 5_000.0, "speed_mps": 20.0, "time_s": 10.0}, 0.0, "the position is 10.0 s ahead of the clock"),
        ({"s_m": math.nan, "speed_mps": 20.0, "time_s": 0.0}, 0.0, "the position is not a number"),
        ({"s_m": 5_000.0, "speed_mps": math.inf, "time_s": 0.0}, 0.0, "the position is not a number"),
        ({"s_m": 5_000.0, "speed_mps": 99.0, "time_s": 0.0}, 0.0, "a speed of 356.4 km/h is impossible"),
        ({"s_m": 5_000.0, "speed_mps": -5.0, "time_s": 0.0}, 0.0, "a speed of -18 km/h is impossible"),
        (
            {"s_m": 40_000.0, "speed_mps": 20.0, "time_s": 0.0},
            0.0,
            "position 40000 m is outside the section 0 … 29000 m",
        ),
        ({"s_m": 5_000.0, "speed_mps": 20.0, "time_s": 0.0, "invalid": True}, 0.0, "the position is marked unusable"),
    ],
)
def test_no_advice_with_its_reason(front: Front, fix: dict[str, float], now_s: float, reason: str) -> None:
    advisor = OneSection(front)
    advisor.set_timetable(Timetable(departure_ns=ns(-100), arrival_ns=ns(1_250)))
    quality = Quality.INVALID if "invalid" in fix else Quality.GOOD
    advisor.set_position(
        PositionFix(time_ns=ns(fix["time_s"]), s_m=fix["s_m"], speed_mps=fix["speed_mps"], quality=quality)
    )
    advice = advisor.update(ns(now_s))
    assert (advice.mode, advice.source, advice.reason.text) == (Regime.NONE, Source.NONE, reason)
    assert math.isnan(advice.advised_speed_mps)
    assert math.isnan(advice.advised_force_n)


def test_advice_comes_back_when_the_position_does(front: Front) -> None:
    advisor, _ = advisor_at(front, 5_000.0, 20.0, now_s=100.0, arrival_s=1_250.0)
    assert advisor.update(ns(110.0)).mode is Regime.NONE
    advisor.set_position(PositionFix(time_ns=ns(111.0), s_m=5_220.0, speed_mps=20.0))
    assert advisor.update(ns(111.0)).mode is not Regime.NONE


def test_without_timetable_or_position_it_says_so(front: Front) -> None:
    advisor = OneSection(front)
    assert advisor.update(T0).reason.text == "no journey yet"
    advisor.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(1_250)))
    assert advisor.update(T0).reason.text == "no position yet"


def test_a_timetable_that_leaves_no_time_is_refused(front: Front) -> None:
    with pytest.raises(DasError, match="not after the departure"):
        OneSection(front).set_timetable(Timetable(departure_ns=ns(10), arrival_ns=ns(10)))


def test_a_plan_is_kept_while_the_train_stays_near_it(front: Front) -> None:
    advisor, advice = advisor_at(front, 5_000.0, 25.0, now_s=200.0, arrival_s=1_250.0)
    plan = advisor.plan
    s, v = 5_000.0, 25.0
    for second in range(201, 210):
        after = after_a_second_mps(advice)
        s, v = s + 0.5 * (v + after), after
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=s + 2.0, speed_mps=v + 0.1))
        advice = advisor.update(ns(second))
    assert advisor.plan is plan
    advisor.set_position(PositionFix(time_ns=ns(210), s_m=s, speed_mps=v - 2.0))
    advisor.update(ns(210))
    assert advisor.plan is not plan


def test_a_new_mode_waits_unless_it_asks_for_less_effort(front: Front) -> None:
    display = Display()
    assert display.held_mode(Regime.COAST, ns(0)) is Regime.COAST
    assert display.held_mode(Regime.CRUISE, ns(1)) is Regime.COAST
    assert display.held_mode(Regime.CRUISE, ns(3)) is Regime.CRUISE
    assert display.held_mode(Regime.COAST, ns(4)) is Regime.COAST
    assert display.held_mode(Regime.FULL_BRAKE, ns(5)) is Regime.FULL_BRAKE


def driven(front: Front, states: list[tuple[float, float]], *, arrival_s: float) -> list[Advice]:
    """The advice of every second for a train in the given states (position m, speed m/s), whatever it is advised."""
    advisor, heard = OneSection(front), []
    advisor.set_timetable(Timetable(departure_ns=ns(-1000.0), arrival_ns=ns(arrival_s)))
    for second, (s_m, v_mps) in enumerate(states):
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=s_m, speed_mps=v_mps))
        heard.append(advisor.update(ns(second)))
    return heard


def test_who_brakes_early_for_the_stop_is_not_told_to_speed_up(front: Front) -> None:
    """The driver brakes half as hard as planned, and is late: if he sped up he would only have to brake again."""
    braked_mps2, from_mps = 0.5, 25.0
    way_s = from_mps / braked_mps2
    start_m = 29_000.0 - from_mps**2 / (2 * braked_mps2)
    cruised = [(start_m - from_mps * (20 - t), from_mps) for t in range(20)]
    braked = [
        (29_000.0 - (from_mps - braked_mps2 * t) ** 2 / (2 * braked_mps2), from_mps - braked_mps2 * t)
        for t in range(int(way_s) - 2)
    ]
    heard = driven(front, cruised + braked, arrival_s=10.0)[len(cruised) + 4 :]
    assert all(advice.mode is not Regime.NONE for advice in heard)
    assert max(advice.advised_force_n for advice in heard) < 0.1 * front.section.train.traction_force_n


def test_who_keeps_a_little_below_the_advised_speed_is_not_chased(front: Front) -> None:
    """The driver is 4 km/h below the limit on the level, and late: the plan stays, and so does the effort."""
    start_m, v_mps = 10_500.0, 120 * KMH
    _, first = advisor_at(front, start_m, v_mps, now_s=0.0, arrival_s=10.0)
    kept_mps = first.limit_mps - 4.0 * KMH
    heard = driven(front, [(start_m + kept_mps * t, kept_mps) for t in range(60)], arrival_s=10.0)
    # He does not brake either: the brake shown grows stronger and stronger, which is not counted as a change here.
    modes = [min(advice.mode, Regime.REDUCED_BRAKE) for advice in heard]
    changes = sum(a != b for a, b in pairwise(modes))
    assert changes <= 4, [advice.mode.name for advice in heard]


def test_the_effort_shown_is_that_of_the_mode_shown(front: Front) -> None:
    """A mode that is still shown is shown with its own effort, however the driver drives."""
    random, s_m, v_mps, states = np.random.default_rng(3), 2_000.0, 20.0, []
    for _ in range(600):
        allowed = float(np.sqrt(np.interp(s_m, front.section.node_m, front.section.envelope_mps**2)))
        v_mps = min(max(v_mps + random.normal(0.0, 0.6), 15.0), allowed)
        s_m += v_mps
        states.append((s_m, v_mps))
    heard = [advice for advice in driven(front, states, arrival_s=900.0) if advice.mode is not Regime.NONE]
    idle_n = 0.03 * front.section.train.traction_force_n
    assert len(heard) > 500
    assert len({advice.mode for advice in heard}) >= 4
    for advice in heard:
        if advice.mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION):
            assert advice.advised_force_n > 0
        if advice.mode is Regime.COAST:
            assert abs(advice.advised_force_n) < idle_n
        if advice.mode in (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE):
            assert advice.advised_force_n < 0


def test_the_effort_of_a_mode_left_out_is_not_shown_with_another(front: Front) -> None:
    """A mode too short to follow is shown as the one before it, and with no more effort than that one."""
    section, left_out = front.section, 0
    for time_s in (1_110.0, 1_150.0, 1_200.0, 1_300.0):
        solution = front.trajectory(time_s)
        plan, planned = Plan.of(solution, section, 0), classify_modes(solution, section)
        left_out += int(np.count_nonzero(plan.modes != planned))
        assert (plan.shown_force_n[plan.modes == planned] == plan.force_n[plan.modes == planned]).all()
        assert (plan.shown_force_n <= plan.force_n).all()
        assert (
            plan.shown_force_n[plan.modes == Regime.COAST].max() <= IDLE_EFFORT_RATIO * section.train.traction_force_n
        )
    assert left_out > 0


def test_a_fix_from_the_future_does_not_shut_out_the_present(front: Front) -> None:
    advisor, _ = advisor_at(front, 5_000.0, 20.0, now_s=100.0, arrival_s=1_250.0)
    advisor.set_position(PositionFix(time_ns=ns(10_000), s_m=6_000.0, speed_mps=20.0))
    assert advisor.update(ns(101)).mode is Regime.NONE
    advisor.set_position(PositionFix(time_ns=ns(102), s_m=5_040.0, speed_mps=20.0))
    assert advisor.update(ns(102)).mode is not Regime.NONE


@pytest.mark.parametrize("s_m", [28_999.5, 29_000.0, 29_030.0])
def test_moving_at_the_stop_it_says_brake_not_stop(front: Front, s_m: float) -> None:
    _, advice = advisor_at(front, s_m, 10.0, now_s=1_240.0, arrival_s=1_250.0)
    assert advice.mode is Regime.FULL_BRAKE
    assert advice.advised_force_n < -1e5
    assert advice.advised_speed_mps <= 10.0
    assert advice.source is Source.FALLBACK


@pytest.mark.parametrize("v_mps", [10.0, 0.0])
def test_far_past_the_stop_there_is_no_advice(front: Front, v_mps: float) -> None:
    _, advice = advisor_at(front, 29_080.0, v_mps, now_s=1_240.0, arrival_s=1_250.0)
    assert (advice.mode, advice.reason.text) == (Regime.NONE, "ran 80 m past the stop")


def test_above_the_end_of_the_loss_map_it_says_brake(front: Front) -> None:
    advisor, _ = advisor_at(front, 5_000.0, 58.0, now_s=200.0, arrival_s=1_250.0)
    for second in range(201, 221):  # So fast a speed is used once the positions have told its scale.
        s_m = 5_000.0 + 58.0 * (second - 200)
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=s_m, speed_mps=58.0, uncertainty_m=3.0))
        advice = advisor.update(ns(second))
    assert advice.mode is Regime.FULL_BRAKE
    assert advice.advised_speed_mps <= advice.limit_mps


def test_modes_too_short_to_follow_are_left_out() -> None:
    modes = np.array([4, 4, 2, 4, 4, 6, 4, 4, 2, 2])
    t_s = np.cumsum([0.0, 5, 5, 1, 5, 5, 1, 5, 5, 2, 2])
    assert without_short(modes, t_s, HOLD_S).tolist() == [4, 4, 4, 4, 4, 6, 4, 4, 2, 2]


def test_who_keeps_his_speed_between_two_stretches_of_cruising_is_cruising() -> None:
    coast, pull, cruise, brake = Regime.COAST, Regime.REDUCED_TRACTION, Regime.CRUISE, Regime.REDUCED_BRAKE
    cases = [
        ([cruise, coast, pull, cruise], [20.0, 20.0, 19.7, 20.2, 20.2], [cruise] * 4),
        ([cruise, coast, pull, cruise], [20.0, 20.0, 19.4, 20.0, 20.0], [cruise, coast, pull, cruise]),
        ([cruise, brake, coast, cruise], [20.0, 20.0, 19.9, 19.8, 19.8], [cruise, brake, coast, cruise]),
        ([coast, cruise, coast, coast], [20.0, 20.0, 20.0, 19.9, 19.9], [coast, cruise, coast, coast]),
        # A slow rise from one stretch of cruising to the next counts as cruising; each stretch is judged by itself.
        ([cruise, pull, cruise, pull, cruise], [20.0, 20.0, 20.5, 20.5, 21.0, 21.0], [cruise] * 5),
    ]
    for modes, v_mps, expected in cases:
        found = without_ripples(np.array(modes, dtype=np.int64), np.array(v_mps), RIPPLE_MPS)
        assert found.tolist() == expected


# --- what other displays show ------------------------------------------------------------------------------------


def test_the_speed_on_a_display_does_not_flicker_and_is_never_above_what_is_allowed(front: Front) -> None:
    display = Display()
    shown = [display.displayed(v * KMH, 200 * KMH) for v in (80.0, 80.9, 81.2, 79.8, 81.24, 81.26, 80.8, 79.0)]
    assert np.array(shown) / KMH == pytest.approx([80, 80, 80, 80, 80, 81, 81, 79])
    assert display.displayed(79.3 * KMH, 78.5 * KMH) == pytest.approx(78 * KMH)


def test_a_clock_that_is_set_back_does_not_hold_a_mode(front: Front) -> None:
    display = Display()
    assert display.held_mode(Regime.COAST, ns(1000)) is Regime.COAST
    assert display.held_mode(Regime.CRUISE, ns(0)) is Regime.CRUISE


def test_every_field_of_the_advice_is_in_the_message() -> None:
    from das.bus import das_pb2

    ours = {field.name for field in dataclasses.fields(Advice)}
    assert ours | {"tick"} == set(das_pb2.Advice.DESCRIPTOR.fields_by_name)
    assert {m.name: m.value for m in Regime} == {
        name.removeprefix("MODE_"): number for name, number in das_pb2.Mode.items()
    }
    assert {s.name: s.value for s in Source} == {
        name.removeprefix("SOURCE_"): number for name, number in das_pb2.Advice.Source.items()
    }
