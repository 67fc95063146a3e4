"""While fronts are looked for: what holds meanwhile, what of searches that fail or come too late."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest

from das.advice.advice import Advice, Source
from das.advice.passing import PassingFronts
from das.advice.regimes import Regime
from das.cab.fronts import Found, Fronts
from das.cab.heard import Target
from das.cab.preparation import TRY_AGAIN_S
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.solver.section import Section
from tests.support.small_trips import DUE, LINE, SmallTrip, at, broken, highest, ns, trip


class HeldFronts(Fronts):
    """Fronts that come when they are let."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.go = Event()
        self.go.set()

    def find(self, section: Section, s_m: float | None = None) -> Found:
        assert self.go.wait(30)
        return super().find(section, s_m)


def when_solved(made: SmallTrip, second: float, s_m: float, v_mps: float) -> Advice:
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
        assert (advice.source, advice.mode) == (Source.FALLBACK, Regime.FULL_TRACTION)
        assert advice.reason == "solving: the fastest safe run"
        assert max(speed for _, speed in highest(advice)) <= 30.0 + 1e-9
    finally:
        fronts.go.set()
        made.close()


def test_a_search_that_fails_withdraws_with_the_reason() -> None:
    class Broken(Fronts):
        def find(self, section: Section, s_m: float | None = None) -> Found:
            raise MemoryError("no room")

    advice = at(trip(Broken()), 60, 1500.0, 24.0)
    assert (advice.mode, advice.reason) == (Regime.NONE, "solving failed (MemoryError: no room)")


class Flaky(Fronts):
    """Fronts that come as long as there is room."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.room, self.asked = True, 0

    def find(self, section: Section, s_m: float | None = None) -> Found:
        self.asked += 1
        if not self.room:
            raise MemoryError("no room")
        return super().find(section, s_m)


def test_a_search_that_failed_is_made_again_after_a_while() -> None:
    fronts = Flaky()
    fronts.room = False
    made = trip(fronts)
    silent, asked = at(made, 60, 1500.0, 24.0), fronts.asked
    assert silent.mode is Regime.NONE
    fronts.room = True
    assert at(made, 60 + 0.9 * TRY_AGAIN_S, 1700.0, 24.0).reason == silent.reason
    assert fronts.asked == asked
    made.take_news()
    again = at(made, 61 + TRY_AGAIN_S, 1764.0, 24.0)
    assert (again.mode is Regime.NONE, again.source) == (False, Source.SOLVED)
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
        assert at(made, 60, 1500.0, 24.0).mode is Regime.NONE
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
        def find(self, section: Section, s_m: float | None = None) -> Found:
            self.asked += 1
            raise DasError("it cannot be driven")

    fronts = Never()
    made = trip(fronts)
    assert at(made, 60, 1500.0, 24.0).reason == "it cannot be driven"
    asked = fronts.asked
    made.set_targets([Target(stop="C", arrival_ns=ns(600))])
    assert at(made, 61 + TRY_AGAIN_S, 1764.0, 24.0).mode is Regime.NONE
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
        assert made.legs.index == 1
        fronts.go.set()
        when_solved(made, 305, 5000.0, 0.0)
        for _ in range(200):
            if not made.searching:
                break
            Event().wait(0.01)
            at(made, 305, 5000.0, 0.0)
        assert not made.searching
        assert not made.preparation.has_answer
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
    assert made.update(ns(70)).mode is Regime.NONE
    assert at(made, 71, 1720.0, 20.0).reason.startswith("pass km 3.5")
    assert fronts.asked == asked


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
        assert meanwhile.mode is not Regime.NONE
        assert meanwhile.reason.startswith("least energy")
    finally:
        fronts.go.set()
        made.close()
