"""The keeper: it keeps a reference until there is a reason for another one, and states the reason and the gain."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from typing import Any, ParamSpec, TypeVar

import pytest

from das.advice.advice import Replan, ReplanCause
from das.advice.goal import Goal, PassingTarget, SpeedsAllowed, TrainState
from das.advice.guide import keeping
from das.advice.guide.keeping import EARLY_S, LATE_S, Changes, Keeper, Kept
from das.advice.guide.planning import Wanted, planned
from das.advice.guide.showing import Showing
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.solver.guide.policies import GuideFront
from das.solver.guide.references import NEAR_S
from das.solver.section import build_section
from tests.support.bundled_sections import BUNDLED, Which, guide_of, section_of
from tests.support.crossing import few
from tests.support.keeping import Keeping, departed, goal_of, keeper_of, ns, started, stood, sure, waiting

LINE = BUNDLED[2]
"""17 km, the middle section of Zürich–Luzern."""
BUFFER = 0.15
P = ParamSpec("P")
T = TypeVar("T")


def driven(
    keeper: Keeper, train: Keeping, goal: Goal, seconds: range, *, behind_s: float = 0.0
) -> list[tuple[int, Kept]]:
    """The references that are made while a train drives some time behind its reference, and when."""
    found: list[tuple[int, Kept]] = []
    for second in seconds:
        before = keeper.reference
        kept = keeper.keep(train.at(second, behind_s=behind_s), goal)
        assert kept is not None
        if kept.reference is not before:
            found.append((second, kept))
    return found


def ridden(keeper: Keeper, train: Keeping, goal: Goal, seconds: range, point_m: float) -> tuple[list[Replan], float]:
    """The new references of a train that keeps each of them until it passes a point, and when it passes it (s)."""
    replans: list[Replan] = []
    for second in seconds:
        state, before = train.at(second), keeper.reference
        if state.s_m >= point_m:
            return replans, second - (state.s_m - point_m) / state.v_mps
        kept = keeper.keep(state, goal)
        assert kept is not None
        if kept.reference is not before:
            replans.append(kept.reference.replan)
            train = Keeping(kept.forecast, second)
    return pytest.fail("the point was never passed")


@pytest.mark.parametrize("which", few(BUNDLED, BUNDLED[:2], pytest.mark.slow))
def test_who_keeps_exactly_to_the_reference_gets_no_other(which: Which) -> None:
    """Over the whole section the forecast arrival changes by less than half a second."""
    goal = goal_of(which, BUFFER)
    keeper, kept, train = started(which, goal)
    assert kept.reference.replan.cause is ReplanCause.START
    for second in range(6, int(train.end_s) - 2):
        here = keeper.keep(train.at(second), goal)
        assert here is not None
        assert here.reference is kept.reference, (second, here.reference.replan)
        assert here.late_s == pytest.approx(kept.late_s, abs=0.5)


@pytest.mark.parametrize(("departs_s", "anew"), [(1, False), (18, True)])
def test_what_a_standing_train_was_told_holds_if_it_departs_on_time(departs_s: int, *, anew: bool) -> None:
    """A train that departs late gets another reference at once; the card of a punctual departure is what follows it."""
    goal, start_m = goal_of(LINE, BUFFER), section_of(LINE).start_m
    keeper = waiting(LINE, goal)
    standing = stood(keeper, LINE, goal)
    later = keeper.keep(TrainState(ns(departs_s - 1), start_m, 0.0), goal)
    moving = keeper.keep(TrainState(ns(departs_s), start_m + 1.0, 1.0), goal)
    after = keeper.keep(TrainState(ns(departs_s + 1), start_m + 2.5, 2.0), goal)
    assert later is not None
    assert moving is not None
    assert after is not None
    assert later.reference is standing.reference
    assert (moving.reference is not standing.reference) is anew
    assert after.reference is moving.reference
    assert moving.reference.replan.cause is ReplanCause.START
    assert moving.reference.replan.time_ns == ns(departs_s if anew else 0)
    assert moving.late_s < 3.0


@pytest.mark.parametrize("behind_s", [7.0, 9.0, 12.0])
def test_who_is_late_gets_one_other_reference_which_says_what_it_gains(behind_s: float) -> None:
    """It regains most of the time without being early itself; kept, it gets no third one.

    At 6 s, whole steps of speed leave no reference that gains enough and is not early itself.
    """
    goal = goal_of(LINE, BUFFER)
    keeper, first, train = started(LINE, goal)
    assert not driven(keeper, train, goal, range(6, 100))
    made = driven(keeper, train, goal, range(100, 101), behind_s=behind_s)
    assert [(second, kept.reference.replan.cause) for second, kept in made] == [(100, ReplanCause.LATE)]
    kept = made[0][1]
    replan = kept.reference.replan
    assert replan.time_ns == ns(100)
    assert -EARLY_S < kept.late_s < LATE_S, "it is not in doubt itself"
    assert 0.5 * behind_s <= replan.gain_s <= behind_s + 1.0
    assert replan.gain_j < 0.0  # Faster driving costs energy.
    assert kept.reference.lambda_w > first.reference.lambda_w
    again = Keeping(kept.forecast, 100.0)
    assert not driven(keeper, again, goal, range(101, int(again.end_s) - 2))


def test_a_new_reference_made_in_doubt_changes_no_instruction_for_10_s() -> None:
    """Shown side by side with the old one; one made for the same state with no regard to the old one changes it now."""
    goal, free = goal_of(LINE, BUFFER), SpeedsAllowed(math.inf, math.inf)
    keeper, old, train = started(LINE, goal)
    now_s = 115  # The next phase is more than 10 s ahead.
    assert not driven(keeper, train, goal, range(6, now_s))
    behind_s, showings = 12.0, (Showing(), Showing(), Showing())
    for second in range(now_s - 20, now_s):  # What was shown before is the same.
        state = train.at(second, behind_s=behind_s)
        before = old._replace(forecast=old.reference.schedule.forecast(state.s_m, state.v_mps))
        for showing in showings:
            showing.show(before, state, free)
    begin = train.at(now_s, behind_s=behind_s)
    ((_, new),) = driven(keeper, train, goal, range(now_s, now_s + 1), behind_s=behind_s)
    assert new.reference.replan.cause is ReplanCause.LATE
    wanted = Wanted(s_m=begin.s_m, v_mps=begin.v_mps, left_s=goal.aimed_s(begin.now_ns))
    hasty = replace(new.reference, schedule=planned(guide_of(LINE), wanted).schedule)
    differs: list[list[int]] = [[], []]
    for second in range(now_s, now_s + 40):
        state = Keeping(new.forecast, float(now_s)).at(second)
        shown = [
            showing.show(Kept(one, one.schedule.forecast(state.s_m, state.v_mps), 0.0), state, free).now
            for showing, one in zip(showings, (old.reference, new.reference, hasty), strict=True)
        ]
        told = [(one.mode, round(one.speed_mps, 3), one.effort_ratio, one.in_s) for one in shown]
        for found, other in zip(differs, told[1:], strict=True):
            if repr(other) != repr(told[0]):
                found.append(second)
    assert now_s + 8 <= differs[0][0] < now_s + 25, "an acceleration is shown 2 s before it is due"
    assert differs[1][0] < now_s + 8


def test_a_driver_who_is_known_to_lose_time_gets_another_reference_all_the_same() -> None:
    """It is quicker by the time he is likely to lose; that it is therefore early on paper is no reason against it."""
    goal = goal_of(LINE, BUFFER)
    keeper, _, train = started(LINE, goal)
    ((_, kept),) = driven(keeper, train, goal, range(100, 110), behind_s=8.0)
    assert kept.reference.replan.cause is ReplanCause.LATE
    assert kept.reference.replan.gain_s > 4.0
    assert kept.late_s < NEAR_S


def test_who_is_late_by_less_than_the_stated_seconds_keeps_his_reference() -> None:
    goal = goal_of(LINE, BUFFER)
    keeper, _, train = started(LINE, goal)
    assert not driven(keeper, train, goal, range(6, 300), behind_s=LATE_S - 1.5)


def test_who_is_early_by_far_gets_a_slower_reference_that_saves_energy() -> None:
    goal = goal_of(LINE, BUFFER)
    keeper, _, train = started(LINE, goal)
    assert not driven(keeper, train, goal, range(6, 100))
    ((_, kept),) = driven(keeper, train, goal, range(100, 101), behind_s=-25.0)
    replan = kept.reference.replan
    assert replan.cause is ReplanCause.EARLY
    assert replan.gain_s > 10.0
    assert replan.gain_j > guide_of(LINE).change_j(kept.reference.lambda_w)


def test_a_reference_is_not_doubted_just_after_the_instruction_has_changed() -> None:
    """The train is 25 s early, but a driver is not told two things at once."""
    goal = goal_of(LINE, BUFFER)
    keeper, kept, train = started(LINE, goal)
    assert not driven(keeper, train, goal, range(6, 100))
    for second in range(100, 110):
        here = keeper.keep(train.at(second, behind_s=-25.0), goal, changes=Changes(last_ns=ns(100)))
        assert here is not None
        assert here.reference is kept.reference
    later = keeper.keep(train.at(110, behind_s=-25.0), goal, changes=Changes(last_ns=ns(100)))
    assert later is not None
    assert later.reference.replan.cause is ReplanCause.EARLY


def test_a_reference_is_not_doubted_just_before_the_next_change() -> None:
    """What was announced comes as announced; then the early train gets its new reference."""
    goal = goal_of(LINE, BUFFER)
    keeper, kept, train = started(LINE, goal)
    assert not driven(keeper, train, goal, range(6, 100))
    due = Changes(next_ns=ns(107.5))
    for second in range(100, 108):
        here = keeper.keep(train.at(second, behind_s=-25.0), goal, changes=due)
        assert here is not None
        assert here.reference is kept.reference
    later = keeper.keep(train.at(108, behind_s=-25.0), goal, changes=due)
    assert later is not None
    assert later.reference.replan.cause is ReplanCause.EARLY


def test_a_reference_is_not_doubted_before_it_is_20_s_old() -> None:
    """The train is 30 s late at once, but the outer loop has a period of at least 20 s: a driver looks and reacts."""
    goal = goal_of(LINE, BUFFER)
    keeper, kept, train = started(LINE, goal)
    assert kept.reference.replan.time_ns == ns(5)
    ((second, later),) = driven(keeper, train, goal, range(6, 50), behind_s=30.0)
    assert (second, later.reference.replan.cause) == (25, ReplanCause.LATE)


def test_a_train_that_cannot_be_earlier_keeps_its_reference_and_is_rarely_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The train is hopelessly late: only the fastest run gains 3 s, in its last braking; no reference can do so."""
    goal, asked = goal_of(LINE, -0.2), []
    keeper, _, train = started(LINE, goal)
    monkeypatch.setattr("das.advice.guide.keeping.planned", lambda *args: asked.append(args) or planned(*args))
    assert not driven(keeper, train, goal, range(6, 200))
    assert len(asked) <= 6, "once in 30 s, of 194 s"


@pytest.mark.parametrize("by_s", [-40.0, 60.0])
def test_another_arrival_makes_another_reference_at_once(by_s: float) -> None:
    goal = goal_of(LINE, BUFFER)
    keeper, first, train = started(LINE, goal)
    other = replace(goal, target_ns=goal.arrival_ns + round(by_s / NS))
    ((_, kept),) = driven(keeper, train, other, range(8, 9))
    assert kept.reference.replan.cause is ReplanCause.GOAL
    assert kept.reference.replan.gain_s > 0.5 * abs(by_s)
    assert kept.reference.arrival_ns == other.arrival_ns
    assert (kept.reference.lambda_w < first.reference.lambda_w) == (by_s > 0)
    assert not driven(keeper, train, other, range(9, 12))


def test_a_restriction_makes_another_reference_which_keeps_to_it() -> None:
    """Until the front of the changed line is ready, the new keeper keeps the old reference below the new limits."""
    goal = goal_of(LINE, BUFFER)
    keeper, _, train = started(LINE, goal)
    free = section_of(LINE)
    one = Restriction(start_m=free.start_m + 9000.0, end_m=free.start_m + 9500.0, limit_mps=12.0)
    route = free.route.with_restrictions((one,))
    section = build_section(route, free.vehicle, start_m=free.start_m, end_m=free.end_m)
    meanwhile, after = sure(section, None), sure(section, GuideFront(section))
    meanwhile.take_over(keeper)
    old = meanwhile.keep(train.at(50), goal)
    assert old is not None
    assert old.reference.replan.cause is ReplanCause.START
    inside = (section.node_m > one.start_m + 1.0) & (section.node_m < one.end_m)
    assert old.forecast.speeds_mps[inside].max() <= 12.0 + 1e-9
    after.take_over(meanwhile)
    new = after.keep(train.at(51), goal)
    assert new is not None
    assert new.reference.replan.cause is ReplanCause.LINE
    assert new.forecast.speeds_mps[inside].max() <= 12.0 + 1e-9
    assert abs(new.late_s) < abs(old.late_s)
    assert not driven(after, Keeping(new.forecast, 51.0), goal, range(52, 200))


class PatientWorker(Executor):
    """A worker that does its work only when the test calls `finish`."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Callable[[], Any], Future[Any]]] = []

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        answer: Future[T] = Future()
        self.waiting.append((partial(fn, *args, **kwargs), answer))
        return answer

    def finish(self) -> None:
        """Do all work that has not been cancelled."""
        for work, answer in self.waiting:
            if answer.set_running_or_notify_cancel():
                answer.set_result(work())
        self.waiting.clear()


def test_while_a_reference_is_being_made_the_one_before_stands() -> None:
    worker, goal = PatientWorker(), goal_of(LINE, BUFFER)
    keeper = sure(section_of(LINE), guide_of(LINE), worker)
    start = TrainState(0, section_of(LINE).start_m, 0.0)
    assert keeper.keep(start, goal) is None
    assert keeper.keep(start, goal) is None
    assert len(worker.waiting) == 1
    worker.finish()
    first = keeper.keep(start, goal)
    assert first is not None
    again = keeper.keep(start, goal)
    assert again is not None
    assert again.reference is first.reference
    train = Keeping(first.forecast, 0.0)
    keeper.keep(train.at(5), goal)
    worker.finish()
    standing = keeper.keep(train.at(6), goal)
    other, another = (replace(goal, target_ns=goal.arrival_ns + ns(later_s)) for later_s in (20.0, 40.0))
    for one, second in ((other, 50), (other, 51), (another, 52)):
        kept = keeper.keep(train.at(second), one)
        assert standing is not None
        assert kept is not None
        assert kept.reference is standing.reference
    assert len(worker.waiting) == 2
    worker.finish()
    later = keeper.keep(train.at(58), another)
    assert later is not None
    assert later.reference.replan.cause is ReplanCause.GOAL
    assert later.reference.arrival_ns == another.arrival_ns
    here = train.at(58)
    again = later.reference.schedule.forecast(here.s_m, here.v_mps)
    assert later.forecast.time_s == pytest.approx(again.time_s, abs=1e-9)


def test_a_reference_asked_for_before_the_line_changed_is_not_made_any_more() -> None:
    """The worker makes one after the other: the one for the new limits does not wait for a useless one."""
    worker, start = PatientWorker(), TrainState(0, section_of(LINE).start_m, 0.0)
    keeper, after = (sure(section_of(LINE), guide_of(LINE), worker) for _ in range(2))
    assert keeper.keep(start, goal_of(LINE, BUFFER)) is None
    after.take_over(keeper)
    assert [answer.cancelled() for _, answer in worker.waiting] == [True]


def test_a_reference_made_in_doubt_waits_for_a_change_that_came_meanwhile() -> None:
    """It was asked for before the instruction changed, and is ready just after."""
    worker, goal = PatientWorker(), goal_of(LINE, BUFFER)
    keeper = sure(section_of(LINE), guide_of(LINE), worker)
    start = TrainState(0, section_of(LINE).start_m, 0.0)
    keeper.keep(start, goal)
    worker.finish()
    first = keeper.keep(start, goal)
    assert first is not None
    train = Keeping(first.forecast, 0.0)
    keeper.keep(train.at(5), goal)
    worker.finish()
    moving = keeper.keep(train.at(6), goal)
    assert moving is not None
    train = Keeping(moving.forecast, 6.0)
    keeper.keep(train.at(100, behind_s=-25.0), goal)
    assert len(worker.waiting) == 1
    worker.finish()
    for second, cause in ((101, ReplanCause.START), (109, ReplanCause.START), (110, ReplanCause.EARLY)):
        kept = keeper.keep(train.at(second, behind_s=-25.0), goal, changes=Changes(last_ns=ns(100)))
        assert kept is not None
        assert kept.reference.replan.cause is cause


def test_a_reference_that_could_not_be_made_in_the_background_is_asked_for_again() -> None:
    worker, goal = PatientWorker(), goal_of(LINE, BUFFER)
    keeper = sure(section_of(LINE), guide_of(LINE), worker)
    assert keeper.keep(TrainState(0, section_of(LINE).start_m, 0.0), goal) is None
    worker.waiting.pop()[1].set_exception(DasError("no way"))
    with pytest.raises(DasError, match="no way"):
        keeper.keep(TrainState(0, section_of(LINE).start_m, 0.0), goal)
    assert keeper.keep(TrainState(0, section_of(LINE).start_m, 0.0), goal) is None
    worker.finish()
    assert keeper.keep(TrainState(0, section_of(LINE).start_m, 0.0), goal) is not None


@pytest.mark.slow
@pytest.mark.parametrize(("earlier_s", "later_s"), [(40.0, None), (25.0, 60.0), (None, -6.0)])
def test_the_window_of_a_point_is_kept_to_with_a_margin(earlier_s: float | None, later_s: float | None) -> None:
    """The window counts from when the train would pass without one; keeping the reference, it gets no other one."""
    goal = goal_of(LINE, BUFFER)
    keeper, kept, train = started(LINE, goal, loses=True)
    point_m, here = section_of(LINE).start_m + 9000.0, train.at(60)
    free_s = 60.0 + kept.reference.schedule.forecast(here.s_m, here.v_mps).passes_s(point_m)
    earliest_ns, latest_ns = (None if x is None else ns(free_s + x) for x in (earlier_s, later_s))
    point = PassingTarget(s_m=point_m, earliest_ns=earliest_ns, latest_ns=latest_ns)
    new = keeper.keep(here, replace(goal, passing=point))
    assert new is not None
    assert new.reference.replan.cause is ReplanCause.POINT
    at_ns = ns(60.0 + new.forecast.passes_s(point_m))
    assert earliest_ns is None or at_ns >= earliest_ns
    assert latest_ns is None or at_ns <= latest_ns - round(5.0 / NS)
    following = Keeping(new.forecast, 60.0)
    replans, passed_s = ridden(keeper, following, replace(goal, passing=point), range(61, 1000), point_m)
    assert all(one.gain_s > 1.0 for one in replans if one.cause in (ReplanCause.LATE, ReplanCause.EARLY))
    assert [one.cause for one in replans].count(ReplanCause.POINT) <= 1
    assert len(replans) <= (passed_s - 60.0) / 45.0
    assert earliest_ns is None or ns(passed_s) >= earliest_ns
    assert latest_ns is None or ns(passed_s) <= latest_ns


def test_the_margins_to_a_window_are_quantiles_of_the_loss_up_to_the_point() -> None:
    """By hand: nobody brakes in the first minutes, so L s are lost in L min, with the standard deviation 2·√L s.

    The 90 % quantiles are 1.2816 σ from L; a driver who hardly gains time is not held back.
    """
    start_m = section_of(LINE).start_m
    for minutes, least_s, most_s in ((1.0, 1.0 - 2.5632, 1.0 + 2.5632), (9.0, 0.0, 9.0 + 1.2816 * 6.0)):
        window = PassingTarget(
            s_m=start_m + 1000.0, earliest_ns=ns(60.0 * minutes), latest_ns=ns(60.0 * minutes + 90.0)
        )
        goal = replace(goal_of(LINE, BUFFER), passing=window)
        wanted = keeper_of(LINE, loses=True)._wanted(TrainState(ns(0), start_m, 0.0), goal)
        assert wanted.window.earliest_s == pytest.approx(60.0 * minutes - least_s, abs=1e-3)
        assert wanted.window.latest_s == pytest.approx(60.0 * minutes + 90.0 - most_s, abs=1e-3)


def test_who_would_miss_the_window_gets_another_reference() -> None:
    """The train is half a minute ahead of a reference that passes a point just after its earliest time."""
    goal = goal_of(LINE, BUFFER)
    keeper, kept, train = started(LINE, goal)
    here, point_m = train.at(60), section_of(LINE).start_m + 9000.0
    free_s = 60.0 + kept.reference.schedule.forecast(here.s_m, here.v_mps).passes_s(point_m)
    goal = replace(goal, passing=PassingTarget(s_m=point_m, earliest_ns=ns(free_s + 20.0)))
    new = keeper.keep(here, goal)
    assert new is not None
    following = Keeping(new.forecast, 60.0)
    ((_, other),) = driven(keeper, following, goal, range(110, 111), behind_s=-20.0)
    assert other.reference.replan.cause is ReplanCause.POINT


@pytest.mark.parametrize(
    ("change_s", "away_mps", "cause"),
    [(0.0, 4.0, ReplanCause.ENERGY), (100.0, 4.0, ReplanCause.START), (0.0, -4.0, ReplanCause.START)],
)
def test_who_is_far_off_the_speed_gets_another_reference_only_where_that_saves_enough(
    monkeypatch: pytest.MonkeyPatch, change_s: float, away_mps: float, cause: ReplanCause
) -> None:
    """The train is 4 m/s off its speed but nearly on time; for a slow train a new reference would need more energy."""
    monkeypatch.setattr(keeping, "LEAST_GAIN_S", 30.0)
    monkeypatch.setattr(keeping, "LATE_S", 60.0)
    monkeypatch.setattr(keeping, "EARLY_S", 60.0)
    goal = goal_of(LINE, BUFFER)
    keeper, _, train = started(LINE, goal)
    front = GuideFront(section_of(LINE))
    monkeypatch.setattr(front, "change_j", lambda lambda_w: change_s * front.power_w)
    monkeypatch.setattr(keeper, "_front", front)
    for second in range(60, 400, 20):
        state = train.at(second)
        kept = keeper.keep(state._replace(v_mps=max(state.v_mps + away_mps, 1.0)), goal)
        assert kept is not None
        if kept.reference.replan.cause is not ReplanCause.START:
            break
    assert kept.reference.replan.cause is cause


def test_without_a_front_there_is_no_reference_and_after_forgetting_it_starts_anew() -> None:
    goal, start_m = goal_of(LINE, BUFFER), section_of(LINE).start_m
    assert sure(section_of(LINE), None).keep(TrainState(ns(0), start_m, 0.0), goal) is None
    keeper, _, train = started(LINE, goal)
    keeper.forget()
    assert keeper.reference is None
    ((_, kept),) = driven(keeper, train, goal, range(30, 31))
    assert kept.reference.replan.cause is ReplanCause.START


@pytest.mark.slow
def test_the_same_inputs_give_the_same_references() -> None:
    goal, found = goal_of(LINE, BUFFER), []
    for _ in range(2):
        keeper = keeper_of(LINE)
        _, train = departed(keeper, LINE, goal)
        made = driven(keeper, train, goal, range(100, 160), behind_s=8.0)
        found.append([(second, kept.reference.replan, kept.reference.schedule.phases) for second, kept in made])
    assert found[0] == found[1] != []
