"""The guard: which messages are ignored and why, which publisher counts, and moderation of complaints."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from das.cab.guard import MOST_RESTRICTIONS, MOST_STOPS, Guard, Publishers, described
from das.cab.heard import JourneyHeard, RestrictionsHeard, Target, TargetsHeard, ToldRestriction
from das.cab.outputs import MOST_A_SECOND, Moderation
from das.domain.journey import OrderedStop
from das.domain.restriction import LONGEST_TEXT

S = 10**9
NOW_NS = 1_800_000_000 * S


def test_moderation_lets_few_through_and_counts_those_held_back() -> None:
    moderation = Moderation()
    assert sum(moderation.allows(NOW_NS + i) for i in range(1_000)) == MOST_A_SECOND
    assert moderation.take_suppressed(NOW_NS + 2_000) == 0
    assert moderation.take_suppressed(NOW_NS + 2 * S) == 1_000 - MOST_A_SECOND
    assert moderation.take_suppressed(NOW_NS + 2 * S) == 0
    assert moderation.allows(NOW_NS - 100 * S)  # the clock was put back


def test_a_second_publisher_of_the_position_is_not_heard_until_the_first_is_silent() -> None:
    publishers = Publishers()
    assert publishers.counts("a", NOW_NS)
    assert publishers.contested(NOW_NS) is None
    assert not publishers.counts("b", NOW_NS + S)
    assert publishers.counts("a", NOW_NS + 2 * S)
    assert publishers.contested(NOW_NS + 2 * S) == "a and b"
    assert publishers.contested(NOW_NS + 4 * S + 1) is None  # the rival has gone
    assert not publishers.counts("b", NOW_NS + 5 * S)  # the first was heard at 2 s
    assert publishers.counts("b", NOW_NS + 5 * S + 1)  # now it has gone
    assert publishers.contested(NOW_NS + 5 * S + 1) is None


def journey(time_ns: int, now_ns: int, stops: int = 2, name: str = "A") -> JourneyHeard:
    stop = OrderedStop(name, 0.0)
    return JourneyHeard(time_ns=time_ns, heard_ns=now_ns, route_id="x", vehicle_id="x", stops=(stop,) * stops)


def restrictions(time_ns: int, now_ns: int, *numbers: tuple[float, ...]) -> RestrictionsHeard:
    them = tuple(ToldRestriction(*one) for one in numbers)  # type: ignore[arg-type]
    return RestrictionsHeard(time_ns=time_ns, heard_ns=now_ns, restrictions=them)


def test_replayed_future_and_oversized_journeys_are_ignored_with_the_reason() -> None:
    guard = Guard()
    assert guard.problem(journey(NOW_NS, NOW_NS)) == ""
    assert guard.problem(journey(NOW_NS, NOW_NS)) == ""  # the bus repeats it to a node that comes back
    assert "10 s older than the last was ignored" in guard.problem(journey(NOW_NS - 10 * S, NOW_NS))
    assert "ahead of the clock was ignored" in guard.problem(journey(2**63 - 1, NOW_NS))
    assert "100000 stops" in guard.problem(journey(NOW_NS + S, NOW_NS, stops=100_000))
    assert "a name of 1000000 letters" in guard.problem(journey(NOW_NS + S, NOW_NS, name="x" * 10**6))
    assert guard.problem(journey(NOW_NS + S, NOW_NS, MOST_STOPS, "x" * LONGEST_TEXT)) == ""
    targets = TargetsHeard(time_ns=1, targets=(Target(),) * 101)
    assert guard.problem(targets) == "target: one of 101 targets, more than 100 was ignored"


def test_messages_ahead_of_a_wrong_clock_are_taken_when_the_clock_is_right() -> None:
    guard, wrong_ns = Guard(), NOW_NS - 3600 * S
    early = [journey(NOW_NS, wrong_ns), restrictions(NOW_NS, wrong_ns, (0.0, 1.0, 5.0))]
    assert all("3600 s ahead of the clock" in guard.problem(one) for one in early)
    assert guard.due(wrong_ns) == []
    assert "3600 s ahead" in str(guard.unheeded)
    assert guard.due(NOW_NS) == early
    assert [guard.problem(replace(one, heard_ns=NOW_NS)) for one in early] == ["", ""]
    assert guard.unheeded is None
    assert guard.due(NOW_NS) == []
    guard.problem(journey(NOW_NS + 3600 * S, NOW_NS))
    guard.problem(journey(NOW_NS + S, NOW_NS))  # the newest counts
    assert guard.due(NOW_NS + 3600 * S) == []


def test_restrictions_older_than_the_last_are_a_replay_or_an_operator_whose_clock_went_back() -> None:
    """Nobody can tell which: the same list is only ignored, a different one withdraws the advice."""
    guard, here, there = Guard(), (0.0, 1.0, 5.0), (2.0, 3.0, 5.0)
    assert guard.problem(restrictions(NOW_NS, NOW_NS, here)) == ""
    assert "10 s older than the last" in guard.problem(restrictions(NOW_NS - 10 * S, NOW_NS, here))
    assert guard.unheeded is None
    assert guard.problem(restrictions(NOW_NS - 10 * S, NOW_NS, here, there))
    assert "one 10 s older than the last, which said otherwise" in str(guard.unheeded)
    assert guard.problem(restrictions(NOW_NS + S, NOW_NS, there)) == ""
    assert guard.unheeded is None


def test_restrictions_nobody_can_heed_withdraw_the_advice_until_there_are_others() -> None:
    guard, nan = Guard(), float("nan")
    assert guard.problem(restrictions(NOW_NS, NOW_NS, (0.0, 1.0, 5.0))) == ""
    assert guard.unheeded is None
    wrongs = [(0.0, 1.0, nan), (0.0, nan, 5.0), (1.0, 0.0, 5.0), (0.0, 1.0, 0.0), (0.0, float("inf"), 1.0)]
    for wrong in wrongs:
        assert guard.problem(restrictions(NOW_NS, NOW_NS, wrong))
        assert "one of" in str(guard.unheeded)
    many = [(0.0, 1.0, 5.0)] * (MOST_RESTRICTIONS + 1)
    problem = guard.problem(restrictions(NOW_NS, NOW_NS, *many))
    assert f"{MOST_RESTRICTIONS + 1} of them, more than {MOST_RESTRICTIONS}" in problem
    assert guard.problem(restrictions(NOW_NS - S, NOW_NS, *many[:3]))  # a replay does not lift the distrust
    assert guard.unheeded
    assert guard.problem(restrictions(NOW_NS + S, NOW_NS, *many[:3])) == ""
    assert guard.unheeded is None
    assert guard.problem(restrictions(NOW_NS + 3600 * S, NOW_NS))
    assert "3600 s ahead of the clock" in str(guard.unheeded)


def test_an_impossible_window_withdraws_the_advice_and_another_window_makes_another_list() -> None:
    guard, place = Guard(), (0.0, 1.0, 5.0)
    assert guard.problem(restrictions(NOW_NS, NOW_NS, (*place, 9, 3)))
    assert guard.unheeded == "one of 5 m/s from 0 to 1 m, valid from 9 to 3 ns"
    assert guard.problem(restrictions(NOW_NS + S, NOW_NS, (*place, 3, 9))) == ""
    assert guard.problem(restrictions(NOW_NS, NOW_NS, (*place, 3, 10)))
    assert "said otherwise" in str(guard.unheeded)


def test_a_restriction_refused_for_its_text_is_described_with_its_length() -> None:
    @dataclass(frozen=True, order=True)
    class Named(ToldRestriction):
        reason: str = field(default="", compare=False)

    one = Named(0.0, 1.0, 5.0, reason="x" * 201)
    assert described(one) == "one of 5 m/s from 0 to 1 m, reason of 201 letters"
