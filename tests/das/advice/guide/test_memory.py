"""What counts as announced: a change of one kind, to one speed, at about one time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.advice.advice import Instruction
from das.advice.guide.memory import Memory, alike, brake, coast, hold, is_own_end, repeats, traction
from das.advice.regimes import Regime
from das.domain.units import KMH
from das.solver.kernels.guide_policy import STANDS_S
from tests.support.keeping import ns


def announced(*second_by_second: tuple[Instruction, ...]) -> Memory:
    """The memory after one announcement a second."""
    memory = Memory()
    for second, following in enumerate(second_by_second):
        memory = replace(memory, announced=memory.noted(following, ns(second)))
    return memory


def due(one: Instruction, in_s: float) -> Instruction:
    return replace(one, in_s=in_s)


def test_a_brake_to_a_limit_does_not_announce_the_brake_to_the_stop_nor_to_another_speed() -> None:
    memory = announced(*((due(brake(0.8, 60 * KMH), 10.0 - k),) for k in range(10)))
    assert memory.lacks_s(brake(0.5, 60 * KMH), ns(9), 1.0) == 0.0
    for other in (brake(0.8, 0.0), brake(0.8, 55 * KMH), hold(60 * KMH)):
        assert memory.lacks_s(other, ns(9), 1.0) == STANDS_S - 1.0


def test_to_coast_is_one_change_to_whatever_speed() -> None:
    memory = announced(*((due(coast(80 * KMH), 9.0 - k),) for k in range(9)))
    assert memory.lacks_s(coast(70 * KMH), ns(8), 1.0) == 0.0


def test_the_time_until_it_is_due_counts_as_announced() -> None:
    memory = announced((due(coast(80 * KMH), 5.0),))
    assert memory.lacks_s(coast(80 * KMH), ns(0), 5.0) == STANDS_S - 5.0
    assert memory.lacks_s(coast(80 * KMH), ns(3), 5.0) == 0.0


def test_an_announcement_that_moves_by_much_or_was_dropped_counts_anew() -> None:
    moved = announced(*((due(brake(0.8, 0.0), 30.0 - k),) for k in range(9)), (due(brake(0.8, 0.0), 5.0),))
    assert moved.lacks_s(brake(0.8, 0.0), ns(9), 5.0) == STANDS_S - 5.0
    drifts = announced(*((due(brake(0.8, 0.0), 30.0 - 3.0 * k),) for k in range(9)))
    assert drifts.lacks_s(brake(0.8, 0.0), ns(8), 6.0) == 0.0
    dropped = announced(*((due(coast(25.0), 30.0 - k),) for k in range(9)), (), (due(coast(25.0), 20.0),))
    assert dropped.lacks_s(coast(25.0), ns(10), 0.0) == STANDS_S


def test_an_announcement_that_ends_because_its_change_is_due_has_not_been_dropped() -> None:
    memory = announced(*((due(coast(25.0), 9.0 - k),) for k in range(9)), (), ())
    assert memory.lacks_s(coast(25.0), ns(10), 0.0) == 0.0


@pytest.mark.parametrize(
    ("one", "before", "said"),
    [
        (hold(20.0), hold(20.2), True),
        (hold(20.0), hold(20.5), False),
        (traction(0.4, 20.0), traction(0.8, 20.0), False),
        (brake(0.4, 20.0), brake(0.8, 20.0), True),
        (hold(20.0), coast(20.0), False),
    ],
)
def test_an_instruction_repeats_another_with_the_same_kind_speed_and_traction(
    one: Instruction, before: Instruction, said: bool
) -> None:
    assert repeats(one, before) is said


def test_only_a_hold_of_its_speed_is_the_end_of_an_instruction() -> None:
    assert is_own_end(hold(20.0), traction(1.0, 20.0))
    assert not is_own_end(hold(20.0), traction(1.0, 21.0))
    assert not is_own_end(coast(20.0), traction(1.0, 20.0))
    assert not alike(Instruction(), Instruction()), "nothing is no instruction"


def test_the_mode_of_an_instruction_follows_from_its_effort() -> None:
    assert [traction(share, 20.0).mode for share in (0.6, 1.0)] == [Regime.REDUCED_TRACTION, Regime.FULL_TRACTION]
    modes = [brake(effort, 20.0).mode for effort in (0.6, 1.0, 1.5)]
    assert modes == [Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE]
