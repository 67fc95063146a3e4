"""The driver's drift: what is learned of the time that he loses, and the reserve for what he is still going to lose."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.advice.advice import ReplanCause, Timetable
from das.advice.goal import UNHURRIED_S, Goal, TrainState
from das.advice.guide.drift import BRAKING_RATIO, RUNNING_S_PER_MIN, Drift, UsualLoss
from das.advice.guide.keeping import EARLY_S, ELSEWHERE_RATIO, ON_TIME_RATIO
from das.cab.legs import Legs
from das.cab.orders import Order
from das.cab.preparation import Fronts, Preparation
from das.cab.situation import Situation
from das.domain.files.load import load_route, load_vehicle
from das.solver.guide import policies
from das.solver.solve import usable_power_w
from tests.support.bundled_sections import BUNDLED, Which, asked_s, section_of
from tests.support.crossing import few
from tests.support.keeping import Keeping, goal_of, keeper_of, ns, started, stood, waiting

LINE = BUNDLED[2]
"""17 km, the middle section of Zürich–Luzern."""


def drifted(per_min_s: float, minutes: int, *, usual_per_min_s: float = 1.0) -> Drift:
    """The drift of a driver who loses this many seconds a minute, where drivers usually lose so many."""
    drift, usual_s = Drift(), usual_per_min_s * minutes
    drift.see(0.0, usual_s, anew=True)
    for step in range(1, 3 * minutes + 1):
        drift.see(per_min_s * step / 3.0, usual_s * (1.0 - step / (3 * minutes)), anew=False)
    return drift


def test_an_unknown_driver_is_expected_to_lose_what_drivers_usually_lose() -> None:
    assert Drift().loss_s(12.0, 0.5) == 12.0


@pytest.mark.parametrize(("per_min_s", "share"), [(0.0, 25 / 37), (0.5, 31 / 37), (1.0, 1.0), (-3.0, 0.0)])
def test_what_a_driver_loses_is_learned_as_a_share_of_the_usual_loss(per_min_s: float, share: float) -> None:
    """After 12 min at 1 s a minute, that is 12 s, beside the 25 s that count before anything is known of him."""
    assert drifted(per_min_s, 12).loss_s(10.0, 0.5) == pytest.approx(10.0 * share)


def test_a_driver_who_loses_more_than_usual_has_no_larger_reserve() -> None:
    """He is given new references on the way."""
    assert drifted(5.0, 12).loss_s(10.0, 0.5) == 10.0


def test_another_reference_is_no_drift_and_a_pause_is_none() -> None:
    """The forecast jumps when the reference changes, or when something else does; this is not the driver's doing."""
    drift = Drift()
    drift.see(0.0, 30.0, anew=True)
    drift.see(-50.0, 20.0, anew=True)
    drift.see(-50.0, 20.0, anew=False)
    drift.pause()
    drift.see(-90.0, 5.0, anew=False)
    assert drift.ratio == 1.0


def test_the_reserve_is_a_quantile_of_the_loss_to_come() -> None:
    """By hand: with 4 s² a second, 9 s have the standard deviation √(4 · 9) = 6 s; the 90 % quantile is 1.2816 σ.

    One driver in a hundred gains 5 s.
    """
    drift = Drift()
    assert drift.loss_s(9.0, 0.9) == pytest.approx(9.0 + 1.2816 * 6.0, abs=1e-3)
    assert drift.loss_s(9.0, 0.3) == pytest.approx(9.0 - 0.5244 * 6.0, abs=1e-3)
    assert drift.loss_s(9.0, 0.01) == pytest.approx(9.0 - 2.3263 * 6.0, abs=1e-3)


def test_the_usual_loss_is_that_of_running_and_of_braking() -> None:
    """The fastest run of the 6 km accelerates to 140 km/h and brakes once: that takes the last 85 s."""
    section = section_of(BUNDLED[0])
    run, usual = section.fastest_run, UsualLoss(section)
    top = int(run.speed_mps.argmax())
    brakes_s = float(run.time_to_go_s[run.speed_mps > run.speed_mps[top] - 1e-3][-1])
    expected_s = RUNNING_S_PER_MIN * 240.0 / 60.0 + BRAKING_RATIO * brakes_s
    assert usual.from_s(section.start_m, 240.0) == pytest.approx(expected_s, abs=0.2)
    assert usual.from_s(section.end_m, 0.0) == 0.0
    assert usual.between_s(section.end_m - 100.0, section.start_m, -200.0) == 0.0, "a point behind the train"


def test_only_what_is_lost_just_before_the_stop_is_reserved() -> None:
    """At 18 min it is as much as at 10; a few seconds before the stop next to nothing."""
    section = section_of(BUNDLED[3])
    usual, start_m = UsualLoss(section), section.start_m
    last_s = usual.at_last_s(start_m, 1100.0)
    assert usual.at_last_s(start_m + 8000.0, 600.0) == last_s < 0.5 * usual.from_s(start_m, 1100.0)
    assert usual.at_last_s(section.end_m - 20.0, 8.0) < 0.2 * last_s


@pytest.mark.parametrize("which", few(BUNDLED[1:], BUNDLED[1:2], pytest.mark.slow))
def test_the_first_reference_leaves_a_reserve_and_less_where_being_on_time_does_not_count(which: Which) -> None:
    """With a buffer of 15 %: the time aimed at is earlier by the reserve; the reference is at most a second later."""
    goal = goal_of(which, 0.15)
    usual_s = UsualLoss(section_of(which)).at_last_s(section_of(which).start_m, goal.left_s(ns(0)))
    for one, ratio in ((goal, ON_TIME_RATIO), (replace(goal, counts=False), ELSEWHERE_RATIO)):
        kept = stood(waiting(which, one, loses=True), which, one)
        aimed_s = kept.forecast.time_s - kept.late_s
        assert one.left_s(ns(0)) - aimed_s == pytest.approx(Drift().loss_s(usual_s, ratio) - UNHURRIED_S, abs=1e-3)
        assert -3.0 < kept.late_s < 1.0


def test_a_reserve_is_bought_up_to_its_price_and_no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the middle section with a buffer of 5 % a second of it soon costs a quarter of the power."""
    goal = goal_of(LINE, 0.05)
    kept = stood(waiting(LINE, goal, loses=True), LINE, goal)
    assert kept.reference.lambda_w <= 1.03**2 * policies.DEAREST_RATIO * usable_power_w(section_of(LINE))
    took_s = [stood(waiting(LINE, goal, loses=loses), LINE, goal).forecast.time_s for loses in (False, True)]
    monkeypatch.setattr(policies, "DEAREST_RATIO", 2.0)
    took_s.append(stood(keeper_of(LINE, loses=True), LINE, goal).forecast.time_s)
    assert took_s[0] - 5.0 > took_s[1] > took_s[2] + 5.0


def test_a_train_that_cannot_be_on_time_has_no_reserve() -> None:
    """Its reference is that for the time left, however little that is; with a second to spare, the reserve is that."""
    start, late = TrainState(ns(0), section_of(LINE).start_m, 0.0), goal_of(LINE, -0.1)
    with_reserve, without = (keeper_of(LINE, loses=loses).keep(start, late) for loses in (True, False))
    assert with_reserve is not None
    assert without is not None
    assert with_reserve.late_s == without.late_s
    assert with_reserve.reference.lambda_w == without.reference.lambda_w
    least_s = float(section_of(LINE).fastest_run.time_to_go_s[0])
    kept = keeper_of(LINE, loses=True).keep(start, Goal(departure_ns=ns(0), due_ns=ns(least_s + 1.0)))
    assert kept is not None
    assert kept.forecast.time_s - kept.late_s == pytest.approx(least_s, abs=1e-3)


def test_who_keeps_exactly_to_his_references_loses_half_of_his_reserve_on_the_way() -> None:
    """He loses nothing, so new references save the energy of being early, and none of them hurries him."""
    goal = replace(goal_of(LINE, 0.15), counts=False)
    keeper, kept, train = started(LINE, goal, loses=True)
    usual_s = UsualLoss(section_of(LINE)).at_last_s(section_of(LINE).start_m, kept.forecast.time_s)
    reserve_s, causes = Drift().loss_s(usual_s, ELSEWHERE_RATIO), []
    for second in range(6, 2000):
        state, before = train.at(second), keeper.reference
        if second >= train.end_s - 2.0:
            break
        found = keeper.keep(state, goal)
        assert found is not None
        if found.reference is not before:
            causes.append(found.reference.replan.cause)
            train = Keeping(found.forecast, second)
    assert set(causes) <= {ReplanCause.EARLY, ReplanCause.ENERGY}
    assert len(causes) <= 4
    early_s = asked_s(LINE, 0.15) - train.end_s
    assert -1.0 < early_s < 0.5 * reserve_s + EARLY_S  # Up to 5 s early is no reason for another one.


def test_what_is_known_of_a_driver_goes_with_him_to_the_next_section_and_ends_with_the_journey() -> None:
    stops, times = load_route("zurich-luzern").stops, [(0.0, 600.0), (660.0, 1300.0), (1360.0, 2500.0)]
    timetables = [Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in times]
    vehicle = load_vehicle("re460-ic")
    situation = Situation(route=load_route("zurich-luzern"), vehicle=vehicle, level=vehicle.default_level)
    legs = Legs(situation, Preparation(Fronts(), background=False, guide=True))
    order = Order(stops=stops, timetables=tuple(timetables), vehicle=vehicle, level=None)
    legs.begin(order)
    drifts = [leg.guide.drift for leg in legs.legs if leg.guide is not None]
    assert len(drifts) == 3
    assert drifts[0] is drifts[1] is drifts[2]
    assert [leg.goal.counts for leg in legs.legs] == [False, False, True]
    legs.begin(replace(order, stops=stops[1:], timetables=order.timetables[1:]))
    assert [leg.guide.drift for leg in legs.legs if leg.guide is not None] == drifts[1:]
    through = (Timetable(departure_ns=ns(0.0), arrival_ns=ns(1300.0)),)
    legs.begin(replace(order, stops=(stops[0], stops[2]), timetables=through))
    assert legs.legs[0].guide is not None
    assert legs.legs[0].guide.drift is not drifts[0]
