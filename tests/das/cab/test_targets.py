"""Targets of traffic management: shifted arrivals, and points with a window."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from das.advice.advice import Advice
from das.advice.guide.planning import Wanted, planned
from das.advice.reason import ReasonCode
from das.advice.wording import words
from das.cab.heard import Target
from das.domain.journey import Window
from das.domain.units import NS
from das.offline.asked_journey import Call, Journey, Passing
from das.offline.journey import JourneyPlanner
from das.solver.guide import policies
from das.solver.guide.policies import LEAST_MPS, GuideFront, PolicySettings
from das.solver.section import build_section
from das.solver.solve import solve_front
from tests.support.crossing import few
from tests.support.fixes import T0, ns
from tests.support.small_trips import LINE, TRAIN, at, follow, trip


def passed_s(advices: Iterable[Advice], s_m: float) -> float:
    """When a place is passed (s)."""
    return (next(a for a in advices if a.s_m >= s_m).time_ns - T0) * NS


def arrived_s(advices: Iterable[Advice]) -> float:
    """When the train stands at B (s)."""
    return (next(a for a in advices if a.s_m > 4970 and a.speed_mps < 0.3).time_ns - T0) * NS


@pytest.mark.parametrize("shift_s", few([-20.0, 60.0], (60.0,), pytest.mark.slow))
def test_an_arrival_shifted_by_traffic_management_is_kept(shift_s: float) -> None:
    made = trip()
    made.set_targets([Target(stop="b", arrival_ns=ns(300 + shift_s), reason="platform")])
    advices = list(follow(made))
    assert arrived_s(advices) == pytest.approx(300 + shift_s, abs=8)
    assert advices[5].predicted_deviation_s == pytest.approx(0, abs=1)


def test_a_target_lifted_gives_the_timetable_back() -> None:
    made = trip()
    before = at(made, 60, 1500.0, 20.0)
    made.set_targets([Target(stop="B", arrival_ns=ns(320))])
    assert at(made, 60, 1500.0, 20.0).advised_speed_mps <= before.advised_speed_mps
    assert at(made, 60, 1500.0, 20.0).predicted_arrival_ns == pytest.approx(ns(320), abs=1e9)
    made.set_targets([])
    assert at(made, 60, 1500.0, 20.0).predicted_arrival_ns == pytest.approx(ns(300), abs=1e9)


@pytest.mark.parametrize("earliest_s", few([205.0, 230.0, 280.0], (230.0,), pytest.mark.slow))
def test_a_point_is_never_passed_before_its_time(earliest_s: float) -> None:
    made = trip()
    made.set_targets([Target(s_m=3500.0, earliest_ns=ns(earliest_s), reason="signal")])
    advices = list(follow(made))
    assert earliest_s <= passed_s(advices, 3500.0) <= earliest_s + 8
    assert min(a.speed_mps for a in advices if 500 < a.s_m < 3500) > 5
    assert any(a.reason.code is ReasonCode.POINT_EARLIEST and a.reason.text == "signal" for a in advices)
    assert arrived_s(advices) >= 298


def test_two_points_one_after_the_other_and_one_that_is_moved() -> None:
    made = trip()

    def tell(second: int, _: float) -> None:
        if second == 20:
            made.set_targets([Target(s_m=2000.0, earliest_ns=ns(160)), Target(s_m=4000.0, earliest_ns=ns(270))])
        if second == 60:
            made.set_targets([Target(s_m=2500.0, earliest_ns=ns(170)), Target(s_m=4000.0, earliest_ns=ns(270))])

    advices = list(follow(made, tell=tell))
    for at_m, earliest_s in ((2500.0, 170.0), (4000.0, 270.0)):
        assert earliest_s <= passed_s(advices, at_m) <= earliest_s + 8


def test_a_point_with_time_to_spare_changes_nothing() -> None:
    made, plain = trip(), trip()
    made.set_targets([Target(s_m=3500.0, earliest_ns=ns(60), latest_ns=ns(290))])
    assert [a.advised_speed_mps for a in follow(made)] == [a.advised_speed_mps for a in follow(plain)]


def test_a_point_to_pass_sooner_is_passed_sooner() -> None:
    made, plain = trip(), trip()
    made.set_targets([Target(s_m=2500.0, latest_ns=ns(115))])
    assert passed_s(follow(plain), 2500.0) > 125
    assert passed_s(follow(made), 2500.0) <= 118


def test_a_window_that_cannot_be_kept_is_reported() -> None:
    made = trip()
    made.set_targets([Target(s_m=2500.0, latest_ns=ns(80), reason="crossing")])
    advices = list(follow(made))
    first = advices[1].reason
    assert (first.code, first.at_m, first.time_ns, first.text) == (
        *(ReasonCode.POINT_MISSED, 2500.0, ns(80), "crossing"),
    )
    assert words(next(a for a in advices if a.s_m >= 2500.0).reason).startswith("least energy")


def test_a_train_that_learns_far_too_late_of_a_point_brakes_to_the_lowest_speed_that_is_told() -> None:
    """400 m before it, at speed, with a minute and a half to spend: it would have to stand still on the line."""
    made = trip()
    at(made, 100, 3000.0, 24.0)
    made.set_targets([Target(s_m=3400.0, earliest_ns=ns(190))])
    advices = list(follow(made, start_s=100, s_m=3000.0, v_mps=24.0))
    assert min(a.speed_mps for a in advices if a.s_m < 3400.0) < LEAST_MPS + 0.1
    assert passed_s(advices, 3400.0) > 160


def test_accepted_targets_are_reported_once() -> None:
    made = trip()
    named = [Target(stop="B", arrival_ns=T0 + 300 * 10**9), Target(s_m=2500.0, earliest_ns=ns(80), reason="crossing")]
    many = [Target(s_m=2000.0 + i, latest_ns=ns(200)) for i in range(5)]
    for targets, texts in (
        (named, ["targets: B at 08:05:00; km 2.5 not before 08:01:20 (crossing)"]),
        (named, []),
        (
            [*named, Target(stop="nowhere", arrival_ns=ns(300))],
            ["target ignored: nowhere is not on the way to a stop of this journey"],
        ),
        (many, ["targets: km 2.0 not after 08:03:20; km 2.0 not after 08:03:20; km 2.0 not after 08:03:20; 2 more"]),
        ([], ["targets: none any more"]),
    ):
        made.set_targets(targets)
        assert [news.text for news in made.take_news() if "target" in news.text] == texts


def test_targets_off_the_journey_are_ignored_and_reported() -> None:
    made = trip()
    made.take_news()
    bad = [
        Target(stop="Q", arrival_ns=ns(1)),
        Target(stop="B"),
        Target(s_m=-3.0, earliest_ns=ns(1)),
        Target(s_m=LINE.length_m - 1.0, latest_ns=ns(500)),
        Target(s_m=math.nan, earliest_ns=ns(1)),
        Target(s_m=800.0, earliest_ns=ns(9), latest_ns=ns(1)),
    ]
    made.set_targets(bad)
    texts = [news.text for news in made.take_news() if news.bad]
    assert len(texts) == len(bad)
    assert all(text.startswith("target ignored: ") for text in texts)
    assert "latest time is before" in texts[-1]
    assert at(made, 60, 1500.0, 24.0).reason.code is ReasonCode.ON_TIME


def test_a_passing_costs_what_the_planner_of_whole_journeys_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Second witness: das.offline.journey plans the same window from the start of the section; changes cost nothing."""
    monkeypatch.setattr(policies, "CHANGE_TIME_S", 0.0)
    section = build_section(LINE, TRAIN, end_m=5000.0)
    least_s = solve_front(section).fastest().time_s
    total_s, to_point_s = 1.35 * least_s, 0.63 * 1.35 * least_s
    wanted = Wanted(s_m=0.0, v_mps=0.0, left_s=total_s, point_m=3000.0, window=Window(earliest_s=to_point_s))
    ours = planned(GuideFront(section, PolicySettings(change_s=0.0)), wanted).solution(0.0, 0.0, total_s)
    points = (
        Call(name="A", position_m=0.0, departure=Window(earliest_s=0.0, latest_s=0.0)),
        Passing(name="P", position_m=3000.0, window=Window(earliest_s=to_point_s)),
        Call(name="B", position_m=5000.0, arrival=Window(latest_s=total_s)),
    )
    journey = Journey(id="j", name="j", source="j", points=points)
    theirs = JourneyPlanner(journey, LINE, TRAIN).plan()
    assert ours.feasible
    assert to_point_s - 0.5 <= np.interp(3000.0, ours.trajectory.s_m, ours.trajectory.t_s) <= to_point_s + 2.0
    assert ours.time_s == pytest.approx(total_s, abs=5.0)
    assert theirs.input_j * 0.99 < ours.balance.input < theirs.input_j * 1.02
