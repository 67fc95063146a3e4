"""Searches for fronts: the advice meanwhile, and searches that fail or come too late."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from threading import Event

import numpy as np
import pytest

from das.advice.advice import Advice, Source
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.advice.wording import words
from das.cab.heard import Target
from das.cab.preparation import TRY_AGAIN_S, Fronts
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.solver.front import Front
from das.solver.section import Section
from tests.support.small_trips import DUE, LINE, SmallTrip, at, broken, highest, ns, trip


class HeldFronts(Fronts):
    """Fronts that are found while `go` is set."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.go = Event()
        self.go.set()

    def find(self, section: Section, s_m: float | None = None) -> Front:
        assert self.go.wait(30)
        return super().find(section, s_m)


Held = tuple[HeldFronts, SmallTrip]


@pytest.fixture
def held() -> Iterator[Held]:
    """Held fronts, and a trip that searches for them in the background."""
    fronts = HeldFronts()
    made = trip(fronts, background=True)
    yield fronts, made
    fronts.go.set()
    made.close()


def when(made: SmallTrip, wanted: Callable[[Advice], bool], second: float, s_m: float, v_mps: float) -> Advice:
    """The first advice that is wanted, at one moment of the trip."""
    for _ in range(3000):
        advice = at(made, second, s_m, v_mps)
        if wanted(advice):
            return advice
        Event().wait(0.01)
    return pytest.fail("never came")


def when_solved(made: SmallTrip, second: float, s_m: float, v_mps: float) -> Advice:
    return when(made, lambda advice: advice.source is not Source.FALLBACK, second, s_m, v_mps)


def test_meanwhile_the_plan_of_before_holds_below_what_is_new(held: Held) -> None:
    fronts, made = held
    before = when_solved(made, 60, 1500.0, 24.0)
    fronts.go.clear()
    one = Restriction(start_m=2000.0, end_m=2600.0, limit_mps=12.0)
    made.set_restrictions([one])
    advice = at(made, 60, 1500.0, 24.0)
    assert advice.source is Source.FALLBACK
    assert advice.reason.code is ReasonCode.AS_BEFORE
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
    assert words(after.reason).startswith("least energy")


def test_with_no_plan_before_it_advises_the_fastest_safe_run(held: Held) -> None:
    fronts, made = held
    fronts.go.clear()
    advice = at(made, 60, 1500.0, 24.0)
    assert (advice.source, advice.mode) == (Source.FALLBACK, Regime.FULL_TRACTION)
    assert advice.reason.code is ReasonCode.FASTEST_SAFE
    assert max(speed for _, speed in highest(advice)) <= 30.0 + 1e-9


def test_a_search_that_fails_withdraws_with_the_reason() -> None:
    advice = at(trip(Flaky(room=False)), 60, 1500.0, 24.0)
    assert (advice.mode, advice.reason.text) == (Regime.NONE, "solving failed (MemoryError: no room)")


def test_ctrl_c_in_compiled_code_is_no_failure_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python turns it into a SystemError that it caused."""

    def interrupted(*_: object) -> None:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(Fronts, "find", interrupted)
    with pytest.raises(KeyboardInterrupt):
        at(trip(), 60, 1500.0, 24.0)


class Flaky(Fronts):
    """Fronts that are found while there is `room`; `asked` counts the searches."""

    def __init__(self, *, room: bool = True) -> None:
        super().__init__(threads=1)
        self.room, self.asked = room, 0

    def find(self, section: Section, s_m: float | None = None) -> Front:
        self.asked += 1
        if not self.room:
            raise MemoryError("no room")
        return super().find(section, s_m)


def test_a_search_that_failed_is_repeated_after_a_while() -> None:
    fronts = Flaky(room=False)
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


ELSEWHERE = Restriction(start_m=8900.0, end_m=8950.0, limit_mps=20.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda made: made.set_restrictions([ELSEWHERE]),
        lambda made: made.set_targets([Target(stop="C", arrival_ns=ns(600))]),
        lambda made: made.set_conditions(Conditions()),
        lambda made: made.begin(LINE.stops, DUE),
    ],
)
def test_a_search_that_failed_is_repeated_after_any_change(change: Callable[[SmallTrip], None]) -> None:
    fronts = Flaky(room=False)
    made = trip(fronts)
    assert at(made, 60, 1500.0, 24.0).mode is Regime.NONE
    fronts.room = True
    change(made)
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED


def test_a_failed_search_for_a_point_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    made = trip()
    with monkeypatch.context() as patch:
        patch.setattr(Fronts, "find_guide", broken)
        made.set_targets([Target(s_m=3500.0, earliest_ns=ns(230))])
        assert words(at(made, 60, 1500.0, 20.0).reason).startswith("least energy")
    assert any("target: solving failed (IndexError" in news.text for news in made.take_news())
    assert words(at(made, 61, 1520.0, 20.0).reason).startswith("least energy")
    assert words(at(made, 61 + TRY_AGAIN_S, 1720.0, 20.0).reason).startswith("km 3.5")


def test_a_section_that_cannot_be_driven_is_not_searched_again() -> None:
    class Never(Flaky):
        def find(self, section: Section, s_m: float | None = None) -> Front:
            self.asked += 1
            raise DasError("it cannot be driven")

    fronts = Never()
    made = trip(fronts)
    assert at(made, 60, 1500.0, 24.0).reason.text == "it cannot be driven"
    asked = fronts.asked
    made.set_targets([Target(stop="C", arrival_ns=ns(600))])
    assert at(made, 61 + TRY_AGAIN_S, 1764.0, 24.0).mode is Regime.NONE
    assert fronts.asked == asked


def test_a_search_for_the_section_before_is_given_up(held: Held) -> None:
    """Nobody would take its answer, and the node would go on as if it had just come."""
    fronts, made = held
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
    when(made, lambda _: not made.searching, 305, 5000.0, 0.0)
    assert not made.preparation.has_answer


def test_a_point_that_was_passed_stays_passed_in_a_dropout() -> None:
    fronts = Flaky()
    made = trip(fronts)
    made.set_targets([Target(s_m=1000.0, earliest_ns=ns(20)), Target(s_m=3500.0, earliest_ns=ns(230))])
    before = at(made, 60, 1500.0, 20.0)
    assert words(before.reason).startswith("km 3.5")
    asked = fronts.asked
    assert made.update(ns(70)).mode is Regime.NONE
    assert words(at(made, 71, 1720.0, 20.0).reason).startswith("km 3.5")
    assert fronts.asked == asked


def test_a_moved_point_is_served_at_once(held: tuple[HeldFronts, SmallTrip]) -> None:
    """The policies of a section serve every point on it."""
    fronts, made = held
    made.set_targets([Target(s_m=2000.0, earliest_ns=ns(160))])
    when(made, lambda advice: words(advice.reason).startswith("km 2.0"), 60, 1000.0, 20.0)
    fronts.go.clear()
    made.set_targets([Target(s_m=3000.0, earliest_ns=ns(200))])
    meanwhile = at(made, 60, 1000.0, 20.0)
    assert words(meanwhile.reason).startswith("km 3.0")
