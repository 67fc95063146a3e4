"""What counts as announced: a change of one kind, to one speed, at one time."""

from __future__ import annotations

from das.advice.advice import Instruction
from das.advice.coach.announcing import Notices
from das.advice.regimes import InstructionKind, Regime
from das.domain.units import KMH, NS

LEAST_S = 8.0


def brake(to_kmh: float, in_s: float) -> Instruction:
    return Instruction(mode=Regime.FULL_BRAKE, speed_mps=to_kmh * KMH, effort_ratio=-1.0, in_s=in_s)


def ns(second: float) -> int:
    return round(second / NS)


def announced(*announcements: tuple[Instruction, ...]) -> Notices:
    """What is known after one announcement a second."""
    notices = Notices(LEAST_S)
    for second, following in enumerate(announcements):
        notices.note(following, ns(second))
    return notices


def test_a_brake_to_a_limit_does_not_announce_the_brake_to_the_stop() -> None:
    notices = announced(*((brake(60.0, 10.0 - k),) for k in range(10)))
    assert notices.lacks_s(brake(60.0, 0.0), ns(9), 1.0) == 0.0
    assert notices.lacks_s(brake(55.0, 0.0), ns(9), 1.0) == 0.0, "a step of the display is the same change"
    assert notices.lacks_s(brake(0.0, 0.0), ns(9), 1.0) == LEAST_S - 1.0
    holds = Instruction(mode=Regime.CRUISE, speed_mps=60.0 * KMH)
    assert notices.lacks_s(holds, ns(9), 1.0) == LEAST_S - 1.0


def test_two_changes_of_a_kind_are_announced_each_for_itself() -> None:
    notices = announced(*((brake(60.0, 10.0 - k), brake(0.0, 14.0 - k)) for k in range(9)))
    assert notices.lacks_s(brake(0.0, 0.0), ns(8), 6.0) == 0.0
    assert notices.due_in_s(InstructionKind.BRAKE, ns(8)) == 2.0


def test_an_announcement_that_moves_by_much_or_was_dropped_is_a_new_one() -> None:
    moved = announced(*((brake(60.0, 30.0 - k),) for k in range(9)), (brake(60.0, 5.0),))
    assert moved.lacks_s(brake(60.0, 0.0), ns(9), 5.0) == LEAST_S - 5.0
    dropped = announced(*((brake(60.0, 30.0 - k),) for k in range(9)), (), (brake(60.0, 20.0),))
    assert dropped.lacks_s(brake(60.0, 0.0), ns(10), 0.0) == LEAST_S
