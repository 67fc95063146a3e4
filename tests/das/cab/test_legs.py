"""The legs of a journey: restrictions, trains, levels and time, and that no advice is above what is in force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from das.advice.advice import Timetable
from das.advice.goal import LONGEST_RATIO
from das.advice.guide.guide import SAID_ANEW_S
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.advice.wording import words
from das.cab.heard import Target
from das.cab.leg import Leg
from das.cab.orders import Order, Trains
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.restriction import Restriction
from das.domain.route import Route, Stop, Stretches
from das.domain.units import NS
from das.domain.vehicle import Load
from das.estimate.estimate import PositionFix
from das.solver.state import least_time_s
from tests.support.fixes import T0
from tests.support.small_trips import (
    DUE,
    FRONTS,
    LENGTH_M,
    LINE,
    TRAIN,
    SmallTrip,
    at,
    broken,
    follow,
    highest,
    ns,
    train,
    trip,
)

# --- restrictions ----------------------------------------------------------------------------------------------------


def limits_by_hand(route: Route, restrictions: Sequence[Restriction], x: float) -> float:
    base = float(route.limits_mps.at(x))
    return min([base, *(one.limit_mps for one in restrictions if one.start_m <= x < one.end_m)])


def test_restrictions_on_a_route_are_the_least_of_all_in_force() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        ends = random.uniform(-500, LINE.length_m + 500, (random.integers(0, 6), 2))
        restrictions = [Restriction(min(a, b), max(a, b), float(random.uniform(5, 40))) for a, b in ends]
        restricted = LINE.with_restrictions(restrictions)
        for x in (*random.uniform(0, LINE.length_m, 40), *ends[(ends >= 0) & (ends < LINE.length_m)]):
            assert float(restricted.limits_mps.at(x)) == limits_by_hand(LINE, restrictions, x)


def test_a_restriction_ahead_is_kept_and_its_end_waits_for_the_tail() -> None:
    one = Restriction(start_m=2000.0, end_m=2600.0, limit_mps=12.0)
    made = trip()

    def tell(second: int, _: float) -> None:
        if second == 30:
            made.set_restrictions([one])

    advices = list(follow(made, tell=tell))
    after = [a for a in advices if a.time_ns >= ns(30)]
    under = [a for a in after if one.start_m < a.s_m < one.end_m + LENGTH_M - 1]
    assert len(under) > 30
    assert max(a.advised_speed_mps for a in under) <= 12.0 + 1e-9
    assert max(a.limit_mps for a in under) == 12.0
    assert max(a.speed_mps for a in under) <= 12.0 + 0.1  # as the filter has it
    for advice in after:
        for s_m, speed in highest(advice):
            if one.start_m + 1 < s_m < one.end_m + LENGTH_M - 1:
                assert speed <= 12.0 + 1e-6
    assert max(a.advised_speed_mps for a in advices if a.s_m > one.end_m + LENGTH_M) > 20
    assert advices[-1].s_m == pytest.approx(LINE.length_m, abs=30)


def test_a_restriction_under_the_train_says_brake_at_once_and_one_lifted_lets_it_go() -> None:
    made = trip()
    free = at(made, 60, 2000.0, 24.0)
    assert free.advised_speed_mps > 20
    # Behind the head, under the tail.
    made.set_restrictions([Restriction(start_m=1850.0, end_m=1950.0, limit_mps=10.0)])
    slow = at(made, 61, 2024.0, 24.0)
    assert slow.advised_speed_mps == slow.limit_mps == 10.0
    assert slow.advised_force_n < -5e4
    assert "too fast" in words(slow.reason)
    made.set_restrictions([])
    assert at(made, 62, 2045.0, 20.0).limit_mps == 30.0


def test_a_message_says_once_whether_the_train_is_too_fast_and_when_it_arrives() -> None:
    """The full advice and the guide's agree in every second, also while the train swings about the limit."""
    made, told = trip(guide=True), []
    for second, over_mps in enumerate((0.6, 0.4, 0.3, -0.5, 0.3, 1.2, 0.6)):
        advice = at(made, 60 + second, 2000.0 + 30.0 * second, 30.0 + over_mps)
        assert advice.guide is not None
        reasons = {ReasonCode.TOO_FAST is one.code for one in (advice.reason, advice.guide.reason)}
        assert len(reasons) == 1
        told.append(reasons.pop())
        late_s = advice.guide.reason.late_s
        assert math.isnan(late_s) or abs(late_s - advice.predicted_deviation_s) < SAID_ANEW_S
        assert advice.predicted_arrival_ns - round(advice.predicted_deviation_s / NS) == DUE[0].arrival_ns
    assert told == [True, True, True, False, False, True, True]


def test_a_restriction_elsewhere_changes_nothing() -> None:
    made = trip()
    before = at(made, 60, 2000.0, 24.0)
    plan = made.plan
    made.set_restrictions([Restriction(start_m=6000.0, end_m=7000.0, limit_mps=10.0)])
    after = at(made, 60, 2000.0, 24.0)
    assert made.plan is plan
    assert before == after


def test_without_a_thread_the_order_of_messages_does_not_matter() -> None:
    """Journey, restrictions and targets come by separate ways: the advice must be the same to the last bit."""
    one = Restriction(start_m=2000.0, end_m=3000.0, limit_mps=10.0)
    news = []
    for order in ((0, 1), (1, 0)):
        made = SmallTrip(Situation(route=LINE, vehicle=TRAIN), Fronts(threads=1))
        messages = [partial(made.begin, LINE.stops, DUE), partial(made.set_restrictions, [one])]
        for which in order:
            messages[which]()
        advice = at(made, 60, 2100.0, 9.0)
        news.append((advice, made.take_news()))
    assert news[0] == news[1]


def test_a_section_that_could_not_be_made_is_not_taken_for_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the train would be advised by the front of the line without the restriction."""
    made, one = trip(), Restriction(start_m=2000.0, end_m=3000.0, limit_mps=10.0)
    assert at(made, 60, 2100.0, 24.0).advised_speed_mps > 20
    with monkeypatch.context() as patch:
        patch.setattr(Leg, "use_meanwhile", broken)
        for second in (61, 62):
            made.set_restrictions([one])
            with pytest.raises(IndexError):
                at(made, second, 2100.0 + 24.0 * (second - 60), 24.0)
    assert at(made, 63, 2172.0, 24.0).advised_speed_mps <= 10.0


def test_a_hill_that_cannot_be_climbed_under_a_restriction_withdraws_with_the_reason() -> None:
    hill = Stretches(start_m=np.array([0.0, 2500.0, 2700.0]), value=np.array([0.0, 0.12, 0.0]))
    steep = replace(LINE, gradients_ratio=hill)
    made = SmallTrip(Situation(route=steep, vehicle=TRAIN), Fronts(threads=1))
    made.begin(steep.stops, DUE)
    assert at(made, 60, 2000.0, 24.0).mode is not Regime.NONE
    made.set_restrictions([Restriction(start_m=2300.0, end_m=2700.0, limit_mps=3.0)])
    silent = at(made, 61, 2024.0, 24.0)
    assert silent.mode is Regime.NONE
    assert "restriction set" in silent.reason.text
    assert "stalls" in silent.reason.text
    made.set_restrictions([])
    assert at(made, 62, 2048.0, 24.0).mode is not Regime.NONE


# --- other trains, loads, levels, conditions -------------------------------------------------------------------------


def test_another_train_level_or_condition_is_solved_anew() -> None:
    made = trip()
    first = at(made, 60, 1500.0, 24.0)
    made.begin(LINE.stops, DUE, vehicle=train(2e5))
    heavy = at(made, 60, 1500.0, 24.0)
    assert heavy.energy_to_go_j != pytest.approx(first.energy_to_go_j, rel=0.05)
    made.begin(LINE.stops, DUE)
    made.set_conditions(Conditions(mass_ratio=2.0))
    assert at(made, 60, 1500.0, 24.0).energy_to_go_j == pytest.approx(heavy.energy_to_go_j, rel=1e-6)
    made.set_conditions(Conditions())
    made.begin(LINE.stops, DUE, level=Level.L0_REG)
    lossless = at(made, 60, 1500.0, 24.0)
    assert made.leg.section.level is Level.L0_REG
    assert lossless.energy_to_go_j < 0.9 * first.energy_to_go_j


def test_estimates_of_a_train_are_forgotten_with_it() -> None:
    made, fresh = trip(), trip()
    made.set_conditions(Conditions(mass_ratio=1.4))
    heavy = at(made, 60, 1500.0, 24.0).energy_to_go_j
    made.begin(LINE.stops, DUE)  # the same train: its estimates hold
    assert at(made, 60, 1500.0, 24.0).energy_to_go_j == heavy
    loaded = train(1.4e5)
    for one in (made, fresh):
        one.begin(LINE.stops, DUE, vehicle=loaded)
    assert at(made, 60, 1500.0, 24.0) == at(fresh, 60, 1500.0, 24.0)


def test_stops_at_the_same_places_may_have_other_names() -> None:
    made = trip()
    made.begin([replace(stop, name=f"new {stop.name}") for stop in LINE.stops], DUE)
    made.take_news()
    made.set_targets([Target(stop="new B", arrival_ns=ns(320))])
    assert not [news for news in made.take_news() if news.bad]
    assert at(made, 60, 1500.0, 20.0).predicted_arrival_ns == pytest.approx(ns(320), abs=1e9)


def test_conditions_the_train_could_not_drive_under_are_ignored_and_reported() -> None:
    hill = Stretches(start_m=np.array([0.0, 300.0, 2700.0]), value=np.array([0.0, 0.03, 0.0]))
    made = SmallTrip(Situation(route=replace(LINE, gradients_ratio=hill), vehicle=TRAIN), FRONTS)
    made.begin(LINE.stops, DUE)
    before = at(made, 60, 1500.0, 24.0)
    made.take_news()
    made.set_conditions(Conditions(mass_ratio=10.0))
    (news,) = (one for one in made.take_news() if one.bad)
    assert news.text.startswith("calibration ignored: ")
    assert at(made, 61, 1524.0, 24.0).energy_to_go_j < before.energy_to_go_j


def test_a_train_found_too_heavy_for_its_brakes_on_a_descent_gets_no_advice_until_they_hold_it() -> None:
    """The advice of the lighter train went on: "brake to 60" for a train that nothing holds at 60."""
    hill = Stretches(start_m=np.array([0.0, 2000.0, 4000.0]), value=np.array([0.0, -0.03, 0.0]))
    made = SmallTrip(Situation(route=replace(LINE, gradients_ratio=hill), vehicle=TRAIN), FRONTS)
    made.begin(LINE.stops, DUE)
    assert at(made, 60, 1500.0, 24.0).mode is not Regime.NONE
    made.set_conditions(Conditions(mass_ratio=10.0))
    silent = at(made, 61, 1524.0, 24.0)
    assert silent.mode is Regime.NONE
    assert "cannot brake on the descent" in silent.reason.text
    assert "friction_brake.max_force_kn" in silent.reason.text
    made.set_conditions(Conditions())
    assert at(made, 62, 1548.0, 24.0).mode is not Regime.NONE


STEEP = replace(LINE, gradients_ratio=Stretches(start_m=np.array([0.0, 2000.0, 3000.0]), value=np.array([0, -0.06, 0])))
TOO_HEAVY = Conditions(mass_ratio=10.0)


def test_advice_comes_back_where_the_descent_is_behind_a_train_that_its_brakes_would_not_hold_on_it() -> None:
    """The advice was withdrawn to the end of the leg: a heavy train drove its last kilometres without any."""
    made = SmallTrip(Situation(route=STEEP, vehicle=TRAIN), FRONTS)
    made.begin(STEEP.stops, DUE)
    made.set_conditions(TOO_HEAVY)
    silent, on_it, back = (at(made, (1500 + way_m) / 25.0, 1500.0 + way_m, 25.0) for way_m in (0.0, 1000.0, 1600.0))
    assert (silent.mode, on_it.mode) == (Regime.NONE, Regime.NONE)
    assert back.mode is not Regime.NONE
    assert 0.0 < back.advised_speed_mps <= back.limit_mps


def test_a_mass_found_behind_the_descent_takes_no_advice_away_nor_does_a_journey_changed_there() -> None:
    made = SmallTrip(Situation(route=STEEP, vehicle=TRAIN), FRONTS)
    made.begin(STEEP.stops, DUE)
    light = at(made, 60, 3100.0, 24.0)
    made.set_conditions(TOO_HEAVY)
    heavy = at(made, 61, 3124.0, 24.0)
    assert light.mode is not Regime.NONE
    assert heavy.mode is not Regime.NONE
    assert heavy.horizon_speed_mps != light.horizon_speed_mps, "the mass counts"
    sooner = (STEEP.stops[0], replace(STEEP.stops[-1], position_m=STEEP.stops[-1].position_m - 200.0))
    order = Order(stops=sooner, timetables=(DUE[0],), vehicle=TRAIN, level=None)
    with pytest.raises(DasError, match="cannot brake on the descent"):
        made.legs.begin(order, (1500.0, False))
    made.legs.begin(order, (3124.0, False))
    assert at(made, 62, 3148.0, 24.0).mode is not Regime.NONE


def test_trains_are_found_by_id_and_load_and_stay_the_same_object() -> None:
    base = replace(TRAIN, id="ours", loads={"full": Load(mass_kg=1.4e5)})
    trains = Trains(base.loaded("full"), base, others=["re460-ic"])
    assert trains.find("ours") is base
    assert trains.find("ours", "full").mass_kg == trains.find("ours/full").mass_kg == 1.4e5
    assert trains.find("ours", "full") is trains.find("ours", "full")
    assert trains.find("re460-ic-igbt").id == "re460-ic-igbt"
    for vehicle_id, load, said in (("x", "", "ours, "), ("../x.toml", "", "knows"), ("ours", "half", "no load")):
        with pytest.raises(DasError, match=said):
            trains.find(vehicle_id, load)


def test_a_journey_that_cannot_be_driven_is_refused_and_the_one_before_goes_on() -> None:
    made = trip()
    at(made, 60, 1500.0, 24.0)
    with pytest.raises(DasError, match="not after the departure"):
        made.begin(LINE.stops, [DUE[0], Timetable(departure_ns=ns(330), arrival_ns=ns(330))])
    with pytest.raises(DasError, match="in the direction of the route"):
        made.begin([Stop(name="A", position_m=0.0), Stop(name="Z", position_m=1e6)], DUE[:1])
    assert at(made, 61, 1524.0, 24.0).mode is not Regime.NONE


# --- time ------------------------------------------------------------------------------------------------------------


def test_far_too_much_time_is_not_crawled_away() -> None:
    ample = [Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in ((0, 3000), (3030, 3290))]
    made = trip(due=ample)
    first = at(made, 0, 0.0, 0.0)
    least_s = least_time_s(made.leg.section, 0.0, 0.0)
    run_s = (first.predicted_arrival_ns - T0) * NS
    assert run_s <= LONGEST_RATIO * least_s + 1
    assert first.predicted_deviation_s < -1000
    assert words(first.reason).endswith("early: wait at B")
    advices = [a for a in follow(made) if a.s_m < 4000]
    assert min(a.speed_mps for a in advices if a.s_m > 500) > 5


def test_a_long_stop_leaves_less_time_and_the_next_section_makes_up_for_it() -> None:
    made = trip()
    late = at(made, 350, 5000.0, 0.0)
    on_time = at(trip(), 330, 5000.0, 0.0)
    assert late.predicted_arrival_ns == pytest.approx(on_time.predicted_arrival_ns, abs=1e9)
    assert late.buffer_ratio < on_time.buffer_ratio
    hopeless = at(trip(), 500, 5000.0, 0.0)
    assert words(hopeless.reason).startswith("fastest, ")
    assert hopeless.predicted_deviation_s > 10


def test_the_next_section_is_ready_before_the_stop_and_those_far_off_are_let_go() -> None:
    made = trip()
    at(made, 60, 1500.0, 24.0)
    _, second = made.legs.legs
    assert second.planner.front is not None
    assert len(second.planner.front.lambda_w) > 10
    at(made, 400, 6000.0, 24.0)
    assert made.leg is second


def test_a_train_that_may_be_further_ahead_brakes_earlier() -> None:
    """Before the limit of 25 m/s at km 3, a train with a sure position still holds 30 m/s; one without brakes."""
    advices = {}
    for uncertainty_m in (2.0, 30.0):
        made = trip()
        for second in range(5):
            fix = PositionFix(
                time_ns=ns(100 + second), s_m=2660.0 + 30.0 * second, speed_mps=30.0, uncertainty_m=uncertainty_m
            )
            made.set_position(fix)
            advices[uncertainty_m] = made.update(ns(100 + second))
    sure, unsure = advices[2.0], advices[30.0]
    assert unsure.position_sd_m > 3.0 * sure.position_sd_m
    assert unsure.advised_speed_mps < sure.advised_speed_mps - 0.3
