"""A trip: restrictions, trains, levels, targets and tables, and that no advice is above what is in force."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

from das.advisor import Advice, Advisor, PositionFix, Source, Timetable
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.journey import Call, Journey, Passing, Window
from das.domain.losses import EfficiencyLoss, Level
from das.domain.route import Restriction, Route, Stop, Stretches
from das.domain.units import NS
from das.domain.vehicle import Load, Vehicle
from das.passing import PassingFronts, PassingTarget, time_at
from das.plan import LONGEST_RATIO, Mode
from das.planning import Found, Fronts, Situation, loaded_front, onboard_ladder
from das.solver.front import solve_front
from das.solver.journey import JourneyPlanner
from das.solver.section import Section, build_section
from das.table import TableSettings, make_table, write_table
from das.trains import Trains
from das.trip import TRY_AGAIN_S, Target, Trip
from tests.making import make_route, make_train

T0 = 1_800_000_000_000_000_000
LOSS = EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.15, idle_w=20e3)
LENGTH_M = 100.0


def ns(seconds: float) -> int:
    return T0 + round(seconds / NS)


def train(mass_kg: float = 1e5) -> Vehicle:
    return replace(make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6, loss=LOSS), length_m=LENGTH_M).with_mass(mass_kg)


def line() -> Route:
    stops = tuple(Stop(name=name, position_m=x) for name, x in (("A", 0.0), ("B", 5000.0), ("C", 9000.0)))
    return replace(make_route(9000.0, [(0.0, 30.0), (3000.0, 25.0)]), stops=stops)


LINE, TRAIN = line(), train()
DUE = [Timetable(departure_ns=ns(0), arrival_ns=ns(300)), Timetable(departure_ns=ns(330), arrival_ns=ns(590))]
FRONTS = Fronts(threads=1, kept_bytes=200_000_000)


def trip(fronts: Fronts = FRONTS, *, background: bool = False, due: Sequence[Timetable] = DUE) -> Trip:
    made = Trip(Situation(route=LINE, vehicle=TRAIN), fronts, background=background)
    made.begin(LINE.stops, due)
    return made


def at(made: Trip, second: float, s_m: float, v_mps: float) -> Advice:
    made.set_position(PositionFix(time_ns=ns(second), s_m=s_m, speed_mps=v_mps))
    return made.update(ns(second))


def follow(made: Trip, *, start_s: int = 0, s_m: float = 0.0, v_mps: float = 0.0, tell: Any = None) -> Iterator[Advice]:
    """A follower with exactly the advised speed after every second, to the last stop."""
    for second in range(start_s, start_s + 2000):
        if tell is not None:
            tell(second, s_m)
        advice = at(made, second, s_m, v_mps)
        yield advice
        if advice.reason.startswith("arrived") and s_m > LINE.length_m - 60:
            return
        after = advice.horizon_speed_mps[0]
        s_m, v_mps = s_m + 0.5 * (v_mps + after), after


def highest(advice: Advice) -> Iterator[tuple[float, float]]:
    """Where the train is at the advised speeds, second by second, and those speeds."""
    s_m, before = advice.s_m, advice.advised_speed_mps
    yield s_m, before
    for after in advice.horizon_speed_mps:
        s_m, before = s_m + 0.5 * (before + after), after
        yield s_m, after


# --- restrictions ------------------------------------------------------------------------------------------------


def broken(*_: Any, **__: Any) -> Any:
    raise IndexError("nobody foresaw this")


def limits_by_hand(route: Route, restrictions: Sequence[Restriction], x: float) -> float:
    base = float(route.limits_mps.at(x))
    return min([base, *(one.limit_mps for one in restrictions if one.start_m <= x < one.end_m)])


def test_restrictions_on_a_route_are_the_least_of_all_in_force() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        ends = random.uniform(-500, LINE.length_m + 500, (random.integers(0, 6), 2))
        restrictions = [
            Restriction(start_m=min(a, b), end_m=max(a, b), limit_mps=float(random.uniform(5, 40))) for a, b in ends
        ]
        restricted = LINE.with_restrictions(restrictions)
        for x in (*random.uniform(0, LINE.length_m, 40), *ends[(ends >= 0) & (ends < LINE.length_m)]):
            assert float(restricted.limits_mps.at(x)) == limits_by_hand(LINE, restrictions, x)


@pytest.mark.parametrize(
    "bad", [(5, 5, 10), (6, 5, 10), (math.nan, 5, 10), (0, math.inf, 10), (0, 5, 0.4), (0, 5, math.nan)]
)
def test_a_restriction_that_is_none_is_refused(bad: tuple[float, float, float]) -> None:
    with pytest.raises(DasError, match="restriction: "):
        Restriction(start_m=bad[0], end_m=bad[1], limit_mps=bad[2])


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
    assert "too fast" in slow.reason
    made.set_restrictions([])
    assert at(made, 62, 2045.0, 20.0).limit_mps == 30.0


def test_a_restriction_elsewhere_changes_nothing() -> None:
    made = trip()
    before = at(made, 60, 2000.0, 24.0)
    plan = made.plan
    made.set_restrictions([Restriction(start_m=6000.0, end_m=7000.0, limit_mps=10.0)])
    after = at(made, 60, 2000.0, 24.0)
    assert made.plan is plan
    assert before == after


def test_too_many_restrictions_are_refused() -> None:
    with pytest.raises(DasError, match="at most 100"):
        trip().set_restrictions([Restriction(start_m=1.0, end_m=2.0, limit_mps=9.0)] * 101)


def test_without_a_thread_the_order_in_which_things_are_told_does_not_matter() -> None:
    """Journey, restrictions and targets come by separate ways: a run must be the same to the last bit."""
    one = Restriction(start_m=2000.0, end_m=3000.0, limit_mps=10.0)
    news = []
    for order in ((0, 1), (1, 0)):
        made = Trip(Situation(route=LINE, vehicle=TRAIN), Fronts(threads=1), background=False)
        told = [partial(made.begin, LINE.stops, DUE), partial(made.set_restrictions, [one])]
        for which in order:
            told[which]()
        advice = at(made, 60, 2100.0, 9.0)
        news.append((advice, made.take_news()))
    assert news[0] == news[1]


def test_a_section_that_could_not_be_made_is_not_taken_for_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the train would be advised by the front of the line without the restriction."""
    made, one = trip(), Restriction(start_m=2000.0, end_m=3000.0, limit_mps=10.0)
    assert at(made, 60, 2100.0, 24.0).advised_speed_mps > 20
    with monkeypatch.context() as patch:
        patch.setattr(Advisor, "set_section", broken)
        for second in (61, 62):
            made.set_restrictions([one])
            with pytest.raises(IndexError):
                at(made, second, 2100.0 + 24.0 * (second - 60), 24.0)
    assert at(made, 63, 2172.0, 24.0).advised_speed_mps <= 10.0


def test_a_hill_that_cannot_be_climbed_under_a_restriction_withdraws_with_the_reason() -> None:
    hill = Stretches(start_m=np.array([0.0, 2500.0, 2700.0]), value=np.array([0.0, 0.12, 0.0]))
    steep = replace(LINE, gradients_ratio=hill)
    made = Trip(Situation(route=steep, vehicle=TRAIN), Fronts(threads=1), background=False)
    made.begin(steep.stops, DUE)
    assert at(made, 60, 2000.0, 24.0).mode is not Mode.NONE
    made.set_restrictions([Restriction(start_m=2300.0, end_m=2700.0, limit_mps=3.0)])
    silent = at(made, 61, 2024.0, 24.0)
    assert silent.mode is Mode.NONE
    assert "restriction set" in silent.reason
    assert "stalls" in silent.reason
    made.set_restrictions([])
    assert at(made, 62, 2048.0, 24.0).mode is not Mode.NONE


# --- while it is being solved ------------------------------------------------------------------------------------


class HeldFronts(Fronts):
    """Fronts that come when they are let."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.go = Event()
        self.go.set()

    def find(self, section: Section) -> Found:
        assert self.go.wait(30)
        return super().find(section)


def when_solved(made: Trip, second: float, s_m: float, v_mps: float) -> Advice:
    for _ in range(3000):
        advice = at(made, second, s_m, v_mps)
        if advice.source is not Source.FALLBACK:
            return advice
        Event().wait(0.01)
    return pytest.fail("was never solved")


def test_meanwhile_the_plan_of_before_holds_below_what_is_new() -> None:
    fronts = HeldFronts()
    made = trip(fronts, background=True)
    try:
        before = when_solved(made, 60, 1500.0, 24.0)
        fronts.go.clear()
        one = Restriction(start_m=2000.0, end_m=2600.0, limit_mps=12.0)
        made.set_restrictions([one])
        advice = at(made, 60, 1500.0, 24.0)
        assert advice.source is Source.FALLBACK
        assert advice.reason == "restriction set: as before, no faster than is allowed now"
        assert advice.advised_speed_mps == pytest.approx(before.advised_speed_mps, abs=0.3)
        for s_m, speed in highest(advice):
            if one.start_m + 1 < s_m < one.end_m:
                assert speed <= 12.0 + 1e-6
        # Nowhere faster than the plan of before, at the same places.
        was = list(highest(before))
        for s_m, speed in highest(advice):
            assert speed <= np.interp(s_m, [x for x, _ in was], [v for _, v in was]) + 0.3
        fronts.go.set()
        after = when_solved(made, 61, 1524.0, 24.0)
        assert after.source is Source.SOLVED
        assert after.reason.startswith("least energy")
    finally:
        fronts.go.set()
        made.close()


def test_with_no_plan_before_it_advises_the_fastest_safe_run() -> None:
    fronts = HeldFronts()
    fronts.go.clear()
    made = trip(fronts, background=True)
    try:
        advice = at(made, 60, 1500.0, 24.0)
        assert (advice.source, advice.mode) == (Source.FALLBACK, Mode.FULL_TRACTION)
        assert advice.reason == "solving: the fastest safe run"
        assert max(speed for _, speed in highest(advice)) <= 30.0 + 1e-9
    finally:
        fronts.go.set()
        made.close()


def test_a_search_that_fails_withdraws_with_the_reason() -> None:
    class Broken(Fronts):
        def find(self, section: Section) -> Found:
            raise MemoryError("no room")

    advice = at(trip(Broken()), 60, 1500.0, 24.0)
    assert (advice.mode, advice.reason) == (Mode.NONE, "solving failed (MemoryError: no room)")


class Flaky(Fronts):
    """Fronts that come as long as there is room."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.room, self.asked = True, 0

    def find(self, section: Section) -> Found:
        self.asked += 1
        if not self.room:
            raise MemoryError("no room")
        return super().find(section)


def test_a_search_that_failed_is_made_again_after_a_while() -> None:
    fronts = Flaky()
    fronts.room = False
    made = trip(fronts)
    silent, asked = at(made, 60, 1500.0, 24.0), fronts.asked
    assert silent.mode is Mode.NONE
    fronts.room = True
    assert at(made, 60 + 0.9 * TRY_AGAIN_S, 1700.0, 24.0).reason == silent.reason
    assert fronts.asked == asked
    made.take_news()
    again = at(made, 61 + TRY_AGAIN_S, 1764.0, 24.0)
    assert (again.mode is Mode.NONE, again.source) == (False, Source.SOLVED)
    assert {news.text for news in made.take_news()} == {"A – B: solved", "B – C: solved"}
    asked = fronts.asked
    for second in range(12, 60):
        at(made, 60 + second, 1740.0 + 24.0 * second, 24.0)
    assert fronts.asked == asked


def test_a_search_that_failed_is_made_again_when_anything_is_told() -> None:
    elsewhere = Restriction(start_m=8900.0, end_m=8950.0, limit_mps=20.0)
    for tell in (
        lambda made: made.set_restrictions([elsewhere]),
        lambda made: made.set_targets([Target(stop="C", arrival_ns=ns(600))]),
        lambda made: made.set_conditions(Conditions()),
        lambda made: made.begin(LINE.stops, DUE),
    ):
        fronts = Flaky()
        fronts.room = False
        made = trip(fronts)
        assert at(made, 60, 1500.0, 24.0).mode is Mode.NONE
        fronts.room = True
        tell(made)
        assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED


def test_a_point_whose_search_failed_is_looked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    made = trip()
    with monkeypatch.context() as patch:
        patch.setattr(PassingFronts, "solve", broken)
        made.set_targets([Target(s_m=3500.0, earliest_ns=ns(230))])
        assert at(made, 60, 1500.0, 20.0).reason.startswith("least energy")
    assert any("target: solving failed (IndexError" in news.text for news in made.take_news())
    assert at(made, 61, 1520.0, 20.0).reason.startswith("least energy")
    assert at(made, 61 + TRY_AGAIN_S, 1720.0, 20.0).reason.startswith("pass km 3.5")


def test_a_section_that_cannot_be_driven_is_not_looked_for_again() -> None:
    class Never(Flaky):
        def find(self, section: Section) -> Found:
            self.asked += 1
            raise DasError("it cannot be driven")

    fronts = Never()
    made = trip(fronts)
    assert at(made, 60, 1500.0, 24.0).reason == "it cannot be driven"
    asked = fronts.asked
    made.set_targets([Target(stop="C", arrival_ns=ns(600))])
    assert at(made, 61 + TRY_AGAIN_S, 1764.0, 24.0).mode is Mode.NONE
    assert fronts.asked == asked


def test_a_search_for_the_section_before_is_given_up() -> None:
    """Nobody would take its answer, and the node would answer ever after as if it had just come."""
    fronts = HeldFronts()
    made = trip(fronts, background=True)
    try:
        when_solved(made, 299, 4990.0, 0.0)
        fronts.go.clear()
        made.set_restrictions([Restriction(start_m=1000.0, end_m=1200.0, limit_mps=20.0)])
        at(made, 300, 4999.0, 0.0)
        assert made.searching
        for second in range(301, 305):
            at(made, second, 5000.0, 0.0)
        assert made.advisor is not None
        assert made.advisor.index == 1
        fronts.go.set()
        when_solved(made, 305, 5000.0, 0.0)
        for _ in range(200):
            if not made.searching:
                break
            Event().wait(0.01)
            at(made, 305, 5000.0, 0.0)
        assert not made.searching
        assert not made.has_answer
    finally:
        fronts.go.set()
        made.close()


def test_a_point_that_was_passed_stays_passed_in_a_dropout() -> None:
    fronts = Flaky()
    made = trip(fronts)
    made.set_targets([Target(s_m=1000.0, earliest_ns=ns(20)), Target(s_m=3500.0, earliest_ns=ns(230))])
    before = at(made, 60, 1500.0, 20.0)
    assert before.reason.startswith("pass km 3.5")
    asked = fronts.asked
    assert made.update(ns(70)).mode is Mode.NONE
    assert at(made, 71, 1720.0, 20.0).reason.startswith("pass km 3.5")
    assert fronts.asked == asked


# --- other trains, loads, levels, conditions ---------------------------------------------------------------------


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
    made.set_position(PositionFix(time_ns=ns(60), s_m=1500.0, speed_mps=24.0))
    lossless = made.update(ns(60))
    assert made.advisor is not None
    assert made.advisor.current.section.level is Level.L0_REG
    assert lossless.energy_to_go_j < 0.9 * first.energy_to_go_j


def test_what_was_found_of_a_train_is_forgotten_with_it() -> None:
    made, fresh = trip(), trip()
    made.set_conditions(Conditions(mass_ratio=1.4))
    heavy = at(made, 60, 1500.0, 24.0).energy_to_go_j
    made.begin(LINE.stops, DUE)  # the same train: what was found holds
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


def test_conditions_the_train_could_not_drive_under_are_ignored_and_said() -> None:
    hill = Stretches(start_m=np.array([0.0, 300.0, 2700.0]), value=np.array([0.0, 0.03, 0.0]))
    made = Trip(Situation(route=replace(LINE, gradients_ratio=hill), vehicle=TRAIN), FRONTS, background=False)
    made.begin(LINE.stops, DUE)
    before = at(made, 60, 1500.0, 24.0)
    made.take_news()
    made.set_conditions(Conditions(mass_ratio=10.0))
    (news,) = (one for one in made.take_news() if one.bad)
    assert news.text.startswith("calibration ignored: ")
    assert at(made, 61, 1524.0, 24.0).energy_to_go_j < before.energy_to_go_j


def test_trains_are_found_by_id_and_load_and_stay_the_same_object() -> None:
    base = replace(TRAIN, id="ours", loads={"full": Load(mass_kg=1.4e5)})
    trains = Trains(base.loaded("full"), base, others=["re460-ic"])
    assert trains.find("ours") is base
    assert trains.find("ours", "full").mass_kg == trains.find("ours/full").mass_kg == 1.4e5
    assert trains.find("ours", "full") is trains.find("ours", "full")
    assert trains.find("re460-ic-igbt").id == "re460-ic-igbt"
    for vehicle_id, load, said in (("x", "", "knows ours, "), ("../x.toml", "", "knows"), ("ours", "half", "no load")):
        with pytest.raises(DasError, match=said):
            trains.find(vehicle_id, load)


def test_a_journey_that_cannot_be_driven_is_refused_and_the_one_before_goes_on() -> None:
    made = trip()
    at(made, 60, 1500.0, 24.0)
    with pytest.raises(DasError, match="not after the departure"):
        made.begin(LINE.stops, [DUE[0], Timetable(departure_ns=ns(330), arrival_ns=ns(330))])
    with pytest.raises(DasError, match="leads forwards"):
        made.begin([Stop(name="A", position_m=0.0), Stop(name="Z", position_m=1e6)], DUE[:1])
    assert at(made, 61, 1524.0, 24.0).mode is not Mode.NONE


# --- targets -----------------------------------------------------------------------------------------------------


def test_an_arrival_shifted_by_traffic_management_is_kept() -> None:
    for shift_s in (-20.0, 60.0):
        made = trip()
        made.set_targets([Target(stop="b", arrival_ns=ns(300 + shift_s), reason="platform")])
        advices = list(follow(made))
        at_b = next(a for a in advices if a.s_m > 4970 and a.speed_mps < 0.3)
        assert (at_b.time_ns - T0) * NS == pytest.approx(300 + shift_s, abs=8)
        assert advices[5].predicted_deviation_s == pytest.approx(0, abs=1)


def test_a_target_lifted_gives_the_timetable_back() -> None:
    made = trip()
    before = at(made, 60, 1500.0, 20.0)
    made.set_targets([Target(stop="B", arrival_ns=ns(320))])
    assert at(made, 60, 1500.0, 20.0).advised_speed_mps <= before.advised_speed_mps
    assert at(made, 60, 1500.0, 20.0).predicted_arrival_ns == pytest.approx(ns(320), abs=1e9)
    made.set_targets([])
    assert at(made, 60, 1500.0, 20.0).predicted_arrival_ns == pytest.approx(ns(300), abs=1e9)


@pytest.mark.parametrize("earliest_s", [205.0, 230.0, 280.0])
def test_a_point_is_never_passed_before_its_time(earliest_s: float) -> None:
    made = trip()
    made.set_targets([Target(s_m=3500.0, earliest_ns=ns(earliest_s), reason="signal")])
    advices = list(follow(made))
    passed = next(a for a in advices if a.s_m >= 3500.0)
    assert earliest_s <= (passed.time_ns - T0) * NS <= earliest_s + 8
    assert min(a.speed_mps for a in advices if 500 < a.s_m < 3500) > 5
    assert any("pass km 3.5 in" in a.reason and "signal" in a.reason for a in advices)
    at_b = next(a for a in advices if a.s_m > 4970 and a.speed_mps < 0.3)
    assert (at_b.time_ns - T0) * NS >= 298


def test_two_points_one_after_the_other_and_one_that_is_moved() -> None:
    made = trip()

    def tell(second: int, _: float) -> None:
        if second == 20:
            made.set_targets([Target(s_m=2000.0, earliest_ns=ns(160)), Target(s_m=4000.0, earliest_ns=ns(270))])
        if second == 60:
            made.set_targets([Target(s_m=2500.0, earliest_ns=ns(170)), Target(s_m=4000.0, earliest_ns=ns(270))])

    advices = list(follow(made, tell=tell))
    for at_m, earliest_s in ((2500.0, 170.0), (4000.0, 270.0)):
        passed = next(a for a in advices if a.s_m >= at_m)
        assert earliest_s <= (passed.time_ns - T0) * NS <= earliest_s + 8


def test_while_it_is_solved_for_a_moved_point_the_fronts_of_the_old_one_are_not_used() -> None:
    fronts = HeldFronts()
    made = trip(fronts, background=True)
    try:
        made.set_targets([Target(s_m=2000.0, earliest_ns=ns(160))])
        at(made, 60, 1000.0, 20.0)
        for _ in range(3000):
            if at(made, 60, 1000.0, 20.0).reason.startswith("pass km 2.0"):
                break
            Event().wait(0.01)
        fronts.go.clear()
        made.set_targets([Target(s_m=3000.0, earliest_ns=ns(200))])
        meanwhile = at(made, 60, 1000.0, 20.0)
        assert meanwhile.mode is not Mode.NONE
        assert meanwhile.reason.startswith("least energy")
    finally:
        fronts.go.set()
        made.close()


def test_a_point_with_time_to_spare_changes_nothing() -> None:
    made, plain = trip(), trip()
    made.set_targets([Target(s_m=3500.0, earliest_ns=ns(60), latest_ns=ns(290))])
    assert [a.advised_speed_mps for a in follow(made)] == [a.advised_speed_mps for a in follow(plain)]


def test_a_point_to_pass_sooner_is_passed_sooner() -> None:
    made, plain = trip(), trip()
    made.set_targets([Target(s_m=2500.0, latest_ns=ns(115))])

    def passes(which: Trip) -> float:
        return (next(a for a in follow(which) if a.s_m >= 2500.0).time_ns - T0) * NS

    assert passes(plain) > 125
    assert passes(made) <= 118


def test_a_window_that_cannot_be_kept_is_said() -> None:
    made = trip()
    made.set_targets([Target(s_m=2500.0, latest_ns=ns(80), reason="crossing")])
    advices = list(follow(made))
    passed_s = (next(a for a in advices if a.s_m >= 2500.0).time_ns - T0) * NS
    said = r"pass km 2\.5 as soon as possible, (\d+) s too late \(crossing\), .*"
    first = re.fullmatch(said, advices[1].reason)
    assert first is not None
    assert float(first[1]) == pytest.approx(passed_s - 80, abs=3)
    assert next(a for a in advices if a.s_m >= 2500.0).reason.startswith("least energy")


def test_a_train_told_far_too_late_to_be_slow_brakes_for_the_point() -> None:
    """400 m before it, at speed, with a minute and a half to spend: slower than any run of least energy."""
    made = trip()
    at(made, 100, 3000.0, 24.0)
    made.set_targets([Target(s_m=3400.0, earliest_ns=ns(190))])
    advices = list(follow(made, start_s=100, s_m=3000.0, v_mps=24.0))
    passed = next(a for a in advices if a.s_m >= 3400.0)
    assert 190 <= (passed.time_ns - T0) * NS <= 200


def test_targets_that_are_kept_to_are_said_once() -> None:
    made = trip()
    named = [Target(stop="B", arrival_ns=T0 + 300 * 10**9), Target(s_m=2500.0, earliest_ns=ns(80), reason="crossing")]
    many = [Target(s_m=2000.0 + i, latest_ns=ns(200)) for i in range(5)]
    for targets, said in (
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
        assert [news.text for news in made.take_news() if "target" in news.text] == said


def test_targets_off_the_journey_are_ignored_and_said() -> None:
    made = trip()
    made.take_news()
    bad = [
        Target(stop="Q", arrival_ns=ns(1)),
        Target(stop="B"),
        Target(s_m=-3.0, earliest_ns=ns(1)),
        Target(s_m=math.nan, earliest_ns=ns(1)),
        Target(s_m=800.0, earliest_ns=ns(9), latest_ns=ns(1)),
    ]
    made.set_targets(bad)
    said = [news.text for news in made.take_news() if news.bad]
    assert len(said) == len(bad)
    assert all(text.startswith("target ignored: ") for text in said)
    assert at(made, 60, 1500.0, 24.0).reason == "least energy on time"
    with pytest.raises(DasError, match="at most 100"):
        made.set_targets([Target()] * 101)


def test_a_passing_costs_what_the_planner_of_whole_journeys_says() -> None:
    """Second witness: das.solver.journey plans the same window from the start of the section."""
    section = build_section(LINE, TRAIN, end_m=5000.0)
    least_s = solve_front(section).fastest().time_s
    total_s, to_point_s = 1.35 * least_s, 0.63 * 1.35 * least_s
    fronts = PassingFronts.solve(
        section, 3000.0, onboard_ladder(section), to_point_s=to_point_s, total_s=total_s, s_m=0.0, v_mps=0.0
    )
    ours = fronts.trajectory(to_point_s, total_s, 0.0, 0.0, 0.02)
    points = (
        Call(name="A", position_m=0.0, departure=Window(earliest_s=0.0, latest_s=0.0)),
        Passing(name="P", position_m=3000.0, window=Window(earliest_s=to_point_s)),
        Call(name="B", position_m=5000.0, arrival=Window(latest_s=total_s)),
    )
    journey = Journey(id="j", name="j", source="j", points=points)
    theirs = JourneyPlanner(journey, LINE, TRAIN).plan()
    assert ours.feasible
    assert time_at(ours.trajectory, 3000.0) == pytest.approx(to_point_s, abs=0.05)
    assert ours.time_s == pytest.approx(total_s, abs=0.05)
    assert ours.ledger.input == pytest.approx(theirs.input_j, rel=2e-3)
    assert ours.ledger.residual_ratio < 1e-6


def test_a_window_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(DasError, match="latest time is before"):
        PassingTarget(s_m=1.0, earliest_ns=2, latest_ns=1)


# --- time --------------------------------------------------------------------------------------------------------


def test_far_too_much_time_is_not_crawled_away() -> None:
    ample = [(0, 3000), (3030, 3290)]
    made = trip(due=[Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in ample])
    first = at(made, 0, 0.0, 0.0)
    assert made.advisor is not None
    least_s = made.advisor.current.front.least_time_s(0.0, 0.0)
    run_s = (first.predicted_arrival_ns - T0) * NS
    assert run_s <= LONGEST_RATIO * least_s + 1
    assert first.predicted_deviation_s < -1000
    assert first.reason.endswith("early: wait at B")
    advices = [a for a in follow(made) if a.s_m < 4000]
    assert min(a.speed_mps for a in advices if a.s_m > 500) > 5


def test_a_long_stop_leaves_less_time_and_the_next_section_makes_up_for_it() -> None:
    made = trip()
    late = at(made, 350, 5000.0, 0.0)
    on_time = at(trip(), 330, 5000.0, 0.0)
    assert late.predicted_arrival_ns == pytest.approx(on_time.predicted_arrival_ns, abs=1e9)
    assert late.buffer_ratio < on_time.buffer_ratio
    hopeless = at(trip(), 500, 5000.0, 0.0)
    assert hopeless.reason.startswith("fastest, ")
    assert hopeless.predicted_deviation_s > 10


def test_the_next_section_is_ready_before_the_stop_and_those_far_off_are_let_go() -> None:
    made = trip()
    at(made, 60, 1500.0, 24.0)
    assert made.advisor is not None
    _, second = made.advisor.advisors
    assert len(second.front.lambda_w) > 10
    at(made, 400, 6000.0, 24.0)
    assert made.advisor.current is second


# --- tables ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made_tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    settings = TableSettings(buffers_percent=(0.0, 10.0))
    write_table(folder / "a-b", make_table(build_section(LINE, TRAIN, end_m=5000.0), settings))
    return folder


@pytest.fixture
def tables(made_tables: Path, tmp_path: Path) -> Path:
    shutil.copytree(made_tables, tmp_path / "tables")
    return tmp_path / "tables"


def test_a_table_answers_where_its_hash_matches(tables: Path) -> None:
    made = trip(Fronts(tables, threads=1))
    by_table, solved = at(made, 60, 1500.0, 24.0), at(trip(), 60, 1500.0, 24.0)
    assert by_table.source is Source.TABLE
    assert by_table.energy_to_go_j == pytest.approx(solved.energy_to_go_j, rel=5e-3)
    assert at(made, 400, 6000.0, 24.0).source is Source.SOLVED
    assert {news.text for news in made.take_news()} == {"A – B: from a table", "B – C: solved"}
    # A restriction makes another section of it; lifted, the table serves again.
    made = trip(Fronts(tables, threads=1))
    made.set_restrictions([Restriction(start_m=2000.0, end_m=2500.0, limit_mps=12.0)])
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert any("other line; solved instead" in news.text for news in made.take_news())
    made.set_restrictions([])
    assert at(made, 61, 1524.0, 24.0).source is Source.TABLE


def test_of_tables_for_other_trains_too_only_the_nearest_is_named(tables: Path) -> None:
    settings = TableSettings(buffers_percent=(0.0,))
    heavy = replace(train(1.3e5), id="heavy")
    write_table(tables / "a-b-heavy", make_table(build_section(LINE, heavy, end_m=5000.0), settings))
    made = trip(Fronts(tables, threads=1))
    made.set_restrictions([Restriction(start_m=2000.0, end_m=2500.0, limit_mps=12.0)])
    at(made, 60, 1500.0, 24.0)
    (said,) = (news.text for news in made.take_news() if news.bad)
    assert said == f"{tables / 'a-b'}: not the table of {made.advisor.current.section.name}: other line; solved instead"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-8])


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(bytes(content))


def other_schema(path: Path) -> None:
    path.write_text(path.read_text().replace('"schema_version": 1', '"schema_version": 99'))


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("value_j.npy", cut, "was it cut?; not used"),
        ("value_j.npy", alter, "was altered since it was written; solved instead"),
        ("grid.npy", alter, "grid.npy: was altered since it was written; solved instead"),
        ("manifest.json", alter, "altered since it was written; not used"),
        ("manifest.json", other_schema, "schema_version = 99: expected 1; not used"),
        ("run_s_m.npy", Path.unlink, "is missing; not used"),
    ],
)
def test_a_table_that_cannot_be_trusted_is_refused_and_solved_instead(
    tables: Path, name: str, damage: Any, said: str
) -> None:
    damage(tables / "a-b" / name)
    made = trip(Fronts(tables, threads=1))
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert any(news.bad and said in news.text for news in made.take_news())


def test_a_table_damaged_while_in_use_cannot_reach_the_advice(tables: Path) -> None:
    front = loaded_front(tables / "a-b", build_section(LINE, TRAIN, end_m=5000.0))
    before = front.trajectory(300.0).ledger.input
    for path in (tables / "a-b").glob("*.npy"):
        with path.open("r+b") as file:
            file.truncate(100)
    assert front.trajectory(300.0).ledger.input == before


def test_fronts_are_kept_up_to_a_size_the_last_one_always() -> None:
    fronts = Fronts(threads=1, kept_bytes=1)
    sections = [build_section(LINE, TRAIN, end_m=end_m) for end_m in (5000.0, 4000.0)]
    first = fronts.find(sections[0])
    assert fronts.find(build_section(LINE, TRAIN, end_m=5000.0)) is first
    fronts.find(sections[1])
    assert fronts.find(sections[0]) is not first


def test_no_folder_of_tables_is_an_error() -> None:
    with pytest.raises(DasError, match="no such folder of tables"):
        Fronts(Path("/nowhere"))
